"""Contact forces found anew from states: which points count as closed, where no number of the state tells."""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.contact.proximity import Proximity
from ffsm_mj.contact_models.persistent.force_check import _closed_points
from ffsm_mj.replay import replay_log
from tests.contact_models.persistent.random_pushes import LAWS
from tests.scenes import HEAD, scene

CORNERS = np.array([[x, y, 0.0] for x in (-0.1, 0.1) for y in (-0.1, 0.1)])

CUBE = " ".join(f"{0.125 * x} {0.125 * y} {0.125 * z}" for x in (-1, 1) for y in (-1, 1) for z in (-1, 1))
TIPPED = f"""<mujoco>{HEAD}<asset><mesh name="cube" vertex="{CUBE}"/></asset><worldbody><body name="base">
  <freejoint name="free"/><inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>
  <geom name="cube" type="mesh" mesh="cube" mass="0"/><site name="push" pos="0.2 0 0" quat="0 1 0 0"/></body></worldbody>
  <actuator><motor name="push" site="push" gear="0 0 1 0 0 0"/></actuator></mujoco>"""
FLOOR = f'<mujoco>{HEAD}<worldbody><geom name="floor" type="box" size="1 1 0.5"/></worldbody></mujoco>'


def face(gap):
    """A face of four corners that is still, but for one edge that rises at 1 nm/s."""
    return Proximity(gap, np.array([0.0, 0.0, 1.0]), CORNERS, np.array([0.0, 0.0, 1e-9, 1e-9]), 1e-12, 1e-14)


def test_corners_that_have_lifted_off_by_less_than_anyone_can_tell_carry_nothing():
    assert np.array_equal(_closed_points(face(1e-14), [*CORNERS[:2]]), CORNERS[:2])
    assert np.array_equal(_closed_points(face(-1e-12), [*CORNERS[:2]]), CORNERS[:2])


def test_corners_that_overlap_carry_their_share_whoever_is_held():
    assert np.array_equal(_closed_points(face(-8e-10), [*CORNERS[:2]]), CORNERS)
    assert np.array_equal(_closed_points(face(0.0), []), CORNERS)


@pytest.mark.parametrize("tilt_rad", [0.0, 1e-7])
def test_vertices_of_a_mesh_that_touch_as_well_as_they_are_known(tmp_path, tilt_rad):
    """A cube whose face is flat to single precision is tipped over the edge that is 30 nm up, and stays on it."""
    path = scene(
        tmp_path,
        TIPPED,
        {"floor": FLOOR},
        fixed={"floor": {"position_m": [0.0, 0.0, -0.625]}},
        duration_s=0.02,
        initial={"joints": {"robot/free": [0.0, 0.0, 0.125 * tilt_rad, 1.0, 0.0, -0.5 * tilt_rad, 0.0]}},
        contacts={"rules": [{"between": ["cube", "floor/floor"], "restitution": 0.0}]},
        phases=[{"name": "tip", "until": "end", "controller": {"kind": "pushes", "efforts": [[2.0]], "hold_s": 1.0}}],
    )
    run = ffsm_mj.run(path, controllers=LAWS)
    assert len(run.log.records["contact_beginnings"]) == 1
    assert run.impacts == ()
    again = replay_log(run.log)
    assert [str(check) for check in (*all_checks(run), *again.checks()) if not check.passes] == []
    assert again.agrees, again.worst
