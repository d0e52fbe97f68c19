"""First-order effect of small changes of the state before an impact: its saltation matrix, time and impulse.

A neighbouring motion meets at another time, so the Jacobian of the impact map alone is wrong. With x = (q, v), f = dx/dt
just before (-) and after (+) the impact, R the impact map, n = (J, 0) the gradient of the gap and u = J v- < 0,

    S = DR + (f+ - DR f-) n^T / (n^T f-),    dt = -J dq / u

(Kong, Payne, Zhu & Johnson, Proc. IEEE 112(6):585, 2024). Always S f- = f+; without friction det S = e^2. Changes of q are
in the tangent space of ``mj_integratePos``: of a free joint, position in world axes and rotation in body axes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact_models.impact.resolution import Contact, Impact, contact_jacobian, resolve
from ffsm_mj.dynamics.rigid_body import mass_matrix
from ffsm_mj.errors import UnsupportedContactError

STEP = 1e-5
"""Step of central differences, rad, m, and of velocities over the largest one: error of truncation and rounding 1e-9."""


@dataclass(frozen=True)
class Saltation:
    """First-order effects of a change (dq, dv) of the state just before an impact, all at the time of the unchanged impact.

    Attributes:
        S: Change of the state just after, as if both motions had their impact at that time, (2 nv, 2 nv).
        time: Change of the time of the impact, (2 nv,), s.
        impulse: Change of the normal impulse, (2 nv,), N s.
        impulse_by_restitution: Change of the normal impulse with the coefficient of restitution, N s.
        velocity_by_restitution: Change of the velocities after, (nv,).
        J: Gradient of the gap, (nv,).
        rate: Gap rate u before, m/s, negative.
        reset: Jacobian of the impact map at a fixed time, DR, (2 nv, 2 nv).
        f_before: (v, a) before, (2 nv,).
        f_after: (v, a) after, (2 nv,).
        impact: The impact itself.
    """

    S: FloatArray
    time: FloatArray
    impulse: FloatArray
    impulse_by_restitution: float
    velocity_by_restitution: FloatArray
    J: FloatArray
    rate: float
    reset: FloatArray
    f_before: FloatArray
    f_after: FloatArray
    impact: Impact


def linearize(
    model: Any,
    data: Any,
    pair: ContactPair,
    *,
    restitution: float | None = None,
    mu: float | None = None,
    compliance_ratio: float | None = None,
    law: str = "blend",
    effort_before: FloatArray | None = None,
    effort_after: FloatArray | None = None,
) -> Saltation:
    """Linearize an impact of one contact point at the state in ``data``, which is not changed.

    Args:
        model: MuJoCo model.
        data: Its state at the instant of the impact, with the velocities before it.
        pair: The two geoms.
        restitution: Coefficient of restitution; None: that of the pair. Above 1 is refused as in :func:`resolve`.
        mu: Coefficient of friction; None: that of the pair.
        compliance_ratio: Tangential over normal compliance; None: that of the pair.
        law: Name of the impact law.
        effort_before: Generalised forces of actuators and external fields just before, (nv,); None: there are none.
        effort_after: Those just after; None: there are none.

    Raises:
        UnsupportedContactError: The geoms touch in an edge or a face, do not approach, or a neighbouring impact passes
            through other contact modes: there is no derivative.
    """
    e = pair.restitution if restitution is None else restitution
    across = pair.mu if mu is None else mu, pair.compliance_ratio if compliance_ratio is None else compliance_ratio
    event = _Event(model, data, pair, e, *across, law)
    nv, qpos, qvel = model.nv, np.array(data.qpos), np.array(data.qvel)
    impact = event.impact(qpos, qvel)
    J = event.row(qpos)
    u = float(J @ qvel)
    # At a graze, u = 0, a neighbour misses or hits: the time of the impact changes with the root of the distance, without
    # derivative.
    if not u < 0.0:
        raise UnsupportedContactError(
            f"{pair}: the contact does not approach (gap rate {u:.3g} m/s): no impact to linearize"
        )
    by_q = event.differences(qpos, qvel, of_velocity=False)
    by_v = event.differences(qpos, qvel, of_velocity=True)
    # An impact changes no coordinate, so the upper half is the identity; velocities after depend on both.
    reset = np.block([[np.eye(nv), np.zeros((nv, nv))], [by_q[:nv], by_v[:nv]]])
    after = impact.after.qvel
    f_before = np.concatenate((qvel, event.acceleration(qpos, qvel, effort_before)))
    f_after = np.concatenate((after, event.acceleration(qpos, after, effort_after)))
    # The gap depends on coordinates alone. Its rate along f- = (v, a) is thus n^T f- = J v = u.
    n = np.concatenate((J, np.zeros(nv)))
    time = -n / u
    of_impulse = np.concatenate((by_q[nv], by_v[nv]))
    by_e = event.by_restitution(qpos, qvel)
    return Saltation(
        S=reset + np.outer(f_after - reset @ f_before, n) / u,
        time=time,
        # At the event of the neighbour its state has moved on by f- dt.
        impulse=of_impulse + (of_impulse @ f_before) * time,
        impulse_by_restitution=float(by_e[nv]),
        velocity_by_restitution=by_e[:nv],
        J=J,
        rate=u,
        reset=reset,
        f_before=f_before,
        f_after=f_after,
        impact=impact,
    )


class SmoothEvent:
    """An event as a smooth function of the state just before it, on data of its own."""

    def __init__(self, model: Any) -> None:
        """Make data of a model."""
        self._model, self._data = model, mujoco.MjData(model)

    def outcome(self, qpos: FloatArray, qvel: FloatArray) -> FloatArray:
        """Velocities after the event, (nv,), then other numbers that follow from the state before."""
        raise NotImplementedError

    def go_to(self, qpos: FloatArray, qvel: FloatArray) -> Any:
        """Set a state; returns the data with what depends on positions and velocities."""
        data = self._data
        data.qpos[:], data.qvel[:] = qpos, qvel
        mujoco.mj_fwdPosition(self._model, data)
        mujoco.mj_fwdVelocity(self._model, data)
        return data

    def differences(self, qpos: FloatArray, qvel: FloatArray, *, of_velocity: bool) -> FloatArray:
        """Derivatives of the outcome, n numbers, by coordinates or velocities, (n, nv)."""
        columns = []
        # Central differences err by h^2 and by EPSILON / h: of the order of 1e-10 each at 1e-5 of the size of what is
        # varied.
        step = STEP * (max(1.0, float(np.abs(qvel).max())) if of_velocity else 1.0)
        for unit in np.eye(self._model.nv):
            ends = []
            for h in (-step, step):
                q, v = qpos.copy(), qvel + h * unit if of_velocity else qvel
                if not of_velocity:
                    # A sum of quaternions is no rotation: changes are taken along the tangent space.
                    mujoco.mj_integratePos(self._model, q, unit, h)
                ends.append(self.outcome(q, v))
            columns.append((ends[1] - ends[0]) / (2.0 * step))
        return np.array(columns).T

    def acceleration(self, qpos: FloatArray, qvel: FloatArray, effort: FloatArray | None) -> FloatArray:
        """Accelerations under generalised forces of the actuators, (nv,); None: off."""
        data = self._data
        # Efforts enter as generalised forces below; with controls too they would act twice.
        data.qpos[:], data.qvel[:], data.ctrl[:] = qpos, qvel, 0.0
        data.qfrc_applied[:] = 0.0 if effort is None else effort
        mujoco.mj_forward(self._model, data)
        data.qfrc_applied[:] = 0.0
        return np.array(data.qacc)


class _Event(SmoothEvent):
    """The impact of a pair as a function of the state."""

    def __init__(
        self, model: Any, data: Any, pair: ContactPair, restitution: float, mu: float, compliance_ratio: float, law: str
    ) -> None:
        super().__init__(model)
        mujoco.mj_copyData(self._data, model, data)
        self._pair, self._e, self._mu, self._law = pair, restitution, mu, law
        self._compliance_ratio = compliance_ratio
        self._path: str | None = None

    def impact(self, qpos: FloatArray, qvel: FloatArray, restitution: float | None = None) -> Impact:
        """Impact of the nearest points, as if they touched.

        Raises:
            UnsupportedContactError: They are several, or other contact modes than in the first call occur.
        """
        contact = self._contact(qpos, qvel, self._e if restitution is None else restitution)
        outcome = resolve(self._model, self._data, [contact], self._law)
        path = f"{outcome.status} {outcome.friction.paths[0] if outcome.friction is not None else ''}"
        if self._path is None:
            self._path = path
        # Where slip becomes stick within the differences the map has a kink: their quotient is no derivative from any side.
        elif path != self._path:
            modes = f"{self._path.strip()}, or {path.strip()}"
            raise UnsupportedContactError(f"{self._pair}: the contact modes change here ({modes}): no derivative exists")
        return outcome

    def row(self, qpos: FloatArray) -> FloatArray:
        """Gradient of the gap, (nv,)."""
        return contact_jacobian(self._model, self._data, self._contact(qpos, np.zeros(self._model.nv), self._e))

    def differences(self, qpos: FloatArray, qvel: FloatArray, *, of_velocity: bool) -> FloatArray:
        """Derivatives of (velocity after, impulse) by coordinates or velocities, (nv + 1, nv)."""
        # The impact map is linear in the velocity then, and exact; differences would leave an error of 1e-9.
        if of_velocity and self._mu == 0.0:
            return self._by_velocity(qpos, qvel)
        return super().differences(qpos, qvel, of_velocity=of_velocity)

    def _by_velocity(self, qpos: FloatArray, qvel: FloatArray) -> FloatArray:
        """Closed form without friction: v+ = (I - (1 + e) M^-1 J^T J / G) v-, impulse -(1 + e) J v- / G."""
        self._contact(qpos, qvel, self._e)
        J, M = self.row(qpos), mass_matrix(self._model, self._data)
        response = np.linalg.solve(M, J)
        gain = (1.0 + self._e) / float(J @ response)
        return np.vstack((np.eye(self._model.nv) - gain * np.outer(response, J), -gain * J))

    def by_restitution(self, qpos: FloatArray, qvel: FloatArray) -> FloatArray:
        """Derivatives of (velocity after, impulse) by e, (nv + 1,); at an end of its range from the inside."""
        # Laws refuse e < 0, and e > 1 with friction or several contacts.
        low, high = max(self._e - STEP, 0.0), min(self._e + STEP, max(1.0, self._e))
        ends = [self.outcome(qpos, qvel, e) for e in (low, high)]
        return np.asarray((ends[1] - ends[0]) / (high - low))

    def _contact(self, qpos: FloatArray, qvel: FloatArray, restitution: float) -> Contact:
        data, pair = self.go_to(qpos, qvel), self._pair
        near = pair.proximity(self._model, data)
        # Of an edge or face that lands flat a neighbour touches with one corner first, and which one depends on the change.
        if len(near.points) > 1:
            raise UnsupportedContactError(f"{pair}: {len(near.points)} contact points at one instant: no derivative exists")
        of_pair = (restitution, self._mu, self._compliance_ratio)
        return Contact(pair.body_a, pair.body_b, near.points[0], near.normal, *of_pair)

    def outcome(self, qpos: FloatArray, qvel: FloatArray, restitution: float | None = None) -> FloatArray:
        """Velocity after, and impulse, (nv + 1,)."""
        impact = self.impact(qpos, qvel, restitution)
        return np.append(impact.after.qvel, impact.impulses[0])
