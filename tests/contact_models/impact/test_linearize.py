"""Saltation matrices against closed forms, invariants, published digits and runs of displaced scenes."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.arrays import FloatArray
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.errors import UnsupportedContactError
from ffsm_mj.impact import linearize
from tests.scenes import ball, box, scene

DIGITS = 1e-7
"""Of central differences at 1e-5: truncation 1e-10, and rounding of the impact map, whose normal is known to 1e-13."""


def linearized(prepared, qpos, qvel, *, pair=0, **given):
    """Saltation of a pair of a prepared scenario at a state."""
    assembly = prepared.assemble()
    data = assembly.data
    data.qpos[:], data.qvel[:] = qpos, qvel
    mujoco.mj_forward(assembly.system.mj, data)
    return linearize(assembly.system.mj, data, assembly.pairs[pair], **given)


def flight(nv: int, time: float) -> FloatArray:
    """Transition matrix of free flight of bodies that do not turn."""
    return np.block([[np.eye(nv), time * np.eye(nv)], [np.zeros((nv, nv)), np.eye(nv)]])


def balls(tmp_path, *, masses, radii, restitution, joints="x", gap=5.0, **extra):
    names = ("ball", "target")
    robot, other = (ball(n, mass=m, radius=r, joints=joints) for n, m, r in zip(names, masses, radii, strict=True))
    rules = [{"between": ["ball", "target/target"], "restitution": restitution, **extra}]
    initial = {"joints": {"target/x": gap} if joints != "free" else {"target/free": [gap, 0, 0, 1, 0, 0, 0]}}
    return prepare(scene(tmp_path, robot, {"target": other}, initial=initial, contacts={"rules": rules}))


def test_equal_balls_exchange_their_perturbations(tmp_path):
    """Balls of radius 0.1 at 0 and 0.52, v = 1 and 0, over 1 s (nimblephysics#97)."""
    prepared = balls(tmp_path, masses=(1, 1), radii=(0.1, 0.1), restitution=1.0)
    t = 0.32
    found = linearized(prepared, (t, 0.52), (1.0, 0.0))
    whole = flight(2, 1 - t) @ found.S @ flight(2, t)
    assert whole == pytest.approx(np.array([[0, 1, 0, 1], [1, 0, 1, 0], [0, 0, 0, 1], [0, 0, 1, 0]]), abs=DIGITS)


def test_ball_on_a_heavy_wall(tmp_path):
    """Gap 0.8, v = 2, e = 0.7, 1 s; the wall has 1e9 kg, whose share is 1e-9."""
    e = 0.7
    prepared = balls(tmp_path, masses=(1, 1e9), radii=(0.1, 0.1), restitution=e)
    found = linearized(prepared, (0.8, 1.0), (2.0, 0.0))
    whole = flight(2, 0.6) @ found.S @ flight(2, 0.4)
    wanted = [[-e, 1 + e, -e, 1 + e], [0, 1, 0, 1], [0, 0, -e, 1 + e], [0, 0, 0, 1]]
    assert whole == pytest.approx(np.array(wanted), abs=DIGITS)
    time, impulse = found.time @ flight(2, 0.4), found.impulse @ flight(2, 0.4)
    assert time == pytest.approx([-0.5, 0.5, -0.2, 0.2], abs=1e-8)
    assert impulse == pytest.approx([0, 0, 1 + e, -(1 + e)], abs=1e-8)
    assert found.impulse_by_restitution == pytest.approx(2.0, rel=1e-8)


def test_bouncing_ball(tmp_path):
    """G = 9.81 m/s^2, e = 0.8, from 1 m: S21 = -(1 + e) g / v-; S sends f- to f+ and has the determinant e^2."""
    g, e = 9.81, 0.8
    path = scene(
        tmp_path,
        ball("ball", joints="z"),
        {"floor": box("floor").replace('<freejoint name="free"/>', "")},
        fixed={"floor": {"position_m": [0.0, 0.0, -0.5]}},
        initial={"joints": {"robot/z": 1.1}},
        contacts={"rules": [{"between": ["ball", "floor/floor"], "restitution": e}]},
    )
    assembly = prepare(path).assemble()
    model, data = assembly.system.mj, assembly.data
    model.opt.gravity[2] = -g
    v = -np.sqrt(2 * g)
    data.qpos[:], data.qvel[:] = 0.1, v
    mujoco.mj_forward(model, data)
    found = linearize(model, data, assembly.pairs[0])
    assert pytest.approx(np.array([[-e, 0.0], [-(1 + e) * g / v, -e]]), abs=DIGITS) == found.S
    assert found.S[1, 0] == pytest.approx(3.9865022262630183, abs=1e-7)
    assert found.time == pytest.approx([-1 / v, 0.0])


def test_spheres_in_space(tmp_path):
    """Masses 2 and 3, radii 0.1 and 0.15: forty-digit derivatives of the closed form over 1.5 s."""
    prepared = balls(tmp_path, masses=(2, 3), radii=(0.1, 0.15), restitution=0.6, joints="free")
    t, rest = 0.5930257131138265, 1.5 - 0.5930257131138265
    v1, v2 = np.array([1, 0.1, 0]), np.array([-0.3, 0, 0.05])
    qpos = np.concatenate((v1 * t, [1, 0, 0, 0], np.array([1, 0.12, 0.05]) + v2 * t, [1, 0, 0, 0]))
    spin = np.array([0.3, -1.0, 2.0])
    found = linearized(prepared, qpos, np.concatenate((v1, spin, v2, -spin)))
    before, whole = flight(12, t), flight(12, rest) @ found.S @ flight(12, t)
    vx1, y2, vx2, vy2 = 12, 7, 18, 19
    assert found.impact.impulses[0] == pytest.approx(2.303030195894096, abs=1e-12)
    assert (found.time @ before)[[y2, vx1]] == pytest.approx([0.20240996108503356, -0.4529985696128337], abs=DIGITS)
    assert (found.impulse @ before)[y2] == pytest.approx(-1.8785507231790308, abs=DIGITS)
    assert whole[vx2, y2] == pytest.approx(-1.381755072403101, abs=DIGITS)
    assert whole[vy2, y2] == pytest.approx(2.856521829470838, abs=DIGITS)
    assert whole[y2, y2] == pytest.approx(3.553065868081145, abs=DIGITS)
    assert np.abs(found.S[15:18, :15]).max() < DIGITS  # spins of smooth spheres are neither changed nor felt


@pytest.mark.long
@pytest.mark.parametrize("name", ["coasting", "spatial"])
@pytest.mark.parametrize("mu", [0.0, 0.15])
def test_invariants_at_impacts_of_scenarios(name, mu):
    """S f- = f+ under any efforts; without friction det S = e^2 and J C = -e J."""
    target = ffsm_mj.impact_map(name, {"contacts.rules.0.mu": mu}, samples=1, starts=0).target
    random, nv = np.random.default_rng(3), target.system.mj.nv
    efforts = {key: random.normal(size=nv) for key in ("effort_before", "effort_after")}
    found = linearize(target.system.mj, target.data(), target.pair, **efforts)
    scale = np.abs(found.S).max()
    # S f- = DR f- + (f+ - DR f-) (n f- / u), and n f- = u to rounding.
    assert np.abs(found.S @ found.f_before - found.f_after).max() < 1e-12 * scale
    assert found.f_before[nv:] != pytest.approx(found.f_after[nv:], abs=1e-3)
    C = found.S[nv:, nv:]
    if mu == 0.0:
        e = target.pair.restitution
        assert np.linalg.det(found.S) == pytest.approx(e**2, rel=1e-6)
        assert np.abs(found.J @ C + e * found.J).max() < 1e-10
        assert found.S[:nv, :nv] == pytest.approx(C, abs=1e-6)  # the position block is the velocity block
    else:
        assert found.impact.friction is not None
        # Columns of a displaced velocity, by the same law.
        assert np.linalg.norm(found.S[:nv, :nv] - C) > 1e-3  # friction breaks their equality


@pytest.mark.long
@pytest.mark.parametrize(
    ("key", "mu", "wanted"),
    [("object/x", 0.0, {"time": -3.08737}), ("object/y", 0.0, {"impulse": 1.0139}), ("object/y", 0.15, {})],
)
def test_derivatives_are_those_of_runs(key, mu, wanted):
    """Of the impact of `coasting` with the place of the resting box, against central differences of runs at 1e-5 m."""
    rough = {"contacts.rules.0.mu": mu}
    target = ffsm_mj.impact_map("coasting", rough, samples=1, starts=0).target
    found = linearize(target.system.mj, target.data(), target.pair)
    at = target.system.joint(key).dofs.start
    h, nominal = 1e-5, {"object/x": 3.5, "object/y": -0.5}[key]
    short = {"stop_on_impact": True} | rough
    low, high = (ffsm_mj.run("coasting", short | {f"initial.joints.{key}": nominal + s}).impacts[0] for s in (-h, h))
    # A shift of the resting box before the run is the same shift at the impact. Error of the differences: 1e-16 / 1e-5
    # of what RK4 leaves, and h^2 of the curvature.
    assert (high.time_s - low.time_s) / (2 * h) == pytest.approx(found.time[at], abs=1e-6)
    assert abs(found.impulse[at]) > 1e-3
    assert (high.impulse_N_s - low.impulse_N_s) / (2 * h) == pytest.approx(found.impulse[at], abs=1e-6)
    for name, value in wanted.items():
        assert getattr(found, name)[at] == pytest.approx(value, abs=2e-4)


def test_what_has_no_derivative_is_refused(tmp_path):
    prepared = balls(tmp_path, masses=(1, 1), radii=(0.1, 0.1), restitution=1.0)
    with pytest.raises(UnsupportedContactError, match="does not approach"):
        linearized(prepared, (0.32, 0.52), (-1.0, 0.0))
    flat = scene(
        tmp_path,
        box("robot_box"),
        {"other": box("other")},
        initial={"joints": {"other/free": [2, 0, 0, 1, 0, 0, 0]}},
        contacts={"rules": [{"between": ["robot_box", "other/other"]}]},
    )
    with pytest.raises(UnsupportedContactError, match="4 contact points at one instant"):
        linearized(prepare(flat), (0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 1, 0, 0, 0), [1] + 11 * [0])


def test_a_boundary_of_contact_modes_is_refused(tmp_path):
    """A sphere that neither spins nor slides: any slip to a side is another mode."""
    prepared = balls(tmp_path, masses=(1, 1), radii=(0.1, 0.1), restitution=0.5, joints="free", mu=0.3)
    with pytest.raises(UnsupportedContactError, match="contact modes change"):
        linearized(prepared, (0.32, 0, 0, 1, 0, 0, 0, 0.52, 0, 0, 1, 0, 0, 0), [1] + 11 * [0])
