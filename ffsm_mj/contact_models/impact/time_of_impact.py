"""Event detection of impacts: the first time within a step at which a pair touches or a joint reaches its limit.

Most steps evaluate no distance: a pair that was far apart is evaluated again only after a motion that could have closed it
(:mod:`.clearances`). Otherwise the step is a smooth path that can be evaluated at
any time of it. A bound on the closing speed excludes most intervals; the others are bisected until each gap has at most one
extremum on them, and there the first root is bracketed. A fast body therefore cannot pass through a thin plate between two
samples, and a graze is neither missed nor invented.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ffsm_mj.contact.broad_phase import BroadPhase
from ffsm_mj.contact.constraint import UnilateralConstraint
from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.contact.normal_search import DISTANCE_LIMIT_M
from ffsm_mj.contact.proximity import Proximity
from ffsm_mj.contact_models.impact.clearances import Clearances
from ffsm_mj.contact_models.impact.closed_pairs import ClosedPairs, PersistentContacts, closed_pairs
from ffsm_mj.contact_models.impact.deepest_overlap import DeepestOverlap
from ffsm_mj.contact_models.impact.first_touch import first_touch
from ffsm_mj.contact_models.impact.limit_clearances import LimitClearances
from ffsm_mj.contact_models.interface import EventSource, Replayable, Scene
from ffsm_mj.errors import UnsupportedContactError
from ffsm_mj.records.columns import Columns
from ffsm_mj.tolerances import DISTANCE_QUERY_M

_MAX_DEPTH = 48
"""Depth of bisection at which an interval is shorter than the rounding of time."""
_MAX_BISECTIONS = 20_000
"""Bisections in one step; an impact at 1000 m/s on a plate of 1 mm within 10 ms takes about 60."""
_MAX_EVALUATIONS = 2_000
"""Evaluations of pairs at different times of one step; a graze takes some tens."""


@dataclass(frozen=True)
class _Sample:
    """The suspects at one time since the start of the step: distances in m and closing speed bounds in m/s."""

    time: float
    gaps: tuple[float, ...]
    bounds: tuple[float, ...]


def _never(_: UnilateralConstraint) -> bool:
    return False


class Detector(EventSource, Replayable):
    """Detects impacts of pairs: evaluates them along the motion and locates the first touch within a step.

    Attributes:
        pairs: Contact pairs, then joint limits.
        columns: Deepest overlap of any pair, and overrun of any joint limit; see
            :class:`~ffsm_mj.contact_models.impact.deepest_overlap.DeepestOverlap`.
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
        geoms = [pair for pair in self.pairs if not isinstance(pair, JointLimit)]
        limits = [pair for pair in self.pairs if isinstance(pair, JointLimit)]
        self._clearances, self._limits = Clearances(scene, geoms), LimitClearances(scene, limits, len(geoms))
        self.watched, self.travels = frozenset(pair.geom_ids for pair in self.pairs), (self._clearances.travel,)
        self._suspects: tuple[int, ...] = ()
        # Evaluations of this step by pair and time; those at its end are kept as the start of the next step.
        self._evaluated: dict[tuple[int, float], Proximity] = {}

    def restart(self) -> None:
        """Discard all evaluations, because the state or the efforts changed discontinuously."""
        self._evaluated = {}
        self._measure_clearances()

    def _measure_clearances(self) -> None:
        for clearances in (self._clearances, self._limits):
            clearances.restart(self.motion, self._is_skipped)
        self._bound_events()

    def _bound_events(self) -> None:
        self.bound_within = self._limits.energy_reach
        self.event_bound = min(self._clearances.energy_reach, self.bound_within)

    def _is_skipped(self, pair: UnilateralConstraint) -> bool:
        """Whether a pair has no impacts now: persistent contact holds it, or both geoms are on one rigid body."""
        return self._holds(pair) or pair.geom_ids in self.motion.disabled

    def is_clear(self) -> bool:
        """Whether the bounds on the motion exclude contact of all pairs in the last step."""
        if self.motion.flight.motion_bound > self.motion.flight.last_increment:
            self._evaluated.clear()  # of an earlier step
        self._suspects = (*self._clearances.after_step().tolist(), *self._limits.after_step().tolist())
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
        self._evaluated = {(i, 0.0): near for (i, time), near in self._evaluated.items() if time == time_s}
        self._measure_clearances()

    def closed_pairs(self) -> ClosedPairs:
        """All pairs in contact at the state in ``data``."""
        return closed_pairs(self._broad_phase, self.scene, self.motion)

    def update_overlap(self, time: float | None = None) -> None:
        """Update the deepest overlap with that of the pairs at the state in ``data``.

        Args:
            time: Time since the start of the step, if evaluations of this step may be used.
        """
        for i in self._broad_phase.near(self._data):
            if not self._is_skipped(self.pairs[i]):
                self._overlap.add(self.pairs[i], self._proximity(i, time).gap)

    def _proximity(self, i: int, time: float | None) -> Proximity:
        """Proximity of a pair at the state in ``data``; evaluated once per time since the start of the step, if given."""
        if time is None:
            return self.pairs[i].proximity(self._model, self._data)
        if (i, time) not in self._evaluated:
            if len(self._evaluated) >= _MAX_EVALUATIONS:
                raise UnsupportedContactError(
                    f"the gap of {self.pairs[i]} changes too often within a step to be followed; use a shorter time_step_s"
                )
            self._evaluated[i, time] = self.pairs[i].proximity(self._model, self._data)
        return self._evaluated[i, time]

    def _sample(self, time: float) -> _Sample:
        model, data = self._model, self._data
        pairs = [self.pairs[i] for i in self._suspects]
        bounds = tuple(pair.closing_speed_bound(data) for pair in pairs)
        gaps = tuple(pair.gap(model, data, DISTANCE_LIMIT_M) for pair in pairs)
        return _Sample(time, gaps, bounds)

    def due(self) -> bool:
        """Whether a pair touches and approaches at the state in ``data``."""
        if self.motion.flight.motion_bound > 0.0:
            self._evaluated.clear()  # of an earlier step
        near = (self._proximity(i, 0.0) for i in (*self._clearances.near().tolist(), *self._limits.near().tolist()))
        # To rounding, as roots are located: another model may have an event that is due here.
        return any(pair.gap <= pair.rounding and pair.approaches for pair in near)

    def _touch_of(self, i: int, start: float, end: float) -> float | None:
        """First touch of one pair in an interval where its gap has at most one extremum."""
        pair, model, data = self.pairs[i], self._model, self._data

        def at(time: float) -> Proximity:
            self.motion.path.move_to(time)
            return self._proximity(i, time)

        return first_touch(at, start, end, lambda near: pair.is_pressed(model, data, near))

    def _first_in(self, a: _Sample, b: _Sample, depth: int) -> float | None:
        """First touch between two samples, by bisection until each pair that may touch moves by less than its size."""
        span = b.time - a.time
        # The gap cannot fall faster than the bound from either end, so contact needs bound * span >= the sum of both gaps.
        candidates = [
            (i, max(a.bounds[k], b.bounds[k]) * span)
            for k, i in enumerate(self._suspects)
            if a.gaps[k] + b.gaps[k] - 2.0 * DISTANCE_QUERY_M <= max(a.bounds[k], b.bounds[k]) * span
        ]
        if not candidates:
            return None
        simple = all(motion <= self.pairs[i].size for i, motion in candidates)
        if simple or depth >= _MAX_DEPTH:
            touches = [t for t in (self._touch_of(i, a.time, b.time) for i, _ in candidates) if t is not None]
            return min(touches, default=None)
        self._bisections += 1
        if self._bisections > _MAX_BISECTIONS:
            fastest = max(*a.bounds, *b.bounds)
            raise UnsupportedContactError(f"bodies close at up to {fastest:.3g} m/s, too fast to be followed")
        self.motion.path.move_to(a.time + 0.5 * span)
        middle = self._sample(a.time + 0.5 * span)
        first = self._first_in(a, middle, depth + 1)
        return first if first is not None else self._first_in(middle, b, depth + 1)
