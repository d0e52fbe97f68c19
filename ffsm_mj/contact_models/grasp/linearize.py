"""First-order effect of small changes of the state before a grasp closes: its saltation matrix, time, impulse and loss.

A grasp closes where the largest ratio of its relative pose and velocity to their bounds falls to 1: g(q, v) = 0. With
x = (q, v), f = dx/dt before (-) and after (+), n the gradient of g and R the plastic closing on the stopped rows,

    S = DR + (f+ - DR f-) n^T / (n^T f-),    dt = -n^T dx / (n^T f-)

as for an impact (:mod:`ffsm_mj.contact_models.impact.linearize`). Always S f- = f+. Coordinates are those of the logged
system before and after: the accelerations after are those under the rows J a = -dJ/dt v of the closed latch. The closing
takes the relative velocities of these rows: J (dv+/dv-) = 0, so det S = 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.grasp.closing_condition import Nearness, Sites
from ffsm_mj.contact_models.grasp.latch_joints import plastic_impulse, relative_twist_rows, stopped_components
from ffsm_mj.contact_models.impact.linearize import STEP, SmoothEvent
from ffsm_mj.dynamics.loops.closed_loops import PlasticClosing
from ffsm_mj.dynamics.rigid_body import mass_matrix
from ffsm_mj.errors import UnsupportedContactError
from ffsm_mj.model.grasp import Grasp
from ffsm_mj.model.system import System
from ffsm_mj.tolerances import RANK

_AT_BOUND = 1e-6
"""A ratio this close to the largest one decides with it; one this far from 1 decides nothing."""


@dataclass(frozen=True)
class GraspSaltation:
    """First-order effects of a change (dq, dv) of the state just before a grasp closes.

    Attributes:
        S: Change of the state just after, as if both motions had the closing at that time, (2 nv, 2 nv).
        time: Change of the time of closing, (2 nv,), s.
        impulse: Change of the impulse on the object in N s and of its moment in N m s, (6, 2 nv).
        loss: Change of the lost energy, (2 nv,), J.
        bound: The bound at which the grasp closes: ``position_m``, ``angle_rad``, ``speed_m_s`` or ``rate_rad_s``.
        guard: Gradient of the ratio to this bound, (2 nv,).
        reset: Jacobian of the closing at a fixed time, DR, (2 nv, 2 nv).
        f_before: (v, a) before, (2 nv,).
        f_after: (v, a) after, (2 nv,).
    """

    S: FloatArray
    time: FloatArray
    impulse: FloatArray
    loss: FloatArray
    bound: str
    guard: FloatArray
    reset: FloatArray
    f_before: FloatArray
    f_after: FloatArray


def linearize_grasp(
    system: System,
    data: Any,
    grasp: Grasp,
    bounds: Sequence[float | None],
    *,
    effort_before: FloatArray | None = None,
    effort_after: FloatArray | None = None,
) -> GraspSaltation:
    """Linearize the closing of a grasp at the state in ``data``, which is not changed.

    Args:
        system: The system in which nothing is grasped.
        data: Its state at the instant of closing, with the velocities before it.
        grasp: The grasp.
        bounds: Greatest distance in m, angle in rad, speed in m/s and rate in rad/s at which it closes; None: no such bound.
        effort_before: Generalised forces of actuators and external fields just before, (nv,); None: there are none.
        effort_after: Those just after; None: there are none.

    Raises:
        UnsupportedContactError: No bound, or more than one, is reached here, or its value does not fall: no derivative.
    """
    nv, event = system.mj.nv, _Closing(system, data, grasp, bounds)
    qpos, qvel = np.array(data.qpos), np.array(data.qvel)
    columns = np.hstack([event.differences(qpos, qvel, of_velocity=item) for item in (False, True)])
    guard, by_state = columns[-1], columns[:-1]
    closed = event.closing(qpos, qvel)
    after = qvel + closed.change
    # The closing changes no coordinate.
    reset = np.vstack((np.eye(nv, 2 * nv), by_state[:nv]))
    f_before = np.concatenate((qvel, event.acceleration(qpos, qvel, effort_before)))
    f_after = np.concatenate((after, event.closed_acceleration(qpos, after, effort_after)))
    falls = float(guard @ f_before)
    # At a ratio that does not fall the neighbours close later or not at all: dt = -n dx / (n f-) has no meaning.
    if not falls < 0.0:
        raise UnsupportedContactError(f"grasp {grasp.name!r}: {event.bound} does not fall to its bound here: no derivative")
    time = -guard / falls
    of_event = by_state[nv:]
    # At the event of the neighbour its state has moved on by f- dt.
    moved = of_event + np.outer(of_event @ f_before, time)
    return GraspSaltation(
        S=reset + np.outer(f_after - reset @ f_before, guard) / falls,
        time=time,
        impulse=moved[:6],
        loss=moved[6],
        bound=event.bound,
        guard=guard,
        reset=reset,
        f_before=f_before,
        f_after=f_after,
    )


class _Closing(SmoothEvent):
    """The closing of a grasp as a function of the state.

    Attributes:
        bound: Name of the bound that decides.
    """

    def __init__(self, system: System, data: Any, grasp: Grasp, bounds: Sequence[float | None]) -> None:
        super().__init__(system.mj)
        self._sites, self._grasp = Sites(system, grasp), grasp
        self.go_to(np.array(data.qpos), np.array(data.qvel))
        near = self._sites.nearness(self._data)
        ratios = np.array([0.0 if b is None else x / b for x, b in zip(near, bounds, strict=True)])
        deciding = np.flatnonzero(ratios >= ratios.max() - _AT_BOUND)
        names = Nearness._fields
        # Which of two bounds closes a neighbour depends on the direction of the change: a corner of the guard.
        if len(deciding) > 1:
            both = ", ".join(names[i] for i in deciding)
            raise UnsupportedContactError(f"grasp {grasp.name!r}: {both} reach their bounds at one instant: no derivative")
        self._which = int(deciding[0])
        self.bound, self._bound = names[self._which], float(bounds[self._which] or 0.0)
        # The formula holds for an event at a root of the guard; one at a fixed time has S = DR.
        if abs(ratios.max() - 1.0) > _AT_BOUND:
            raise UnsupportedContactError(
                f"grasp {grasp.name!r}: no bound is reached here, the largest ratio is {ratios.max():.6g}: it closed when "
                "it was armed, or at an impact, at a time that does not depend on the state"
            )

    def closing(self, qpos: FloatArray, qvel: FloatArray) -> PlasticClosing:
        """The plastic impulse."""
        data, sites = self.go_to(qpos, qvel), self._sites
        return plastic_impulse(self._model, data, sites.link, sites.root, sites.point(data), self._stopped(data))

    def _stopped(self, data: Any) -> FloatArray:
        """Components of the relative twist that the latch stops, (n, 6), in directions that are fixed in the link.

        Their number and span are those of the closing; fixed directions make the rows smooth functions of the state.
        """
        joint, turn = self._grasp.joint, data.site_xmat[self._sites.robot].reshape(3, 3).T
        # Kinds without an axis stop the same components about any: one is chosen.
        local = stopped_components(joint.kind, np.array(joint.axis or (1.0, 0.0, 0.0)))
        return np.hstack((local[:, :3] @ turn, local[:, 3:] @ turn))

    def outcome(self, qpos: FloatArray, qvel: FloatArray) -> FloatArray:
        """Velocities after, impulse, loss, and the ratio that decides, (nv + 8,)."""
        closing = self.closing(qpos, qvel)
        ratio = self._sites.nearness(self._data)[self._which] / self._bound
        return np.concatenate((qvel + closing.change, closing.impulses, [closing.loss_J, ratio]))

    def closed_acceleration(self, qpos: FloatArray, qvel: FloatArray, effort: FloatArray | None) -> FloatArray:
        """Accelerations with the grasp closed: a + M^-1 J^T lambda with J a = -dJ/dt v, (nv,)."""
        free = self.acceleration(qpos, qvel, effort)
        M, J = mass_matrix(self._model, self._data), self._rows(qpos)
        ends = []
        for h in (-STEP, STEP):
            q = qpos.copy()
            mujoco.mj_integratePos(self._model, q, qvel, h)
            ends.append(self._rows(q))
        # The rows turn with the link: dJ/dt qdot along the motion, by central differences as in the derivatives.
        drift = (ends[1] - ends[0]) @ qvel / (2.0 * STEP)
        answer = np.linalg.solve(M, J.T)
        # Rows of a planar robot depend on each other: least squares gives the one acceleration that they all allow.
        forces = np.linalg.lstsq(J @ answer, J @ free + drift, rcond=RANK)[0]
        return free - answer @ forces

    def _rows(self, qpos: FloatArray) -> FloatArray:
        """Rows of the relative twist that the latch stops, at the object's site, (n, nv)."""
        data, sites = self.go_to(qpos, np.zeros(self._model.nv)), self._sites
        return self._stopped(data) @ relative_twist_rows(self._model, data, sites.link, sites.root, sites.point(data))
