"""Persistent contacts in viewers: an arrow while a force acts, and the force over time."""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.log.markers import ARROW_M, arrow_series, declared_arrows
from ffsm_mj.log.rerun.sink import write_recording
from tests.analysis.test_contacts import pushed_twice
from tests.contact_models.persistent.test_friction_seen import SLIPS, on_floor
from tests.log.markers import scale_of
from tests.log.test_recording import entities, read
from tests.log.test_viewer_topics import decoded
from tests.scenes import two_balls

KEY = "contact.ball_target_target"


@pytest.fixture(scope="module")
def pushed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pushed")
    run = ffsm_mj.run(pushed_twice(folder), out=folder / "out", rerun=False)
    return ffsm_mj.load_run(run.path)


def frames(run):
    """Indices of the rows of the frames, every 20 ms, and a mask of those with a contact force."""
    shown = np.arange(0, len(run.time), 20)
    return shown, run[f"{KEY}_mode"][shown] == 2.0


def test_foxglove_draws_an_arrow_to_the_centre_of_pressure_in_every_frame_with_force(pushed):
    shown, presses = frames(pushed)
    updates = {round(time / 1e6): update for time, update in decoded(pushed.path)["/scene/contacts"]}
    arrows = {time for time, update in updates.items() if update.entities}
    assert arrows == {round(1e3 * t) for t in pushed.time[shown[presses]]}
    cleared = {round(1e3 * t) for t in pushed.time[shown[1:][presses[:-1] & ~presses[1:]]]}
    assert len(cleared) == 1
    assert updates.keys() - arrows == cleared
    assert all(len(update.deletions) == 1 for update in updates.values())
    row = int(shown[presses][1])
    ((arrow,),) = (entity.arrows for entity in updates[round(1e3 * pushed.time[row])].entities)
    length = scale_of(pushed) * np.clip(pushed[f"{KEY}_force_N"][row], *ARROW_M)
    assert arrow.shaft_length + arrow.head_length == pytest.approx(length)
    start = [getattr(arrow.pose.position, axis) for axis in "xyz"]
    push = [pushed[f"{KEY}_force_{axis}_N"][row] for axis in "xyz"] / pushed[f"{KEY}_force_N"][row]
    centre = [pushed[f"{KEY}_centre_{axis}_m"][row] for axis in "xyz"]
    np.testing.assert_allclose(start + length * push, centre, atol=1e-9)


def test_rerun_draws_the_arrow_and_plots_the_force(pushed, tmp_path):
    write_recording(pushed.log, tmp_path / "run.rrd")
    data = {(entity, name.rsplit(":")[-1]): rows for (entity, name), rows in read(tmp_path / "run.rrd").items()}
    shown, presses = frames(pushed)
    forces = data["/plots/contact_forces/ball_target_target", "scalars"]
    np.testing.assert_array_equal([value for _, (value,) in forces], pushed[f"{KEY}_force_N"][shown])
    arrows = {
        name: [value for _, value in data["/world/contacts/ball_target_target", name]] for name in ("origins", "vectors")
    }
    origins, vectors = (np.array(arrows[name]).reshape(-1, 3) for name in ("origins", "vectors"))
    np.testing.assert_array_equal(np.any(vectors != 0.0, axis=1), presses)
    ends = (origins + vectors)[presses]
    np.testing.assert_allclose(ends[:, 0], pushed[f"{KEY}_centre_x_m"][shown[presses]], rtol=1e-6)  # float32
    assert "Contact force [N]" in entities(tmp_path / "run.rrd", "-vvv")  # the layout that was sent last


def test_without_persistent_contact_there_are_no_arrows_and_no_figure(tmp_path):
    run = ffsm_mj.run(two_balls(tmp_path, duration_s=0.4), out=tmp_path / "out", rerun=False)
    assert "/scene/contacts" not in decoded(run.path)
    assert "contacts" not in ffsm_mj.plot(run)
    write_recording(run.log, tmp_path / "run.rrd")
    assert "ontact force" not in entities(tmp_path / "run.rrd", "-vvv")


def test_the_figure_shows_force_impulse_and_intervals_of_contact(pushed):
    """The curve contains the greatest force; the bar of the second contact extends to the end."""
    forces, closed, impulses = ffsm_mj.plot(pushed, "contacts")["contacts"].axes
    assert [axes.get_ylabel() for axes in (forces, closed, impulses)] == ["contact force, N", "closed", "impulse, N s"]
    (line,) = (line for line in forces.lines if line.get_label() == "ball-target/target")
    assert line.get_ydata().max() == pushed[f"{KEY}_force_N"].max()
    (bars,) = closed.collections
    spans = [path.get_extents() for path in bars.get_paths()]
    ends = [contact.end_s or pushed.time[-1] for contact in pushed.contacts]
    np.testing.assert_allclose(
        [(span.x0, span.x1) for span in spans], [(c.start_s, e) for c, e in zip(pushed.contacts, ends, strict=True)]
    )


@pytest.fixture(scope="module")
def rolled(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rolled")
    run = ffsm_mj.run(on_floor(folder, rates=SLIPS, duration_s=0.24), out=folder / "out", rerun=False)
    return ffsm_mj.load_run(run.path)


def test_rerun_shows_where_a_contact_slides_and_sticks_and_how_much_of_the_limit_it_uses(rolled, tmp_path):
    write_recording(rolled.log, tmp_path / "run.rrd")
    data = {(entity, name.rsplit(":")[-1]): rows for (entity, name), rows in read(tmp_path / "run.rrd").items()}
    states = [(time, state) for time, (state,) in data["/states/contacts/sole", "state"]]
    ticks = rolled.time[rolled["contact.sole_mode"] == 3.0]
    assert states[-2:] == [(0.0, "sliding"), (pytest.approx(ticks[0]), "sticking")]
    shown = np.arange(0, len(rolled.time), 5)  # every 20 ms
    use = [value for _, (value,) in data["/plots/friction_use", "scalars"]]
    np.testing.assert_array_equal(use, rolled["contact.sole_friction_use"][shown])


def test_friction_has_an_arrow_beside_that_of_the_whole_force(rolled):
    arrows = {arrow.name: arrow_series(arrow, rolled.log.rows[:1], 1.0) for arrow in declared_arrows(rolled.log.header)}
    assert list(arrows) == ["sole", "sole_friction"]
    along = np.array([0.13, 0.05, 0.0]) / np.hypot(0.13, 0.05)
    np.testing.assert_allclose(arrows["sole_friction"].vectors[0], ARROW_M[0] * along, atol=1e-12)
    np.testing.assert_allclose(arrows["sole_friction"].sizes, 0.2)
    assert arrows["sole"].sizes[0] == pytest.approx(np.hypot(1.0, 0.2))
