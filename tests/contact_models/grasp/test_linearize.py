"""Saltation matrices of grasps against runs of displaced scenes and invariants."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly.grasps import grasps_of
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.contact_models.grasp.latch_joints import relative_twist_rows
from ffsm_mj.errors import InputError, UnsupportedContactError
from ffsm_mj.impact import linearize_grasp
from tests.controllers.detumbling import spacecraft
from tests.scenes import box, scene

BOX = box("box", mass=8.0, half=(0.1, 0.2, 0.15)).replace("</body>", '<site name="handle" pos="-0.1 0.02 0"/></body>')
JOINTS = {
    "base": [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
    "shoulder": 0.1,
    "box/free": [1.1, 0.02, -0.03, 0.98, 0.1, -0.1, 0.14],
}
RATES = {"base": [0.05, 0.02, 0.0, 0.05, -0.02, 0.04], "shoulder": 0.05, "box/free": [-0.2, 0.02, 0.01, 0.1, 0.2, -0.15]}
STEP = 1e-5
"""Displacement of the initial state: truncation is a hundredth of that at 1e-4, and times of events are known to 1e-13 s."""
POSITION = {"position_m": 0.08}


def prepared(folder, within=POSITION, joints=JOINTS, rates=RATES, **latch):
    """A spinning robot with unpowered joints, and a box that drifts towards its tip."""
    folder.mkdir(exist_ok=True)
    grasp = {"robot_site": "tip", "object_site": "box/handle", "when": {"within": within}, **latch}
    path = scene(
        folder,
        spacecraft(),
        {"box": BOX},
        duration_s=1.5,
        time_step_s=0.01,
        control_period_s=0.01,
        initial={"joints": joints, "rates": rates},
        grasps={"grasp": grasp},
        phases=[{"name": "all", "until": "end", "arm": ["grasp"], "controller": {"kind": "off"}}],
    )
    return prepare(path)


def state(record, system):
    """Coordinates, and velocities before and after a capture."""
    before, after = (
        np.concatenate([qvel[name] for name in system.joints]) for qvel in (record.qvel_before, record.qvel_after)
    )
    return np.array(record.qpos), before, after


def linearized(made, record, bounds):
    assembly = made.assemble()
    system, data = assembly.system, assembly.data
    data.qpos[:], data.qvel[:], _ = state(record, system)
    mujoco.mj_forward(system.mj, data)
    (grasp,) = grasps_of(made.scenario, system)
    return system, linearize_grasp(system, data, grasp, bounds)


def displaced(model, direction, h):
    """Initial coordinates and rates by joint, displaced along a direction of the tangent space."""
    q = np.concatenate([np.atleast_1d(JOINTS["base"]), np.zeros(3), [JOINTS["shoulder"]], JOINTS["box/free"]])
    v = np.concatenate([RATES["base"], np.zeros(3), [RATES["shoulder"]], RATES["box/free"]])
    mujoco.mj_normalizeQuat(model, q)
    mujoco.mj_integratePos(model, q, direction[: model.nv], h)
    v = v + h * direction[model.nv :]
    wheels = range(3)
    joints = {"base": q[:7], **{f"wheel_{i}": q[7 + i] for i in wheels}, "shoulder": q[10], "box/free": q[11:]}
    rates = {"base": v[:6], **{f"wheel_{i}": v[6 + i] for i in wheels}, "shoulder": v[9], "box/free": v[10:]}
    return tuple({name: np.asarray(x).tolist() for name, x in each.items()} for each in (joints, rates))


@pytest.mark.long
@pytest.mark.parametrize(
    ("within", "latch"),
    [
        (POSITION, {}),
        (POSITION, {"joint": "hinge", "axis": [0.0, 0.6, 0.8]}),
        (POSITION, {"joint": "cylindrical", "axis": [1.0, 0.0, 0.2]}),
        ({"position_m": 0.5, "speed_m_s": 0.26}, {"joint": "ball"}),
        ({"position_m": 0.5, "angle_rad": 0.33}, {"joint": "slide", "axis": [0.0, 1.0, 0.0]}),
    ],
    ids=["rigid", "hinge", "cylindrical", "ball by speed", "slide by angle"],
)
def test_displaced_runs_change_as_the_saltation_says(tmp_path, within, latch, rng):
    """With dx = x' - x - f dt at the nominal time before and after: dx+ = S dx-, dt = time . dx-, from records alone."""
    made = prepared(tmp_path / "nominal", within, **latch)
    nominal = made.run()
    (record,) = nominal.records["grasp_impulses"]
    bounds = [within.get(key) for key in ("position_m", "angle_rad", "speed_m_s", "rate_rad_s")]
    system, found = linearized(made, record, bounds)
    model, (q, before, after) = system.mj, state(record, system)
    for _ in range(2):
        direction, ends = rng.normal(size=2 * model.nv), []
        for h in (-STEP, STEP):
            joints, rates = displaced(model, direction, h)
            run = prepared(tmp_path / "other", within, joints, rates, **latch).run()
            (other,) = run.records["grasp_impulses"]
            there, v, w = state(other, system)
            dq, dt = np.empty(model.nv), other.time_s - record.time_s
            mujoco.mj_differentiatePos(model, dq, 1.0, q, there)
            impulse = np.array([*other.impulse_N_s, *other.angular_impulse_N_m_s])
            ends.append((np.concatenate((dq, v - before)), np.concatenate((dq, w - after)), dt, impulse, other.loss_J))
        of_before, of_after, dt, impulse, loss = ((b - a) / (2.0 * STEP) for a, b in zip(*ends, strict=True))
        dx = of_before - found.f_before * dt
        tolerance = 2e-6 * np.linalg.norm(of_before)
        np.testing.assert_allclose(found.S @ dx, of_after - found.f_after * dt, atol=tolerance)
        assert found.time @ dx == pytest.approx(dt, abs=tolerance)
        np.testing.assert_allclose(found.impulse @ dx, impulse, atol=10.0 * tolerance)
        assert found.loss @ dx == pytest.approx(loss, abs=tolerance)


