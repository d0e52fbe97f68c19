"""Possibly hostile logs with valid checksums and changed content: one line with the file, or a correct verdict."""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from random import Random

import pytest
from mcap.records import Attachment, Channel, Message
from zstandard import ZstdError

import ffsm_mj
from ffsm_mj.cli.main import main
from ffsm_mj.contact_models.impact.records import IMPACT
from ffsm_mj.log.mcap.format import decode_record, encode_record
from tests.hostile.log_mutations import log, mutate_log, records
from tests.scenes import two_balls


@pytest.fixture(scope="module")
def hit(tmp_path_factory):
    """A log of 21 samples with one impact."""
    folder = tmp_path_factory.mktemp("hit")
    ffsm_mj.run(two_balls(folder, gap=0.01, duration_s=0.02), out=folder / "out", rerun=False)
    return ffsm_mj.load_run(folder / "out")


def changed(hit, path, change):
    """The log with a change to its records, written anew."""
    path.write_bytes(log([found for record in records(hit.path.read_bytes()) for found in change(record)]))
    return str(path)


def test_an_impact_whose_normal_is_no_vector(hit, tmp_path, capsys):
    (impact,) = hit.impacts
    whole, short = (encode_record(replace(impact, normal=normal)) for normal in (impact.normal, (1.0,)))

    def change(record):
        yield replace(record, data=short) if isinstance(record, Message) and record.data == whole else record

    path = changed(hit, tmp_path / "x.mcap", change)
    assert main(["analyze", path]) == 2
    expected = f"{path}: not of this version's format (normal of impact has 1 values, not 3)\n"
    assert capsys.readouterr().err == expected
    assert decode_record(IMPACT, whole) == impact


@pytest.mark.parametrize("field", ["momentum_before", "energy_after_J"])
def test_an_impact_without_its_totals(hit, tmp_path, capsys, field):
    (impact,) = hit.impacts
    whole, short = (encode_record(record) for record in (impact, replace(impact, **{field: {}})))
    path = changed(
        hit,
        tmp_path / "x.mcap",
        lambda record: [replace(record, data=short) if getattr(record, "data", b"") == whole else record],
    )
    assert main(["analyze", path]) == 2
    assert f"{field}.total of impact has 0 values" in capsys.readouterr().err


def test_a_log_with_a_damaged_chunk_can_be_mutated_again(hit):
    data = bytearray(hit.path.read_bytes())
    at = data.index(b"\x28\xb5\x2f\xfd") + 4  # behind the magic number of Zstandard
    data[at : at + 8] = bytes(8)
    with pytest.raises(ZstdError):
        records(bytes(data))
    assert all(isinstance(mutate_log(Random(seed), bytes(data)), bytes) for seed in range(8))


def test_a_scenario_that_is_no_text(hit, tmp_path, capsys):
    def change(record):
        scenario = isinstance(record, Attachment) and record.name == "scenario.yaml"
        yield replace(record, data=b"name: \xff") if scenario else record

    path = changed(hit, tmp_path / "x.mcap", change)
    assert main(["analyze", path]) == 2
    assert capsys.readouterr().err == f"{path}: its attachment scenario.yaml is not UTF-8 (byte 6)\n"


@pytest.mark.parametrize(("command", "code"), [("analyze", (1, 2, 4)), ("export", (2,))])
@pytest.mark.parametrize("content", [b"", b"3", b"robot: 3", b"!!bool maybe", b"a: \x7f", b"&a [*a]"])
def test_a_log_without_its_scenario(hit, tmp_path, capsys, command, code, content):
    def change(record):
        scenario = isinstance(record, Attachment) and record.name == "scenario.yaml"
        yield replace(record, data=content) if scenario else record

    path = changed(hit, tmp_path / "x.mcap", change)
    assert main([command, path, *(["--gif"] if command == "export" else [])]) in code
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) <= 1
    assert all(line.startswith(f"log {path}: ") for line in lines if command == "export")


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("free_components_total", ""),
        ("free_components_robot", "1 1 1 1 1 nan"),
        ("task_axes", "x w"),
        ("task_target_m", "1"),
        ("orbit_rate_rad_s", "0 0 x"),
        ("orbit_rate_rad_s", "0 1"),
        ("terminal_stack_momentum_N_m_s", "x"),
        ("terminal_base_rate_rad_s", "-1"),
        ("model", ""),
        ("model", "[1.0]"),
        ("model", '{"a": {"b": {"mass_kg": NaN}}}'),
        ("controller_model", '{"a": {"b": {"mass_kg": "7"}}}'),
        ("controller_model", "{" + '"a":{' * 6 + "}" * 7),
        ("controller_model", '{"a":' * 100_000),
    ],
)
def test_metadata_that_are_no_numbers(hit, tmp_path, capsys, name, text):
    def change(record):
        facts = isinstance(record, Channel) and "conservative" in record.metadata
        yield replace(record, metadata=record.metadata | {name: text}) if facts else record

    path = changed(hit, tmp_path / "x.mcap", change)
    assert main(["analyze", path]) == 2
    assert capsys.readouterr().err.startswith(f"{path}: its metadata entry {name} is {text!r}; ")


