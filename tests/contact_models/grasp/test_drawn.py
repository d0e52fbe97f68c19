"""The load on what is held in the viewers and figures: an arrow each for force and torque at the object's site."""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.contact_models.grasp.records import GRASP
from ffsm_mj.log.markers import ARROW_M, marks_topic
from ffsm_mj.log.rerun.sink import write_recording
from tests.contact_models.grasp.scenes import grasping
from tests.log.markers import scale_of
from tests.log.test_recording import entities, read
from tests.log.test_viewer_topics import decoded

LOADS = {"grasp": ("force", "N"), "grasp_torque": ("torque", "N_m")}


@pytest.fixture(scope="module")
def held(tmp_path_factory):
    """Something is held from 0.9 s to 1.8 s."""
    folder = tmp_path_factory.mktemp("held")
    return ffsm_mj.load_run(ffsm_mj.run(grasping(folder / "scene"), out=folder / "out", rerun=False).path)


def vectors(run, name):
    """Force or torque, and where it acts, at all rows."""
    what, unit = LOADS[name]
    load = np.column_stack([run[f"contact.grasp_{what}_{axis}_{unit}"] for axis in "xyz"])
    return load, np.column_stack([run[f"contact.grasp_centre_{axis}_m"] for axis in "xyz"])


def test_the_load_acts_at_the_objects_site_while_it_is_held(held):
    """And there is no place where nothing is held."""
    _, centre = vectors(held, "grasp")
    holds = held["contact.grasp_closed"] == 1.0
    np.testing.assert_array_equal(np.isfinite(centre).all(axis=1), holds)
    assert np.isnan(centre[~holds]).all()
    (capture,), (release,) = held.records["grasp_impulses"], held.records["releases"]
    np.testing.assert_allclose(centre[holds][0], capture.point_m, atol=2e-3)  # a tick later, at 0.3 m/s
    np.testing.assert_allclose(centre[holds][-1], release.point_m, atol=1e-12)  # decided at that tick: the row is its own


def test_foxglove_has_both_arrows_in_every_frame_in_which_it_is_held_and_no_other(held):
    shown = np.arange(0, len(held.time), 20)
    holds = held["contact.grasp_closed"][shown] == 1.0
    updates = {round(time / 1e6): update for time, update in decoded(held.path)["/scene/contacts"]}
    assert {time for time, update in updates.items() if update.entities} == {round(1e3 * t) for t in held.time[shown[holds]]}
    assert len(updates) == np.count_nonzero(holds) + 1  # and once nothing
    row = int(shown[holds][3])
    entities_there = updates[round(1e3 * held.time[row])].entities
    assert [entity.id for entity in entities_there] == ["grasp", "grasp_torque"]
    for entity in entities_there:
        load, centre = vectors(held, entity.id)
        (arrow,) = entity.arrows
        length = scale_of(held) * np.clip(np.linalg.norm(load[row]), *ARROW_M)
        assert arrow.shaft_length + arrow.head_length == pytest.approx(length)
        start = [getattr(arrow.pose.position, axis) for axis in "xyz"]
        np.testing.assert_allclose(start + length * load[row] / np.linalg.norm(load[row]), centre[row], atol=1e-9)


def test_the_mark_of_the_capture_has_its_name_and_its_impulse(held):
    (((_, update),), (capture,)) = decoded(held.path)[marks_topic(GRASP)], held.records["grasp_impulses"]
    (entity,) = update.entities
    (text,), (arrow,) = entity.texts, entity.arrows
    size = np.linalg.norm(capture.impulse_N_s)
    assert text.text == f"grasp: {size:.4g} N s"
    start = np.array([getattr(arrow.pose.position, axis) for axis in "xyz"])
    length = arrow.shaft_length + arrow.head_length
    reached = np.min(
        [np.linalg.norm(start + k * length * np.array(capture.impulse_N_s) / size - capture.point_m) for k in (0, 1)]
    )
    assert reached < 1e-9


def test_rerun_has_both_arrows_and_a_line_of_each_size(held, tmp_path):
    write_recording(held.log, tmp_path / "run.rrd")
    data = {(entity, name.rsplit(":")[-1]): rows for (entity, name), rows in read(tmp_path / "run.rrd").items()}
    shown = np.arange(0, len(held.time), 20)
    for name, plot in (("grasp", "contact_forces"), ("grasp_torque", "interface_torque")):
        load, _ = vectors(held, name)
        sizes = [value for _, (value,) in data[f"/plots/{plot}/{name}", "scalars"]]
        np.testing.assert_allclose(sizes, np.linalg.norm(load[shown], axis=1), rtol=1e-6)
        arrows = np.array([value for _, value in data[f"/world/contacts/{name}", "vectors"]]).reshape(-1, 3)
        np.testing.assert_array_equal(np.any(arrows != 0.0, axis=1), held["contact.grasp_closed"][shown] == 1.0)
    layout = entities(tmp_path / "run.rrd", "-vvv")
    assert "Contact force [N]" in layout
    assert "Interface torque [N m]" in layout


def test_the_figure_has_both_and_when_it_was_held(held):
    force, torque, holds = ffsm_mj.plot(held, "grasps")["grasps"].axes
    assert [axes.get_ylabel().replace("\n", " ") for axes in (force, torque, holds)] == [
        "force on the object, N",
        "torque about its site, N m",
        "holds",
    ]
    (told,) = held.grasps
    (size,) = (line for line in force.lines if line.get_label() == "$|F|$")
    load, _ = vectors(held, "grasp")
    assert np.nanmax(size.get_ydata()) == pytest.approx(np.linalg.norm(load, axis=1).max(), rel=1e-12)
    (bars,) = holds.collections
    (span,) = (path.get_extents() for path in bars.get_paths())
    np.testing.assert_allclose((span.x0, span.x1), (told.time_s, told.release_s))