def test_invariants(tmp_path):
    """S f- = f+; the stopped velocities are gone whatever they were; det S = 0; the closed pose is at rest."""
    made = prepared(tmp_path)
    (record,) = made.run().records["grasp_impulses"]
    system, found = linearized(made, record, [0.08, None, None, None])
    nv = system.mj.nv
    np.testing.assert_allclose(found.S @ found.f_before, found.f_after, atol=1e-10)
    data = mujoco.MjData(system.mj)
    data.qpos[:] = record.qpos
    mujoco.mj_forward(system.mj, data)
    link, root = system.index("body", "robot/link"), system.index("body", "box/box")
    J = relative_twist_rows(system.mj, data, link, root, np.array(record.point_m))
    np.testing.assert_allclose(J @ found.reset[nv:, nv:], 0.0, atol=1e-8)
    np.testing.assert_allclose(J @ found.f_after[:nv], 0.0, atol=1e-12)
    assert np.linalg.matrix_rank(found.S, tol=1e-6) <= 2 * nv - 6 + 1
    assert abs(np.linalg.det(found.S)) < 1e-12


def test_what_has_no_derivative_is_refused(tmp_path):
    made = prepared(tmp_path)
    (record,) = made.run().records["grasp_impulses"]
    distance = record.position_m
    assert distance == pytest.approx(0.08, abs=1e-12)
    with pytest.raises(UnsupportedContactError, match="no bound is reached here"):
        linearized(made, record, [0.06, None, None, None])
    with pytest.raises(UnsupportedContactError, match="position_m, speed_m_s reach their bounds at one instant"):
        linearized(made, record, [0.08, None, record.speed_m_s, None])
    back = replace(record, qvel_before={name: tuple(-x for x in each) for name, each in record.qvel_before.items()})
    with pytest.raises(UnsupportedContactError, match="does not fall"):
        linearized(made, back, [0.08, None, None, None])


def test_derivatives_of_a_run_are_those_of_its_secants(tmp_path):
    """``exact`` against runs at plus and minus 1e-5 of a coordinate and a rate, relative 1e-6; control laws are refused."""
    run = prepared(tmp_path).run()
    of = ["grasps.0.time_s", "grasps.0.loss_J"]
    wrt = {"initial.joints.box/free.1": 1e-5, "initial.rates.box/free.0": 1e-5, "initial.rates.shoulder": 1e-5}
    exact, secant = ffsm_mj.sensitivity(run, of, wrt, kind="exact"), ffsm_mj.sensitivity(run, of, wrt)
    np.testing.assert_allclose(exact.derivative, secant.derivative, rtol=2e-5)
    assert "the closing time of grasp 1 by" in " ".join(exact.sentences())
    with pytest.raises(InputError, match="name those of one event"):
        ffsm_mj.sensitivity(run, [*of, "impacts.0.time_s"], wrt, kind="exact")
    with pytest.raises(InputError, match="has 0 contacts"):
        ffsm_mj.sensitivity(run, ["impacts.0.time_s"], wrt, kind="exact")
