"""A registered kind of record appears everywhere that impacts do, without further code."""

from __future__ import annotations

import csv
import json
import runpy
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

import ffsm_mj
from ffsm_mj.analysis.run import Run
from ffsm_mj.cli.main import main
from ffsm_mj.contact_models.grasp.records import GRASP
from ffsm_mj.log.markers import declared_arrows
from ffsm_mj.log.recorder import MemorySink
from ffsm_mj.log.rerun.sink import write_recording
from ffsm_mj.records import kinds as register_of_kinds
from ffsm_mj.records.kinds import SUMMARY_KEYS, Mark, kinds, register
from ffsm_mj.report.page import scene as page_scene
from ffsm_mj.report.page.scene import poses
from ffsm_mj.report.pictures import _arrows, pictures
from ffsm_mj.report.plots import comparison, figures
from ffsm_mj.report.plots.silhouette import Plane
from ffsm_mj.report.plots.subject import Subject
from ffsm_mj.report.verification_report import SENSITIVITY_KEY
from tests.log.grips import FIRST, GRIP, LAST, arrows, recorded
from tests.log.markers import scale_of
from tests.log.test_recording import read as read_recording

ROOT = Path(__file__).parents[2]


def messages(path):
    """Messages of a log by topic, read without code of ffsm-mj."""
    found = defaultdict(list)
    with path.open("rb") as stream:
        decoders = [DecoderFactory()]
        for _, channel, message, content in make_reader(stream, decoder_factories=decoders).iter_decoded_messages():
            found[channel.topic].append((message.log_time, content))
    return found


@pytest.mark.usefixtures("grips")
def test_a_record_is_read_back_and_listed(plain_run, tmp_path):
    kept, read = recorded(plain_run, tmp_path / "out", FIRST, LAST)
    for run in (kept, read):
        assert run.records["grips"] == (FIRST, LAST)
        assert (run.impacts, run.phases) == (plain_run.impacts, plain_run.phases)
        assert [type(event).__name__ for event in run.log.events] == ["PhaseRecord", "Grip", "ImpactRecord", "Grip"]
        assert run.summary()["grips"] == [GRIP.summary(FIRST), GRIP.summary(LAST)]
        assert run.table("grips").columns["point_y_m"].tolist() == [0.05, 0.05]
        assert run.table("grips").columns["geoms_b"].tolist() == ["target", "target"]
        assert run.table("grips").units["point_x_m"] == "m"
    assert (read.log.header.kinds, read.note, read.damage) == (("grip",), "", "")
    written = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert written == ffsm_mj.summary(read) == ffsm_mj.summary(kept)
    assert "grips" not in plain_run.summary()


@pytest.mark.usefixtures("grips")
def test_a_record_has_a_topic_a_text_and_marks_in_the_log(plain_run, tmp_path):
    _, read = recorded(plain_run, tmp_path / "out", FIRST, LAST)
    topics = messages(read.path)
    (time, grip), _ = topics["/ffsm/grip"]
    assert (time, list(grip.geoms), list(grip.wrench_N["ball"].values)) == (100_000_000, ["ball", "target"], [1.5, -2.0])
    said = {time: (message.message, message.level) for time, message in topics["/log"]}
    assert said[100_000_000] == ("grip of ball and target, holds 1", 2)  # foxglove.Log: INFO is 2, WARNING 3
    assert said[450_000_000] == ("grip of ball and target, holds 0", 3)
    (time, update), (later, other) = topics["/scene/grips"]
    assert (time, later) == (100_000_000, 450_000_000)
    arrow, dot = update.entities
    assert arrow.arrows[0].shaft_length + arrow.arrows[0].head_length == pytest.approx(0.7 * scale_of(read))
    assert (arrow.texts[0].text, dot.texts[0].text) == ("1.5 N", "held")
    assert (dot.spheres[0].pose.position.x, dot.spheres[0].pose.position.y) == (0.2, 0.05)
    assert not {entity.id for entity in update.entities} & {entity.id for entity in other.entities}


