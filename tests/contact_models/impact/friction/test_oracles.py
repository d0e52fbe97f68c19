"""Independent solutions: many small impulses, Pinocchio's cone solvers, frictionless laws, Newton's law and its energy."""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np
import pytest

from ffsm_mj.contact_models.impact.friction.coulomb import CoulombProblem, coulomb
from ffsm_mj.contact_models.impact.friction.laws import impact_with_friction
from ffsm_mj.contact_models.impact.friction.routh import stronge
from ffsm_mj.contact_models.impact.laws import FRICTIONLESS, _reflections, project
from tests.contact_models.impact.friction.problems import PENDULUM, energy, newton_with_friction, problem, rod, rows
from tests.contact_models.impact.friction.test_one_contact import random_contact

pin = pytest.importorskip("pinocchio")


def many_small_impulses(G, u, mu, e, steps):
    """Velocity after of m contacts at once, (m, 3); friction of each small normal impulse is solved at its end."""
    given = -u[:, 0] / (steps * G[:, 0, 0])
    g, H = G[:, 1:, 0] * given[:, None], G[:, 1:, 1:]
    share, radius = 1.0 / np.linalg.eigvalsh(H)[:, -1:], (mu * given)[:, None]
    work, deepest, friction = np.zeros(len(u)), np.zeros(len(u)), np.zeros((len(u), 2))
    compressing, ended, after = np.ones(len(u), bool), np.zeros(len(u), bool), u.copy()
    for _ in range(40 * steps):
        free = u[:, 1:] + g
        for _ in range(15):  # projected steps from the friction of the impulse before
            wanted = friction - share * (free + np.einsum("mij,mj->mi", H, friction))
            length = np.maximum(np.hypot(wanted[:, 0], wanted[:, 1]), 1e-300)[:, None]
            friction = wanted * np.minimum(1.0, radius / length)
        then = u + np.einsum("mij,mj->mi", G, np.column_stack((given, friction)))
        work += 0.5 * given * (u[:, 0] + then[:, 0])
        turns = compressing & (then[:, 0] >= 0.0)
        deepest = np.where(turns, np.minimum(deepest, work), deepest)
        compressing = (compressing & ~turns) | (~compressing & (then[:, 0] < 0.0))
        ends = ~compressing & ~ended & (work >= (1.0 - e * e) * deepest)
        after[ends] = then[ends]
        ended |= ends
        u = then
        if ended.all():
            break
    assert ended.all()
    return after


@pytest.mark.long
@pytest.mark.parametrize("seed", range(10))
def test_one_contact_by_many_small_impulses(seed):
    """200 contacts: the path ends within three of the small impulses, each of which changes u by G_ij / (G_nn steps)."""
    rng, steps = np.random.default_rng([7, seed]), 300
    found = []
    while len(found) < 20:
        A, w, mu, e = random_contact(rng)
        if np.linalg.cond(A) < 10.0:
            found.append((A, w / np.abs(A @ w).max(), mu, e))
    G, u = np.array([A @ A.T for A, *_ in found]), np.array([A @ w for A, w, *_ in found])
    mu, e = np.array([one[2] for one in found]), np.array([one[3] for one in found])
    ours = np.array([A @ stronge(A, w, *rest).w for A, w, *rest in found])
    missed = np.abs(many_small_impulses(G, u, mu, e, steps) - ours).max(axis=1)
    assert np.all(missed <= 3.0 * np.abs(G).max(axis=(1, 2)) / G[:, 0, 0] / steps)


def pinocchio_impulses(solver, G, u, mu):
    """Impulses (k, 3) of a cone solver of Pinocchio, whose normal is the third row; None if it does not converge."""
    order = np.concatenate([3 * i + np.array([1, 2, 0]) for i in range(len(mu))])
    model = pin.Model()
    model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "body")
    models, datas, points = pin.StdVec_ConstraintModel(), pin.StdVec_ConstraintData(), []
    for one in mu:
        point = pin.PointContactConstraintModel(model, 0, pin.SE3.Identity(), 1, pin.SE3.Identity())
        point.setFriction(one)
        points.append(point)
        models.append(pin.ConstraintModel(point))
        datas.append(models[-1].createData())
    settings, result = getattr(pin, f"{solver}SolverSettings")(), getattr(pin, f"{solver}SolverResult")()
    settings.absolute_feasibility_tol = settings.absolute_complementarity_tol = 1e-11
    settings.relative_feasibility_tol = settings.relative_complementarity_tol = 0.0
    settings.max_iterations, settings.solve_ncp = 20_000, True
    delassus = pin.DelassusOperatorDense(np.asfortranarray(G[np.ix_(order, order)]))
    if not getattr(pin, f"{solver}ConstraintSolver")(len(u)).solve(delassus, u[order], models, datas, settings, result):
        return None
    impulses = np.empty(len(u))
    impulses[order] = result.retrieveConstraintImpulses()
    return impulses.reshape(-1, 3)


