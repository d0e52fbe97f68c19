"""Pinocchio: a library of algorithms, so the steps are Python: RK4, an event located by bisection, a weld by constraint."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from engine_runs.exact import normalised, pinocchio_model, pinocchio_start, pinocchio_states, position_rate
from engine_runs.scene import Scene
from engine_runs.states import States

BISECTIONS = 50
Acceleration = Callable[[np.ndarray, np.ndarray], np.ndarray]


def _stepped(model: Any, acceleration: Acceleration, q: np.ndarray, v: np.ndarray, h: float) -> tuple[Any, Any]:
    """One step of RK4 on coordinates and rates."""
    a1 = acceleration(q, v)
    k1 = position_rate(model, q, v)
    q2, v2 = q + 0.5 * h * k1, v + 0.5 * h * a1
    a2, k2 = acceleration(q2, v2), position_rate(model, q2, v2)
    q3, v3 = q + 0.5 * h * k2, v + 0.5 * h * a2
    a3, k3 = acceleration(q3, v3), position_rate(model, q3, v3)
    q4, v4 = q + h * k3, v + h * a3
    a4, k4 = acceleration(q4, v4), position_rate(model, q4, v4)
    return normalised(model, q + h / 6 * (k1 + 2 * (k2 + k3) + k4)), v + h / 6 * (a1 + 2 * (a2 + a3) + a4)


def _free(model: Any, data: Any) -> Acceleration:
    import pinocchio as pin

    none = np.zeros(model.nv)

    def acceleration(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.array(pin.aba(model, data, normalised(model, q), v, none))

    return acceleration


def _welded(scene: Scene, model: Any, data: Any, step_s: float) -> Acceleration:
    """A rigid constraint of six rows, corrected with a time constant of ten steps."""
    import pinocchio as pin

    first, second = (model.getJointId(name) for name in scene.weld)
    place = np.array(scene.body(scene.weld[1]).position_m) - np.array(scene.body(scene.weld[0]).position_m)
    frames = pin.SE3(np.eye(3), place), pin.SE3.Identity()
    weld = pin.RigidConstraintModel(pin.ContactType.CONTACT_6D, model, first, frames[0], second, frames[1], pin.LOCAL)
    gain = 1.0 / (10 * step_s)
    weld.setBaumgarteCorrectorParameters(pin.BaumgarteCorrectorParameters(gain**2, 2 * gain))
    welds, found = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    welds.append(weld)
    found.append(weld.createData())
    pin.initConstraintDynamics(model, data, welds, found)
    settings, none = pin.ProximalSettings(1e-12, 0.0, 10), np.zeros(model.nv)

    def acceleration(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.array(pin.constraintDynamics(model, data, normalised(model, q), v, none, welds, found, settings))

    return acceleration


class _Touch:
    """Gap of the two bodies of a scene and its Jacobian, by coal."""

    def __init__(self, scene: Scene, model: Any, data: Any) -> None:
        import coal

        self.model, self.data, self.coal = model, data, coal
        self.joints = [model.getJointId(name) for name in scene.touching[0]]
        self.shapes = [
            coal.Box(*(2 * np.array(body.half_m))) if body.half_m else coal.Sphere(body.radius_m)
            for body in map(scene.body, scene.touching[0])
        ]

    def gap(self, q: np.ndarray) -> Any:
        """Result of the distance at q."""
        import pinocchio as pin

        pin.forwardKinematics(self.model, self.data, q)
        places = [
            self.coal.Transform3s(self.data.oMi[joint].rotation, self.data.oMi[joint].translation) for joint in self.joints
        ]
        found = self.coal.DistanceResult()
        self.coal.distance(self.shapes[0], places[0], self.shapes[1], places[1], self.coal.DistanceRequest(), found)
        return found

    def row(self, q: np.ndarray) -> np.ndarray:
        """J_n, (1, nv)."""
        import pinocchio as pin

        found = self.gap(q)
        point = 0.5 * (np.array(found.getNearestPoint1()) + np.array(found.getNearestPoint2()))
        pin.computeJointJacobians(self.model, self.data, q)
        row = np.zeros((1, self.model.nv))
        for joint, sign in zip(self.joints, (-1.0, 1.0), strict=True):
            J = pin.getJointJacobian(self.model, self.data, joint, pin.LOCAL_WORLD_ALIGNED)
            arm = point - self.data.oMi[joint].translation
            row += sign * np.array(found.normal) @ (J[:3] - pin.skew(arm) @ J[3:])
        return row


def run(scene: Scene, step_s: float) -> tuple[list[States], float]:
    """States at the scene's times and CPU time in s of the loop."""
    import pinocchio as pin

    model = pinocchio_model(scene)
    data = model.createData()
    q, v = pinocchio_start(scene, model)
    acceleration = _welded(scene, model, data, step_s) if scene.weld else _free(model, data)
    touch = _Touch(scene, model, data) if scene.touching else None
    found, spent, done = [], 0.0, 0
    for time_s in scene.times_s:
        steps = round(time_s / step_s) - done
        clock = time.process_time()
        for _ in range(steps):
            ahead = _stepped(model, acceleration, q, v, step_s)
            if touch and touch.gap(ahead[0]).min_distance < 0.0 and (touch.row(q) @ v)[0] < 0.0:
                low, high = 0.0, step_s
                for _ in range(BISECTIONS):
                    middle = 0.5 * (low + high)
                    inside = touch.gap(_stepped(model, acceleration, q, v, middle)[0]).min_distance < 0.0
                    low, high = (low, middle) if inside else (middle, high)
                q, v = _stepped(model, acceleration, q, v, low)
                v = np.array(pin.impulseDynamics(model, data, q, v, touch.row(q), scene.restitution, 0.0))
                ahead = _stepped(model, acceleration, q, v, step_s - low)
            q, v = ahead
        spent += time.process_time() - clock
        done += steps
        found.append(pinocchio_states(scene, model, data, q, v))
    return found, spent
