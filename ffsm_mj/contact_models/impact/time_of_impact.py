"""Event detection of impacts: the first time within a step at which a pair touches or a joint reaches its limit.

Most steps evaluate no distance: a pair that was far apart is evaluated again only after a motion that could have closed it.
Otherwise the step is a smooth path that can be evaluated at any time of it. A bound on the closing speed excludes most
intervals; the others are bisected until each gap has at most one extremum on them, and there the first root is bracketed. A
fast body therefore cannot pass through a thin plate between two samples, and a graze is neither missed nor invented.

Clearances: how far each pair can certainly still close before it is near contact.

A gap is evaluated only when the motion since its last evaluation may have closed it. Two bounds on that motion are used.
The kinetic energy bounds the speed of every body; its integral is accumulated by the stepper. The bound is poor for a light
link of a heavy system, which could be fast with all that energy. Once it is used up, the generalised velocities bound the
motion of each pair by the joints between its geoms; their sums are accumulated step by step, too.

Clearances of joint limits: which of them a joint may have reached in a step.

Gaps and rates of joints cost next to nothing, at the start of a step as at its end: both are evaluated exactly. As for pairs
the kinetic energy bounds how long this can be left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from ffsm_mj._core.gap_bounds import Instant
from ffsm_mj._core.steppers import BOUND_MARGIN
from ffsm_mj._core.travel import Closings, Travel
from ffsm_mj.arrays import BoolArray, FloatArray
from ffsm_mj.contact.broad_phase import FEW, BroadPhase
from ffsm_mj.contact.joint_limit import JointLimit, LimitCoordinates
from ffsm_mj.contact.motion_bound import TravelBound, speeds_per_root_energy
from ffsm_mj.contact.normal import DISTANCE_LIMIT_M
from ffsm_mj.contact.pairs import ContactPair, UnilateralConstraint, by_kind
from ffsm_mj.contact.piece_pair import TwoPieces
from ffsm_mj.contact.proximity import Proximity
from ffsm_mj.contact_models.impact.columns import DeepestOverlap
from ffsm_mj.contact_models.impact.first_touch import first_touch
from ffsm_mj.contact_models.impact.resolution import ClosedPairs, PersistentContacts, closed_pairs
from ffsm_mj.contact_models.interface import EventSource, Replayable, Scene
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.dynamics.springs import tendon_rows
from ffsm_mj.errors import UnsupportedContactError
from ffsm_mj.records.columns import Columns
from ffsm_mj.tolerances import CLEARLY_APART_M, DISTANCE_QUERY_M, EPSILON

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
        last: Largest closing of each pair in the last step, m, (n,); infinite before the first one.
    """

    def __init__(self, scene: Scene, pairs: Sequence[ContactPair]) -> None:
        """Bind to the state of a scene; :meth:`restart` must follow."""
        self._model, self._data, self._pairs = scene.system.mj, scene.data, pairs
        self._spheres = BroadPhase(self._model, pairs)
        self._per_root_energy = speeds_per_root_energy(self._model, self._data, pairs)
        self._clearance, self._skipped = np.zeros(len(pairs)), np.zeros(len(pairs), dtype=bool)
        self.last: FloatArray = np.full(len(pairs), np.inf)
        self._left: set[int] = set()
        self.travel, self._start, self.energy_reach = Travel(self._data.qvel), 0.0, 0.0
        self._bind_travel()

    def _bind_travel(self) -> None:
        """Compute the bounds by joints for the present displacements of slide joints."""
        self._by_joints = TravelBound(self._model, self._data.qpos, self._pairs)
        self._closings = Closings(self._by_joints.rows, self._by_joints.slides, self._per_root_energy)

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
        if self._motion.stepper.motion_bound < self.energy_reach or self.travel.is_within:
            return NO_PAIRS
        return np.flatnonzero(~(self._clearance > 0.0))

    def after_step(self) -> Indices:
        """Indices of the pairs that may have been in contact during the last step."""
        stepper = self._motion.stepper
        if stepper.motion_bound < self.energy_reach or self.travel.is_within:
            return NO_PAIRS
        self._clearance[list(self._left)] = -math.inf
        self._left.clear()
        closed = self._closings.most(self.travel.travelled, stepper.motion_bound - self._start)
        self.last = self._closings.most(self.travel.last, stepper.last_increment)
        return self._exhausted(closed, self.last, stepper.motion_bound)

    def last_closing(self, i: int) -> float:
        """Largest closing of a pair in the last step, by an index that may be of a joint limit too, m."""
        return float(self.last[i]) + DISTANCE_QUERY_M if i < len(self._pairs) else math.inf

    def follow_pieces(self, i: int) -> None:
        """Follow pieces of a pair by distance from here on, which their contact points watched: no bound holds for them."""
        self._left.add(i)
        self.travel.end()
        self.energy_reach = -math.inf

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
            self._clearance[i] = self._pairs[i].watched_gap(model, data, DISTANCE_LIMIT_M) - DISTANCE_QUERY_M

    def _begin(self, motion_bound: float) -> None:
        """Begin new bounds on the motion at the state in ``data``, for which the clearances hold."""
        data, slides = self._data, self._by_joints.slide_allowance(self._data.qpos)
        if (slides <= 0.0).any():
            self._bind_travel()
            slides = self._by_joints.slide_allowance(data.qpos)
        self._clearance[self._skipped] = math.inf
        self._start = motion_bound
        self.energy_reach = motion_bound + self._closings.begin(self.travel, self._clearance, slides)