def test_a_number_that_is_not_finite_is_null_in_json(hit, tmp_path, capsys):
    """Infinity in a sample is told by the verdict, and is no reason for a traceback or for JSON that nobody reads."""
    samples = 0

    def change(record):
        nonlocal samples
        if isinstance(record, Message) and len(record.data) > 500:
            samples += 1
            if samples == 5:
                at = record.data.index(struct.pack("<d", 0.004)) + 9  # the coordinate behind the time
                record = replace(record, data=record.data[:at] + struct.pack("<d", float("inf")) + record.data[at + 8 :])
        yield record

    path = changed(hit, tmp_path / "x.mcap", change)
    assert main(["analyze", path, "--json"]) in (1, 4)
    found = capsys.readouterr()
    assert json.loads(found.out, parse_constant=pytest.fail)["complete"]
    assert found.err == ""


EVIL = "\x1b]0;owned\x07\x1b[31m\u202e\u2066$script ${x} $$\nall 99 checks pass\r"


def test_what_a_log_says_does_not_steer_the_terminal(hit, tmp_path, capsys):
    """Colours, titles, bidirectional marks and line ends in names, messages and facts: escaped wherever they are printed."""

    def change(record):
        if isinstance(record, Channel) and "conservative" in record.metadata:
            odd = {"scenario": EVIL, "phases": EVIL, "conservative": "false", "not_conservative": EVIL}
            record = replace(record, metadata=record.metadata | odd)
        yield record

    path = changed(hit, tmp_path / "x.mcap", change)
    assert main(["analyze", path]) in (0, 1)
    assert main(["export", path, "--csv", "--table", EVIL]) == 2
    captured = capsys.readouterr()
    assert (captured.out + captured.err).replace("\n", "").isprintable()
    assert [line for line in captured.out.splitlines() if line.startswith("all 99 checks pass")] == []


@pytest.mark.parametrize("name", ["time_step_s", "control_period_s"])
@pytest.mark.parametrize("text", ["None", "", "nan", "-1", "inf", "0"])
def test_a_step_that_is_none(hit, tmp_path, capsys, name, text):
    def change(record):
        facts = isinstance(record, Channel) and "conservative" in record.metadata
        yield replace(record, metadata=record.metadata | {name: text}) if facts else record

    path = changed(hit, tmp_path / "x.mcap", change)
    assert main(["analyze", path]) == 2
    assert (
        capsys.readouterr().err
        == f"{path}: its metadata entry {name} is {text!r}; a positive number of seconds is allowed\n"
    )


@pytest.mark.parametrize("arguments", ["analyze", "export --csv", "export --html", "view"])
def test_whatever_a_log_makes_go_wrong_is_one_line(hit, tmp_path, capsys, monkeypatch, arguments):
    """Also what nobody has foreseen, here a reader that breaks down."""

    def broken(*_):
        raise ZeroDivisionError("float\ndivision")

    path = changed(hit, tmp_path / "x.mcap", lambda record: [record])
    monkeypatch.setattr("ffsm_mj.analysis.run.read_log", broken)
    monkeypatch.setenv("DISPLAY", ":0")  # no viewer is opened: the log is refused before
    command, *options = arguments.split()
    assert main([command, path, *options]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "x.mcap: cannot be used (ZeroDivisionError: float division (test_logs.py:" in captured.err
    assert captured.err.count("\n") == 1


def _dollars(record):
    """Names that Matplotlib would take for mathematics: of models, pairs, phases and the scenario."""
    if isinstance(record, Attachment):
        for name in (b'name="ball"', b'name="robot"', b'name="other"'):
            record = replace(record, data=record.data.replace(name, name[:-1] + b'$x${y}$$"'))
    if isinstance(record, Channel) and "conservative" in record.metadata:
        record = replace(record, metadata=record.metadata | {"scenario": "$a$ ${b} $$"})
    if isinstance(record, Message) and b"approach" in record.data:
        record = replace(record, data=record.data.replace(b"approach", b"$a$ {b$$"))
    yield record


def _doubles(*values):
    """A sample whose coordinates and what follows are these."""

    def change(record):
        at = record.data.find(struct.pack("<d", 0.004)) if isinstance(record, Message) and len(record.data) > 500 else -1
        if at >= 0:
            data = bytearray(record.data)
            for i in range(30):
                data[at + 9 * (i + 1) : at + 9 * (i + 1) + 8] = struct.pack("<d", values[i % len(values)])
            record = replace(record, data=bytes(data))
        yield record

    return change


@pytest.mark.long
@pytest.mark.parametrize(
    "change", [_dollars, _doubles(float("nan")), _doubles(float("inf"), 1e308), _doubles(-1e308, 5e-324)]
)
@pytest.mark.parametrize("arguments", ["export --html", "analyze --plots", "export --gif"])
def test_what_is_drawn_of_odd_names_and_numbers(hit, tmp_path, capfd, change, arguments):
    path = changed(hit, tmp_path / "x.mcap", change)
    command, form = arguments.split()
    options = [str(tmp_path / "figures")] if form == "--plots" else ["--fps", "1"] if form == "--gif" else []
    code = main([command, path, form, *options])
    said = capfd.readouterr().err
    assert "cannot be used" not in said
    assert code in (0, 1, 4) or said.count("\n") == 1
