"""Solutions that the engines are compared with: closed forms, and DOP853 on Pinocchio's dynamics to 1e-13."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from engine_runs.scene import (
    HIT_S,
    LOAD_S,
    OFFSET_M,
    PUSH_N,
    PUSHED_KG,
    Scene,
    collision,
    free_flight,
    initial_twists,
    weld,
)
from engine_runs.states import States, rotation


def after_collision(restitution: float) -> States:
    """One impulse along x; the closed form of ``ffsm validate one-collision``."""
    scene = collision(restitution)
    ball, box = scene.bodies
    effective = 1.0 / (1.0 / ball.mass_kg + 1.0 / box.mass_kg + OFFSET_M**2 / box.inertia_kg_m2[2])
    impulse = (1.0 + restitution) * effective
    free_s, spin = scene.duration_s - HIT_S, -impulse * OFFSET_M / box.inertia_kg_m2[2]
    speeds = np.array([1.0 - impulse / ball.mass_kg, impulse / box.mass_kg])
    place = np.array([ball.position_m, box.position_m])
    place[:, 0] += speeds * free_s + np.array([HIT_S, 0.0])
    half = 0.5 * spin * free_s
    return States(
        place,
        np.array([[1.0, 0.0, 0.0, 0.0], [np.cos(half), 0.0, 0.0, np.sin(half)]]),
        np.column_stack([speeds, np.zeros((2, 2))]),
        np.array([[0.0, 0.0, 0.0], [0.0, 0.0, spin]]),
    )


def pushed_speed() -> float:
    """Speed of the gripper and of what it holds at the end of ``grip``, m/s."""
    return PUSH_N * LOAD_S / PUSHED_KG


def pinocchio_model(scene: Scene) -> Any:
    """The scene's trees in Pinocchio, joints named as the bodies; a welded object is left free."""
    import pinocchio as pin

    model, joints = pin.Model(), {"": 0}
    model.gravity = pin.Motion.Zero()
    origins = {"": np.zeros(3)}
    for body in scene.bodies:
        if body.joint is None:
            parent, origin, kind = "", np.array(body.position_m), pin.JointModelFreeFlyer()
        else:
            parent, origin = body.joint.parent, np.array(body.joint.anchor_m)
            of = pin.JointModelRevoluteUnaligned if body.joint.kind == "hinge" else pin.JointModelPrismaticUnaligned
            kind = of(np.array(body.joint.axis))
        place = pin.SE3(np.eye(3), origin - origins[parent])
        joints[body.name] = model.addJoint(joints[parent], kind, place, body.name)
        origins[body.name] = origin
        inertia = pin.Inertia(body.mass_kg, np.zeros(3), np.diag(body.inertia_kg_m2))
        model.appendBodyToJoint(joints[body.name], inertia, pin.SE3(np.eye(3), np.array(body.position_m) - origin))
    return model


def pinocchio_start(scene: Scene, model: Any) -> tuple[np.ndarray, np.ndarray]:
    """q, zero since the joints are placed at the start, and v; body and world frames agree there."""
    import pinocchio as pin

    q, twists = pin.neutral(model), initial_twists(scene)
    v = np.zeros(model.nv)
    for body in scene.bodies:
        joint = model.joints[model.getJointId(body.name)]
        if body.joint is None:
            v[joint.idx_v : joint.idx_v + 6] = np.concatenate(twists[body.name])
        else:
            v[joint.idx_v] = body.joint.rate
    return q, v


def pinocchio_states(scene: Scene, model: Any, data: Any, q: np.ndarray, v: np.ndarray) -> States:
    """Of every body."""
    import pinocchio as pin

    pin.forwardKinematics(model, data, q, v)
    rows: list[list[np.ndarray]] = [[], [], [], []]
    for body in scene.bodies:
        joint = model.getJointId(body.name)
        place, twist = data.oMi[joint], data.v[joint]
        lever = model.inertias[joint].lever
        R = place.rotation
        quaternion = pin.Quaternion(R)
        rows[0].append(place.translation + R @ lever)
        rows[1].append(np.array([quaternion.w, quaternion.x, quaternion.y, quaternion.z]))
        rows[2].append(R @ (twist.linear + np.cross(twist.angular, lever)))
        rows[3].append(R @ twist.angular)
    return States(*(np.array(row) for row in rows))


