"""Clearance of closed pairs outside their contact points: where they touch at another point, these have changed.

Tilts of rims and lines that carry force bound a step, too: contact points travel at their relative rate.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from ffsm_mj.contact.features.body_motion import Vector, cross
from ffsm_mj.contact.features.cone_gaps import PointOnCone, RoundOnCone
from ffsm_mj.contact.features.gap_function import Feature, GapFunction
from ffsm_mj.contact.features.point_line_gaps import PointOnFace
from ffsm_mj.contact.features.round_gaps import RoundOnFace
from ffsm_mj.contact.features.search import features
from ffsm_mj.contact.pairs import ContactPair, UnilateralConstraint
from ffsm_mj.contact_models.interface import Scene
from ffsm_mj.contact_models.persistent.contact_points import ContactPoint, over_one_face
from ffsm_mj.tolerances import CONTACT_GAP_M, FLAT_M, OTHER_POINT_M

_OVERLAPS_M = 0.5 * OTHER_POINT_M
"""Another point overlaps from here on, half of what ends a step: whatever the rounding of its end, it does there."""
LEVEL_M = 0.1 * OTHER_POINT_M
"""Three corners within this of a face keep every other corner within OTHER_POINT_M of it, at ten times their distance."""
_NARROW = 0.1
"""Points whose spread across their longest direction is below this share are on a line."""
GapsOf = Callable[[ContactPair], Sequence[float]]
"""Gaps of the contact points of a pair at the present state, m."""
_TILT_SHARE = 0.2
"""A step ends early where the tilt of a rim over a face has changed by this share: forces grow as its inverse, and the steps
of a disc that falls flat must shrink with it. RK4 then errs by about 0.2^5 / 120 of them."""
_USED_UP = 0.01
"""Share of that change which is left, at most, where it has ended the step: the time of its end is known far better."""
_TURN = 0.02
"""Angle in rad by which the contact point of a rim travels round it in one step, where it would travel by more than 1 rad in
the time step: the force is then an impulse, which leaves an error of 1e-10 of its energy. A tilt that falls straight to zero
leaves the force as it is, and slower turns are left to the time step or its control."""
_ROUND = 0.01
"""Distance in rad that a contact travels round the axis of a cone, or towards it over what is left, in one step: near the
axis the force turns and grows as the inverse cube of the distance. RK4 then errs by 0.01^5 / 120 = 1e-12 of the motion."""


class Clearance:
    """Clearance of the closed pairs that may touch at several points.

    Attributes:
        pairs: These pairs.
    """

    def __init__(self, scene: Scene) -> None:
        """Initialise with no closed pairs."""
        self._scene, self._model = scene, scene.system.mj
        self.set_pairs({})

    def set_pairs(self, by_pair: Mapping[UnilateralConstraint, Sequence[ContactPoint]]) -> None:
        """Set the closed pairs and their contact points."""
        self.pairs = [pair for pair in by_pair if not pair.is_limit and not pair.touches_once]
        # Vertices of a mesh are as far from the plane of its face as single precision takes them.
        lie_flat = [
            pair
            for pair in self.pairs
            if pair.position_tolerance == 0.0
            and (_lie_flat(features := [point.feature for point in by_pair[pair]]) or _rolls_on_face(pair, features))
        ]
        for pair in self.pairs:
            pair.lie_on(by_pair[pair][0].feature if pair in lie_flat else None)
        self._lie_flat = frozenset(lie_flat)
        self.forget()

    @property
    def flat_pairs(self) -> frozenset[ContactPair]:
        """Pairs that lie on a face with three corners at least, and of which nothing else touches."""
        # Of two unions a piece that stands beside the face may touch as well.
        return frozenset(pair for pair in self._lie_flat if not pair.is_beside)

    def forget(self) -> None:
        """Discard the clearance that is kept."""
        self._known: tuple[object, float] | None = None

    def least(self, kinematics: object, largest: float, gaps_of: GapsOf) -> float:
        """Least clearance outside the active contact points: gap less drift, plus the threshold, m.

        Args:
            kinematics: Token of the present positions and velocities; the clearance at one state is computed once.
            largest: Largest absolute gap of a contact point, m.
            gaps_of: Returns gaps of contact points.
        """
        if not self.pairs:
            return math.inf
        if self._known is None or self._known[0] is not kinematics:
            # On three corners, two convex bodies are on either side of the face: nothing else of them can overlap.
            level = self.flat_pairs if largest <= LEVEL_M else ()
            others = [self._gap_elsewhere(pair, gaps_of(pair)) for pair in self.pairs if pair not in level]
            self._known = kinematics, min([*others, 0.0] if level else others) + OTHER_POINT_M
        return self._known[1]

    def _gap_elsewhere(self, pair: ContactPair, gaps: Sequence[float]) -> float:
        """Gap of a pair less the deepest of its contact points, m."""
        # The drift of closed points lowers the whole pair: only what is deeper than they are is another point. Pieces of
        # unions that do not touch yet are followed by event location.
        watched = pair.watched_by_points(self._model, self._scene.data)
        return min(map(self._pair_gap, watched), default=math.inf) - min([0.0, *gaps])

    def _pair_gap(self, pair: ContactPair) -> float:
        """Gap of a pair, m.

        MuJoCo's distance is used unless it shows an overlap: then the polished gap, or zero if the pair already separates.
        An overlap deeper than contact is one that a step has passed, although its end separates again.
        """
        data = self._scene.data
        gap = pair.gap(self._model, data)
        # One distance query excludes an overlap at nearly every step; points and rates are needed only beyond.
        if gap > -_OVERLAPS_M:
            return gap
        near = pair.proximity(self._model, data)
        # Vertices of meshes are known to position_tolerance, and a point that closes may be CONTACT_GAP_M too high: held, it
        # lowers others that lift by as much. No step has passed an overlap within that.
        passed = near.gap < -max(CONTACT_GAP_M, pair.position_tolerance)
        # Where the point separates already there is no impact to resolve: an event there would change nothing and recur, up
        # to the limit of events.
        return near.gap if near.approaches or passed else max(near.gap, 0.0)

    def overlapping_features(self, gaps_of: GapsOf) -> list[Feature]:
        """Features other than the contact points, by which closed pairs overlap."""
        model, data = self._model, self._scene.data
        return [
            feature
            for pair in self.pairs
            for near in pair.proximities(model, data)
            for feature in features(pair, model, data, near)
            if feature.at(data).gap < min([0.0, *gaps_of(pair)]) - _OVERLAPS_M
        ]


def _rolls_on_face(pair: ContactPair, features: Sequence[Feature]) -> bool:
    """Whether a sphere, an ellipsoid or both ends of a capsule are on one face: all of it is beyond that plane."""
    if len(features) != pair.rolls_on or any(type(feature) not in (PointOnFace, RoundOnFace) for feature in features):
        return False
    return len(features) == 1 or (len(features) == 2 and over_one_face(*features))


def _lie_flat(features: Sequence[Feature]) -> bool:
    """Whether some features are at least three points of one body over the same face, far from being on a line."""
    places = [
        feature.point.centre
        for feature in features
        if isinstance(feature, PointOnFace) and over_one_face(features[0], feature)
    ]
    if len(places) < 3:
        return False
    longest, across, _ = np.linalg.svd(np.array(places) - np.mean(places, axis=0), compute_uv=False)
    # Points near one line leave the tilt about it open: level corners there do not keep the others level.
    return bool(across > _NARROW * longest)


class Tilts:
    """Tilts at the start of a step, and what is left of the changes that it may bring."""

    def __init__(self, data: Any) -> None:
        """Start without contact points; ``data`` is that of the logged system."""
        self._data = data
        self._rims: list[ContactPoint] = []
        self._caps: list[RoundOnFace] = []
        self._in_cones: list[PointOnCone | RoundOnCone] = []
        self._starts: list[tuple[ContactPoint, Vector, float]] = []

    def set_closed(self, contact_points: Sequence[ContactPoint]) -> None:
        """Set the contact points of all closed pairs."""
        self._caps = [contact.feature for contact in contact_points if isinstance(contact.feature, RoundOnFace)]

    def set_points(self, pressing: Sequence[ContactPoint]) -> None:
        """Set the contact points that carry force."""
        self._rims = [contact for contact in pressing if type(contact.feature).tilt is not GapFunction.tilt]
        cones = PointOnCone | RoundOnCone
        self._in_cones = [contact.feature for contact in pressing if isinstance(contact.feature, cones)]

    @property
    def bound_steps(self) -> bool:
        """Whether there are any."""
        return bool(self._rims or self._caps or self._in_cones)

    def begin_step(self) -> None:
        """Start at the state in ``data``."""
        tilts = ((contact, contact.feature.tilt(self._data)) for contact in self._rims)
        self._starts = [(contact, tilt, _TILT_SHARE * math.hypot(*tilt)) for contact, tilt in tilts if tilt is not None]

    def _left(self) -> Iterator[tuple[ContactPoint, float, float]]:
        """Rims with what their tilt may still change in this step and may change in one step."""
        for contact, start, most in self._starts:
            now = contact.feature.tilt(self._data)
            assert now is not None
            yield contact, most - math.dist(now, start), most

    def margins(self) -> tuple[float, float]:
        """Least change of a tilt that this step may still bring, and :meth:`least_rise`; infinite without any."""
        return min([left for _, left, _ in self._left()], default=math.inf), self.least_rise()

    def least_rise(self) -> float:
        """Least rise of a rim above FLAT_M, m: negative where a cap lies flat; infinite without any."""
        return min([feature.rise(self._data) for feature in self._caps], default=math.inf) - FLAT_M

    def step_limit(self, left_s: float) -> float:
        """Longest step of caps that roll on their rims, s, given the remaining time of the grid step.

        The stages of a step past the state in which a cap is flat would have forces at opposite points of its rim.
        """
        fastest = max([feature.turn_rate(self._data) for feature in self._in_cones], default=0.0)
        limit = _ROUND / fastest if fastest > 0.0 else math.inf
        return min([self._limit_of(cap, left_s) for cap in self._caps], default=limit)

    def _limit_of(self, cap: RoundOnFace, left_s: float) -> float:
        tilt, rate = cap.tilt(self._data), cap.tilt_rate(self._data)
        if tilt is None or rate is None or not any(rate):
            return math.inf
        size = math.hypot(*tilt)
        # The event is at one _TILT_SHARE: a step of twice that contains it, and its stages stay short of the flat state.
        limit, turn = 2.0 * _TILT_SHARE * size / math.hypot(*rate), math.hypot(*cross(tilt, rate))
        # The tilt turns at |tilt x rate| / |tilt|^2, and the contact point travels round the rim with it.
        return min(limit, _TURN * size * size / turn) if turn * left_s > size * size else limit

    def pairs_at_limit(self) -> list[UnilateralConstraint]:
        """Pairs with a rim whose tilt has changed to the limit of a step."""
        return [contact.pair for contact, left, most in self._left() if left < _USED_UP * most]