@pytest.mark.parametrize("solver", ["ADMM", "PGS"])
def test_the_plastic_step_is_pinocchios(solver):
    """Full rank, where the solution is unique: velocities to 1e-8; the solver stops at 1e-11 of impulses and velocities."""
    compared = 0
    for seed in range(20):
        A, w, mu, _ = problem(np.random.default_rng([3, seed]), 0)
        G, u = A @ A.T, A @ w
        ours, residual = coulomb(contacts := CoulombProblem(G, u, mu, np.zeros(len(mu)), float(np.abs(u).max())))
        assert residual <= 1e-9
        theirs = pinocchio_impulses(solver, G, u, mu)
        if theirs is not None and ours.any():
            np.testing.assert_allclose(contacts.after(ours), contacts.after(theirs), rtol=0, atol=1e-8 * np.abs(u).max())
            compared += 1
    assert compared >= 12


@pytest.mark.parametrize("law", ["blend", "poisson"])
def test_little_friction_is_nearly_none(law):
    """With mu = 1e-6 the frictionless law to 1e-4, unless an elastic impulse is below the plastic one, clipped at zero."""
    compared = 0
    for seed in range(60):
        A, w, mu, e = problem(np.random.default_rng([4, seed]), seed % 3)
        N = A[::3]
        elastic, jammed = _reflections(N, w)
        if jammed or (law == "blend" and np.any(elastic < project(N, w) - 1e-9)):
            continue
        plain = FRICTIONLESS[law](N, w, e)
        result = impact_with_friction(A, w, np.full(len(mu), 1e-6), e, law)
        np.testing.assert_allclose(result.w, plain.w, rtol=0, atol=1e-4 * np.abs(w).max())
        compared += bool(plain.impulses.any())
    assert compared >= 35


@pytest.mark.parametrize(
    ("G", "before", "mu", "e", "after", "change"),
    [
        (rod(45), (-1, 1, 0), 0.3, 0.5, (0.5, 0, 0), -0.171875),
        (rod(55), (-1, 0.7, 0), 0.3, 1.0, (1, 0, 0), 0.1249674136),
        (PENDULUM, (-0.1342020143, -0.2671743428, 0), 0.5, 0.5, (0.0671010072, 0, 0), 0.0136189557),
        (PENDULUM, (-0.1342020143, -0.2671743428, 0), 0.7, 0.7, None, 0.0489473),
    ],
)
def test_newtons_law_gains_energy_where_stronges_does_not(G, before, mu, e, after, change):
    """The reason to refuse it: a rod at 55 degrees gains half of the kinetic energy of its contact."""
    A, w = rows(G, before)
    newton = newton_with_friction(A, w, mu, e)
    if after is not None:
        np.testing.assert_allclose(A @ newton, after, rtol=0, atol=1e-9)
    assert energy(newton) - energy(w) == pytest.approx(change, abs=1e-7 if after is None else 1e-9)
    assert energy(stronge(A, w, mu, e).w) < energy(w)


def test_newtons_law_gains_energy_at_random_contacts(monkeypatch, rng):
    monkeypatch.setattr(
        "ffsm_mj.contact_models.impact.friction.coulomb._FACETS", ((8, 0.0),)
    )  # often there is no solution to look for
    gained = 0
    for _ in range(150):
        A, w, mu, e = random_contact(rng)
        after = newton_with_friction(A, w, mu, e)
        gained += after is not None and energy(after) > energy(w) * (1 + 1e-9)
        assert energy(stronge(A, w, mu, e).w) <= energy(w)
    assert gained > 3


def test_the_figure_of_energy_gain():
    """Newton's law gains half at mu = 0.3, e = 1; Stronge's law conserves all energy only without friction."""
    page = runpy.run_path(str(Path(__file__).parents[4] / "docs" / "friction_energy.py"))
    mu, e, found = page["energies"](11)
    assert (mu[3], e[-1]) == (pytest.approx(0.3), 1.0)
    stronge_s, newton_s = found.values()
    assert newton_s[-1, 3] == pytest.approx(1 + 0.1249674136 / 0.2516613632, abs=1e-9)
    assert stronge_s[-1, 3] == pytest.approx(1 - 0.0687596295 / 0.2516613632, abs=1e-9)
    assert stronge_s.max() == pytest.approx(1.0, abs=1e-12)
    assert stronge_s[:, 1:].max() < 1.0
