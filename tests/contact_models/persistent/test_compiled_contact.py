"""Compiled twins of the classes of persistent contact against their originals: the same inputs, the same outputs.

Rows and forces of both are of the order of 1 to 100; sums of some twenty terms are taken in another order.
"""

from __future__ import annotations

import pickle
from copy import copy
from dataclasses import replace
from functools import partial

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly.simulator import Simulator
from ffsm_mj.contact.features.search import features
from ffsm_mj.contact_models.persistent.acceleration import ContactAcceleration
from ffsm_mj.contact_models.persistent.exchange import StageSums
from ffsm_mj.contact_models.persistent.friction.held_rows import HeldForces
from ffsm_mj.contact_models.persistent.friction.modes import FrictionModes
from ffsm_mj.contact_models.persistent.friction.point_modes import CLOSED, SLIDE, STICK
from ffsm_mj.contact_models.persistent.friction.problem import FrictionProblem
from ffsm_mj.contact_models.persistent.friction.state import FrictionState
from ffsm_mj.contact_models.persistent.rows import ContactPoint, RowEvaluator
from ffsm_mj.contact_models.persistent.smooth import Smooth
from ffsm_mj.contact_models.persistent.stage_forces import StageForces
from ffsm_mj.dynamics.forced_stepper import ForcedStepper
from ffsm_mj.dynamics.free_stepper import WHOLE_STATE
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.dynamics.rigid_body import mass_matrix
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
        values += [with_friction.largest_slip(np.arange(k) < most) for most in (1, k)]
        # In units of their largest shares.
        values.append(1e12 * with_friction.acceleration_rounding(np.linspace(-1.0, 1.0, model.nv)))
        for rows in (with_friction, without):
            values += [rows.J, rows.gamma, rows.response, rows.G, rows.gaps, rows.rates, rows.scales, rows.insides]
            values += [rows.normals, rows.points, rows.starts, rows.wrenches(np.linspace(-1.0, 1.0, len(rows.J)))]
            values += [*rows.resultant(slice(0, k), forces, friction), *rows.resultant(slice(0, k), 0.0 * forces, None)]
            values.append(rows.extremes)
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
    """Four points of a body, with dependent rows; modes at random, also with none that holds, without sliding friction."""
    places, k = rng.uniform(-1.0, 1.0, (4, 3)), 4
    places[:, 2] = 0.3
    rows = np.vstack([np.hstack((np.eye(3)[[2, 0, 1]], np.cross(place, np.eye(3)[[2, 0, 1]]))) for place in places])
    G = rows @ np.diag(rng.uniform(0.5, 2.0, 6)) @ rows.T
    b, mu = rows @ rng.normal(size=6), np.array([0.3, 0.0, 0.5, 0.4])
    kinds = rng.choice([CLOSED, SLIDE, STICK], k) if case else np.full(k, CLOSED)
    kinds = np.where((kinds == SLIDE) & (mu > 0.0), STICK, kinds)
    problem, slips = FrictionProblem(G, b, mu), np.zeros((k, 2))
    other, sides = rng.normal(size=(2, 6)) @ rows.T, []
    for kind in (HeldForces, twins.HeldForces):
        held = kind(problem, problem.structure(kinds))
        forces = held.forces(b, slips)
        springs = held.springs(other[:, problem.structure(kinds).rows], forces) if kinds.any() else ()
        sides.append([held.redundant, forces, held.forces(2.0 * b, slips), *springs])
    for plain, twin in zip(*sides, strict=True):
        # The condition of the systems is below 1e4.
        np.testing.assert_allclose(twin, plain, rtol=1e-11, atol=1e-11)


def sides(tmp_path, rng, *, mu):
    """Evaluators of the points of a box on a plate, by twin and by original, and a generalised force that presses them."""
    pair, model, data, found = face_to_face(tmp_path, rng, BOX, PLATE)
    pair.mu, motion = mu, Motion(model, data)
    contact_points = tuple(ContactPoint(pair, feature) for feature in found)
    plain, twin = (kind(motion, data, contact_points) for kind in (RowEvaluator, twins.RowEvaluator))
    # The wrench of forces that press all points has such forces as an answer.
    rows = plain.rows()
    force = -rng.uniform(50.0, 60.0, len(found)) @ rows.J + 0.1 * rng.normal(size=model.nv)
    return contact_points, motion, plain, twin, force