_ROUNDING = 4.0 * EPSILON
"""Of a gap q - limit with q near it, relative to 1 + the limit: q, the limit and their difference are rounded."""


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
        # Coordinates of joints are exact; lengths of tendons at the start of a step are not known.
        self._unknown = np.array([_ROUNDING * (1.0 + abs(limit.limit)) for limit in limits])
        self._unknown[len(self._coordinates.joints) :] = DISTANCE_QUERY_M
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
        if motion.stepper.motion_bound < self.energy_reach:
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
        clear = (after > self._unknown) & (before + after - 2.0 * self._unknown > travel)
        self._set_reach(after, motion.stepper.motion_bound)
        return self._indices(self._watched & ~clear)

    def _gaps(self, coordinates: FloatArray) -> FloatArray:
        gaps: FloatArray = self._signs * (coordinates - self._values)
        return gaps

    def _set_reach(self, gaps: FloatArray, motion_bound: float) -> None:
        """Begin a new motion bound with these gaps."""
        # A limit nearer than this is evaluated in any case (:meth:`near`): the bound counts the way until there.
        reach = (gaps[self._watched] - DISTANCE_QUERY_M) / self._per_root_energy[self._watched]
        self.energy_reach = motion_bound + float(reach.min(initial=np.inf))

    def _indices(self, flags: BoolArray) -> Indices:
        return self._first + np.flatnonzero(flags)


_MAX_DEPTH = 48
"""Depth of bisection at which an interval is shorter than the rounding of time."""
_MAX_BISECTIONS = 20_000
"""Bisections in one step; an impact at 1000 m/s on a plate of 1 mm within 10 ms takes about 60."""
_MAX_EVALUATIONS = 2_000
"""Evaluations of pairs at different times of one step; a graze takes some tens."""


@dataclass(frozen=True)
class _Sample:
    """The suspects at one time since the start of the step: distances in m, closing speed bounds in m/s, and the state."""

    time: float
    gaps: tuple[float, ...]
    bounds: tuple[float, ...]
    instant: Instant | None


def _may_touch(pair: UnilateralConstraint, before: Instant | None, after: Instant | None) -> bool:
    """Whether a pair may touch between two states of a step, if both are known: a face parts most pieces all the time."""
    if before is None or after is None or not isinstance(pair, TwoPieces):
        return True
    return not pair.stays_apart(before, after)


def _never(_: UnilateralConstraint) -> bool:
    return False


