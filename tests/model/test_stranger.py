"""Logs and models of unknown origin: no file outside their folder is written, no file outside them is read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

import ffsm_mj
from ffsm_mj.cli.main import main
from ffsm_mj.errors import InputError, LogError
from ffsm_mj.log import scenario as log_scenario
from ffsm_mj.log.mcap.reader import read_log
from ffsm_mj.log.rerun.sink import write_recording
from ffsm_mj.log.scenario import compile_log
from tests.scenes import two_balls

PNG = b"\x89PNG\r\n\x1a\nof the reader"
EVIL_NAMES = [
    "/tmp/evil.xml",
    "../evil.xml",
    "a/../../evil.xml",
    "C:\\evil.xml",
    "a\\..\\evil.xml",
    "a\nb.xml",
    "",
    "./a.xml",
]


@pytest.fixture(scope="module")
def log(tmp_path_factory) -> Path:
    """The log of an unmodified run."""
    folder = tmp_path_factory.mktemp("honest")
    ffsm_mj.run(two_balls(folder, duration_s=0.01), out=folder / "run", rerun=False)
    return folder / "run" / "run.mcap"


def forged(log: Path, path: Path, files: dict[str, bytes], scenario: dict[str, str] | None = None) -> Path:
    """The log with added or replaced attachments and a changed scenario."""
    with log.open("rb") as source, path.open("wb") as stream:
        reader, writer = make_reader(source), Writer(stream)
        writer.start(profile="", library="stranger")
        for record in reader.iter_metadata():
            writer.add_metadata(record.name, record.metadata)
        carried = {attachment.name: attachment.data for attachment in reader.iter_attachments()}
        for old, new in (scenario or {}).items():
            assert old in carried["scenario.yaml"].decode()
            carried["scenario.yaml"] = carried["scenario.yaml"].replace(old.encode(), new.encode())
        for name, content in (carried | files).items():
            writer.add_attachment(create_time=0, log_time=0, name=name, media_type="", data=content)
        numbers: dict[int, int] = {}
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            if channel.id not in numbers:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                numbers[channel.id] = writer.register_channel(channel.topic, "protobuf", number, channel.metadata)
            writer.add_message(numbers[channel.id], message.log_time, message.data, message.publish_time)
        writer.finish()
    return path


def tree(folder: Path) -> set[Path]:
    return set(folder.rglob("*"))


def one_line(capsys: Any) -> str:
    (line,) = capsys.readouterr().err.splitlines()
    return str(line)


# --- what is written --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", EVIL_NAMES)
@pytest.mark.parametrize("command", [["analyze", "--plots", "p"], ["export", "--gif"], ["export", "--csv"], ["analyze"]])
def test_names_outside_the_folder_are_refused_before_anything_is_written(tmp_path, log, capsys, monkeypatch, name, command):
    inner = tmp_path / "a" / "b"
    inner.mkdir(parents=True)
    monkeypatch.chdir(inner)
    path = forged(log, inner / "evil.mcap", {name: b"<mujoco/>"})
    before = tree(tmp_path)
    assert main([command[0], str(path), *command[1:]]) == 2
    line = one_line(capsys)
    assert line.startswith(f"{path}: the attachment ")
    assert "not a plain relative path" in line
    assert tree(tmp_path) - {inner / "p"} == before  # the folder that the user named
    assert not Path("/tmp/evil.xml").exists()


def test_a_log_is_compiled_without_touching_the_disk(log, monkeypatch):
    import tempfile

    def refuse(*_: Any, **__: Any) -> None:
        raise AssertionError("something is written")

    for name in ("mkdtemp", "TemporaryDirectory", "NamedTemporaryFile"):
        monkeypatch.setattr(tempfile, name, refuse)
    monkeypatch.setattr(Path, "write_bytes", refuse)
    monkeypatch.setattr(Path, "mkdir", refuse)
    assert compile_log(read_log(log)).names("body") == ("robot/ball", "target/target")


def test_mujoco_leaves_no_file_of_warnings(tmp_path, log, monkeypatch, capfd):
    """For a model whose options are not those of the scene, MuJoCo would write MUJOCO_LOG.TXT in the current folder."""
    head = '<option cone="elliptic" tolerance="1e-3" gravity="0 0 0"/><size nkey="2"/>'
    path = forged(log, tmp_path / "log.mcap", {"mjcf/target/target.xml": BALL.format(head=head).encode()})
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    (note,) = compile_log(read_log(path)).notes
    assert note.endswith(": tolerance, cone")
    assert tree(tmp_path / "here") == set()
    assert capfd.readouterr() == ("", "")


def test_unrelated_attachments_are_harmless(tmp_path, log):
    path = forged(log, tmp_path / "more.mcap", {"notes.txt": b"hello", "mjcf/robot/other.xml": b"not even XML"})
    assert compile_log(read_log(path)).names("geom") == ("robot/ball", "target/target")
    write_recording(read_log(path), tmp_path / "made.rrd")


# --- what is read -----------------------------------------------------------------------------------------------------

BALL = """<mujoco><option gravity="0 0 0"/>{head}<worldbody><body name="ball"><freejoint name="free"/>
<geom name="ball" size="0.1" mass="1"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize(
    "head",
    [
        '<asset><texture name="t" type="2d" file="{secret}"/></asset>',
        '<asset><texture name="t" type="cube" fileup="{secret}"/></asset>',
        '<compiler texturedir="{folder}"/><asset><texture name="t" type="2d" file="secret.png"/></asset>',
        '<compiler assetdir="{folder}"/><asset><hfield name="h" size="1 1 1 1" file="secret.png"/></asset>',
        '<asset><mesh name="m" file="{relative}"/></asset>',
        '<asset><mesh name="m" file="x/../{relative}"/></asset>',
        '<asset><skin name="m" file="{secret}"/></asset>',
        '<asset><model name="m" file="{secret}"/></asset>',
        '<include file="{secret}"/>',
        '<Include file="{secret}"/>',
        '<include file="{relative}"/>',
        '<asset><texture name="t" type="2d" file="file://{secret}"/></asset>',
        '<extension><plugin plugin="mujoco.sdf.nut"/></extension>',
    ],
)
def test_a_log_cannot_refer_to_files_outside_it(tmp_path, log, monkeypatch, head):
    reader = tmp_path / "reader"
    reader.mkdir()
    monkeypatch.chdir(reader)
    secret = tmp_path / "secret.png"
    secret.write_bytes(PNG)
    text = head.format(secret=secret, folder=tmp_path, relative="../secret.png")
    forgery = forged(log, reader / "log.mcap", {"mjcf/target/target.xml": BALL.format(head=text).encode()})

    def untouched(*_: Any, **__: Any) -> None:
        raise AssertionError("MuJoCo is given the model")

    monkeypatch.setattr(log_scenario, "compile_system", untouched)
    with pytest.raises(InputError) as refused:
        compile_log(read_log(forgery), "log log.mcap")
    (line,) = refused.value.lines
    assert line.startswith("log log.mcap: mjcf/target/target.xml:1: ")


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"mjcf/robot/robot.xml": "mjcf/robot/absent.xml"}, "log x: mjcf/robot/absent.xml is not in the log"),
        (
            {"mjcf/robot/robot.xml": "/etc/passwd"},
            "log x: the model of robot is '/etc/passwd', which is not below mjcf/robot/",
        ),
        ({"mjcf/robot/robot.xml": "mjcf/robot/../../x.xml"}, "log x: mjcf/robot/../../x.xml is not in the log"),
        (
            {"time_step_s:": "time_step:"},
            "not a scenario of this version, 'time_step_s' is missing",
        ),
        ({"time_step_s: 0.001": "time_step_s: .nan"}, "(time_step_s: Input should be a finite number)"),
        ({"view_rate_hz: 50.0": "view_rate_hz: [1]"}, "(log.view_rate_hz: Input should be a valid number)"),
    ],
)
def test_scenarios_of_unknown_origin_are_validated(tmp_path, log, change, expected):
    path = forged(log, tmp_path / "log.mcap", {}, scenario=change)
    with pytest.raises(InputError) as refused:
        compile_log(read_log(path), "log x")
    assert expected in refused.value.lines[0]


def test_a_log_without_scenario_is_refused(tmp_path, log):
    path = forged(log, tmp_path / "log.mcap", {"scenario.yaml": b""})
    with pytest.raises(InputError, match="the log: contains no scenario"):
        compile_log(read_log(path))
    with pytest.raises(LogError, match="not a plain relative path"):
        read_log(forged(log, tmp_path / "long.mcap", {"n" * 513: b""}))


def test_faults_of_a_model_in_a_log_name_the_log_and_the_line(tmp_path, log):
    path = forged(log, tmp_path / "log.mcap", {"mjcf/robot/robot.xml": b"<mujoco>\n<worldbodi/></mujoco>"})
    with pytest.raises(InputError) as refused:
        compile_log(read_log(path), f"log {path}")
    assert refused.value.lines == (
        f"log {path}: mjcf/robot/robot.xml: XML Error: Schema violation: unrecognized element Element 'worldbodi', line 2",
    )