def values_of(stage, generalised):
    """Numbers of a stage."""
    friction = np.zeros(0) if stage.friction is None else stage.friction
    return [stage.forces, stage.power, np.array(stage.wrenches), friction, generalised]


def agree(plain, twin, rtol=1e-11):
    """The condition of the systems is below 1e4."""
    for one, other in zip(plain, twin, strict=True):
        np.testing.assert_allclose(other, one, rtol=rtol, atol=1e-11 * (1.0 + np.abs(one).max(initial=0.0)))


def test_contact_without_friction(tmp_path, rng):
    """All points active, one of them and some; also where the expected active set does not push everywhere."""
    points, motion, *evaluators, force = sides(tmp_path, rng, mu=0.0)
    k, qvel, found = len(points), rng.normal(size=len(force)), []
    turned = rng.permuted(force)
    for kind, evaluator in zip((ContactAcceleration, twins.ContactAcceleration), evaluators, strict=True):
        for pushed in (force, -force, turned):
            problem = kind(partial(mass_matrix, motion.model, motion.data), evaluator.rows(), pushed)
            stage = problem.stage(qvel)
            found.append(
                [problem.free, 1e10 * np.array(problem.rounding), *values_of(*stage)]
                + [problem.bilateral_forces(which) for which in ((), (1,), (0, 2), range(k))]
                + [problem.unilateral_forces(which) for which in ((), range(k))]
                + [problem.validity(which) for which in ((0, 1, 2), range(k))]
                + [problem.gap_accelerations(np.ones(k)), problem.own_acceleration(np.ones(k))]
            )
    for plain, twin in zip(found[:3], found[3:], strict=True):
        agree(plain, twin)


def test_points_that_stick(tmp_path, rng):
    """Inside their cones and outside, below the drift of sticking points and above."""
    points, _, *evaluators, force = sides(tmp_path, rng, mu=0.5)
    modes, k, found = FrictionModes(), len(points), []
    modes.set(points, np.full(k, STICK), np.zeros((k, 3)), np.zeros(k), np.zeros(k, dtype=bool))
    slow = modes.of(points)
    creeping = replace(slow, stop_speeds=np.full(k, 1e6))
    for kind, evaluator in zip((FrictionState, twins.FrictionState), evaluators, strict=True):
        for pushed in (force, -force):
            assert kind(points, evaluator.frictional_rows(), pushed, slow).sticking() is None
            here = kind(points, evaluator.frictional_rows(), pushed, replace(creeping, structures={}))
            solution = here.sticking()
            assert (solution is not None) == (pushed is force)
            stage, generalised = here.stuck_stage()
            forces = solution.forces if solution else np.column_stack((stage.forces, np.ones((k, 2))))
            held = [*solution[2:5]] if solution else []
            found.append(
                [*held, 1e10 * here.rounding, here.limit_ratios(forces), here.problem.b, *values_of(stage, generalised)]
            )
    for plain, twin in zip(found[:2], found[2:], strict=True):
        agree(plain, twin)


def test_sums_of_stages(tmp_path, rng):
    _, _, evaluator, _, force = sides(tmp_path, rng, mu=0.0)
    problem, parts = ContactAcceleration(lambda: None, evaluator.rows(), force), np.array([0.1, 0.2, 0.3, 0.4])
    stages = [problem.stage(rng.normal(size=len(force)))[0] for _ in parts]
    plain, twin = (kind(stages, parts) for kind in (StageSums, twins.StageSums))
    agree(*([each.work, each.total, each.impulses, each.sizes] for each in (plain, twin)))
    groups, robot = len(plain.impulses), slice(1, 7)
    signs = rng.normal(size=groups), rng.normal(size=(2, groups)), robot
    agree(*(each.exchange(*signs) for each in (plain, twin)))