@pytest.mark.usefixtures("grips")
def test_arrows_that_a_kind_declares_are_drawn_alike_in_every_view(plain_run, tmp_path, monkeypatch):
    """Along the momentum, ending at the target, 0.4 m to 1.5 m long at scale 1; a torque of zero is not drawn."""
    monkeypatch.setitem(register_of_kinds._KNOWN, "grip", replace(GRIP, arrows=arrows))
    _, read = recorded(plain_run, tmp_path / "out", FIRST, LAST)
    row = 20
    force, end = read.momentum("robot")[row, :3], np.array([read["state.q_target_x_m"][row], 0.0, 0.0])
    vector = scale_of(read) * np.clip(np.linalg.norm(force), 0.4, 1.5) * force / np.linalg.norm(force)
    update = dict(messages(read.path)["/scene/contacts"])[round(1e9 * read.time[row])]
    (entity,) = update.entities
    (arrow,) = entity.arrows
    start = [getattr(arrow.pose.position, axis) for axis in "xyz"]
    assert (entity.id, arrow.shaft_length + arrow.head_length) == ("pull", pytest.approx(np.linalg.norm(vector)))
    np.testing.assert_allclose(start, end - vector, atol=1e-12)
    data = {
        (path, name.rsplit(":")[-1]): dict(rows)
        for (path, name), rows in read_recording(read.path.parent / "run.rrd").items()
    }
    (drawn,) = (
        np.array(value)
        for time, value in data["/world/contacts/pull", "vectors"].items()
        if abs(time - read.time[row]) < 1e-9
    )
    np.testing.assert_allclose(drawn[0], vector, rtol=1e-6)
    assert ("/world/contacts/twist", "vectors") not in data
    subject = Subject(read, [])
    (mesh,) = page_scene.forces(read.log.header, poses(subject), scale_of(read))
    matrix = mesh.model_matrix[page_scene.tick(float(read.time[row]))]
    np.testing.assert_allclose((matrix[:3, 2], matrix[:3, 3]), (vector, end - vector), rtol=1e-6)
    (line, *_) = _arrows(
        declared_arrows(read.log.header), read.log.rows[row : row + 1], Plane(0, 1), (0.0, 10.0, 0.0, 10.0)
    ).get_segments()
    np.testing.assert_allclose(line[1], end[:2])
    np.testing.assert_allclose((line[1] - line[0]) / 1.2, (force / np.linalg.norm(force))[:2], atol=1e-12)


@pytest.mark.usefixtures("grips")
@pytest.mark.parametrize("source", ["run", "log"])
def test_a_record_is_in_the_recording(plain_run, tmp_path, source):
    _, read = recorded(plain_run, tmp_path / "out", FIRST, LAST)
    recording = tmp_path / "out" / "run.rrd"
    if source == "log":
        recording.unlink()
        write_recording(read.log, recording)
    data = read_recording(recording)
    texts = [
        text for (entity, name), rows in data.items() if entity == "/events" and name.endswith("text") for _, text in rows
    ]
    assert ["0.100000 s  grip of ball and target, holds 1"] in texts
    states = [row for (entity, _), rows in data.items() if entity == "/states/grip" for row in rows]
    assert [(round(time, 9), *state) for time, state in states] == [(0.1, "held"), (0.45, "free")]
    drawn = {entity for entity, _ in data if entity.startswith("/world/grips/")}
    marks = {f"/world/grips/{i}/{name}" for i in (0, 1) for name in ("jaw_1", "contact_2")}
    assert marks < drawn <= marks | {f"{mark}/text" for mark in marks}


@pytest.mark.usefixtures("grips")
def test_a_record_is_a_table_for_other_tools(plain_run, tmp_path, capsys):
    out = tmp_path / "out"
    recorded(plain_run, out, FIRST, LAST)
    assert main(["export", str(out), "--csv", "--table", "grips"]) == 0
    with (out / "grips.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [(row["time_s"], row["geoms_a"], row["point_x_m"], row["holds"]) for row in rows] == [
        ("0.1", "ball", "0.2", "1"),
        ("0.45", "ball", "0.2", "0"),
    ]
    assert main(["export", str(out), "--parquet", "--table", "grips"]) == 0
    field = pyarrow.parquet.read_table(out / "grips.parquet").schema.field("point_z_m")
    assert field.metadata == {b"unit": b"m", b"description": b"position in world axes"}
    recorded(plain_run, tmp_path / "none", kinds=())
    assert main(["export", str(tmp_path / "none"), "--csv", "--table", "grips"]) == 2
    known = (
        "angular_momentum, checks, contact_beginnings, contact_changes, contact_endings, contacts, impacts, "
        "internal_errors, phases, samples, unhandled_contacts"
    )
    assert f"unknown table 'grips'; allowed: {known}" in capsys.readouterr().err