class Detector(EventSource, Replayable):
    """Detects impacts of pairs: evaluates them along the motion and locates the first touch within a step.

    Attributes:
        pairs: Contact pairs, then joint limits.
        columns: Deepest overlap of any pair, and overrun of any joint limit; see
            :class:`~ffsm_mj.contact_models.impact.columns.DeepestOverlap`.
    """

    kind = "impact"

    def __init__(
        self,
        scene: Scene,
        pairs: Sequence[UnilateralConstraint],
        persistent: PersistentContacts | None = None,
        overlap: DeepestOverlap | None = None,
    ) -> None:
        """Start at the state of a scene.

        Args:
            scene: The logged system and its data.
            pairs: Pairs and joint limits to detect.
            persistent: Persistent contact, which takes over the pairs that stay closed; None: there is none.
            overlap: Deepest overlap, shared with ``persistent``; None: an own one.
        """
        super().__init__(scene)
        self._model, self._data = scene.system.mj, scene.data
        self.pairs = tuple(pairs)
        self._holds: Callable[[UnilateralConstraint], bool] = persistent.holds if persistent is not None else _never
        self._overlap = overlap or DeepestOverlap()
        self.columns: tuple[Columns, ...] = self._overlap.columns
        self._broad_phase = BroadPhase(self._model, self.pairs)
        geoms, limits = by_kind(self.pairs)
        self._clearances, self._limits = Clearances(scene, geoms), LimitClearances(scene, limits, len(geoms))
        self.watched = frozenset(ids for pair in self.pairs for ids in pair.geom_pairs)
        self.travels = (self._clearances.travel,)
        for i, pair in enumerate(geoms):
            if pair.has_pieces:
                pair.on_left = partial(self._follow_pieces, i)
        self._has_pieces = any(pair.has_pieces for pair in geoms)
        self._ends: tuple[Instant | None, Instant | None] = (None, None)
        self._suspects: tuple[UnilateralConstraint, ...] = ()
        # Evaluations of this step by pair and time; those at its end are kept as the start of the next step.
        self._evaluated: dict[tuple[UnilateralConstraint, float], Proximity] = {}

    def restart(self) -> None:
        """Discard all evaluations, because the state or the efforts changed discontinuously."""
        self._evaluated = {}
        self._measure_clearances()

    def _follow_pieces(self, i: int) -> None:
        self._clearances.follow_pieces(i)
        self._bound_events()

    def _measure_clearances(self) -> None:
        for clearances in (self._clearances, self._limits):
            clearances.restart(self.motion, self._is_skipped)
        self._bound_events()
        self._note_instant()

    def _instant(self) -> Instant | None:
        """The state in ``data``, for pairs of pieces; None: there are none."""
        return Instant(self._model, self._data) if self._has_pieces else None

    def _note_instant(self) -> None:
        """Note the state at the end of a step, at which the next one may start."""
        (before, last), now = self._ends, self._instant()
        is_same = last is not None and now is not None and last.time == now.time
        self._ends = before if is_same else last, now

    def _bound_events(self) -> None:
        self.bound_within = self._limits.energy_reach
        self.event_bound = min(self._clearances.energy_reach, self.bound_within)

    def _is_skipped(self, pair: UnilateralConstraint) -> bool:
        """Whether a pair has no impacts now: persistent contact holds it, or both geoms are on one rigid body.

        A pair of unions that is held goes on with those pieces that do not touch.
        """
        in_contact = self._holds(pair) and (pair.is_limit or not pair.has_pieces)
        return in_contact or pair.geom_ids in self.motion.disabled

    def is_clear(self) -> bool:
        """Whether the bounds on the motion exclude contact of all pairs in the last step."""
        if self.motion.stepper.motion_bound > self.motion.stepper.last_increment:
            self._evaluated.clear()  # of an earlier step
        # Bounds on the motion are cheap and certain: only pairs that they do not clear are followed along the path.
        suspects = (*self._clearances.after_step().tolist(), *self._limits.after_step().tolist())
        # Of unions those pieces that may have touched in the last step: each pair of them is followed by itself.
        self._note_instant()
        before, now = self._ends
        if before is not None and before.time != self.motion.path.start[0]:
            before = None  # of an earlier step: this one started where nothing was asked
        self._suspects = tuple(
            one
            for i in suspects
            for one in self.pairs[i].apart_within(self._model, self._data, self._clearances.last_closing(i))
            if _may_touch(one, before, now)
        )
        self._bound_events()
        return not self._suspects

    def first_event(self, duration_s: float) -> float | None:
        """First time in the first ``duration_s`` of the last step at which a pair touches: approaching, or pressed at rest.

        Raises:
            UnsupportedContactError: Bodies close or spin too fast to be followed.
        """
        path = self.motion.path
        path.move_to(duration_s)
        end = self._sample(duration_s)
        path.move_to(0.0)
        start = self._sample(0.0)
        self._bisections = 0
        return self._first_in(start, end, 0)

    def on_event_located(self, time_s: float) -> None:
        """Update the deepest overlap, and start new motion bounds from here."""
        self.update_overlap(time_s)
        self._evaluated = {(pair, 0.0): near for (pair, time), near in self._evaluated.items() if time == time_s}
        self._measure_clearances()

    def closed_pairs(self, *, located: bool = False) -> ClosedPairs:
        """All pairs in contact at the state in ``data``; ``located``: it is that of an event just located."""
        # Evaluations since the last step are of this state: no model has changed it yet.
        known = self._evaluated if located and self.motion.stepper.motion_bound <= 0.0 else {}
        return closed_pairs(self._broad_phase, self.scene, self.motion, known)

    def update_overlap(self, time: float | None = None) -> None:
        """Update the deepest overlap with that of the pairs at the state in ``data``.

        Args:
            time: Time since the start of the step, if evaluations of this step may be used.
        """
        for i in self._broad_phase.near(self._data):
            pair = self.pairs[i]
            if not self._is_skipped(pair) and not self._holds(pair):
                self._overlap.add(pair, self._proximity(pair, time).gap)

    def _proximity(self, pair: UnilateralConstraint, time: float | None) -> Proximity:
        """Proximity of a pair at the state in ``data``; evaluated once per time since the start of the step, if given."""
        if time is None:
            return pair.watched_proximity(self._model, self._data)
        if (pair, time) not in self._evaluated:
            if len(self._evaluated) >= _MAX_EVALUATIONS:
                raise UnsupportedContactError(
                    f"the gap of {pair} changes too often within a step to be followed; use a shorter time_step_s"
                )
            self._evaluated[pair, time] = pair.watched_proximity(self._model, self._data)
        return self._evaluated[pair, time]

    def _sample(self, time: float) -> _Sample:
        model, data = self._model, self._data
        bounds = tuple(pair.closing_speed_bound(data) for pair in self._suspects)
        gaps = tuple(pair.gap(model, data, DISTANCE_LIMIT_M) for pair in self._suspects)
        return _Sample(time, gaps, bounds, self._instant())

    def due(self) -> bool:
        """Whether a pair touches and approaches at the state in ``data``."""
        if self.motion.stepper.motion_bound > 0.0:
            self._evaluated.clear()  # of an earlier step
        indices = (*self._clearances.near().tolist(), *self._limits.near().tolist())
        pairs = (self.pairs[i].apart_within(self._model, self._data, DISTANCE_QUERY_M) for i in indices)
        near = (self._proximity(pair, 0.0) for some in pairs for pair in some)
        # To rounding, as roots are located: another model may have an event that is due here.
        return any(pair.gap <= pair.rounding and pair.approaches for pair in near)

    def _touch_of(self, pair: UnilateralConstraint, start: float, end: float, end_gap: float) -> float | None:
        """First touch of one pair in an interval where its gap has at most one extremum; see :func:`first_touch`."""
        model, data = self._model, self._data

        def at(time: float) -> Proximity:
            if (pair, time) not in self._evaluated:
                self.motion.path.move_to(time)
            return self._proximity(pair, time)

        def pressed(time: float) -> bool:
            self.motion.path.move_to(time)
            return pair.is_pressed(model, data, at(time))

        touch = first_touch(at, start, end, pressed, end_gap)
        if touch is None and not pair.is_limit and at(start).gap < -CLEARLY_APART_M:  # none has passed otherwise
            pair.refuse_passage(at(start), at(end))
        # Two pieces that touch where other pieces cover them, or go on with a contact that is held, begin nothing.
        if touch is not None and not pair.is_limit and any(map(self._holds, pair.together)) and not at(touch).approaches:
            return None
        return touch

    def _first_in(self, a: _Sample, b: _Sample, depth: int) -> float | None:
        """First touch between two samples, by bisection until each pair that may touch moves by less than its size."""
        span = b.time - a.time
        # The gap cannot fall faster than the bound from either end, so contact needs bound * span >= the sum of both gaps.
        candidates = [
            (pair, max(a.bounds[k], b.bounds[k]) * span, b.gaps[k])
            for k, pair in enumerate(self._suspects)
            if a.gaps[k] + b.gaps[k] - 2.0 * DISTANCE_QUERY_M <= max(a.bounds[k], b.bounds[k]) * span
            and _may_touch(pair, a.instant, b.instant)
        ]
        if not candidates:
            return None
        simple = all(motion <= pair.size for pair, motion, _ in candidates)
        if simple or depth >= _MAX_DEPTH:
            # At once for all that need it: each move integrates from the start of the step.
            self.motion.path.move_to(a.time)
            first = [(pair, end_gap, self._proximity(pair, a.time)) for pair, _, end_gap in candidates]
            # The rate at the start tells of a pair that is clearly apart at the end whether it may have touched before.
            open_ends = [
                p for p, end_gap, near in first if abs(end_gap) <= CLEARLY_APART_M or (end_gap > 0.0 and near.approaches)
            ]
            if open_ends:
                self.motion.path.move_to(b.time)
                for pair in open_ends:
                    self._proximity(pair, b.time)
            touches = (self._touch_of(pair, a.time, b.time, end_gap) for pair, _, end_gap in candidates)
            return min((touch for touch in touches if touch is not None), default=None)
        self._bisections += 1
        if self._bisections > _MAX_BISECTIONS:
            fastest = max(*a.bounds, *b.bounds)
            raise UnsupportedContactError(f"bodies close at up to {fastest:.3g} m/s, too fast to be followed")
        self.motion.path.move_to(a.time + 0.5 * span)
        middle = self._sample(a.time + 0.5 * span)
        touch = self._first_in(a, middle, depth + 1)
        return touch if touch is not None else self._first_in(middle, b, depth + 1)
