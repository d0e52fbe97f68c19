"""Friction modes of contact points, kept from (sub-)step to (sub-)step: closed without force, sliding, sticking."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

from ffsm_mj.arrays import BoolArray, FloatArray, IntArray
from ffsm_mj.cached_property import cached_property
from ffsm_mj.contact.pairs import UnilateralConstraint
from ffsm_mj.contact_models.persistent.contact_points import ContactPoint
from ffsm_mj.state import entries
from ffsm_mj.tolerances import CLOSED_RATE, RATE, SOLVED

TOGETHER = 100.0
"""Points whose slip is within this factor of the speed at which another one stops, stop with it."""
UNKNOWN = -1
"""In place of the mode of a point that has none yet."""
_STOPPED = 1e-9
"""A point stops where its slip is below this share of its largest slip since it last began to slide."""
_LEAST_SLIP_M_S = 1e-3
"""Smallest value of that largest slip, m/s."""
_STRAIGHT = 1e-6
"""Below this share of the largest slip a point that slows down goes straight on to its stop.

The direction of a slip near zero is rounding, and would turn the friction of its last instants.
"""
_STRUCK = SOLVED / RATE
"""Slip that an impact leaves is rounding within SOLVED of the speeds, this many times the rounding of speeds."""


class PointMode(IntEnum):
    """Mode of a closed contact point. A point without friction that carries force slides: it presses, and no more."""

    CLOSED = 0
    SLIDE = 1
    STICK = 2


CLOSED, SLIDE, STICK = map(int, PointMode)
"""The modes as plain numbers, which numpy compares faster."""


@dataclass(frozen=True, eq=False)
class PointModes:
    """Modes of k points in the current (sub-)step.

    Attributes:
        mu: Coefficients of friction, (k,).
        kinds: Modes, UNKNOWN for points without one, (k,).
        sliding: Points that slide with friction, (k,).
        directions: Directions of slip at the start of the step, world axes, (k, 3); zero for points that do not slide.
        stop_speeds: Slips below which points that slide stop, m/s, (k,).
        straight: Points so close to their stop that their direction of slip is kept until then, (k,).
        directed_at: Slips at which these directions were determined, m/s, (k,); infinite for points that are not straight.
        drifts: Points whose slip is drift: those that stick, begin to slide, or replace others that stick, (k,).
        structures: Rows held in modes of the step, by the modes; see ``ActiveRows``.
        kept: The same of earlier steps in these modes.
        pairs: Pairs with friction and their points, which are consecutive.
    """

    mu: FloatArray
    kinds: IntArray
    sliding: BoolArray
    directions: FloatArray
    stop_speeds: FloatArray
    straight: BoolArray
    directed_at: FloatArray
    drifts: BoolArray
    structures: dict[bytes, Any]
    kept: dict[bytes, Any]
    pairs: list[tuple[UnilateralConstraint, slice]]

    @cached_property
    def no_slips(self) -> FloatArray:
        """Directions of slip of points that do not slide, (k, 2)."""
        return np.zeros((len(self.kinds), 2))

    @cached_property
    def key(self) -> bytes:
        """The modes as a key."""
        return self.kinds.tobytes()

    @cached_property
    def all_stick(self) -> bool:
        """Whether all points with friction stick, and all without press."""
        return bool((self.kinds == np.where(self.mu > 0.0, STICK, SLIDE)).all())

    @cached_property
    def all_slide(self) -> bool:
        """Whether all points with friction slide, none of them straight on to its stop, and all without press."""
        return self.any_sliding and not self.any_straight and bool((self.kinds == SLIDE).all())

    @cached_property
    def none_presses(self) -> bool:
        """Whether all points are closed without force."""
        return bool((self.kinds == CLOSED).all())

    @cached_property
    def stick_mu(self) -> FloatArray:
        """Coefficients of friction of the points that stick; zero at the others, (k,)."""
        return np.where(self.kinds == STICK, self.mu, 0.0)

    @cached_property
    def drift_m_s(self) -> float:
        """Speed up to which no point slips, if all stick; negative if one does not."""
        return 2.0 * TOGETHER * float(self.stop_speeds.min()) if self.all_stick else -1.0

    @cached_property
    def any_sliding(self) -> bool:
        """Whether any point slides with friction."""
        return bool(self.sliding.any())

    @cached_property
    def any_straight(self) -> bool:
        """Whether any point goes straight on to its stop."""
        return bool(self.straight.any())

    @cached_property
    def nowhere(self) -> BoolArray:
        """False for each point, (k,)."""
        return np.zeros(len(self.kinds), dtype=np.bool_)

    @cached_property
    def _directed(self) -> bool:
        return bool(self.directions.any())

    def start_directions(self, axes: FloatArray) -> FloatArray:
        """Directions of slip at the start of the step along the tangents, (k, 2).

        Args:
            axes: Normal and tangents of each point, (k, 3, 3).
        """
        if not self._directed:
            return self.no_slips
        return unit_slips(np.einsum("kij,kj->ki", axes[:, 1:], self.directions))


def unit_slips(velocities: FloatArray) -> FloatArray:
    """Unit vectors along slip velocities, (k, 2); zero where there is none."""
    sizes = np.hypot(velocities[:, 0], velocities[:, 1])
    return np.asarray(velocities / np.where(sizes > 0.0, sizes, 1.0)[:, None])


class Layers(NamedTuple):
    """Layers of points that slide, at the start of a (sub-)step.

    Attributes:
        points: The points that slide in two directions, m.
        efforts: Efforts, bit by bit.
        time_s: Time of the start.
        deviations: Deviations at the start of the layer, m/s, (m,).
        damping: Integral of k / |u| since then, (m,).
        speeds: Slips, m/s, (m,).
        strengths: k, m/s^2, (m,).
    """

    points: tuple[ContactPoint, ...]
    efforts: bytes
    time_s: float
    deviations: FloatArray
    damping: FloatArray
    speeds: FloatArray
    strengths: FloatArray


class FrictionModes:
    """Modes of the contact points in the current (sub-)step, and what the choice of the next ones depends on.

    Attributes:
        released: Whether sticking points have reached the limit of friction at the current state: those there slide.
        struck: Whether the velocities are those after an impact, which leaves sticking points a slip of rounding.
        stops: Whether a sliding point is known to stop at the current state, as at a logged stop that is replayed.
        beginning: Points that begin to slide at the current state. The slip that they have is the drift of sticking points;
            it is projected out like that before they move.
        replacing: Points without a mode whose slip is drift: those that they replace stick.
        layers: Layers of the points that slide, at the start of the last (sub-)step; None without any.
        estimates: Forces with the least use of friction found last, N, (m, 3), by the points that share a load.
        generation: Number of changes of the modes so far.
    """

    def __init__(self) -> None:
        """Start without modes."""
        self.generation = 0
        self.clear()

    def clear(self) -> None:
        """No point has a mode."""
        self.released = self.struck = self.stops = False
        self.beginning: frozenset[ContactPoint] = frozenset()
        self.replacing: frozenset[ContactPoint] = frozenset()
        self._of: dict[tuple[ContactPoint, ...], PointModes] = {}
        self.layers: Layers | None = None
        self.estimates: dict[tuple[ContactPoint, ...], FloatArray] = {}
        self.generation += 1
        self._kinds: dict[ContactPoint, int] = {}
        self._directions: dict[ContactPoint, FloatArray] = {}
        self._largest_slip: dict[ContactPoint, float] = {}
        self._straight: dict[ContactPoint, float] = {}

    @dataclass
    class State:
        """Modes by contact point, as indices into all of them; see the attributes.

        Attributes:
            flags: Whether points are released, were struck, and stop.
            beginning: Points that begin to slide.
            replacing: Points whose slip is drift.
            kinds: Modes by point.
            directions: Directions of slip by point, world axes.
            largest_slip: Largest slip of points that slide, m/s.
            straight: Slips at which points began to go straight on to their stop, m/s.
            layers: Layers of points, then what they are; None without any.
            estimates: Points that share a load, and their forces, N.
        """

        flags: tuple[bool, bool, bool]
        beginning: list[int]
        replacing: list[int]
        kinds: dict[int, int]
        directions: dict[int, FloatArray]
        largest_slip: dict[int, float]
        straight: dict[int, float]
        layers: Any
        estimates: list[Any]

    def get_state(self, contact_points: Sequence[ContactPoint]) -> State:
        """The modes of all closed points; what is kept of points that have opened counts no more."""
        place = {contact: i for i, contact in enumerate(contact_points)}

        def by_place(values: Mapping[ContactPoint, Any]) -> dict[int, Any]:
            return {place[contact]: value for contact, value in values.items() if contact in place}

        # A layer or an estimate of which a point has opened belongs to another problem.
        layers = self.layers if self.layers is not None and place.keys() >= set(self.layers.points) else None
        return self.State(
            (self.released, self.struck, self.stops),
            sorted(place[point] for point in self.beginning if point in place),
            sorted(place[point] for point in self.replacing if point in place),
            by_place(self._kinds),
            by_place({contact: np.array(direction) for contact, direction in self._directions.items()}),
            by_place(self._largest_slip),
            by_place(self._straight),
            None if layers is None else ([place[point] for point in layers.points], *layers[1:]),
            [
                ([place[point] for point in points], np.array(forces))
                for points, forces in self.estimates.items()
                if place.keys() >= set(points)
            ],
        )

    def set_state(self, state: Any, contact_points: Sequence[ContactPoint]) -> None:
        """Set the modes of all closed points.

        Args:
            state: Their state.
            contact_points: The points.
        """
        saved = entries(state, self.State)

        def by_point(values: Mapping[int, Any]) -> dict[ContactPoint, Any]:
            return {contact_points[i]: value for i, value in values.items()}

        self.forget_structures()
        self.released, self.struck, self.stops = saved["flags"]
        self.beginning, self.replacing = (
            frozenset(contact_points[i] for i in saved[name]) for name in ("beginning", "replacing")
        )
        self._kinds, self._directions = by_point(saved["kinds"]), by_point(saved["directions"])
        self._largest_slip, self._straight = by_point(saved["largest_slip"]), by_point(saved["straight"])
        self.layers = None
        if saved["layers"] is not None:
            of, *rest = saved["layers"]
            self.layers = Layers(tuple(contact_points[i] for i in of), *rest)
        self.estimates = {tuple(contact_points[i] for i in points): forces for points, forces in saved["estimates"]}

    def of(self, contact_points: tuple[ContactPoint, ...]) -> PointModes:
        """Modes of some points; the same object until they change."""
        modes = self._of.get(contact_points)
        if modes is None:
            modes = self._of[contact_points] = self._collected(contact_points)
        return modes

    def _collected(self, contact_points: tuple[ContactPoint, ...]) -> PointModes:
        mu, nothing = np.array([contact.pair.mu for contact in contact_points]), np.zeros(3)
        kinds = np.array([self._kinds.get(contact, UNKNOWN) for contact in contact_points], dtype=np.int64)
        drifting = self.beginning | self.replacing
        drifts = np.array([contact in drifting for contact in contact_points], dtype=np.bool_)
        directed_at = np.array([self._straight.get(contact, np.inf) for contact in contact_points])
        # _STOPPED times the least value is 1e-12 m/s, the rounding of speeds (RATE): a lower stop speed would never be
        # reached.
        largest = [max(self._largest_slip.get(contact, 0.0), _LEAST_SLIP_M_S) for contact in contact_points]
        return PointModes(
            mu=mu,
            kinds=kinds,
            sliding=(kinds == SLIDE) & (mu > 0.0),
            directions=np.array([self._directions.get(contact, nothing) for contact in contact_points]).reshape(-1, 3),
            stop_speeds=_STOPPED * np.array(largest),
            straight=directed_at < np.inf,
            directed_at=directed_at,
            drifts=(kinds == STICK) | drifts,
            structures={},
            kept={},
            pairs=_with_friction(contact_points),
        )

    def set(
        self,
        contact_points: Sequence[ContactPoint],
        kinds: IntArray,
        directions: FloatArray,
        slips: FloatArray,
        slipping: BoolArray,
        pinned: BoolArray,
    ) -> None:
        """Set the modes of all closed points for the next step.

        Args:
            contact_points: All closed contact points.
            kinds: Their modes, (k,).
            directions: Directions of slip, world axes, (k, 3).
            slips: Slip speeds, m/s, (k,).
            slipping: Points that slip already; others only begin to slide, (k,).
            pinned: Sliding points that cannot slip while others stick; they keep the direction of their friction, (k,).
        """
        before, kinds_before, straight, kept = self._largest_slip, self._kinds, self._straight, self._directions
        # These concern the state that has just been decided on: at the next one modes would be chosen anew without a cause.
        self.released = self.struck = self.stops = False
        self._straight, self.replacing = {}, frozenset()
        self.forget_structures()
        self._kinds = dict(zip(contact_points, kinds.tolist(), strict=True))
        begins = ((kinds == SLIDE) & ~slipping).tolist()
        self.beginning = frozenset(
            point for point, new in zip(contact_points, begins, strict=True) if new and point.pair.mu > 0.0
        )
        self._directions = dict(zip(contact_points, directions, strict=True))
        self._largest_slip = {}
        for contact, kind, slip, slips_already, stays in zip(
            contact_points, kinds.tolist(), slips.tolist(), slipping.tolist(), pinned.tolist(), strict=True
        ):
            # Without friction the sliding mode says only that a point presses: it has no direction and does not stop.
            if contact.pair.mu == 0.0:
                continue
            slid = kinds_before.get(contact) == SLIDE
            # A stop is found by the share that is left of the largest slip: rounding of a velocity has no scale of its own.
            # One that has just stopped keeps its scale for a step: the slip left by the stop is drift in proportion to it.
            if slid and (slips_already or kind == STICK):  # or has just stopped
                largest = self._largest_slip[contact] = max(before.get(contact, 0.0), slip)
                # Not above half of the largest: a point that has just begun to slide is as slow, but its direction is still
                # to turn.
                if kind == SLIDE and slip <= min(_STRAIGHT * max(largest, _LEAST_SLIP_M_S), 0.5 * largest):
                    self._straight[contact] = straight.get(contact, slip)
                    if contact in straight:
                        self._directions[contact] = kept[contact]
            elif kind == SLIDE:
                # A load that goes round a cap leaves each point for a while: its slip is the motion of the others.
                regains = kinds_before.get(contact) == CLOSED
                of_pair = (size for point, size in before.items() if point.pair is contact.pair)
                self._largest_slip[contact] = max((slip, *of_pair)) if regains else slip
                # A pinned point, or one on a new feature that is about to stop, goes straight on: its slip has no direction
                # of its own.
                if stays or (slips_already and slip <= _STRAIGHT * _LEAST_SLIP_M_S):  # the latter on a new feature
                    self._straight[contact] = slip

    def keep_still(self, contact_points: tuple[ContactPoint, ...], kinds: IntArray) -> bool:
        """Keep the modes if none changes and no point slides with friction or has just stopped; return whether that is so.

        Args:
            contact_points: All closed contact points.
            kinds: Modes chosen for them, (k,).
        """
        # Where points slide or have just stopped, directions, slips and drifts change although the modes do not.
        if self._largest_slip or self.beginning or len(self._kinds) != len(contact_points):
            return False
        present = self.of(contact_points)
        if present.any_sliding:
            return False
        if kinds is not present.kinds and kinds.tolist() != present.kinds.tolist():
            return False
        self.released = self.struck = self.stops = False
        # Modes are the same, but which rows can move anything is determined anew for each step.
        for modes in self._of.values():
            modes.structures.clear()
        return True

    def slide_on(
        self, contact_points: tuple[ContactPoint, ...], present: PointModes, directions: FloatArray, slips: Sequence[float]
    ) -> None:
        """Go on sliding at all points with friction: of the modes of the step before, directions and slips change.

        Args:
            contact_points: All closed contact points.
            present: Their modes, which change in place.
            directions: Directions of slip, world axes, (k, 3).
            slips: Slip speeds, m/s, (k,).
        """
        before, self._largest_slip = self._largest_slip, {}
        for i, (contact, slip) in enumerate(zip(contact_points, slips, strict=True)):
            if contact.pair.mu == 0.0:
                continue
            largest = self._largest_slip[contact] = max(before.get(contact, 0.0), slip)
            present.stop_speeds[i] = _STOPPED * max(largest, _LEAST_SLIP_M_S)
        self._directions = dict(zip(contact_points, directions, strict=True))
        present.directions[:] = directions
        present.structures.clear()
        # Modes of other sets of points were collected with the directions of the step before.
        self._of = {contact_points: present}

    def replace(self, old: Sequence[ContactPoint], new: Sequence[ContactPoint]) -> None:
        """Replace points of a pair by others at the same state: where they stick, the slip of the others is drift, too."""
        kinds = {self._kinds.get(contact, UNKNOWN) for contact in old}
        # Where the pair slides the velocity of its new points is slip, which friction must oppose.
        if STICK in kinds and SLIDE not in kinds:
            self.replacing |= {contact for contact in new if contact not in self._kinds}
            self.forget_structures()

    def begin_slip(self) -> None:
        """Take all slip from here on as slip: the drift of points that begin to slide has been projected out."""
        if self.beginning:
            self.beginning = frozenset()
            self.forget_structures()

    def snapshot(self) -> Callable[[], None]:
        """Return a function that restores all that decides on the modes of the next step."""
        flags, points = (self.released, self.struck, self.stops), (self.beginning, self.replacing, self._straight)
        # References suffice: set() and slide_on() put new dictionaries in place of these.
        kept = self._kinds, self._directions, self._largest_slip, self.layers

        def restore() -> None:
            (self.released, self.struck, self.stops), (self.beginning, self.replacing, self._straight) = flags, points
            self._kinds, self._directions, self._largest_slip, self.layers = kept
            self.forget_structures()

        return restore

    def assume(self, contact_points: Sequence[ContactPoint], *, sticks: bool) -> None:
        """Make the points that slide or stick do what they did before an event: stick, or slide until they stop there."""
        before, after = (STICK, SLIDE) if sticks else (SLIDE, STICK)
        self.stops = not sticks
        self.forget_structures()
        # A pair slides while one of its points does, and may stick at others, as an edge that turns about one of its ends.
        known = {contact.pair for contact in contact_points if self._kinds.get(contact) == before == SLIDE}
        for contact in contact_points:
            if self._kinds.get(contact) == after and contact.pair not in known:
                self._kinds[contact] = before

    def forget_structures(self) -> None:
        """Discard the rows held and estimates of forces: the modes, the contact points or the motion have changed."""
        self._of, self.estimates = {}, {}
        self.generation += 1


def _with_friction(contact_points: Sequence[ContactPoint]) -> list[tuple[UnilateralConstraint, slice]]:
    """Pairs with friction and their points."""
    runs, end = list[tuple[UnilateralConstraint, slice]](), 0
    for pair, points in groupby(contact_points, lambda contact: contact.pair):
        start, end = end, end + len(list(points))
        if pair.mu > 0.0:
            runs.append((pair, slice(start, end)))
    return runs


def slipping_points(
    slips: FloatArray,
    sliding: BoolArray,
    stop_speeds: FloatArray,
    rounding: FloatArray,
    straight: BoolArray,
    drifts: BoolArray,
    *,
    struck: bool,
    stops: bool = False,
    pairs: Sequence[slice] = (),
) -> BoolArray:
    """Points that slip, (k,).

    Points of a body that stop at one instant reach the speed at which one stops within rounding of each other: those close
    to it stop with it. The velocity of sticking points drifts, until it is projected out.

    Args:
        slips: Slip speeds, m/s, (k,).
        sliding: Points that slide with friction at present, (k,); others stop no point.
        stop_speeds: Slips below which sliding points stop, m/s, (k,).
        rounding: Rounding of the speeds, m/s, (k,).
        straight: Points that go straight on to their stop, and stop where their slip is zero, (k,).
        drifts: Points that stick or begin to slide, (k,).
        struck: Whether the velocities are those after an impact.
        stops: Whether a sliding point is known to stop here.
        pairs: Points of each two bodies.
    """
    # After an impact no point is known to stick: slips count as zero within what the impact law leaves (SOLVED).
    if struck:
        return np.asarray(slips > _STRUCK * rounding)
    # Translation and spin of a sliding block end at one instant, and with them the slips of all its corners.
    close = TOGETHER * np.maximum(stop_speeds, rounding)
    least = np.maximum(np.where(straight, 0.0, stop_speeds), rounding)
    # A run locates a stop just below this speed. At the logged state a replay may find the slip above it, by rounding: the
    # pose of a grasped object is transferred to the motion and back, which changes it by 1e-15 m, and slips with it.
    if np.any(sliding & (slips <= (least + rounding if stops else least))):
        # Among the points of two bodies are some without load, and some that slide anew: their own scale says nothing.
        for points in pairs:
            close[points] = close[points].max()
        least = np.where(drifts, least, close)
    # Twice what stops together: a point that has just stopped must not slip again at once. Within a step velocities of
    # sticking points drift by its truncation, as gap rates do (CLOSED_RATE).
    drift = np.maximum(2.0 * close, CLOSED_RATE / RATE * rounding)
    return np.asarray(slips > np.where(drifts, drift, least))
