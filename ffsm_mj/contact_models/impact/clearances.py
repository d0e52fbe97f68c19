"""Clearances: how far each pair can certainly still close before it is near contact.

A gap is evaluated only when the motion since its last evaluation may have closed it. Two bounds on that motion are used.
The kinetic energy bounds the speed of every body; its integral is accumulated by the stepper. The bound is poor for a light
link of a heavy system, which could be fast with all that energy. Once it is used up, the generalised velocities bound the
motion of each pair by the joints between its geoms; their sums are accumulated step by step, too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from ffsm_mj._core.travel import Travel
from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.broad_phase import FEW, BroadPhase
from ffsm_mj.contact.motion_bound import speeds_per_root_energy
from ffsm_mj.contact.normal_search import DISTANCE_LIMIT_M
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact.travel_bound import TravelBound
from ffsm_mj.contact_models.interface import Scene
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.tolerances import DISTANCE_QUERY_M

Indices = npt.NDArray[np.intp]
_STEPS_AHEAD = 16
"""A pair that the present motion could bring near contact within so many steps is evaluated with the exhausted ones."""
NO_PAIRS: Indices = np.zeros(0, dtype=np.intp)


class Clearances:
    """Certified clearances of some pairs, from step to step.

    Attributes:
        energy_reach: Motion bound (``motion_bound`` of :class:`~ffsm_mj._core.steppers.FreeStepper`) below which no
            pair can be near contact.
        travel: Motion of the coordinates, within whose reach none can be either.
    """

    def __init__(self, scene: Scene, pairs: Sequence[ContactPair]) -> None:
        """Bind to the state of a scene; :meth:`restart` must follow."""
        self._model, self._data, self._pairs = scene.system.mj, scene.data, pairs
        self._spheres = BroadPhase(self._model, pairs)
        self._per_root_energy = speeds_per_root_energy(self._model, self._data, [pair.ids for pair in pairs])
        self._clearance, self._skipped = np.zeros(len(pairs)), np.zeros(len(pairs), dtype=bool)
        self.travel, self._start, self.energy_reach = Travel(self._data.qvel), 0.0, 0.0
        self._bind_travel()

    def _bind_travel(self) -> None:
        """Compute the bounds by joints for the present displacements of slide joints."""
        self._by_joints = TravelBound(self._model, self._data.qpos, [pair.ids for pair in self._pairs])
        rows = np.concatenate((self._by_joints.rows, np.eye(self._model.nv)[self._by_joints.slides]))
        # One number accumulates the largest weighted motion of all degrees of freedom, instead of a sum for each pair.
        self._weights = rows.max(axis=0, initial=0.0)
        self._per_length = (rows / np.where(self._weights > 0.0, self._weights, 1.0)).sum(axis=1)

    def restart(self, motion: Motion, is_skipped: Callable[[ContactPair], bool]) -> None:
        """Start at the state in ``data``, which has changed discontinuously, or the pairs to be detected have.

        Args:
            motion: The motion that follows.
            is_skipped: Whether a pair is not detected now.
        """
        self._motion = motion
        self._skipped[:] = [is_skipped(pair) for pair in self._pairs]
        self._measure(np.flatnonzero(~self._skipped))
        self._begin(0.0)

    def near(self) -> Indices:
        """Indices of the pairs that may be in contact at the state in ``data``."""
        if self._motion.flight.motion_bound < self.energy_reach or self.travel.is_within:
            return NO_PAIRS
        return np.flatnonzero(~(self._clearance > 0.0))

    def after_step(self) -> Indices:
        """Indices of the pairs that may have been in contact during the last step."""
        flight = self._motion.flight
        if flight.motion_bound < self.energy_reach or self.travel.is_within:
            return NO_PAIRS
        rows, parts = self._by_joints.rows, (flight.motion_bound - self._start, flight.last_increment)
        moved = zip((self.travel.travelled, self.travel.last), map(self._by_energy, parts), strict=True)
        closed, last = (np.minimum(rows @ by_rates, by_energy) for by_rates, by_energy in moved)
        return self._exhausted(closed, last, flight.motion_bound)

    def _by_energy(self, motion_bound: float) -> FloatArray:
        """Largest closing of each pair in a motion, m."""
        return self._per_root_energy * motion_bound if motion_bound > 0.0 else np.zeros(len(self._pairs))

    def _exhausted(self, closed: FloatArray, last: FloatArray, motion_bound: float) -> Indices:
        """Evaluate the pairs that may be near contact after closing by at most these lengths; return the suspects.

        Args:
            closed: Largest closing of each pair since its evaluation, m.
            last: That of the last step, m.
            motion_bound: Motion bound at the state in ``data``.
        """
        left = np.where(self._skipped, math.inf, self._clearance - closed)
        before = left + last
        if len(self._pairs) > FEW:
            left = np.maximum(left, self._spheres.gaps(self._data) - DISTANCE_QUERY_M)
        # Pairs that would be exhausted soon are evaluated with those that are: one by one they would spoil many steps.
        spent = np.flatnonzero(~(left > _STEPS_AHEAD * last))
        before = before[spent]
        self._clearance = left
        self._measure(spent)
        # A pair is at least ``before`` apart at the start of the step and ``apart`` at its end: contact in between needs a
        # motion of at least the sum of both.
        apart = self._clearance[spent]
        suspects = spent[~((apart > 0.0) & (before + apart > last[spent]))]
        self._begin(motion_bound)
        return suspects

    def _measure(self, indices: Indices) -> None:
        """Set the clearances of some pairs to those at the state in ``data``, m."""
        model, data = self._model, self._data
        if len(self._pairs) > FEW and len(indices):
            spheres = self._spheres.gaps(data)[indices]
            self._clearance[indices] = spheres - DISTANCE_QUERY_M
            indices = indices[spheres < self._spheres.radii[indices]]
        for i in indices.tolist():
            self._clearance[i] = self._pairs[i].gap(model, data, DISTANCE_LIMIT_M) - DISTANCE_QUERY_M

    def _begin(self, motion_bound: float) -> None:
        """Begin new bounds on the motion at the state in ``data``, for which the clearances hold."""
        data, slides = self._data, self._by_joints.slide_allowance(self._data.qpos)
        if (slides <= 0.0).any():
            self._bind_travel()
            slides = self._by_joints.slide_allowance(data.qpos)
        self._clearance[self._skipped] = math.inf
        self._start = motion_bound
        with np.errstate(divide="ignore", invalid="ignore"):
            self.travel.begin(self._weights, _least(np.concatenate((self._clearance, slides)) / self._per_length))
            self.energy_reach = motion_bound + _least(self._clearance / self._per_root_energy)


def _least(lengths: FloatArray) -> float:
    """Least of some lengths; infinite ones over infinite bounds, which are not numbers, do not count."""
    return float(np.fmin.reduce(lengths, initial=math.inf))