@pytest.mark.parametrize("kinds", [None, (STICK,) * 4, (STICK, STICK, CLOSED, STICK)])
def test_stages_inside_a_step(tmp_path, rng, monkeypatch, kinds):
    """State after state in the same memory: without friction, with points that stick, and with one without force."""
    points, motion, *evaluators, force = sides(tmp_path, rng, mu=0.5 if kinds else 0.0)
    modes, found, data = FrictionModes(), [], motion.data
    if kinds is not None:
        modes.set(points, np.array(kinds), np.zeros((4, 3)), np.zeros(4), np.zeros(4, dtype=np.bool_))
    stages = []
    for switch, kind, smooth, each in zip(
        "01", (StageForces, twins.StageForces), (Smooth, twins.Smooth), evaluators, strict=True
    ):
        monkeypatch.setenv("FFSM_COMPILED", switch)
        stages.append(kind(smooth(motion, data), each, points, modes.of(points) if kinds else None))
    stages[0]._twists = None  # by points, as in its twin
    for _ in range(3):
        data.qvel[:] = 0.1 * rng.normal(size=len(force))
        mujoco.mj_forward(motion.model, data)
        both = []
        for each in stages:
            applied = force + 0.0
            stage = each.add(applied)
            both.append([applied, stage.forces, stage.power, np.array(stage.wrenches)])
        found.append(both)
    for plain, twin in found:
        agree(plain, twin)


@pytest.mark.parametrize("implicit", [False, True])
def test_steps_under_forces(tmp_path, rng, implicit):
    """Two free bodies under a force that depends on their positions and velocities: to rounding, also in implicit stages."""
    _, model, start, _ = face_to_face(tmp_path, rng, BOX, PLATE)
    ends = []
    for kind in (ForcedStepper, twins.ForcedStepper):
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = start.qpos, start.qvel
        mujoco.mj_forward(model, data)

        def push(data):
            data.qfrc_applied -= data.qvel + data.qpos[: model.nv]

        state, momentum = np.empty(mujoco.mj_stateSize(model, WHOLE_STATE)), np.empty(model.nv)
        stepper, seen = kind(model, data, state, momentum, [push], lambda: None), []
        stepper.clear(np.inf)
        stepper.implicit = implicit
        for _ in range(5):
            seen.append(stepper.step(1e-2))
        stepper.integrate(5e-3)
        ends.append(
            [data.qpos, data.qvel, data.qacc, data.time, stepper.energy, stepper.motion_bound, stepper.weights, seen]
        )
    agree(*ends, rtol=1e-13)


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
            state = smooth.state(pushes)
            assert smooth.state(pushes) is state
            assert smooth.state(pushes + 1.0) is not state


def test_a_run_is_the_same(tmp_path, monkeypatch):
    """A ball that slides, with implicit stages, and rolls; and a box whose corners stick."""
    for name, more in (("ball", {"rates": SLIPS}), ("box", {"geom": 'type="box" size="1 1 1"'})):
        rows = []
        for switch in "01":
            monkeypatch.setenv("FFSM_COMPILED", switch)
            (tmp_path / (name + switch)).mkdir()
            rows.append(np.array(ffsm_mj.run(on_floor(tmp_path / (name + switch), duration_s=0.04, **more)).log.rows))
        np.testing.assert_allclose(rows[1], rows[0], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("mu", [0.0, 0.5])
def test_a_saved_state_goes_on_bit_for_bit(tmp_path, mu):
    """What the twins keep of a state is found again, or computed again."""
    with Simulator(on_floor(tmp_path, duration_s=0.04, mu=mu, geom='type="box" size="1 1 1"')) as simulator:
        simulator.reset()
        simulator.step()
        saved, ends = pickle.loads(pickle.dumps(simulator.state())), []
        for _ in range(2):
            simulator.restore(saved)
            for _ in range(3):
                simulator.step()
            data = simulator.assembly.data
            ends.append(np.concatenate((data.qpos, data.qvel, data.qacc, data.qfrc_applied)))
    np.testing.assert_array_equal(*ends)
