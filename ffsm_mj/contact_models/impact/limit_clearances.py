"""Clearances of joint limits: which of them a joint may have reached in a step.

Gaps and rates of joints cost next to nothing, at the start of a step as at its end: both are evaluated exactly. As for pairs
(:mod:`.clearances`), the kinetic energy bounds how long this can be left out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np

from ffsm_mj._core.steppers import BOUND_MARGIN
from ffsm_mj.arrays import BoolArray, FloatArray
from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.contact.tendon_limit import LimitCoordinates
from ffsm_mj.contact_models.impact.clearances import NO_PAIRS, Indices
from ffsm_mj.contact_models.interface import Scene
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.dynamics.tendon_springs import tendon_rows
from ffsm_mj.tolerances import DISTANCE_QUERY_M


class LimitClearances:
    """Distances of joints from their limits, from step to step.

    Attributes:
        energy_reach: Motion bound (``motion_bound`` of :class:`~ffsm_mj._core.steppers.FreeStepper`) below which no
            joint can be near a limit.
    """

    def __init__(self, scene: Scene, limits: Sequence[JointLimit], first: int) -> None:
        """Bind to the state of a scene; :meth:`restart` must follow.

        Args:
            scene: The logged system and its data.
            limits: The limits.
            first: Index of the first of them among all pairs and limits.
        """
        model, self._data, self._limits, self._first = scene.system.mj, scene.data, limits, first
        self._coordinates = LimitCoordinates(limits)
        self._dofs = np.array([limit.dof for limit in self._coordinates.joints], dtype=np.intp)
        self._signs, self._values = np.array([(limit.sign, limit.limit) for limit in limits]).reshape(-1, 2).T
        self._per_root_energy = np.array([limit.speed_bound_per_root_energy(model, scene.data) for limit in limits])
        self._watched, self.energy_reach = np.ones(len(limits), dtype=bool), 0.0
        self._motion: Motion | None = None

    def restart(self, motion: Motion, is_skipped: Callable[[JointLimit], bool]) -> None:
        """Start at the state in ``data``, which has changed discontinuously, or the limits to be detected have.

        Args:
            motion: The motion that follows.
            is_skipped: Whether a limit is not detected now.
        """
        if motion is not self._motion:
            self._bind(motion)
        self._watched[:] = [not is_skipped(limit) for limit in self._limits]
        self._set_reach(self._gaps(self._coordinates.at(self._data)), 0.0)

    def _bind(self, motion: Motion) -> None:
        """Find the coordinates and rates of the joints in the state at the start of a step."""
        self._motion, model = motion, motion.model
        joints = [model.joint(limit.joint) for limit in self._coordinates.joints]
        self._tendons = [model.tendon(limit.joint).id for limit in self._limits[len(joints) :]]
        before = int(mujoco.mj_stateSize(model, int(mujoco.mjtState.mjSTATE_TIME)))
        self._first_qpos = before
        self._start_qpos = np.array([before + int(joint.qposadr[0]) for joint in joints], dtype=np.intp)
        self._start_rates = np.array([before + model.nq + int(joint.dofadr[0]) for joint in joints], dtype=np.intp)

    def near(self) -> Indices:
        """Indices of the limits that joints may be at, at the state in ``data``."""
        return self._indices(self._watched & (self._gaps(self._coordinates.at(self._data)) <= DISTANCE_QUERY_M))

    def after_step(self) -> Indices:
        """Indices of the limits that joints may have reached during the last step."""
        motion: Any = self._motion
        if motion.flight.motion_bound < self.energy_reach:
            return NO_PAIRS
        start, data = motion.path.start, self._data
        after, values = self._gaps(self._coordinates.at(data)), start[self._start_qpos]
        rates = np.maximum(np.abs(start[self._start_rates]), np.abs(data.qvel[self._dofs]))
        if self._tendons:
            # The state at the start of the step has no lengths: contact then needs no motion of a gap there.
            values, first = np.concatenate((values, self._values[len(values) :])), motion.model.nq + self._first_qpos
            rows = tendon_rows(motion.model, motion.data)[self._tendons]
            both = rows @ start[first : first + motion.model.nv], rows @ motion.data.qvel
            rates = np.concatenate((rates, np.abs(both).max(axis=0)))
        before = self._gaps(values)
        travel = BOUND_MARGIN * (motion.data.time - float(start[0])) * rates
        # Contact in between needs a motion of at least the sum of both gaps.
        clear = (after > DISTANCE_QUERY_M) & (before + after - 2.0 * DISTANCE_QUERY_M > travel)
        self._set_reach(after, motion.flight.motion_bound)
        return self._indices(self._watched & ~clear)

    def _gaps(self, coordinates: FloatArray) -> FloatArray:
        gaps: FloatArray = self._signs * (coordinates - self._values)
        return gaps

    def _set_reach(self, gaps: FloatArray, motion_bound: float) -> None:
        """Begin a new motion bound with these gaps."""
        reach = (gaps[self._watched] - DISTANCE_QUERY_M) / self._per_root_energy[self._watched]
        self.energy_reach = motion_bound + float(reach.min(initial=np.inf))

    def _indices(self, found: BoolArray) -> Indices:
        return self._first + np.flatnonzero(found)
