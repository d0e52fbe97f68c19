"""Contact of two rigid bodies as unions of convex pieces: one constraint, whose normals are decided on the unions.

Apart from each other, the distance of two unions is the least of their pieces, and its normal is one of the unions. Where
they touch, a pair of pieces may touch along a face that another piece covers, as the next box of a floor does. At each
contact point the cells of all pieces that meet there say which normals there are (:mod:`ffsm_mj.contact.cells`), and points
with one normal in one plane are one patch, whose corners are those of its hull: seams leave no trace.

Which pieces belong to the union does not change what a pair of them does while it is apart: event location follows each pair
of pieces by itself, and asks here only where it touches.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from ffsm_mj._core.polygons import corners_across
from ffsm_mj._core.shapes import separation
from ffsm_mj.arrays import BoolArray, FloatArray
from ffsm_mj.cached_property import cached_property
from ffsm_mj.contact.cells import cells, chosen_cell, in_cone, separating_normals
from ffsm_mj.contact.features.gap_function import Feature
from ffsm_mj.contact.near_pieces import NearPieces
from ffsm_mj.contact.normal import DISTANCE_LIMIT_M
from ffsm_mj.contact.pairs import ContactPair, gap_rounding
from ffsm_mj.contact.piece_pair import TwoPieces
from ffsm_mj.contact.probe import Probe
from ffsm_mj.contact.proximity import AT_END, FAR_M, Proximity, SecondRate, second_rate
from ffsm_mj.contact.sides import Piece, Side
from ffsm_mj.contact.surfaces import (
    AT_POINT_M,
    ONE_NORMAL,
    AmongOthers,
    Meeting,
    PointGroup,
    crosses_seam,
    levelled,
    may_tie,
)
from ffsm_mj.model.system import System
from ffsm_mj.state import StateError, entries, fitting
from ffsm_mj.tolerances import CLOSED_RATE, CONTACT_GAP_M, DISTANCE_QUERY_M, RATE, SAME_POINT_M

_QUERY_M = 1e-3
"""Limit of queries that look for pieces in contact: a small limit ends a query early."""
_TURNED = 1e-4
"""Normals of a contact point that is held and of the patch that is found there differ by less: in a corner by much more."""
_SPHERE, _CAPSULE = int(mujoco.mjtGeom.mjGEOM_SPHERE), int(mujoco.mjtGeom.mjGEOM_CAPSULE)
_ONE_POINT = {_SPHERE, int(mujoco.mjtGeom.mjGEOM_ELLIPSOID)}
"""Strictly convex geoms: they touch any convex geom at one point only."""


@dataclass(frozen=True)
class UnionProximity(Proximity):
    """One patch of a contact of unions: all its points have one normal, and lie in one plane.

    Attributes:
        pieces: Pairs of pieces that touch in its plane, those of other rules too.
        owners: The pair of pieces of each point.
        corners: Number of corners of the patch, those of other rules too.
    """

    pieces: tuple[PiecePair, ...] = ()
    owners: tuple[PiecePair, ...] = ()
    corners: int = 0

    @property
    def extreme_points(self) -> int:
        """See :class:`Proximity`."""
        return self.corners


class PiecePair(TwoPieces):
    """Two pieces of a union pair, followed by themselves while they are apart.

    Attributes:
        union: The pair of unions.
        number: Its place among all pairs of pieces.
    """

    def __init__(self, system: System, union: UnionPair, a: Piece, b: Piece) -> None:
        """Resolve two pieces; see :class:`ContactPair`."""
        self.union, self.number = union, union.number_of(a, b)
        self._met: tuple[FloatArray, list[Meeting | None]] | None = None
        super().__init__(system, union, union.sides, (a, b), lambda: union.probe)

    @property
    def together(self) -> Sequence[UnionPair]:
        """The pairs of unions of the same bodies."""
        return self.union.together

    def proximity(self, model: Any, data: Any) -> Proximity:
        """Gap, normal, points and rates: those of the unions where both pieces touch."""
        alone = self.alone(model, data)
        return self.union.at_pieces(model, data, self, alone) if abs(alone.gap) <= CONTACT_GAP_M else alone

    def meetings(self, model: Any, data: Any, near: Proximity) -> list[Meeting | None]:
        """What meets at each point of the proximity of these two alone; None where that is no contact of these."""
        # The pose of both bodies decides, and with it the points: while they are the same array, it has not changed.
        if self._met is None or self._met[0] is not near.points:
            self._met = near.points, [self.union.meeting(model, data, self, near, point) for point in near.points]
        return self._met[1]

    def watched_proximity(self, model: Any, data: Any) -> Proximity:
        """The same without what contact points watch; see :attr:`UnionPair.level`."""
        alone, is_level = self.alone(model, data), bool(self.union.level.flat[self.number])
        if abs(alone.gap) <= CONTACT_GAP_M:
            return self.union.at_pieces(model, data, self, alone, without_closed=is_level)
        # In a step that is too long held points drift further: its end is found by that.
        drifts = is_level and alone.gap < 0.0 and self.union.is_closed(alone, data)
        return replace(alone, rates=np.zeros(len(alone.points))) if drifts else alone


class UnionPair(ContactPair):
    """Contact of the pieces of two rigid bodies under one contact rule.

    Attributes:
        sides: The rigid bodies a and b.
        of_rule: Numbers of the pieces of each that the rule names.
        joined: Pairs of pieces that touch at the start of a step while persistent contact holds the pair: these are
            watched by their contact points, all others by their distance.
        level: Which others go on in a plane of those, (pieces of a, pieces of b). They are followed too, but contact points
            find where they land in that plane: a distance is off by the drift of held points, times a ratio of lever arms.
    """

    has_pieces = True
    has_one_patch = False

    def __init__(
        self,
        system: System,
        name: str,
        sides: tuple[Side, Side],
        geoms: Collection[tuple[int, int]],
        restitution: float,
        mu: float,
        rule: str,
    ) -> None:
        """Resolve the pieces.

        Args:
            system: The system.
            name: Name of the pair.
            sides: The rigid bodies a and b.
            geoms: Ids of the geoms of a and b that the rule pairs.
            restitution: Coefficient of restitution.
            mu: Coefficient of friction.
            rule: Name of the rule.
        """
        self._system, self.sides, self._geoms = system, sides, frozenset(geoms)
        first = min(geoms)
        super().__init__(system, name, *first, restitution, mu, rule=rule)
        self.body_a, self.body_b = (side.body for side in sides)
        self.position_tolerance, self.touches_once = 0.0, False
        alone = {side.pieces[0].kind for side in sides if len(side.pieces) == 1}
        self.rolls_on = 1 if alone & _ONE_POINT else 2 if _CAPSULE in alone else 0
        self._allowed = np.array([[(a.geom, b.geom) in self._geoms for b in sides[1].pieces] for a in sides[0].pieces])
        self.of_rule = tuple(frozenset(np.flatnonzero(self._allowed.any(axis=k)).tolist()) for k in (1, 0))
        self._known: dict[int, PiecePair] = {}
        a, b = sides
        self._radii = a.radius_about(first[0]), b.radius_about(first[1])
        self.joined: frozenset[int] = frozenset()
        self.level = np.zeros_like(self._allowed)
        self._near, self._last, self._last_watched = NearPieces(sides), -1, -1
        self._closed: tuple[Feature, ...] = ()
        self._face: Feature | None = None
        self._watch(None)
        self._together: Sequence[UnionPair] = (self,)

    @dataclass
    class State:
        """What the pairs of pieces remember, by their numbers, and which was the nearest last; -1: none has been."""

        pieces: list[tuple[int, Any]]
        last: int

    def get_state(self) -> State:
        """What the pairs of pieces remember. What is joined belongs to the closed contacts."""
        return self.State([(k, pair.get_state()) for k, pair in sorted(self._known.items())], self._last)

    def set_state(self, state: Any) -> None:
        """Take back what :meth:`get_state` gave."""
        values = entries(state, self.State)
        self._known.clear()
        for number, kept in values["pieces"]:
            self.piece_pair(self._checked(number)).set_state(kept)
        self._last = self._checked(values["last"]) if values["last"] != -1 else -1

    def _checked(self, number: int) -> int:
        """The number of a pair of pieces in a state."""
        if not 0 <= number < self._allowed.size:
            raise StateError(f"{self.name} has no pair of pieces {number}")
        return number

    @property
    def together(self) -> Sequence[UnionPair]:
        """It and the pairs of the same bodies under other rules, in the order of the rules."""
        return self._together

    @classmethod
    def join_rules(cls, pairs: Iterable[ContactPair]) -> None:
        """Let pairs of the same bodies know of each other: contact passes from one to another at a seam of two rules."""
        by_sides: dict[tuple[Side, Side], list[UnionPair]] = {}
        for pair in pairs:
            if isinstance(pair, cls):
                by_sides.setdefault(pair.sides, []).append(pair)
                pair._together = by_sides[pair.sides]

    @cached_property
    def probe(self) -> Probe:
        """Scratch model for queries of parts."""
        return Probe(self._system.mj, max(side.most_vertices for side in self.sides))

    @property
    def geom_pairs(self) -> tuple[frozenset[int], ...]:
        """Ids of both geoms of every two geoms that can touch."""
        return tuple(map(frozenset, sorted(self._geoms)))

    def is_of(self, kind: mujoco.mjtGeom) -> bool:
        """Whether one of the pieces is of a kind."""
        return any(piece.kind == int(kind) and piece.part is None for side in self.sides for piece in side.pieces)

    # ---- Pairs of pieces

    def number_of(self, a: Piece, b: Piece) -> int:
        """Place of a pair of pieces among all."""
        return a.number * len(self.sides[1].pieces) + b.number

    def piece_pair(self, number: int) -> PiecePair:
        """A pair of pieces, by its place among all; made when it comes near first."""
        if number not in self._known:
            (a, b), (i, k) = self.sides, divmod(number, len(self.sides[1].pieces))
            self._known[number] = PiecePair(self._system, self, a.pieces[i], b.pieces[k])
        return self._known[number]

    def within(self, model: Any, data: Any, reach: float, among: BoolArray | None = None) -> list[tuple[float, int]]:
        """Gaps, as queries say, and numbers of the pairs of pieces that are within a reach in m, the nearest first.

        Args:
            model: MuJoCo model.
            data: Its data, kinematics current.
            reach: The reach.
            among: Which pairs count, (pieces of a, pieces of b); None: all of the rule.
        """
        near = self._near.within(self._allowed if among is None else among, data, reach)
        gaps = ((self.piece_pair(k).gap(model, data, reach), k) for _, k in near)
        return sorted((gap, k) for gap, k in gaps if gap < reach)

    def gap(self, model: Any, data: Any, limit: float = FAR_M) -> float:
        """Signed distance in m of the unions from distance queries; ``limit`` if it is larger."""
        gap, self._last = self._nearest(self._allowed, self._last, model, data, limit)
        return gap

    def _nearest(self, among: BoolArray, last: int, model: Any, data: Any, limit: float) -> tuple[float, int]:
        """The least gap of some pairs of pieces, m, or the limit if it is larger, and the number of that pair.

        The pair that was nearest last, or seems to be, tells how far to look; -1: none has been, or there is none.
        """
        first = last if last >= 0 and among.flat[last] else self._near.first_guess(among, data)
        if first < 0:
            return limit, first
        best = self.piece_pair(first).gap(model, data, limit), first
        for bound, k in self._near.within(among, data, best[0], first):
            if bound >= best[0]:
                break
            # A pair that is farther away says the limit, the gap of the nearest one so far.
            gap = self.piece_pair(k).gap(model, data, best[0])
            best = (gap, k) if gap < best[0] else best
        return best

    def _nearest_pair(self, model: Any, data: Any) -> PiecePair:
        """The two pieces that are nearest to each other."""
        self.gap(model, data, DISTANCE_LIMIT_M)
        return self.piece_pair(self._last)

    def gap_to_rounding(self, model: Any, data: Any, gap: float) -> float:
        """The gap at the state in ``data``, to rounding; see :class:`ContactPair`."""
        return self.piece_pair(self._last).gap_to_rounding(model, data, gap)  # of the pieces that the query found

    def watched_gap(self, model: Any, data: Any, limit: float) -> float:
        """The same of what event location has to follow, see :meth:`apart_within`."""
        # Of equally near pairs the last one stays the nearest: bounds on the motion must not change which one that is, as
        # they begin anew where a run goes on from a state.
        gap, self._last_watched = self._nearest(self._apart, self._last_watched, model, data, limit)
        return gap

    def apart_within(self, model: Any, data: Any, reach: float) -> list[PiecePair]:
        """Pairs of pieces within a reach in m that are not joined, nor parted by the face on which the bodies lie flat."""
        return [self.piece_pair(k) for _, k in self.within(model, data, reach, self._apart)]

    def watched_by_points(self, model: Any, data: Any) -> list[PiecePair]:
        """Pairs of pieces that are joined, and those in their planes that are near."""
        among = self.level & self._apart
        level = self.within(model, data, DISTANCE_QUERY_M, among) if among.any() else ()
        return [self.piece_pair(k) for k in sorted((*self.joined, *(k for _, k in level)))]

    def hold(self, features: Sequence[Feature]) -> None:
        """Note the contact points that persistent contact holds: what is joined follows from them at the next step."""
        if self._closed != (closed := tuple(features)):
            self._closed, self.joined, self.level = closed, frozenset(), np.zeros_like(self._allowed)
            self._watch(None)
            self.on_left()

    def lie_on(self, face: Feature | None) -> None:
        """Note a corner on the face on which the bodies lie flat; None: they do not."""
        self._face = face
        self._watch(None)

    def _watch(self, parted: tuple[BoolArray, BoolArray] | None) -> None:
        """Take which pieces of a and of b the plane of the face parts, and with it which pairs of them are followed."""
        joined, self._parted = list(self.joined), parted
        by_plane = np.zeros_like(self._allowed) if parted is None else np.logical_and.outer(*parted)
        self._apart = self._allowed & ~by_plane
        self._apart.flat[joined] = False
        self.is_beside = parted is None or not by_plane.flat[joined].all()

    def joining(self) -> tuple[list[int], list[int], tuple[BoolArray, BoolArray] | None]:
        """Numbers of joined and of level pairs, and which pieces of a and b the face parts; None: it is not known."""
        return sorted(self.joined), np.flatnonzero(self.level).tolist(), self._parted

    def set_joining(self, state: Any) -> None:
        """Take back what :meth:`joining` gave, with the same points held."""
        # Found anew it may be other pieces: one that has lifted by less than a query sees stays joined, and drifts.
        joined, level, parted = state
        self.joined = frozenset(map(self._checked, joined))
        sides = zip(parted, self.sides, strict=True) if parted is not None else ()
        both = [fitting(which, (len(side.pieces),), f"{self.name}, pieces by the plane") for which, side in sides]
        self._watch((both[0], both[1]) if both else None)
        self.level.flat[list(map(self._checked, level))] = True

    def join(self, model: Any, data: Any) -> None:
        """Take the pairs of pieces that touch in patches that are held at the state in ``data`` as joined."""
        near = [k for gap, k in self.within(model, data, 2.0 * DISTANCE_QUERY_M) if gap <= DISTANCE_QUERY_M]
        joined = frozenset(k for k in near if k in self.joined or self._goes_on(self.piece_pair(k), model, data))
        parted = self._parted
        if parted is None and self._face is not None:  # bodies that lie flat move along the plane: what it parts stays
            parted = self._near.parted_by(self._face, model, data, AT_POINT_M)
        left = self.joined - joined
        if joined != self.joined or parted is not self._parted:
            self.joined = joined
            self._watch(parted)
            points = [np.asarray(feature.at(data).point) for feature in self._closed]
            self.level = self._near.on_planes_of(joined, points, data, AT_POINT_M)
        if self._apart.flat[list(left)].any():
            self.on_left()

    def _goes_on(self, pair: PiecePair, model: Any, data: Any) -> bool:
        """Whether the contact of two pieces is in a patch that is held."""
        near = pair.proximity(model, data)
        return isinstance(near, UnionProximity) and self.is_closed(near, data)

    def is_closed(self, near: Proximity, data: Any) -> bool:
        """Whether persistent contact holds a point of the normal of a patch, be it under another rule."""
        # By the normals of now: they turn with a, with b or with neither, as faces and edges meet.
        closed = (feature for union in self.together for feature in union._closed)
        return any(math.dist(feature.at(data).normal, near.normal) <= _TURNED for feature in closed)

    def closing_speed_bound(self, data: Any) -> float:
        """Bound on the closing speed of any two pieces; see :class:`ContactPair`."""
        raise NotImplementedError  # event location asks each pair of pieces

    # ---- Contact

    def proximity(self, model: Any, data: Any) -> Proximity:
        """The patch that approaches fastest, or else the nearest points of the unions; see :meth:`proximities`."""
        patches = self.proximities(model, data) or (self._nearest_pair(model, data).alone(model, data),)
        return min(patches, key=lambda near: near.rate)

    def proximities(self, model: Any, data: Any) -> tuple[Proximity, ...]:
        """All patches of contact at the state in ``data``, or the nearest points of the unions if these are apart.

        None where all corners of the patches are those of other rules.
        """
        alone = self._alone(model, data)
        if any(one.gap <= CONTACT_GAP_M for _, one in alone):
            every = (entry for union in self.together for entry in (alone if union is self else union._alone(model, data)))
            return self._patches(model, data, [(pair, one) for pair, one in every if one.gap <= CONTACT_GAP_M])
        near = [one for _, one in alone] or [self._nearest_pair(model, data).alone(model, data)]
        return (min(near, key=lambda one: one.gap),)

    def _alone(self, model: Any, data: Any) -> list[tuple[PiecePair, Proximity]]:
        """Pairs of pieces that may touch, each as if there were no others."""
        near = self.within(model, data, _QUERY_M)
        pairs = [self.piece_pair(k) for gap, k in near if gap <= DISTANCE_QUERY_M]
        return [(pair, pair.alone(model, data)) for pair in pairs]

    def at_pieces(
        self, model: Any, data: Any, pair: PiecePair, alone: Proximity, *, without_closed: bool = False
    ) -> Proximity:
        """Proximity of two pieces that touch, with the normals of the unions: the patch that approaches fastest.

        ``alone`` is their proximity as if there were no others; ``without_closed`` leaves out patches that are held.
        """
        # Gaps of a patch that is held drift by the truncation error of a step: that is no approach.
        patches = [
            replace(near, rate_tolerance=near.rate_tolerance * (CLOSED_RATE / RATE if is_closed else 1.0))
            for near in self._patches(model, data, [(pair, alone)])
            for is_closed in (self.is_closed(near, data),)
            if not (is_closed and without_closed)
        ]
        # A point at which pieces of another rule decide is no contact here.
        return min(
            patches,
            key=lambda near: near.rate + near.rate_tolerance,
            default=replace(alone, rates=np.zeros(len(alone.points))),
        )

    def _patches(self, model: Any, data: Any, touching: Sequence[tuple[PiecePair, Proximity]]) -> tuple[UnionProximity, ...]:
        """Patches of some pairs of pieces that touch, with their points of this rule."""
        groups: list[PointGroup[PiecePair]] = []
        met = [
            (pair, near, meeting)
            for pair, near in touching
            for meeting in pair.meetings(model, data, near)
            if meeting is not None
        ]
        for pair, near, meeting in met:
            normals = meeting.cells[0] if len(meeting.cells) == 1 else self._chosen_together(data, meeting, met, near)
            for normal in normals:
                if (owner := pair.union._owner_along(pair, meeting, normal)) is None:
                    continue
                # The search knows its normal to rounding; that of two edges here is a cross product.
                better = near.normal if meeting.clauses and math.dist(near.normal, normal) <= ONE_NORMAL else normal
                group = next((one for one in groups if one.has(better, meeting.point)), None)
                if group is None:
                    groups.append(group := PointGroup())
                group.add(better, meeting.point, owner)
        patches = (self._patch(model, data, group) for group in groups)
        return tuple(patch for patch in patches if patch is not None)

    def _chosen_together(
        self, data: Any, meeting: Meeting, met: Iterable[tuple[Any, Any, Meeting]], near: Proximity
    ) -> FloatArray:
        """Normals of the cell in which the motion is at all points of an edge on an edge, or of the nearest one, (k, 3)."""
        motions = np.array([self._velocity.at(data, other.point) for _, _, other in met if meeting.chooses_with(other)])
        return chosen_cell(meeting.cells, motions, near.rate_tolerance, near.normal)

    def _patch(self, model: Any, data: Any, group: PointGroup[PiecePair]) -> UnionProximity | None:
        """The patch of some points with one normal: corners of their hull, so that seams and covered edges leave none.

        Where another rule goes on in its plane it has those of the corners that are this rule's; None without any.
        """
        every = np.array(group.points)
        pieces = tuple(dict.fromkeys(group.owners))
        shapes = [pair.shapes(model, data) for pair in pieces]
        # A face that lands on several pieces has the normal of either side to rounding: as of two geoms, the one that parts
        # them best is that of all its points.
        gap, normal = max(
            ((min(separation(*both, one) for both in shapes), one) for one in group.distinct()), key=lambda pair: pair[0]
        )
        mine = [i for i, owner in enumerate(group.owners) if owner.union is self]
        corners = every[corners_across(every, normal)]
        # Corners within the distance at which points are one may be on either side of a seam of two rules: features decide.
        places = [
            i
            for corner in (corners if mine else ())
            for i in (min(mine, key=lambda k: math.dist(every[k], corner)),)
            if math.dist(every[i], corner) <= SAME_POINT_M
        ]
        if not places:
            return None
        points, owners = every[places], tuple(group.owners[i] for i in places)
        rates, tolerance = self._velocity.along(data, normal, points)
        rounding = gap_rounding(points)
        turned = np.round(normal @ data.xmat[self.body_b].reshape(3, 3), 6) + 0.0
        patch = " ".join(map("{:g}".format, turned.tolist()))
        return UnionProximity(gap, normal, points, rates, tolerance, rounding, patch, pieces, owners, len(corners))

    def meeting(self, model: Any, data: Any, pair: PiecePair, near: Proximity, point: FloatArray) -> Meeting | None:
        """What meets at a point where two pieces touch; None if that is no contact of these."""
        if pair.is_curved and self._is_covered(pair, data, near.normal):
            return None  # the next cylinder has the contact
        a, b = (side.surfaces_at(model, data, point, AT_POINT_M) for side in self.sides)
        # Deeper overlaps have no common point of both surfaces: they are asked for to find when they began.
        if near.gap < -CONTACT_GAP_M or (len(a) <= 1 and len(b) <= 1 and not may_tie(a, b)):
            return Meeting(point, [near.normal[None]])
        if pair.is_curved and (level := levelled(self.sides, pair.pieces, near.normal, (a, b))) is not None:
            crosses = crosses_seam(pair.shapes(model, data), point, level, (a, b))
            return None if crosses else Meeting(point, [level[None]])
        clauses = {(one, other): separating_normals(a[one], b[other]) for one in a for other in b}
        # Surfaces that overlap by rounding have no normal that parts them: the other pieces there decide.
        parting = [clause for clause in clauses.values() if len(clause)]
        if not parting and len(clauses) == 1:
            # Two pieces alone: a point is known to the distance at which two are one, and may be beyond that of an edge.
            return Meeting(point, [near.normal[None]])
        return Meeting(point, cells(parting), clauses)

    def _owner_along(self, pair: PiecePair, meeting: Meeting, normal: FloatArray) -> PiecePair | None:
        """The pair of pieces that has a normal of a meeting of two pieces; None: those of another rule have it."""
        if not meeting.clauses:
            return pair
        parted = [pieces for pieces, clause in meeting.clauses.items() if in_cone(clause, normal)]
        # Of several pieces in one plane any will do, but those of another rule are of another pair.
        owners = [self.number_of(*pieces) for pieces in parted if self._allowed[pieces[0].number, pieces[1].number]]
        return self.piece_pair(min(owners)) if owners else None

    def _is_covered(self, pair: PiecePair, data: Any, normal: FloatArray) -> bool:
        """Whether a normal of two pieces is that of an end of a cylinder or capsule which another one continues."""
        return any(
            side.is_covered(piece, sense * normal @ data.xmat[side.body].reshape(3, 3))
            for side, piece, sense in zip(self.sides, pair.pieces, (1.0, -1.0), strict=True)
        )

    def second_rate(self, model: Any, data: Any, near: Proximity, point: FloatArray) -> SecondRate:
        """Second rate of the gap at one of the points of a patch; accelerations in ``data`` must be current."""
        owner, half = _owner(near, point), 0.5 * near.gap * near.normal
        # As far from the end of its face as a point still counts as at the end.
        shapes = [
            AmongOthers(
                model, data, piece, [*side.surfaces_at(model, data, point, 2.0 * AT_END * piece.radius)], point, side.body
            )
            for piece, side in zip(owner.pieces, self.sides, strict=True)
        ]
        bodies, points = (self.body_a, self.body_b), (point - half, point + half)
        return second_rate(model, data, bodies, (shapes[0], shapes[1]), near.normal, points)

    def geoms_at(self, near: Proximity, point: FloatArray) -> tuple[str, str]:
        """Full names of the geoms of the pieces that touch at one of the points of a patch."""
        return _owner(near, point).geoms

    def geoms_among(self, model: Any, data: Any, points: Iterable[FloatArray]) -> tuple[str, str]:
        """Full names of two geoms whose pieces meet at one of some contact points; of the nearest pieces without any.

        Of several the first: the order of points depends on rounding.
        """
        met = [
            self.number_of(one, other)
            for point in points
            for a, b in (tuple(side.surfaces_at(model, data, point, AT_POINT_M) for side in self.sides),)
            for one in a
            for other in b
            if self._allowed[one.number, other.number]
        ]
        if not met and (near := self.within(model, data, _QUERY_M)):
            # Of pieces that are as near as queries can tell, whichever was the nearest before.
            met = [k for gap, k in near if gap <= near[0][0] + DISTANCE_QUERY_M]
        return (self.piece_pair(min(met)) if met else self._nearest_pair(model, data)).geoms


def _owner(near: Proximity, point: FloatArray) -> PiecePair:
    """The pair of pieces at a point of a patch."""
    assert isinstance(near, UnionProximity)
    return near.owners[min(range(len(near.points)), key=lambda i: math.dist(near.points[i], point))]
