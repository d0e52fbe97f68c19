"""Logs with records of unknown kinds, of another version, or with inconsistent content."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass, replace

import numpy as np
import pytest
from mcap.records import Channel, Message, Schema

import ffsm_mj
from ffsm_mj.cli.main import main
from ffsm_mj.contact_models import registry as contact_models
from ffsm_mj.errors import LogError
from ffsm_mj.log.mcap.format import decode_record, encode_record
from ffsm_mj.records import kinds as register_of_kinds
from ffsm_mj.records.kinds import register
from ffsm_mj.records.record import declared
from tests.hostile.log_mutations import log, records
from tests.log.grips import FIRST, GRIP, LAST, recorded


def test_a_log_with_an_unknown_kind_of_record_is_read_with_a_note(plain_run, tmp_path, capsys, monkeypatch):
    known = dict(register_of_kinds._KNOWN)
    monkeypatch.setattr(register_of_kinds, "_KNOWN", dict(known))
    register(GRIP)
    recorded(plain_run, tmp_path / "out", FIRST, LAST)
    monkeypatch.setattr(register_of_kinds, "_KNOWN", known)
    read = ffsm_mj.load_run(tmp_path / "out")
    assert read.note == "/ffsm/grip: not read, no such kind of record is known here"
    assert (read.impacts, read.damage, "grips" in read.records) == (plain_run.impacts, "", False)
    np.testing.assert_array_equal(read.log.rows, plain_run.log.rows)
    assert main(["analyze", str(tmp_path / "out")]) == 0
    assert f"\nnote: {read.note}\n" in capsys.readouterr().out
    assert main(["analyze", str(tmp_path / "out"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["note"] == read.note
    assert main(["export", str(tmp_path / "out"), "--csv", "--table", "phases"]) == 0
    assert f"note: {read.note}" in capsys.readouterr().out


@pytest.mark.parametrize("broken", [False, True])
def test_kinds_of_installed_packages_are_loaded(plain_run, tmp_path, monkeypatch, broken):
    """In a process that reads a log without a run; a package that cannot be imported is ignored."""
    known = dict(register_of_kinds._KNOWN)
    monkeypatch.setattr(register_of_kinds, "_KNOWN", dict(known))
    register(GRIP)
    recorded(plain_run, tmp_path / "out", FIRST, LAST)
    monkeypatch.setattr(register_of_kinds, "_KNOWN", known)
    monkeypatch.setattr(contact_models.PLUGINS, "registered", {})
    package = tmp_path / "package"
    (package / "grips-1.0.dist-info").mkdir(parents=True)
    (package / "grips-1.0.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: grips\nVersion: 1.0\n")
    (package / "grips-1.0.dist-info" / "entry_points.txt").write_text(f"[{contact_models.GROUP}]\ngripper = grips:Gripper\n")
    (package / "grips.py").write_text(
        "import nothing_of_that_name"
        if broken
        else "from ffsm_mj.config import StrictModel\n"
        "from ffsm_mj.contact_models.interface import ContactModel, EventSource\nfrom tests.log.grips import GRIP\n"
        "class Gripper(ContactModel, EventSource):\n    kind = 'gripper'\n    Config = StrictModel\n    records = (GRIP,)\n"
    )
    monkeypatch.syspath_prepend(package)
    monkeypatch.delitem(sys.modules, "grips", raising=False)
    read = ffsm_mj.load_run(tmp_path / "out")
    assert read.records.get("grips", ()) == (() if broken else (FIRST, LAST))
    assert bool(read.note) == broken


def test_a_kind_of_the_same_name_with_other_fields_is_unknown(plain_run, tmp_path, monkeypatch):
    """Another version of a contact model, or another model: its values would be misinterpreted."""
    known = dict(register_of_kinds._KNOWN)
    monkeypatch.setattr(register_of_kinds, "_KNOWN", dict(known))
    register(GRIP)
    recorded(plain_run, tmp_path / "out", FIRST, LAST)

    @dataclass(frozen=True)
    class Grip:
        time_s: float = declared("Time.")
        force_N: float = declared("Force.")

    monkeypatch.setattr(register_of_kinds, "_KNOWN", dict(known))
    register(replace(GRIP, record=Grip))
    read = ffsm_mj.load_run(tmp_path / "out")
    assert read.note == "/ffsm/grip: not read, no such kind of record is known here"
    assert "grips" not in read.summary()


def test_impacts_of_another_version_are_refused(plain_run, tmp_path):
    """With a note only, the impacts would not be verified."""
    recorded(plain_run, tmp_path / "out", kinds=())
    found = [
        replace(record, data=record.data.replace(b"restitution", b"restitutiom")) if isinstance(record, Schema) else record
        for record in records((tmp_path / "out" / "run.mcap").read_bytes())
    ]
    (tmp_path / "x.mcap").write_bytes(log(found))
    with pytest.raises(LogError, match=r"not of this version's format ./ffsm/impact has another schema"):
        ffsm_mj.load_run(tmp_path / "x.mcap")


@pytest.mark.parametrize(("facts", "told"), [({"format_version": "2"}, "log format 2"), ({}, "log format unknown")])
def test_a_log_of_another_format_is_refused_by_its_version(plain_run, tmp_path, facts, told):
    """Its columns have other names, so the version is tested first."""
    recorded(plain_run, tmp_path / "out", kinds=())
    found = []
    for record in records((tmp_path / "out" / "run.mcap").read_bytes()):
        if isinstance(record, Channel) and record.topic == "/ffsm/sample":
            kept = {key: value for key, value in record.metadata.items() if key != "format_version"}
            record = replace(record, metadata=kept | facts)  # noqa: PLW2901
        found.append(record)
    (tmp_path / "x.mcap").write_bytes(log(found))
    with pytest.raises(LogError, match=rf"x.mcap: {told}; this version of ffsm-mj reads format 4$"):
        ffsm_mj.load_run(tmp_path / "x.mcap")


def test_a_log_with_two_channels_of_a_topic_is_refused(plain_run, tmp_path):
    """As of merged files: the schema of one would be taken for the samples of the other."""
    recorded(plain_run, tmp_path / "out", kinds=())
    found = list(records((tmp_path / "out" / "run.mcap").read_bytes()))
    at = next(i for i, each in enumerate(found) if isinstance(each, Channel) and each.topic == "/ffsm/sample")
    (tmp_path / "x.mcap").write_bytes(log([*found[:at], found[at], replace(found[at], id=999), *found[at + 1 :]]))
    with pytest.raises(LogError, match=r"two channels of /ffsm/sample: a log has one of each topic$"):
        ffsm_mj.load_run(tmp_path / "x.mcap")


@pytest.mark.usefixtures("grips")
def test_an_inconsistent_record_is_refused(plain_run, tmp_path):
    """Wrong lengths of vectors, a missing second geom, a missing entry that the marks need."""
    _, read = recorded(plain_run, tmp_path / "out", FIRST)
    whole = encode_record(FIRST)
    for change in ({"point_m": (1.0,)}, {"geoms": ("ball",)}, {"wrench_N": {}}):
        short = encode_record(replace(FIRST, **change))
        found = [
            replace(record, data=short) if isinstance(record, Message) and record.data == whole else record
            for record in records(read.path.read_bytes())
        ]
        (tmp_path / "x.mcap").write_bytes(log(found))
        with pytest.raises(LogError, match=rf"{next(iter(change))}.* of grip has . values, not"):
            ffsm_mj.load_run(tmp_path / "x.mcap")
    assert decode_record(GRIP, whole) == FIRST