def position_rate(model: Any, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Rate of q, with quaternions as four numbers."""
    rate = np.empty(model.nq)
    for joint in list(model.joints)[1:]:
        at, dof = joint.idx_q, joint.idx_v
        if joint.nq != 7:
            rate[at : at + joint.nq] = v[dof : dof + joint.nv]
            continue
        (X, Y, Z, W), (wx, wy, wz) = q[at + 3 : at + 7], v[dof + 3 : dof + 6]
        rotated = rotation(np.array([[W, X, Y, Z]]))[0] @ v[dof : dof + 3]
        spin = (W * wx + Y * wz - Z * wy, W * wy + Z * wx - X * wz, W * wz + X * wy - Y * wx, -X * wx - Y * wy - Z * wz)
        rate[at : at + 3], rate[at + 3 : at + 7] = rotated, 0.5 * np.array(spin)
    return rate


def normalised(model: Any, q: np.ndarray) -> np.ndarray:
    """With unit quaternions."""
    import pinocchio as pin

    return np.asarray(pin.normalize(model, q))


def _flown(scene: Scene, times: tuple[float, ...]) -> list[States]:
    """Free motion of the scene's trees by DOP853."""
    import pinocchio as pin
    from scipy.integrate import solve_ivp

    model = pinocchio_model(scene)
    data = model.createData()

    def rate(_: float, x: np.ndarray) -> np.ndarray:
        q, v = normalised(model, x[: model.nq]), x[model.nq :]
        return np.concatenate([position_rate(model, q, v), pin.aba(model, data, q, v, np.zeros(model.nv))])

    start = np.concatenate(pinocchio_start(scene, model))
    found = solve_ivp(rate, (0.0, times[-1]), start, "DOP853", t_eval=times, rtol=1e-13, atol=1e-13)
    return [pinocchio_states(scene, model, data, normalised(model, x[: model.nq]), x[model.nq :]) for x in found.y.T]


@cache
def flown() -> list[States]:
    """``flight`` at its times."""
    scene = free_flight()
    return _flown(scene, scene.times_s)


@cache
def welded() -> list[States]:
    """``weld`` at its times: base and object as one rigid body."""
    scene = weld()
    base, held = scene.bodies
    mass = base.mass_kg + held.mass_kg
    place = np.array(held.position_m)
    centre = held.mass_kg / mass * place
    inertia = np.zeros((3, 3))
    for body in scene.bodies:
        arm = np.array(body.position_m) - centre
        inertia += np.diag(body.inertia_kg_m2) + body.mass_kg * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    w, v = np.array(base.rate_rad_s), np.array(base.velocity_m_s)
    v_centre = v + np.cross(w, centre)

    from scipy.integrate import solve_ivp

    def rate(_: float, x: np.ndarray) -> np.ndarray:
        W, X, Y, Z = x[:4]
        wx, wy, wz = x[4:]
        turn = 0.5 * np.array(
            [-X * wx - Y * wy - Z * wz, W * wx + Y * wz - Z * wy, W * wy + Z * wx - X * wz, W * wz + X * wy - Y * wx]
        )
        return np.concatenate([turn, np.linalg.solve(inertia, -np.cross(x[4:], inertia @ x[4:]))])

    start = np.concatenate([[1.0, 0.0, 0.0, 0.0], w])
    found = solve_ivp(rate, (0.0, scene.duration_s), start, "DOP853", t_eval=scene.times_s, rtol=1e-13, atol=1e-13)
    ends = []
    for time_s, x in zip(scene.times_s, found.y.T, strict=True):
        R = rotation(x[None, :4])[0]
        middle, spin = centre + v_centre * time_s, R @ x[4:]
        arms = np.array([R @ (np.array(body.position_m) - centre) for body in scene.bodies])
        ends.append(States(middle + arms, np.tile(x[:4], (2, 1)), v_centre + np.cross(spin, arms), np.tile(spin, (2, 1))))
    return ends
