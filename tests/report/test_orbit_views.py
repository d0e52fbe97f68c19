"""What figures, page and recording show of a run in orbit: paths in LVLH with R-bar down, and arrows that turn."""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.log.markers import lvlh_frames
from ffsm_mj.report.page.document import inline_figures
from ffsm_mj.report.plots import figure_names, figures
from tests.log.test_recording import read
from tests.scenes import ball, scene


@pytest.fixture(scope="module", name="run")
def _run(tmp_path_factory):
    """A ball that leaves one at the origin along V-bar, R-bar and against the H-bar for 500 s of an orbit, 32 deg."""
    folder = tmp_path_factory.mktemp("orbit")
    start = {"joints": {"robot/free": [-3.0, 1.0, 2.0, 1, 0, 0, 0]}, "rates": {"robot/free": [-0.02, 0.0, 0.01, 0, 0, 0]}}
    keys = {"time_step_s": 1.0, "control_period_s": 1.0, "duration_s": 500.0, "environment": {"orbit": {"altitude_km": 400}}}
    path = scene(folder, ball(), {"rock": ball("rock")}, initial={"frame": "lvlh", **start}, **keys)
    return ffsm_mj.run(path, out=folder / "out")


def column(run, name):
    return np.array(run[f"orbit.{name}"])


def test_the_plane_of_v_bar_and_r_bar(run):
    drawn = figures(run, ["orbit", "lvlh"])
    (axes,) = drawn["orbit"].axes
    assert axes.get_xlim()[0] > axes.get_xlim()[1]  # V-bar to the left
    assert axes.get_ylim()[0] > axes.get_ylim()[1]  # R-bar down
    path = next(line for line in axes.get_lines() if line.get_label() == "base")
    np.testing.assert_array_equal(path.get_xdata(), column(run, "robot_x_m"))
    np.testing.assert_array_equal(path.get_ydata(), column(run, "robot_z_m"))
    assert any(text.get_text() == "coast, 0 s" for text in axes.texts)
    bars = {line.get_label(): line.get_ydata() for line in drawn["lvlh"].axes[0].get_lines()}
    assert bars["H-bar"][0] == pytest.approx(-1.0)
    assert bars["R-bar"][0] == pytest.approx(2.0)
    assert not {"orbit", "lvlh"} & set(figure_names(ffsm_mj.run("tap", {"duration_s": 0.01})))


def test_the_axes_that_viewers_draw_are_those_of_the_columns(run):
    frames = lvlh_frames(run.log.header.layout, np.array(run.log.rows))
    world = np.column_stack([run[f"state.q_robot_free_{axis}_m"] for axis in "xyz"])
    there = np.column_stack([column(run, f"robot_{axis}_m") for axis in "xyz"])
    np.testing.assert_allclose(np.einsum("nij,nj->ni", frames, there), world, atol=1e-12)
    assert np.abs(frames[-1] - frames[0]).max() > 0.5


def test_a_page_has_no_time_in_the_plane(run):
    drawn = inline_figures(run)
    assert "cursor" not in drawn["orbit"]
    assert "cursor" in drawn["lvlh"]


def test_the_entity_of_a_recording_turns_with_lvlh(run):
    matrices = read(run.path.parent / "run.rrd")["/world/orbit", "Transform3D:mat3x3"]
    first, last = (np.reshape(matrices[i][1], (3, 3)).T for i in (0, -1))  # columns one after the other
    frames = lvlh_frames(run.log.header.layout, np.array(run.log.rows))
    np.testing.assert_allclose(first, frames[0], atol=1e-6)
    np.testing.assert_allclose(last, frames[-1], atol=1e-6)
