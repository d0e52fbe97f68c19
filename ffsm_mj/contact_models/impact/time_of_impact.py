"""When, within a step, does a pair first touch?

The step is a smooth path that can be evaluated at any fraction (restore, step for a shorter time). A closing-speed bound
rules out most intervals; the rest are halved until each gap is a simple function of time on them, and there the first
root is bracketed and found. So a thin plate is never jumped over, and a graze is neither missed nor invented.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ffsm_mj.contact.normal_search import DISTANCE_LIMIT_M
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact.proximity import Proximity
from ffsm_mj.contact_models.impact.closing import NoPersistentContacts, PersistentContacts
from ffsm_mj.contact_models.impact.first_touch import first_touch
from ffsm_mj.contact_models.interface import ContactModel, Scene
from ffsm_mj.errors import UnsupportedContactError
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.signals import OVERLAP, Signal
from ffsm_mj.tolerances import CONTACT_GAP_M, DISTANCE_QUERY_M

# Where only near pairs count, gaps beyond this in m need not be told apart.
_LOOK = 1e-3
_MAX_HALVINGS = 48
# In one step; a hit at 1000 m/s on a plate of 1 mm within 10 ms takes about 60.
_MOST_HALVINGS = 20_000
# At pairs in one step, at instants of their own; a graze takes some tens.
_MOST_LOOKS = 2_000


@dataclass(frozen=True)
class _Edge:
    """All pairs at one end of an interval: time since the start of the step, gaps and closing bounds."""

    time: float
    gaps: tuple[float, ...]
    bounds: tuple[float, ...]


class Detector(ContactModel):
    """Watches impact pairs along the motion, and finds the first touch within a step.

    Most steps ask for no distance at all: the kinetic energy bounds how fast any gap can close, so a pair that was far
    apart is looked at again only when it could have come near.

    Attributes:
        pairs: Those that it watches.
        closing: Takes over those that stay closed.
        columns: Deepest overlap of any pair at the ends of (sub-)steps since the sample before.
    """

    def __init__(self, scene: Scene, pairs: Sequence[ContactPair]) -> None:
        """Watch pairs by the state of a scene."""
        super().__init__(None, scene)
        model, data = self._model, self._data = scene.system.mj, scene.data
        self.pairs = tuple(pairs)
        self.closing: PersistentContacts = NoPersistentContacts()
        self._reach = [pair.speed_bound_per_root_energy(model, data) for pair in self.pairs]
        self.watched = frozenset(pair.geom_ids for pair in self.pairs)
        # What was seen in this step, by pair and time; at the start of the next one what was seen at the end of it.
        self._seen: dict[tuple[int, float], Proximity] = {}
        self._deepest, self._told = 0.0, np.zeros(1)
        meaning = "deepest overlap of an impact pair at the ends of the steps and sub-steps since the sample before"
        self.columns = (Columns((Signal("balance", OVERLAP, "m", meaning),), live=self._told, on_sample=self._tell),)

    def restart(self) -> None:
        """Look again after something changed at one instant."""
        self._seen = {}
        self._look_ahead()

    def _look_ahead(self) -> None:
        # How far the flight must go before each pair can have touched; held ones have no touch to come.
        self._safe = [
            math.inf
            if self._elsewhere(pair)
            else (pair.gap(self._model, self._data, DISTANCE_LIMIT_M) - DISTANCE_QUERY_M) / reach
            for pair, reach in zip(self.pairs, self._reach, strict=True)
        ]
        self.horizon = min(self._safe, default=math.inf)

    def _elsewhere(self, pair: ContactPair) -> bool:
        """Whether a pair is none to watch now: somebody holds it closed, or what moves has it on one rigid body."""
        return self.closing.holds(pair) or pair.geom_ids in self.motion.rigid

    def is_clear(self) -> bool:
        """Whether no pair can have touched in the last step, given how far it went; distances are asked as needed."""
        flight = self.motion.flight
        before = flight.way - flight.last
        if before > 0.0:
            self._seen.clear()  # it tells of an earlier step
        for i, (pair, reach) in enumerate(zip(self.pairs, self._reach, strict=True)):
            if flight.way < self._safe[i]:
                continue
            apart = pair.gap(self._model, self._data, DISTANCE_LIMIT_M) - DISTANCE_QUERY_M
            if apart <= 0.0 or reach * (self._safe[i] - before) + apart <= reach * flight.last:
                return False
            self._safe[i] = flight.way + apart / reach
        self.horizon = min(self._safe, default=math.inf)
        return True

    def first_event(self, duration_s: float) -> float | None:
        """When a pair touches within so much of the last step: it approaches, or is closed and pressed together.

        Raises:
            UnsupportedContactError: Bodies close in too fast, or spin too fast, to follow.
        """
        path = self.motion.path
        path.move_to(duration_s)
        end = self._edge(duration_s)
        path.move_to(0.0)
        start = self._edge(0.0)
        self._halvings = 0
        return self._first_touch(start, end, 0)

    def on_event_located(self, time_s: float) -> None:
        """Keep account of overlaps, and look ahead from here."""
        self.note_overlap(time_s)
        self._seen = {(i, 0.0): near for (i, time), near in self._seen.items() if time == time_s}
        self._look_ahead()

    def contacts(self) -> list[tuple[ContactPair, Proximity]]:
        """All pairs in contact at the state in ``data``."""
        model, data = self._model, self._data
        rigid = self.motion.rigid
        close = [
            pair for pair in self.pairs if pair.geom_ids not in rigid and pair.gap(model, data, _LOOK) <= DISTANCE_QUERY_M
        ]
        near = [(pair, pair.proximity(model, data)) for pair in close]
        return [(pair, proximity) for pair, proximity in near if proximity.gap <= CONTACT_GAP_M]

    def note_overlap(self, time: float | None = None) -> None:
        """Keep account of how deep pairs overlap at the state in ``data``; far pairs are asked for no exact gap.

        Args:
            time: Since the start of the step, where what was seen in it may be used.
        """
        for i, pair in enumerate(self.pairs):
            if not self._elsewhere(pair) and pair.gap(self._model, self._data, _LOOK) <= DISTANCE_QUERY_M:
                self.deepen(-self._look(i, time).gap)

    def deepen(self, depth: float) -> None:
        """Keep account of an overlap, m, of a pair that somebody else looks after."""
        self._deepest = max(self._deepest, depth)

    def _tell(self, _: float) -> None:
        self._told[0], self._deepest = self._deepest, 0.0

    def _look(self, i: int, time: float | None) -> Proximity:
        """A pair at the state in ``data``; looked at once where the time since the start of the step is known."""
        if time is None:
            return self.pairs[i].proximity(self._model, self._data)
        if (i, time) not in self._seen:
            if len(self._seen) >= _MOST_LOOKS:
                raise UnsupportedContactError(
                    f"the gap of {self.pairs[i]} changes too often within a step to follow; try a shorter one"
                )
            self._seen[i, time] = self.pairs[i].proximity(self._model, self._data)
        return self._seen[i, time]

    def _edge(self, time: float) -> _Edge:
        model, data = self._model, self._data
        bounds = tuple(pair.closing_speed_bound(data) for pair in self.pairs)
        gaps = tuple(pair.gap(model, data, DISTANCE_LIMIT_M) for pair in self.pairs)
        return _Edge(time, gaps, bounds)

    def due(self) -> bool:
        """Whether a pair touches and approaches at the state in ``data``."""
        flight = self.motion.flight
        if flight.way > 0.0:
            self._seen.clear()  # it tells of an earlier step
        for i, safe in enumerate(self._safe):
            if safe <= flight.way:
                near = self._look(i, 0.0)
                if near.gap <= 0.0 and near.approaches:
                    return True
        return False

    def _touch_of(self, i: int, start: float, end: float) -> float | None:
        """First touch of one pair on a stretch where its gap is simple."""
        pair, model, data = self.pairs[i], self._model, self._data

        def at(time: float) -> Proximity:
            self.motion.path.move_to(time)
            return self._look(i, time)

        return first_touch(at, start, end, lambda near: pair.is_pressed(model, data, near))

    def _first_touch(self, a: _Edge, b: _Edge, depth: int) -> float | None:
        """Earliest touch in an interval, halving it until each pair that may touch moves simply."""
        span = b.time - a.time
        open_pairs = [
            i
            for i, pair in enumerate(self.pairs)
            if a.gaps[i] + b.gaps[i] - 2.0 * DISTANCE_QUERY_M <= max(a.bounds[i], b.bounds[i]) * span
            and not self._elsewhere(pair)
        ]
        if not open_pairs:
            return None
        simple = all(max(a.bounds[i], b.bounds[i]) * span <= self.pairs[i].size for i in open_pairs)
        if simple or depth >= _MAX_HALVINGS:
            touches = [t for t in (self._touch_of(i, a.time, b.time) for i in open_pairs) if t is not None]
            return min(touches, default=None)
        self._halvings += 1
        if self._halvings > _MOST_HALVINGS:
            raise UnsupportedContactError(
                f"bodies close in at up to {max(*a.bounds, *b.bounds):.3g} m/s, too fast to follow"
            )
        self.motion.path.move_to(a.time + 0.5 * span)
        middle = self._edge(a.time + 0.5 * span)
        first = self._first_touch(a, middle, depth + 1)
        return first if first is not None else self._first_touch(middle, b, depth + 1)
