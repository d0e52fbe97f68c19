"""Contact problems of the core against dense matrices: rows by other groupings, forces by least norm, states in memory."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from itertools import chain, combinations

import mujoco
import numpy as np
import pytest

from ffsm_mj._core.contacts import ContactEvaluation, StageForces
from ffsm_mj._core.forces import ActiveForces
from ffsm_mj._core.row_evaluator import RowEvaluator
from ffsm_mj._core.stages import Smooth, StageSums
from ffsm_mj.assembly.simulator import Simulator, SimulatorState
from ffsm_mj.contact.features.search import features
from ffsm_mj.contact_models.persistent.contact_points import ContactPoint
from ffsm_mj.contact_models.persistent.friction.cones import ON_CONE, cone_depth
from ffsm_mj.contact_models.persistent.friction.decision import Decision
from ffsm_mj.contact_models.persistent.friction.modes import CLOSED, SLIDE, STICK, FrictionModes
from ffsm_mj.contact_models.persistent.friction.problem import FrictionProblem
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.dynamics.rigid_body import mass_matrix
from ffsm_mj.tolerances import ACCELERATION, ACCELERATION_M_S2
from tests.contact.features.test_gap_functions import in_contact, pair_of
from tests.contact.test_geometry import shape
from tests.contact_models.persistent.test_friction_seen import on_floor
from tests.contact_models.persistent.test_rows import BOX, PLATE, face_to_face

RANK = 1e-10
"""Below this share of the largest singular value rows depend on each other; the others exceed 1e-4 of it."""


def agree(own, expected, share=1e-11):
    """The condition of the systems is below 1e4."""
    np.testing.assert_allclose(own, expected, rtol=0.0, atol=share * (1.0 + np.abs(expected).max(initial=0.0)))


@pytest.fixture(params=[(BOX, PLATE), (PLATE, BOX)], ids=["box on plate", "plate on box"])
def resting(request, tmp_path, rng):
    """Pair, motion, contact points of two bodies face to face, and a generalised force that presses all points."""
    pair, model, data, found = face_to_face(tmp_path, rng, *request.param)
    pair.mu, motion = 0.5, Motion(model, data)
    points = tuple(ContactPoint(pair, feature) for feature in found)
    rows = RowEvaluator(motion, data, points).rows()
    return pair, motion, points, -rng.uniform(50.0, 60.0, len(points)) @ rows.J[::3] + 0.1 * rng.normal(size=model.nv)


def test_points_together_have_the_rows_of_each_by_itself(resting):
    _, motion, points, force = resting
    data, k = motion.data, len(points)
    together = RowEvaluator(motion, data, points)
    alone = [RowEvaluator(motion, data, [point]) for point in points]
    one, each = together.rows(), [evaluator.rows() for evaluator in alone]
    for name in ("J", "gamma", "response", "gaps", "rates", "scales", "insides"):
        agree(np.array(getattr(one, name)), np.concatenate([np.array(getattr(rows, name)) for rows in each]), 1e-13)
    agree(one.response, np.linalg.solve(mass_matrix(motion.model, data), one.J.T).T)
    agree(one.G, one.J @ one.response.T)
    along = np.linspace(-1.0, 1.0, len(one.J))
    parts = [np.array(rows.wrenches(part)) for rows, part in zip(each, np.split(along, k), strict=True)]
    agree(np.array(one.wrenches(along)).sum(axis=0), np.sum(parts, axis=0).sum(axis=0))
    normal, places = one.axes[:, 0], np.concatenate([group.points for group in one.groups])
    agree(one.slips, (one.J @ data.qvel).reshape(-1, 3)[:, 1:])
    assert one.largest_slip(np.arange(k) < 2) == pytest.approx(np.abs(one.slips[:2]).max(), rel=1e-12)
    pushed, rubbed = np.linspace(1.0, 2.0, k), np.linspace(-1.0, 1.0, 3 * k).reshape(k, 3)
    resultant = pushed @ normal + rubbed.sum(axis=0), pushed @ places / pushed.sum(), normal[0]
    for own, expected in zip(one.resultant(slice(0, k), pushed, rubbed), resultant, strict=True):
        agree(own, expected)
    terms = np.abs(one.response * force).reshape(k, -1).max(axis=1)
    terms = np.maximum(terms, np.abs(one.gamma).reshape(k, 3).max(axis=1))
    rounding = np.array(ContactEvaluation(points, one, force, sticking(points)).rounding)
    agree(rounding / ACCELERATION, ACCELERATION_M_S2 / ACCELERATION + np.maximum(terms, one.scales))


@pytest.mark.parametrize(("a", "b"), [("sphere", "box"), ("box", "sphere"), ("capsule", "capsule"), ("box", "box")])
def test_a_point_of_a_pair_without_friction_has_no_tangents(tmp_path, rng, a, b):
    """Beside the same with friction, whose normal row it has."""
    pair, model, data = pair_of(tmp_path, shape(a), shape(b))
    found = features(pair, model, data, in_contact(pair, model, data, rng))[0]
    pair.mu, smooth = 0.5, copy(pair)
    smooth.mu = 0.0
    points = [ContactPoint(pair, found), ContactPoint(smooth, found)]
    rows = RowEvaluator(Motion(model, data), data, points).rows()
    J = rows.J.reshape(2, 3, -1)
    agree(J[0, 0], J[1, 0], 1e-14)
    assert not J[1, 1:].any()
    assert not rows.axes[1, 1:].any()
    np.testing.assert_allclose(rows.axes[0] @ rows.axes[0].T, np.eye(3), atol=1e-14)


@pytest.mark.parametrize("case", range(24))
def test_forces_of_held_rows(rng, case):
    """Four points of a body, with dependent rows; modes at random, also with none that holds, sliding points in half."""
    places, k = rng.uniform(-1.0, 1.0, (4, 3)), 4
    places[:, 2] = 0.3
    rows = np.vstack([np.hstack((np.eye(3)[[2, 0, 1]], np.cross(place, np.eye(3)[[2, 0, 1]]))) for place in places])
    G = rows @ np.diag(rng.uniform(0.5, 2.0, 6)) @ rows.T
    b, mu = rows @ rng.normal(size=6), np.array([0.3, 0.0, 0.05, 0.1])
    kinds = rng.choice([CLOSED, SLIDE, STICK], k) if case else np.full(k, CLOSED)
    kinds = np.where((kinds == SLIDE) & (mu > 0.0), STICK, kinds) if case % 2 else kinds
    angles = rng.uniform(0.0, 2.0 * np.pi, k)
    slips = np.column_stack((np.cos(angles), np.sin(angles))) * ((kinds == SLIDE) & (mu > 0.0))[:, None]
    problem = FrictionProblem(G, b, mu)
    structure = problem.structure(kinds)
    held, D, which = ActiveForces(problem, structure), along_rows(kinds, mu, slips), structure.rows
    forces = held.forces(b, slips)
    agree(forces.ravel(), spring_forces(G, b, D, which))
    agree(held.forces(2.0 * b, slips), 2.0 * forces)
    assert held.redundant == (np.linalg.matrix_rank(G[np.ix_(which, which)], tol=1e-9) < len(which))
    U = span(G[np.ix_(which, which)])
    assert held.is_regular(slips) == (np.linalg.slogdet(U.T @ G[which] @ D @ U)[0] > 0.0)
    if len(which):
        other = rng.normal(size=(2, 6)) @ rows.T
        square = U.T @ G[np.ix_(which, which)] @ U
        responses = np.linalg.solve(square, (other[:, which] @ U).T)
        agree(held.springs(other[:, which], forces), responses.T @ U.T @ forces.ravel()[which])
        masses = np.sum((other[:, which] @ U).T * responses, axis=0)
        assert held.decide(other[:, which], masses * (1.0, 1.1)).tolist() == [True, False]
    slides = np.flatnonzero((kinds == SLIDE) & (mu > 0.0))
    if len(slides):
        across, step = np.column_stack((-slips[slides, 1], slips[slides, 0])), 1e-4
        held.turn_to(slips)
        changes = held.responses_to_turns(slides, across, forces[slides, 0])
        for column, point in zip(changes.T, slides, strict=True):
            ends = []
            for turn in (-step, step):
                turned = slips.copy()
                turned[point] = np.cos(turn) * slips[point] + np.sin(turn) * np.array((-slips[point, 1], slips[point, 0]))
                ends.append(ActiveForces(problem, structure).forces(b, turned).ravel())
            # A central difference: its error is the square of the step times the forces.
            np.testing.assert_allclose(column, (ends[1] - ends[0]) / (2.0 * step), rtol=0, atol=1e-6 * np.abs(forces).max())


def along_rows(kinds, mu, slips):
    """Directions of forces by held row, (3k, r): a sliding point has friction along with its normal force."""
    columns = []
    for point, kind in enumerate(kinds):
        unit = np.zeros((3, 3 * len(kinds)))
        unit[:, 3 * point : 3 * point + 3] = np.eye(3)
        if kind == SLIDE:
            columns.append(unit[0] - mu[point] * slips[point] @ unit[1:])
        elif kind == STICK:
            columns += list(unit)
    return np.array(columns).reshape(-1, 3 * len(kinds)).T


def span(square):
    """Orthonormal basis of the range of a symmetric matrix."""
    values, vectors = np.linalg.eigh(square)
    return vectors[:, values > RANK * values.max(initial=0.0)]


def spring_forces(G, b, D, which):
    """Forces in the range of the held rows that leave these no acceleration."""
    U = span(G[np.ix_(which, which)])
    return D @ U @ np.linalg.solve(U.T @ G[which] @ D @ U, -U.T @ b[which])


def test_contact_without_friction(resting, rng):
    """A cone of width zero: the complementarity problem by trying all sets of active contacts, and forces in any modes."""
    pair, motion, points, force = resting
    pair.mu, k = 0.0, len(points)
    for pushed in (force, -force, rng.permuted(force), 50.0 * rng.normal(size=len(force))):
        rows, modes = RowEvaluator(motion, motion.data, points).rows(), FrictionModes()
        free = rows.J @ np.linalg.solve(mass_matrix(motion.model, motion.data), pushed) + rows.gamma
        G, free = rows.G[::3, ::3], free[::3]
        chosen = Decision(ContactEvaluation(points, rows, pushed, modes.of(points)), modes)
        opens = free + G @ complementary(G, free)
        assert chosen.forces.min() >= 0.0
        agree(free + G @ chosen.forces, opens, 1e-10)  # unique, though the forces are not
        chosen.keep_modes()
        here = ContactEvaluation(points, rows, pushed, modes.of(points))
        agree(Decision(here, modes).forces, chosen.forces)
        assert (here.settled() is not None) == (pushed is force), "steady where all press"
        for which in ((), (1,), (0, 2), (0, 1, 2), range(k)):
            held = np.zeros(k)
            held[list(which)] = np.linalg.lstsq(G[np.ix_(which, which)], -free[list(which)], rcond=RANK)[0]
            modes = FrictionModes()
            kinds = np.where(np.isin(np.arange(k), list(which)), SLIDE, CLOSED)
            modes.set(points, kinds, np.zeros((k, 3)), np.zeros(k), *np.zeros((2, k), dtype=bool))
            stage, generalised = ContactEvaluation(points, rows, pushed, modes.of(points)).present_stage()
            agree(stage.forces, held)
            agree(generalised, held @ rows.J[::3])
            agree(stage.power, generalised * motion.data.qvel)
            agree(np.array(stage.wrenches), np.array(rows.wrenches(np.kron(held, (1.0, 0.0, 0.0)))))


def complementary(G, free):
    """Forces without a negative one that leave no negative acceleration, by trying sets."""
    k, scale = len(free), 1.0 + np.abs(free).max()
    for which in map(list, chain.from_iterable(combinations(range(k), size) for size in range(k + 1))):
        forces = np.zeros(k)
        forces[which] = np.linalg.lstsq(G[np.ix_(which, which)], -free[which], rcond=RANK)[0]
        if forces.min() >= -1e-9 * scale and (free + G @ forces).min() >= -1e-9 * scale:
            return forces
    raise AssertionError("no active set solves the problem")


def sticking(points, **changes):
    """Modes of points that all stick."""
    modes, k = FrictionModes(), len(points)
    modes.set(points, np.full(k, STICK), np.zeros((k, 3)), np.zeros(k), *np.zeros((2, k), dtype=bool))
    return replace(modes.of(points), structures={}, **changes)


def test_points_that_stick(resting):
    """Inside their cones and outside, below the drift of sticking points and above."""
    _, motion, points, force = resting
    evaluator, k = RowEvaluator(motion, motion.data, points), len(points)
    for pushed in (force, -force):
        rows = evaluator.rows()
        assert ContactEvaluation(points, rows, pushed, sticking(points)).settled() is None
        here = ContactEvaluation(points, rows, pushed, sticking(points, stop_speeds=np.full(k, 1e6)))
        b = rows.J @ np.linalg.solve(mass_matrix(motion.model, motion.data), pushed) + rows.gamma
        agree(here.problem.b, b)
        expected = np.linalg.lstsq(rows.G, -b, rcond=RANK)[0]
        stage, generalised = here.present_stage()
        agree(stage.forces, expected[::3])
        agree(generalised, expected @ rows.J)
        agree(np.array(stage.wrenches), np.array(rows.wrenches(expected)))
        solution, forces, mu = here.settled(), expected.reshape(-1, 3), np.full(k, 0.5)
        margin = (cone_depth(forces, mu) + ON_CONE * np.abs(forces).max()) * rows.G.diagonal()[::3].mean()
        assert (solution is not None) == (pushed is force) == (margin > 0.0)
        if solution is not None:
            agree(solution.forces, forces)
            agree(solution.accelerations.ravel(), b + rows.G @ expected)
            assert solution.validity == pytest.approx(margin, rel=1e-9)
            agree(here.limit_ratios(forces), np.hypot(*forces.T[1:]) / (0.5 * forces[:, 0]))


@pytest.mark.parametrize("kinds", [None, (STICK,) * 4, (STICK, STICK, CLOSED, STICK), (STICK, SLIDE, STICK, CLOSED)])
def test_stages_inside_a_step(resting, rng, kinds):
    """State after state in the same memory: without friction, with points that stick, with one without force or sliding."""
    pair, motion, points, force = resting
    data, modes, along_x = motion.data, FrictionModes(), np.tile((1.0, 0.0, 0.0), (4, 1))
    pair.mu = 0.5 if kinds else 0.0
    modes.set(points, np.array(kinds or (SLIDE,) * 4), along_x, np.zeros(4), *np.zeros((2, 4), dtype=bool))
    evaluator = RowEvaluator(motion, data, points)
    inside = StageForces(Smooth(motion, data), evaluator, points, modes.of(points))
    for _ in range(3):
        data.qvel[:] = 0.1 * rng.normal(size=len(force))
        mujoco.mj_forward(motion.model, data)
        applied = force + 0.0
        stage = inside.add(applied)
        rows = evaluator.rows()
        smooth = data.qfrc_passive - data.qfrc_bias + data.qfrc_actuator + force
        b = rows.J @ np.linalg.solve(mass_matrix(motion.model, data), smooth) + rows.gamma
        if kinds is None:
            D, which = np.eye(12)[:, ::3], np.arange(0, 12, 3)
        else:
            slips = rows.slips / np.hypot(*rows.slips.T)[:, None]
            D = along_rows(kinds, np.full(4, 0.5), slips)
            which = FrictionProblem(rows.G, b, np.full(4, 0.5)).active_rows(np.array(kinds))
        along = spring_forces(rows.G, b, D, which)
        agree(applied, force + along @ rows.J)
        agree(stage.power, (along @ rows.J) * data.qvel)
        agree(np.array(stage.wrenches), np.array(rows.wrenches(along)))
        assert (stage.slide is not None) == (kinds is not None and SLIDE in kinds)


def test_sums_of_stages(resting, rng):
    _, motion, points, force = resting
    rows, parts = RowEvaluator(motion, motion.data, points).rows(), np.array([0.1, 0.2, 0.3, 0.4])
    loads = (force, -2.0 * force, 0.5 * force, 3.0 * force)
    stages = [ContactEvaluation(points, rows, each, sticking(points)).present_stage()[0] for each in loads]
    sums = StageSums(stages, parts)
    wrenches = np.array([stage.wrenches for stage in stages])
    agree(sums.work, parts @ np.array([stage.power for stage in stages]))
    assert sums.total == pytest.approx(sums.work.sum(), rel=1e-12)
    agree(sums.impulses, np.tensordot(parts, wrenches, 1))
    agree(sums.sizes, parts @ np.linalg.norm(wrenches[:, :, :3], axis=2))
    groups, robot = len(sums.impulses), slice(1, 7)
    signs, outside = rng.normal(size=groups), rng.normal(size=(2, groups))
    exchange = sums.exchange(signs, outside, robot)
    own = sums.work[robot].sum()
    for found, expected in zip(
        exchange[:3], ((sums.total, own, sums.total - own), signs @ sums.impulses, outside @ sums.impulses), strict=True
    ):
        agree(found, np.array(expected))


def test_smooth_forces(resting, rng):
    """Efforts are those of the logged system; a token is the same object while what it stands for is."""
    _, motion, _, _ = resting
    model, data, pushes = motion.model, motion.data, rng.normal(size=motion.model.nv)
    for logged in (data, mujoco.MjData(model)):
        logged.ctrl[:] = rng.normal(size=model.nu)
        smooth, other = Smooth(motion, logged), mujoco.MjData(model)
        other.qpos[:], other.qvel[:], other.ctrl[:] = data.qpos, data.qvel, logged.ctrl
        mujoco.mj_forward(model, other)
        agree(smooth.force(pushes), other.qfrc_passive - other.qfrc_bias + other.qfrc_actuator + pushes, 1e-12)
        kinematics, load, state = smooth.kinematics(), smooth.load(pushes), smooth.state(pushes)
        assert smooth.kinematics() is kinematics
        assert smooth.load(pushes) is load
        assert smooth.state(pushes) is state
        assert smooth.load(pushes + 1.0) is not load
        assert smooth.state(pushes + 1.0) is not state
        data.qvel[0] += 1.0
        assert smooth.kinematics() is not kinematics


@pytest.mark.parametrize("mu", [0.0, 0.5])
def test_a_saved_state_goes_on_bit_for_bit(tmp_path, mu):
    """What the core keeps of a state is found again, or computed again."""
    with Simulator(on_floor(tmp_path, duration_s=0.04, mu=mu, geom='type="box" size="1 1 1"')) as simulator:
        simulator.reset()
        simulator.step()
        saved, ends = SimulatorState.from_bytes(simulator.get_state().to_bytes()), []
        for _ in range(2):
            simulator.set_state(saved)
            for _ in range(3):
                simulator.step()
            data = simulator.assembly.data
            ends.append(np.concatenate((data.qpos, data.qvel, data.qacc, data.qfrc_applied)))
        np.testing.assert_array_equal(*ends)
