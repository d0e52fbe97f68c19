"""Forces of patches that stick by the twist that they hold, against those of all their points."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from ffsm_mj.contact_models.persistent.friction.held_twists import HeldTwists, Patch
from ffsm_mj.contact_models.persistent.friction.modes import FrictionModes
from ffsm_mj.contact_models.persistent.friction.point_modes import STICK
from ffsm_mj.contact_models.persistent.rows import ContactPoint, RowEvaluator
from ffsm_mj.contact_models.persistent.smooth import Smooth
from ffsm_mj.contact_models.persistent.stage_forces import StageForces
from ffsm_mj.dynamics.body_twists import chain
from ffsm_mj.dynamics.motion import Motion
from tests.contact_models.persistent.test_rows import BOX, PLATE, face_to_face


@pytest.fixture(autouse=True)
def _plain(monkeypatch):
    monkeypatch.setenv("FFSM_COMPILED", "0")


@pytest.mark.parametrize("halves", [(BOX, PLATE), (PLATE, BOX)])
def test_the_forces_are_those_of_all_points(tmp_path, rng, halves):
    """Both bodies turn together, at rest to each other: power, wrench and generalised forces, with and without the twist."""
    pair, model, data, found = face_to_face(tmp_path, rng, *halves)
    pair.mu, motion = 0.5, Motion(model, data)
    points, modes = tuple(ContactPoint(pair, feature) for feature in found), FrictionModes()
    modes.set(
        points, np.full(len(points), STICK), np.zeros((len(points), 3)), np.zeros(len(points)), np.zeros(len(points)) > 0
    )
    evaluator = RowEvaluator(motion, data, points)
    _move_together(model, data, rng)
    by_points, by_twist = (StageForces(Smooth(motion, data), evaluator, points, modes.of(points)) for _ in range(2))
    by_twist.begin(evaluator.frictional_rows())
    given, sides = rng.normal(size=model.nv), []
    for each in (by_points, by_twist):
        applied = given.copy()
        stage = each.add(applied)
        sides.append(np.concatenate((applied, stage.power, np.ravel(stage.wrenches))))
    # The condition of both systems is below 1e4.
    np.testing.assert_allclose(*sides, rtol=0.0, atol=1e-11 * np.abs(sides[0]).max())


def _move_together(model, data, rng):
    """Set velocities of one rigid body, about the world origin."""
    mujoco.mj_forward(model, data)
    twist, jacp, jacr = rng.normal(size=6), np.zeros((3, model.nv)), np.zeros((3, model.nv))
    rows, rates = [], []
    for body in range(1, model.nbody):
        if chain(model, body).any():
            mujoco.mj_jac(model, data, jacp, jacr, data.xpos[body], body)
            rows += [jacp.copy(), jacr.copy()]
            rates += [twist[3:] + np.cross(twist[:3], data.xpos[body]), twist[:3]]
    data.qvel[:] = np.linalg.lstsq(np.vstack(rows), np.concatenate(rates), rcond=None)[0]
    mujoco.mj_forward(model, data)


def test_points_on_a_line_hold_no_twist(tmp_path, rng):
    """Two points, three on a line, and three almost on one are left to their own rows."""
    pair, model, data, found = face_to_face(tmp_path, rng, BOX, PLATE)
    bodies, along = (model.nbody - 1, 1), rng.normal(size=3)
    line = np.linspace(-0.1, 0.1, 3)[:, None] * along
    aside = np.cross(along, rng.normal(size=3))
    assert Patch.of(data, bodies, line) is None
    assert Patch.of(data, bodies, line + 1e-5 * np.array([[0.0], [1.0], [0.0]]) * aside) is None
    assert Patch.of(data, bodies, line + 0.1 * np.array([[0.0], [1.0], [0.0]]) * aside) is not None
    motion, two = Motion(model, data), tuple(ContactPoint(pair, feature) for feature in found[:2])
    assert not HeldTwists(motion, two).begin(RowEvaluator(motion, data, two).frictional_rows())
