"""Forces from the twists that points hold, against those of all their points."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from ffsm_mj.contact.features.point_line_gaps import PointOnFace
from ffsm_mj.contact.features.search import features
from ffsm_mj.contact_models.persistent.friction.modes import FrictionModes
from ffsm_mj.contact_models.persistent.friction.point_modes import SLIDE, STICK
from ffsm_mj.contact_models.persistent.holds.held_twists import HeldTwists
from ffsm_mj.contact_models.persistent.holds.stuck_patch import StuckPatch
from ffsm_mj.contact_models.persistent.rows import ContactPoint, RowEvaluator
from ffsm_mj.contact_models.persistent.smooth import Smooth
from ffsm_mj.contact_models.persistent.stage_forces import StageForces
from ffsm_mj.dynamics.body_twists import chain
from ffsm_mj.dynamics.motion import Motion
from tests.contact.features.test_gap_functions import in_contact, pair_of
from tests.contact.test_geometry import shape
from tests.contact_models.persistent.test_rows import BOX, PLATE, face_to_face


@pytest.fixture(autouse=True)
def _plain(monkeypatch):
    monkeypatch.setenv("FFSM_COMPILED", "0")


def in_modes(points, kind):
    """Modes of some points, none of which slides with friction; None where they have none."""
    if kind is None:
        return None
    modes, k = FrictionModes(), len(points)
    none = np.zeros(k, dtype=bool)
    modes.set(points, np.full(k, kind), np.zeros((k, 3)), np.zeros(k), none, none)
    return modes.of(points)


def check(pair, model, data, found, kind, rng):
    """Power, wrench and generalised forces, with and without the twist. The condition of both systems is below 1e4."""
    points, motion = tuple(ContactPoint(pair, feature) for feature in found), Motion(model, data)
    evaluator, modes = RowEvaluator(motion, data, points), in_modes(points, kind)
    holds = HeldTwists.of(motion, data, points, modes)
    assert holds is not None
    assert holds.begin(evaluator.frictional_rows().points)
    by_points, by_twist = (StageForces(Smooth(motion, data), evaluator, points, modes) for _ in range(2))
    by_points._twists = None
    by_twist.begin(evaluator.frictional_rows().points)
    given, sides = rng.normal(size=model.nv), []
    for each in (by_points, by_twist):
        applied = given.copy()
        stage = each.add(applied)
        sides.append(np.concatenate((applied, stage.power, np.ravel(stage.wrenches))))
    np.testing.assert_allclose(*sides, rtol=0.0, atol=1e-11 * np.abs(sides[0]).max())


@pytest.mark.parametrize("halves", [(BOX, PLATE), (PLATE, BOX)])
def test_a_patch_that_sticks(tmp_path, rng, halves):
    """Both bodies turn together, at rest to each other."""
    pair, model, data, found = face_to_face(tmp_path, rng, *halves)
    pair.mu = 0.5
    _move_together(model, data, rng)
    check(pair, model, data, found, STICK, rng)


@pytest.mark.parametrize("halves", [(BOX, PLATE), (PLATE, BOX)])
@pytest.mark.parametrize("count", [1, 2, 3, 4])
@pytest.mark.parametrize("kind", [None, SLIDE])
def test_points_without_friction(tmp_path, rng, halves, count, kind):
    """At any velocities: also of bodies that slide, and that turn over each other; alone, or beside pairs with friction."""
    pair, model, data, found = face_to_face(tmp_path, rng, *halves)
    pair.mu = 0.0
    check(pair, model, data, found[:count], kind, rng)


@pytest.mark.parametrize("shapes", [("sphere", "box"), ("box", "sphere")])
@pytest.mark.parametrize(("mu", "kind"), [(0.0, None), (0.5, STICK)])
def test_a_ball(tmp_path, rng, shapes, mu, kind):
    """At any velocities: what sticks rolls; also one whose surface slips and leaves the face."""
    pair, model, data = pair_of(tmp_path, *map(shape, shapes))
    found = []
    while not any(isinstance(feature, PointOnFace) for feature in found):
        found = features(pair, model, data, in_contact(pair, model, data, rng))
    pair.mu = mu
    check(pair, model, data, found, kind, rng)


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
    patch, along = StuckPatch(model.nbody - 1, data), rng.normal(size=3)
    line = np.linspace(-0.1, 0.1, 3)[:, None] * along
    aside = np.cross(along, rng.normal(size=3))
    assert not patch.begin(line)
    assert not patch.begin(line + 1e-5 * np.array([[0.0], [1.0], [0.0]]) * aside)
    assert patch.begin(line + 0.1 * np.array([[0.0], [1.0], [0.0]]) * aside)
    pair.mu, two = 0.5, tuple(ContactPoint(pair, feature) for feature in found[:2])
    assert HeldTwists.of(Motion(model, data), data, two, in_modes(two, STICK)) is None
