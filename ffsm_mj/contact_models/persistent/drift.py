"""Drift projection: returns closed contacts to gap 0, and accounts for the energy and momentum this changes.

Constraints are enforced at the acceleration level, so rounding and truncation error make gaps drift; projection onto the
position and velocity constraints is the standard remedy (Hairer & Wanner, *Solving ODEs II*, sec. VII.2).
"""

from __future__ import annotations

import mujoco
import numpy as np

from ffsm_mj.arrays import BoolArray, FloatArray
from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.contact_models.impact.friction.tangents import tangents
from ffsm_mj.contact_models.interface import Scene
from ffsm_mj.contact_models.persistent.active_set import ActiveContactSet
from ffsm_mj.contact_models.persistent.exchange import Shares
from ffsm_mj.contact_models.persistent.point_rows import FrictionalRows
from ffsm_mj.contact_models.persistent.projection import ClosedRows, needs_projection, project
from ffsm_mj.dynamics.rigid_body import free_components, momentum_matrix


def sum_exchanges(one: Exchange | None, other: Exchange) -> Exchange:
    """Sum of two exchanges."""
    return other if one is None else Exchange(*(a + b for a, b in zip(one, other, strict=True)))


class DriftProjection:
    """Projects out the drift of the closed contacts of a scene."""

    def __init__(self, scene: Scene, closed: ActiveContactSet) -> None:
        """Determine the momentum components that the joints leave free."""
        self._scene, self._active_set = scene, closed
        self._free = np.all([free_components(scene.system, tree) for tree in scene.system.trees], axis=0)

    def remove_drift(self) -> Exchange | None:
        """Project the state in ``data`` at the start of a step if needed; returns the energy and momentum this changed."""
        closed, system, data = self._active_set, self._scene.system, self._scene.data
        if not closed.contact_points or not needs_projection(*drift_of(closed)):
            return None
        contact_points, motion = closed.contact_points, closed.motion
        outside = Shares.of(system, contact_points, motion.grasped_bodies).outside != 0.0
        taken = unit_wrenches(closed, outside.any(axis=0))
        before, qpos = self._energy_and_momenta(), data.qpos.copy()
        project(motion, lambda: closed_rows(closed), self._free, taken)
        motion.path.on_event_located()
        motion.flight.account(0.0)  # its energy and momentum are those of other velocities
        energy, impulse, total = (after - then for after, then in zip(self._energy_and_momenta(), before, strict=True))
        # Only the sum of what fixed bodies absorb is known: it is entered for the robot if they touch it, else for the
        # objects. A grasped object counts as part of the robot here; the balance separates the two.
        from_outside = np.zeros((2, 6))
        if outside[0].any():
            from_outside[0] = total
        elif outside[1].any():
            from_outside[1] = total
            impulse = impulse - total
        # The balance computes actuator work from joint displacements; the displacement of a projection is not work.
        displacement = np.empty(system.mj.nv)
        mujoco.mj_differentiatePos(system.mj, displacement, 1.0, qpos, data.qpos)
        energy[:2] -= float(data.qfrc_actuator @ displacement)
        return Exchange(energy, impulse, from_outside)

    def _energy_and_momenta(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Kinetic energy of (total, robot with grasped object, other objects), momentum of other objects, total momentum."""
        system, data, grasped = self._scene.system, self._scene.data, self._active_set.motion.grasped_object
        momentum = np.empty(system.mj.nv)
        mujoco.mj_mulM(system.mj, data, momentum, data.qvel)
        total = 0.5 * float(momentum @ data.qvel)
        ours = system.robot, *([grasped] if grasped is not None else [])
        own = sum(0.5 * float(momentum[tree.dofs] @ data.qvel[tree.dofs]) for tree in ours)
        of_objects = (
            momentum_matrix(system.mj, data, tree.root) @ data.qvel for tree in system.objects if tree is not grasped
        )
        energy, of_all = np.array((total, own, total - own)), momentum_matrix(system.mj, data, 0) @ data.qvel
        return energy, sum(of_objects, np.zeros(6)), of_all


def drift_of(closed: ActiveContactSet) -> tuple[float, float, float]:
    """Largest gap of the closed contact points, m, gap rate, m/s, and slip along a tangent that is drift, m/s."""
    rows = closed.decide().rows
    slip = rows.largest_slip(closed.modes.of(closed.contact_points).drifts) if isinstance(rows, FrictionalRows) else 0.0
    return rows.extremes.gap, rows.extremes.rate, slip


def closed_rows(closed: ActiveContactSet) -> ClosedRows:
    """Rows of all closed contact points at the current state, as a projection needs them."""
    every = closed.decide().rows
    if not isinstance(every, FrictionalRows):
        return ClosedRows(every.gaps, every.rates, every.J, np.empty((0, closed.motion.model.nv)))
    J = every.J.reshape(len(closed.contact_points), 3, -1)
    sticking = J[closed.modes.of(closed.contact_points).drifts, 1:]
    return ClosedRows(every.gaps, every.rates, J[:, 0], sticking.reshape(-1, J.shape[2]))


def unit_wrenches(closed: ActiveContactSet, which: BoolArray) -> FloatArray:
    """Wrenches about the world origin of unit forces on geom b, (m, 6), at some of the closed contact points, (k,).

    Along the normals, and at points whose slip is drift along two tangents.
    """
    points = [contact for contact, taken in zip(closed.contact_points, which.tolist(), strict=True) if taken]
    states = [contact.feature.at(closed.data) for contact in points]
    forces = [
        (here.point, along)
        for here, drifts in zip(states, closed.modes.of(tuple(points)).drifts.tolist(), strict=True)
        for along in (here.normal, *(tangents(here.normal) if drifts else ()))
    ]
    return np.array([np.concatenate((along, np.cross(point, along))) for point, along in forces]).reshape(-1, 6)
