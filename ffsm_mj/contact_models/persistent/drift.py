"""Keeps closed gaps closed against what rounding and the order of the integrator leave, and books what that costs."""

from __future__ import annotations

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.contact_models.interface import Scene
from ffsm_mj.contact_models.persistent.active_set import ActiveContactSet
from ffsm_mj.contact_models.persistent.exchange import Shares, wrenches
from ffsm_mj.contact_models.persistent.projection import needs_projection, project
from ffsm_mj.contact_models.persistent.rows import rows
from ffsm_mj.dynamics.rigid_body import free_components, momentum_matrix


def added(one: Exchange | None, other: Exchange) -> Exchange:
    """What two bookings come to."""
    return other if one is None else Exchange(*(a + b for a, b in zip(one, other, strict=True)))


class Drift:
    """Takes drift out of the closed contacts of a scene."""

    def __init__(self, scene: Scene, closed: ActiveContactSet) -> None:
        """Find what the joints leave free."""
        self._scene, self._closed = scene, closed
        self._free = np.all([free_components(scene.system, tree) for tree in scene.system.trees], axis=0)

    def taken_out(self) -> Exchange | None:
        """Project the state in ``data`` where that is needed, as a step begins; says what that gave to the subsystems."""
        closed, system, data = self._closed, self._scene.system, self._scene.data
        here = closed.decide().rows if closed.touches else None
        if here is None or not needs_projection(here):
            return None
        touches, motion = closed.touches, closed.motion
        outside = Shares.of(system, touches, motion.carried_bodies).outside != 0.0
        taken = np.array(wrenches(here, np.ones(len(touches))))[outside.any(axis=0)]
        before, qpos = self._accounts(), data.qpos.copy()
        project(motion, lambda: rows(motion, data, touches), self._free, taken)
        motion.path.on_event_located()
        motion.flight.account(0.0)  # its energy and momentum are those of other velocities
        energy, impulse, total = (after - then for after, then in zip(self._accounts(), before, strict=True))
        # What fixed bodies take is one sum: it is booked to the robot where they touch it, else to the objects. What is
        # carried counts as the robot's here, and its gains are booked by the balance.
        from_outside = np.zeros((2, 6))
        if outside[0].any():
            from_outside[0] = total
        elif outside[1].any():
            from_outside[1] = total
            impulse = impulse - total
        # The books of the joints take the way for work: it is none.
        way = np.empty(system.mj.nv)
        mujoco.mj_differentiatePos(system.mj, way, 1.0, qpos, data.qpos)
        energy[:2] -= float(data.qfrc_actuator @ way)
        return Exchange(energy, impulse, from_outside)

    def _accounts(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Kinetic energies of (total, robot with what it carries, other objects), and the momenta of those and of all."""
        system, data, carried = self._scene.system, self._scene.data, self._closed.motion.carried
        momentum = np.empty(system.mj.nv)
        mujoco.mj_mulM(system.mj, data, momentum, data.qvel)
        total = 0.5 * float(momentum @ data.qvel)
        ours = system.robot, *([carried] if carried is not None else [])
        own = sum(0.5 * float(momentum[tree.dofs] @ data.qvel[tree.dofs]) for tree in ours)
        of_objects = (
            momentum_matrix(system.mj, data, tree.root) @ data.qvel for tree in system.objects if tree is not carried
        )
        energy, of_all = np.array((total, own, total - own)), momentum_matrix(system.mj, data, 0) @ data.qvel
        return energy, sum(of_objects, np.zeros(6)), of_all