@pytest.mark.usefixtures("grips")
def test_a_kind_without_records_is_an_empty_list(plain_run, tmp_path):
    kept, read = recorded(plain_run, tmp_path / "out")
    for run in (kept, read):
        assert run.summary()["grips"] == []
        assert len(run.table("grips").columns["point_x_m"]) == 0
    assert main(["export", str(tmp_path / "out"), "--parquet", "--table", "grips"]) == 0


@pytest.mark.usefixtures("grips")
def test_reports_list_records_and_comparisons_their_first_difference(plain_run, tmp_path, capsys):
    first, _ = recorded(plain_run, tmp_path / "a", FIRST, LAST)
    second, _ = recorded(plain_run, tmp_path / "b", FIRST)
    assert main(["analyze", str(tmp_path / "a"), str(tmp_path / "b"), "--compare"]) == 0
    out = capsys.readouterr().out
    assert "2 grips\n  0.100000 s  grip of ball and target, holds 1\n" in out
    assert "  impacts: 1, identical\n" in out
    assert "  grips: 2 -> 1, number 2 differs: grip of ball and target, holds 0 -> none\n" in out
    assert not ffsm_mj.compare(first, second).same
    assert not ffsm_mj.compare(first, plain_run).same
    assert ffsm_mj.compare(first, first).same


@pytest.mark.usefixtures("grips")
def test_film_and_figures_draw_the_marks(plain_run, tmp_path):
    with_grips, _ = recorded(plain_run, tmp_path / "out", FIRST, LAST)
    times = np.array([0.0, 0.2])
    films = [list(pictures(Subject(run), times, 1.0)) for run in (plain_run, with_grips)]
    above = slice(None, -60)  # the legend, which differs from the start
    differs = [bool(np.any(a[above] != b[above])) for a, b in zip(*films, strict=True)]
    assert differs == [False, True]  # before the grip at 0.1 s, and while it is shown
    labels = [text.get_text() for text in figures(with_grips, ["motion"])["motion"].legends[0].get_texts()]
    assert "grip, impact" in labels or "impact, grip" in labels
    axes = comparison([("a", with_grips)]).axes[-1]
    assert axes.get_xlabel() == "time, s (dotted: impacts, grips)"
    assert sorted(line.get_xdata()[0] for line in axes.lines[1:]) == pytest.approx([0.1, 0.3, 0.45])


@pytest.mark.usefixtures("grips")
def test_the_log_reference_describes_a_kind():
    page = "\n".join(runpy.run_path(str(ROOT / "docs" / "log_reference.py"))["reference"]())
    assert "| `/ffsm/grip` | `ffsm.Grip` | when something is gripped or released |" in page
    assert "| `/scene/grips` | `foxglove.SceneUpdate` | with `/ffsm/grip` |" in page
    assert "## /ffsm/grip\n" in page
    assert "| `point_m` | double[] | m | Position in world axes. |" in page


@pytest.mark.usefixtures("grips")
def test_a_record_that_the_header_does_not_name_is_refused(plain_run):
    sink = MemorySink()
    sink.open(plain_run.log.header)
    sink.event(FIRST)
    with pytest.raises(KeyError, match="grips"):
        assert sink.log().records


@pytest.mark.usefixtures("grips")
def test_keys_of_the_summary_and_names_of_tables_are_reserved(plain_run):
    """A kind could otherwise replace an entry of every run."""
    header = plain_run.log.header
    facts = dict(header.metadata) | {"start_s": "0.1", "model": "{}", "controller_model": "{}"}
    every = Run(replace(plain_run.log, header=replace(header, metadata=facts, kinds=(*header.kinds, GRASP.name))))
    # A run that waits for a clock has ``realtime`` too.
    words = {*ffsm_mj.summary(every), SENSITIVITY_KEY, "realtime"} - {kind.plural for kind in kinds()}
    assert words == SUMMARY_KEYS
    for word in words | {"samples", "plumes"}:
        with pytest.raises(ValueError, match="the name is reserved"):
            register(replace(GRIP, name=f"{word}_of_mine", plural=word, record=Mark))
