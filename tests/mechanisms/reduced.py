"""Motion of a mechanism by an independent integration: multipliers of its equality constraints, DOP853, located kinks.

Mass matrix, bias, springs and dampers are MuJoCo's; rows, their rates, limits of servos and dry friction are evaluated here,
and the time integration shares nothing with the engine.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import qr

Vector = NDArray[np.float64]

_TOLERANCE = 1e-13


class Reference(NamedTuple):
    """State at the end: joints and their rates by name, work of the servo, heat of dampers, when its limit ends."""

    joints: dict[str, float]
    rates: dict[str, float]
    work_J: float
    heat_J: float
    limit_ends_s: float


def closing(model: Any, duration_s: float, control: float, sliding: Mapping[str, float] | None = None) -> Reference:
    """Motion from rest at ``qpos0`` of a mechanism whose one servo begins at its upper limit and leaves it once.

    Args:
        model: Its model: joints with one coordinate each, connects and affine couplings of joints, no contact.
        duration_s: Duration, s.
        control: Control of the servo, constant.
        sliding: Dry friction in N m of joints that turn in their positive direction throughout.
    """
    (servo,) = np.flatnonzero(model.actuator_forcelimited)
    nv, limit = model.nv, float(model.actuator_forcerange[servo, 1])
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    model.actuator_forcelimited[:] = 0
    data, friction = mujoco.MjData(model), np.zeros(nv)
    for joint, torque in (sliding or {}).items():
        friction[model.joint(joint).dofadr[0]] = torque
    data.ctrl[servo] = control
    mujoco.mj_forward(model, data)
    rows = _rows(model, data)[0]
    kept = np.sort(qr(rows.T, mode="r", pivoting=True)[1][: np.linalg.matrix_rank(rows)])

    def slope(_: float, state: Vector, *, limited: bool) -> Vector:
        data.qpos[:], data.qvel[:] = state[:nv], state[nv : 2 * nv]
        mujoco.mj_forward(model, data)
        J, gamma = (each[kept] for each in _rows(model, data))
        driven = data.qfrc_actuator * (limit / data.actuator_force[servo] if limited else 1.0)
        mass = np.zeros((nv, nv))
        mujoco.mj_fullM(model, data, mass)
        force = driven + data.qfrc_passive - data.qfrc_bias - friction
        system = np.block([[mass, J.T], [J, np.zeros((len(J), len(J)))]])
        acceleration = np.linalg.solve(system, np.concatenate((force, -gamma)))[:nv]
        powers = driven @ data.qvel, -data.qfrc_damper @ data.qvel
        return np.concatenate((data.qvel, acceleration, powers))

    def excess(time_s: float, state: Vector) -> float:
        slope(time_s, state, limited=True)
        return float(data.actuator_force[servo]) - limit

    excess.terminal = True  # type: ignore[attr-defined]
    options: dict[str, Any] = {"method": "DOP853", "rtol": _TOLERANCE, "atol": 0.1 * _TOLERANCE}
    start = np.concatenate((model.qpos0, np.zeros(nv + 2)))
    first = solve_ivp(lambda t, y: slope(t, y, limited=True), (0.0, duration_s), start, events=excess, **options)
    ends_s = float(first.t_events[0][0])
    rest = solve_ivp(lambda t, y: slope(t, y, limited=False), (ends_s, duration_s), first.y[:, -1], **options)
    end, names = rest.y[:, -1].tolist(), [model.joint(j).name for j in range(model.njnt)]
    assert excess(duration_s, rest.y[:, -1]) < 0.0
    return Reference(dict(zip(names, end[:nv], strict=True)), dict(zip(names, end[nv:], strict=False)), *end[-2:], ends_s)


def _rows(model: Any, data: Any) -> tuple[Vector, Vector]:
    """Rows of all equality constraints and their rates at zero acceleration."""
    rows, rates = [], []
    for i in range(model.neq):
        if model.eq_type[i] == mujoco.mjtEq.mjEQ_CONNECT:
            jacobians = [_point(model, data, i, end) for end in (0, 1)]
            rows += list(jacobians[0][0] - jacobians[1][0])
            rates += list((jacobians[0][1] - jacobians[1][1]) @ data.qvel)
        else:
            assert model.eq_type[i] == mujoco.mjtEq.mjEQ_JOINT
            row = np.zeros(model.nv)
            row[model.jnt_dofadr[model.eq_obj1id[i]]] = 1.0
            row[model.jnt_dofadr[model.eq_obj2id[i]]] = -model.eq_data[i, 1]
            rows, rates = [*rows, row], [*rates, 0.0]
    return np.array(rows), np.array(rates)


def _point(model: Any, data: Any, equality: int, end: int) -> tuple[Vector, Vector]:
    """Jacobian of the velocity of an end of a connect, and its rate."""
    which = int((model.eq_obj1id, model.eq_obj2id)[end][equality])
    if model.eq_objtype[equality] == mujoco.mjtObj.mjOBJ_SITE:
        body, point = int(model.site_bodyid[which]), data.site_xpos[which]
    else:
        body = which
        point = data.xpos[body] + data.xmat[body].reshape(3, 3) @ model.eq_data[equality, 3 * end : 3 * end + 3]
    jacobian, rate = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    mujoco.mj_jac(model, data, jacobian, None, point, body)
    mujoco.mj_jacDot(model, data, rate, None, point, body)
    return jacobian, rate
