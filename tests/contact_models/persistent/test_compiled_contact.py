"""Compiled twins of the classes of persistent contact against their originals: the same inputs, the same outputs.

Rows and forces of both are of the order of 1 to 100; sums of some twenty terms are taken in another order.
"""

from __future__ import annotations

from copy import copy

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.contact.features.search import features
from ffsm_mj.contact_models.persistent.friction.held_rows import HeldForces
from ffsm_mj.contact_models.persistent.friction.modes import CLOSED, SLIDE, STICK, unit_slips
from ffsm_mj.contact_models.persistent.friction.problem import FrictionProblem
from ffsm_mj.contact_models.persistent.rows import ContactPoint, RowEvaluator
from ffsm_mj.contact_models.persistent.smooth import Smooth
from ffsm_mj.dynamics.motion import Motion
from tests.contact.features.test_gap_functions import in_contact, pair_of
from tests.contact.test_geometry import shape
from tests.contact_models.persistent.test_friction_seen import SLIPS, on_floor
from tests.contact_models.persistent.test_rows import BOX, PLATE, face_to_face

twins = pytest.importorskip("ffsm_mj_fast", reason="the extra 'fast' is not installed")
ROUNDING = 1e-12


def same_rows(pair, model, data, found, *, flat=()):
    """Rows with and without tangents, what they tell of the points, and resultants."""
    pair.mu, motion = 0.5, Motion(model, data)
    contact_points, k = [ContactPoint(pair, feature) for feature in found], len(found)
    forces, friction = np.linspace(1.0, 2.0, k), np.linspace(-1.0, 1.0, 3 * k).reshape(k, 3)
    sides = []
    for kind in (RowEvaluator, twins.RowEvaluator):
        evaluator = kind(motion, data, contact_points, flat)
        with_friction, without = evaluator.frictional_rows(), evaluator.rows()
        values = [
            with_friction.axes,
            with_friction.slips,
            with_friction.speed_rounding,
            with_friction.across(friction[:, 1:]),
        ]
        # In units of their largest shares.
        values.append(1e12 * with_friction.acceleration_rounding(np.linspace(-1.0, 1.0, model.nv)))
        for rows in (with_friction, without):
            values += [rows.J, rows.gamma, rows.response, rows.G, rows.gaps, rows.rates, rows.scales, rows.insides]
            values += [rows.normals, rows.points, rows.starts, rows.wrenches(forces), rows.wrenches(forces, friction)]
            values += [np.hstack([np.ravel(value) for value in state]) for state in rows.states]
        sides.append(values)
    for plain, twin in zip(*sides, strict=True):
        np.testing.assert_allclose(twin, plain, rtol=ROUNDING, atol=ROUNDING)


@pytest.mark.parametrize("halves", [(BOX, PLATE), (PLATE, BOX)])
def test_rows_of_points_over_a_face(tmp_path, rng, halves):
    same_rows(*face_to_face(tmp_path, rng, *halves))


@pytest.mark.parametrize(("a", "b"), [("sphere", "box"), ("box", "sphere"), ("capsule", "capsule"), ("box", "box")])
def test_rows_of_single_points(tmp_path, rng, a, b):
    """A point over a face, which the twin evaluates itself, and points of other features."""
    pair, model, data = pair_of(tmp_path, shape(a), shape(b))
    near = in_contact(pair, model, data, rng)
    same_rows(pair, model, data, features(pair, model, data, near))


def test_rows_of_a_flat_patch_of_several_groups(tmp_path, rng):
    """One of its points is by itself, as where edges cross; and so is a point of a pair without friction."""
    pair, model, data, found = face_to_face(tmp_path, rng, BOX, PLATE)
    pair.mu, without_friction = 0.5, copy(pair)
    without_friction.mu = 0.0
    contact_points = [ContactPoint(pair, feature) for feature in found]
    contact_points.insert(1, ContactPoint(without_friction, found[1]))
    plain, twin = (
        kind(Motion(model, data), data, contact_points, {pair}).frictional_rows()
        for kind in (RowEvaluator, twins.RowEvaluator)
    )
    for name in ("J", "gamma", "axes"):
        np.testing.assert_allclose(getattr(twin, name), getattr(plain, name), rtol=ROUNDING, atol=ROUNDING)


@pytest.mark.parametrize("case", range(12))
def test_forces_of_held_rows(rng, case):
    """Four points of a body, with dependent rows; modes at random, also with none that holds."""
    places, k = rng.uniform(-1.0, 1.0, (4, 3)), 4
    places[:, 2] = 0.3
    rows = np.vstack([np.hstack((np.eye(3)[[2, 0, 1]], np.cross(place, np.eye(3)[[2, 0, 1]]))) for place in places])
    G = rows @ np.diag(rng.uniform(0.5, 2.0, 6)) @ rows.T
    b, mu = rows @ rng.normal(size=6), np.array([0.3, 0.0, 0.5, 0.4])
    kinds = rng.choice([CLOSED, SLIDE, STICK], k) if case else np.full(k, CLOSED)
    slips = np.where((kinds == SLIDE)[:, None] & (mu > 0.0)[:, None], unit_slips(rng.normal(size=(k, 2))), 0.0)
    problem, points = FrictionProblem(G, b, mu), np.flatnonzero((kinds == SLIDE) & (mu > 0.0))
    across, other, sides = np.stack((-slips[points, 1], slips[points, 0]), axis=1), rng.normal(size=(2, 6)) @ rows.T, []
    for kind in (HeldForces, twins.HeldForces):
        held = kind(problem, problem.structure(kinds))
        forces = held.forces(b, slips)
        turns = held.responses_to_turns(points, across, forces[points, 0])
        springs = held.springs(other[:, problem.structure(kinds).rows], forces) if kinds.any() else ()
        sides.append([held.redundant, held.is_regular(slips), forces, held.forces(2.0 * b, slips), turns, *springs])
    for plain, twin in zip(*sides, strict=True):
        # The condition of the systems is below 1e4.
        np.testing.assert_allclose(twin, plain, rtol=1e-11, atol=1e-11)


def test_smooth_forces(tmp_path, rng):
    _, model, data, _ = face_to_face(tmp_path, rng, BOX, PLATE)
    motion, pushes, seen = Motion(model, data), rng.normal(size=model.nv), mujoco.MjData(model)
    seen.ctrl[:] = rng.normal(size=model.nu)
    for logged in (data, seen):
        plain, twin = Smooth(motion, logged), twins.Smooth(motion, logged)
        np.testing.assert_allclose(twin.force(pushes), plain.force(pushes), rtol=ROUNDING, atol=ROUNDING)
        assert twin.motion is plain.motion
        for smooth in (plain, twin):
            place, load = smooth.place(), smooth.load(pushes)
            assert smooth.place() is place
            assert smooth.load(pushes) is load
            data.qvel[0] += 1.0
            assert smooth.place() is not place
            assert smooth.load(pushes) is load
            assert smooth.load(pushes + 1.0) is not load


def test_a_run_is_the_same(tmp_path, monkeypatch):
    """A ball that slides, with implicit stages, and rolls; and a box whose corners stick."""
    for name, more in (("ball", {"rates": SLIPS}), ("box", {"geom": 'type="box" size="1 1 1"'})):
        rows = []
        for switch in "01":
            monkeypatch.setenv("FFSM_COMPILED", switch)
            (tmp_path / (name + switch)).mkdir()
            rows.append(np.array(ffsm_mj.run(on_floor(tmp_path / (name + switch), duration_s=0.04, **more)).log.rows))
        np.testing.assert_allclose(rows[1], rows[0], rtol=1e-12, atol=1e-12)
