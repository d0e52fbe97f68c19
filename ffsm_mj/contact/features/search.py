"""Contact features: the vertex, edge, face and curve pairs by which two geoms touch.

Persistent contact constrains one smooth gap function per feature, fixed for all trial states of a step; if the contact
leaves the bounds of a feature, the features are determined again here. Candidates are the points, lines and faces of both
geoms that are extreme along the contact normal.

Features as data, and made again from them: those of closed contacts are of the state of a simulation.

A feature keeps the arguments of its class (:attr:`~.gap_function.GapFunction.arguments`): names, signs and cores. Cores that
share a body object belong to one search, and only these are on one face; a body is stored by its id and place in a list.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import fields
from typing import Any, TypeVar

import mujoco

from ffsm_mj._core.polygons import lie_along
from ffsm_mj.contact.cone_pair import ConePair
from ffsm_mj.contact.features.body_motion import Body, Vector, cross, dot, minus, shifted
from ffsm_mj.contact.features.cone_gaps import Cone, LevelRimOnCone, PointOnCone, RoundOnCone
from ffsm_mj.contact.features.cores import Circle, Core, Curve, Ellipsoid, Face, Line, Point, RegionFace
from ffsm_mj.contact.features.gap_function import Feature, FeatureState, GapFunction
from ffsm_mj.contact.features.outline import CylinderOutline, EllipsoidOutline, Outline, PlaneOutline, PolytopeOutline
from ffsm_mj.contact.features.point_line_gaps import LineOnCurve, PointOnCurve, PointOnFace, PointOnPoint
from ffsm_mj.contact.features.rim_gaps import RimOnEllipsoid, RimOnRim, SideOnRim, level_crossings, rim_towards
from ffsm_mj.contact.features.round_gaps import EllipsoidOnEllipsoid, OnEllipsoid, RoundOnFace
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact.patch import flush_offset
from ffsm_mj.contact.proximity import Proximity
from ffsm_mj.contact.solid.faces import UnionFace
from ffsm_mj.contact.union_pair import PiecePair, UnionProximity
from ffsm_mj.state import StateError
from ffsm_mj.tolerances import ACCELERATION, ACCELERATION_M_S2, CONTACT_GAP_M, FEATURE_BOUND_M, PARALLEL, SAME_POINT_M

_OUTLINES: dict[int, type[Outline]] = {
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): CylinderOutline,
    int(mujoco.mjtGeom.mjGEOM_ELLIPSOID): EllipsoidOutline,
    int(mujoco.mjtGeom.mjGEOM_PLANE): PlaneOutline,
}
_FIRST: tuple[type[Core], ...] = (Face, Ellipsoid, Circle, Line, Point)
"""The first of two cores is the one whose kind comes first here."""
_NAMES = ("sphere", "end", "side", "rim", "ellipsoid", "vertex", "edge", "cap", "face")
"""Names of two cores of one kind are given in this order."""


def features(pair: ContactPair, model: Any, data: Any, near: Proximity) -> tuple[Feature, ...]:
    """All contact features of a pair.

    Args:
        pair: Two geoms.
        model: MuJoCo model.
        data: Its data, positions and velocities current.
        near: The pair's gap and normal there, at this state alone: it keeps the features.

    Returns:
        Features with a gap of at most CONTACT_GAP_M, or that of the pair if larger, and no further than FEATURE_BOUND_M / 2
        outside their bounds. A face on a face has several; there are none if only vertices or edges meet vertices or
        parallel edges.
    """
    if not near.features:
        near.features.extend(_determined(pair, model, data, near))
    return tuple(near.features)


def _determined(pair: ContactPair, model: Any, data: Any, near: Proximity) -> Iterable[Feature]:
    if isinstance(pair, ConePair):
        return pair.features_at(model, data, near)
    if isinstance(near, UnionProximity):
        return _of_patch(near, model, data)
    return _search(pair, model, data, near).all()


def _search(
    pair: ContactPair, model: Any, data: Any, near: Proximity, bodies: tuple[Body | None, Body | None] = (None, None)
) -> _Search:
    a, b = (
        (_OUTLINES.get(int(model.geom_type[geom]), PolytopeOutline) if part is None else PolytopeOutline)(
            model, data, geom, outward, pair.position_tolerance, body, part
        )
        for geom, part, body, outward in zip(pair.ids, pair.parts, bodies, (near.normal, -near.normal), strict=True)
    )
    return _Search(a, b, data, near)


def _of_patch(near: UnionProximity, model: Any, data: Any) -> list[Feature]:
    """Features at the points of a patch of two unions: those of its pieces, on the faces and edges of the unions.

    Pieces of other rules have theirs in the plane, too: a point over a seam of two rules is on one of them.
    """
    mine = near.owners[0].union
    sides = mine.sides
    bodies = Body(model, sides[0].body), Body(model, sides[1].body)
    closed: list[tuple[GapFunction, FeatureState, PiecePair]] = []
    for on_face in (True, False):
        closing = [
            (feature, pair)
            for pair in near.pieces
            for search in (_search(pair, model, data, near, bodies),)
            for feature in ([one for one, _ in search.on_faces()] if on_face else search.all())
        ]
        for feature, pair in sorted(closing, key=lambda entry: _is_covered(*entry)):
            united = _united(feature, data, pair)
            if united is None:
                continue
            state = united.at(data)
            # Points of seams are no corners of the patch, and a corner over a seam is found by both pieces. Where a body
            # passes the rim between two cylinders, this is no contact beside that on their side.
            apart = SAME_POINT_M if _is_covered(feature, pair) else FEATURE_BOUND_M
            if any(math.dist(state.point, point) <= SAME_POINT_M for point in near.points):
                _keep(closed, (united, state, pair), apart)
        # The highest-dimensional contact wins, as between two geoms.
        if closed:
            break
    return [feature for feature, _, pair in closed if pair.union is mine]


def _is_covered(feature: GapFunction, pair: PiecePair) -> bool:
    """Whether a feature is at an end of a cylinder or capsule that another one continues."""
    _, swapped, first, second, *_ = feature.arguments
    entries = [*zip(pair.union.sides, pair.pieces, strict=True)][:: -1 if swapped else 1]
    return any(side.is_covered_end(core, piece) for core, (side, piece) in zip((first, second), entries, strict=True))


def _united(feature: GapFunction, data: Any, pair: PiecePair) -> GapFunction | None:
    """A feature of two pieces on the faces and edges of their unions; None at an edge that is none of its union.

    All points over one plane then have one face, and the edges of several pieces on one line are one edge: crossing a seam
    changes no number.
    """
    name, swapped, first, second, *rest = feature.arguments
    sides = pair.union.sides[:: -1 if swapped else 1]
    pieces, (x, y, z) = pair.pieces[:: -1 if swapped else 1], feature.at(data).point.tolist()
    cores: list[Core] = []
    for core, side, piece in zip((first, second), sides, pieces, strict=True):
        motion = core.body.motion(data)
        place = motion.local(minus((x, y, z), motion.origin))
        united: Core | None = core
        if isinstance(core, Face) and core.sides:
            among = pair.union.of_rule[pair.union.sides.index(side)]
            united = side.face(core, piece, place, among)
        elif isinstance(core, Line):
            united = side.edge(core, piece, place)
        if united is None:
            return None
        cores.append(united)
    arguments: tuple[Any, ...] = (name, swapped, *cores, *rest)
    of_union = type(feature)(*arguments)
    of_union.set_state(feature.get_state())
    return of_union


def features_at_rest(
    pair: ContactPair, model: Any, data: Any, near: Proximity, is_at_rest: Callable[[FeatureState], bool]
) -> list[Feature]:
    """Those features of a pair that are at rest; see :func:`features`.

    A cap that an impact leaves tipping may do so over any point of its rim, and the fixed points that represent the rim then
    all separate: the point at which the impact acted is at rest.
    """
    resting: list[Feature] = [feature for feature in features(pair, model, data, near) if is_at_rest(feature.at(data))]
    if isinstance(pair, ConePair):
        return resting
    return resting or [feature for feature in _search(pair, model, data, near).on_rims() if is_at_rest(feature.at(data))]


class _Search:
    """Finds the pairs of cores of two outlines that are in contact at one state."""

    def __init__(self, a: Outline, b: Outline, data: Any, near: Proximity) -> None:
        self._a, self._b, self._data, self._near = a, b, data, near
        self._position_tolerance = a.position_tolerance + b.position_tolerance
        x, y, z = near.normal.tolist()
        self._normal: Vector = (x, y, z)

    def all(self) -> list[GapFunction]:
        """All features of the contact."""
        # The highest-dimensional contact wins: corners of a face on a face would otherwise be found again as edge contacts.
        on_faces: list[tuple[GapFunction, FeatureState]] = []
        for candidate in self.on_faces():
            _keep(on_faces, candidate, 0.5 * FEATURE_BOUND_M)
        if on_faces:
            return [feature for feature, _ in on_faces]
        return self.between_lines() or self.on_lines() or self.between_corners()

    def on_faces(self) -> list[tuple[GapFunction, FeatureState]]:
        """Corners on faces, and crossings of edges over faces, with their states: all of those at one place."""
        a, b = self._a, self._b
        face_a, face_b = a.face(), b.face()
        if face_a is None and face_b is None:
            return []
        touching = self._touching((core, face_b) for core in a.points() if face_b is not None)
        touching += self._touching((face_a, core) for core in b.points() if face_a is not None)
        return touching + self._touching(self._crossing_curves())

    def on_rims(self) -> list[GapFunction]:
        """Contact points of the pair that are points of the rim of a cap, over a face."""
        a, b, places = self._a, self._b, self._near.points
        face_a, face_b = a.face(), b.face()
        touching = self._touching((core, face_b) for core in a.rim_points(places) if face_b is not None)
        touching += self._touching((face_a, core) for core in b.rim_points(places) if face_a is not None)
        return [feature for feature, _ in touching]

    def between_lines(self) -> list[GapFunction]:
        """Crossing lines; for parallel lines, the ends of their overlap."""
        crossings = []
        for one in self._a.edges(bounded=True):
            for other in self._b.edges(bounded=True):
                if self._lie_along(one, other):
                    # The contact is a segment; its two ends determine the motion of both lines.
                    crossings += self._touching((one, end) for end in other.ends)
                    crossings += self._touching((end, other) for end in one.ends)
                else:
                    crossings += self._touching([(one, other)])
        return [feature for feature, _ in crossings]

    def on_lines(self) -> list[GapFunction]:
        """The corner or round part in contact with a line, if there is one."""
        x, y, z = self._normal
        a, b = self._a, self._b
        touching = self._touching((c, self._facing(e, c, self._normal)) for c in a.corners() for e in b.curves(bounded=True))
        touching += self._touching(
            (self._facing(e, c, (-x, -y, -z)), c) for e in a.curves(bounded=True) for c in b.corners()
        )
        touching += self._touching((e, self._below(f, e)) for e in a.edges(bounded=True) for f in b.curves(bounded=True))
        touching += self._touching((self._below(e, f), f) for e in a.curves(bounded=True) for f in b.edges(bounded=True))
        return _most_inside(touching)

    def _below(self, curve: Curve, line: Line) -> Curve:
        """The curve; the rim around a cap with angle 0 where it is nearest to a line."""
        if not isinstance(curve, Circle):
            return curve
        motion, curve_motion = line.body.motion(self._data), curve.body.motion(self._data)
        arm, _, _ = line.foot(motion, minus(curve_motion.place(curve.centre), motion.origin))
        return rim_towards(curve, curve_motion, shifted(motion.origin, 1.0, arm))

    def _facing(self, curve: Curve, corner: Core, outward: Vector) -> Curve:
        """The curve; the rim around a cap with angle 0 next to a round corner, whose normal points outward."""
        if not isinstance(curve, Circle) or not isinstance(corner, Circle | Ellipsoid):
            return curve
        motion = corner.body.motion(self._data)
        arm = corner.extreme(motion, outward)
        return rim_towards(curve, curve.body.motion(self._data), shifted(motion.origin, 1.0, arm))

    def between_corners(self) -> list[GapFunction]:
        """The corner or round part in contact with another one, if there is one."""
        return _most_inside(self._touching((one, other) for one in self._a.corners() for other in self._b.corners()))

    def _crossing_curves(self) -> Iterator[tuple[Core, Core]]:
        """Lines that are not parallel, and the places where lines enter and leave a rim."""
        a, b = self._a, self._b
        others = list(b.curves(bounded=False))
        for one in a.curves(bounded=False):
            for other in others:
                if isinstance(one, Circle) and isinstance(other, Circle):
                    yield from level_crossings(one, other, self._data)
                elif isinstance(one, Circle) and isinstance(other, Line):
                    yield from ((circle, other) for circle in a.crossings(one, b.centre(other), b.direction(other)))
                elif isinstance(one, Line) and isinstance(other, Circle):
                    yield from ((one, circle) for circle in b.crossings(other, a.centre(one), a.direction(one)))
                elif not self._are_parallel(one, other):
                    yield one, other

    def _are_parallel(self, one: Curve, other: Curve) -> bool:
        """Whether two curves are parallel at the contact."""
        return math.hypot(*cross(self._a.direction(one), self._b.direction(other))) <= PARALLEL

    def _lie_along(self, one: Line, other: Line) -> bool:
        """Whether two lines are parallel, or so nearly that their round sides touch along the length that they share."""
        sine = math.hypot(*cross(self._a.direction(one), self._b.direction(other)))
        return lie_along(sine, 2.0 * min(one.half, other.half), flush_offset(one.radius + other.radius))

    def _have_no_normal(self, one: Core, other: Core) -> bool:
        """Whether two cores are parallel curves: these have no cross product, and they touch at their ends."""
        if not (isinstance(one, Line | Circle) and isinstance(other, Line | Circle)) or not self._are_parallel(one, other):
            return False
        # A round side along the tangent of a rim touches it at one point.
        return type(one) is type(other) or one.radius + other.radius <= 0.0

    def _touching(self, cores: Iterable[tuple[Core, Core]]) -> list[tuple[GapFunction, FeatureState]]:
        """Features of those pairs of cores, of a and of b, that are in contact, with their states."""
        closed = []
        for one, other in cores:
            if self._have_no_normal(one, other):
                continue
            feature = gap_function(one, other, self._sense(one, other))
            if feature is None:
                continue
            state = feature.at(self._data)
            if state.inside < -0.5 * FEATURE_BOUND_M or not self._is_closed(state.gap):
                continue
            aligned = self._aligned(one, other, state.gap)
            closed.append((aligned or feature, state))
        return closed

    def _is_closed(self, gap: float) -> bool:
        near = self._near
        # Features of a mesh differ from the gap of the pair by single precision, which may exceed CONTACT_GAP_M.
        if self._position_tolerance > 0.0:
            return abs(gap - near.gap) <= self._position_tolerance + CONTACT_GAP_M
        return abs(gap) <= max(CONTACT_GAP_M, abs(near.gap) + near.rounding)

    def _aligned(self, one: Core, other: Core, gap: float) -> GapFunction | None:
        """The same feature with the normal of the pair, if all features of a flat contact must share one.

        Normals that differ by rounding would over-constrain the tangential motion: the contact would jam.
        """
        if self._position_tolerance == 0.0 and not (self._a.flat and self._b.flat):
            return None
        feature = gap_function(self._a.aligned(one), self._b.aligned(other), self._sense(one, other))
        if feature is not None:
            # The other normal changes the gap: it is shifted back, for a mesh to the gap of the pair, which all share.
            feature.subtract_length(feature.at(self._data).gap - (self._near.gap if self._position_tolerance > 0.0 else gap))
        return feature

    def _sense(self, one: Core, other: Core) -> float:
        """Sign of the normal along the cross product of two line directions; 0 for other cores."""
        if not (isinstance(one, Line | Circle) and isinstance(other, Line | Circle)):
            return 0.0
        return math.copysign(1.0, dot(self._normal, cross(self._a.direction(one), self._b.direction(other))))


_Candidate = TypeVar("_Candidate", tuple[GapFunction, FeatureState], tuple[GapFunction, FeatureState, PiecePair])
"""A feature with its state, and its pair of pieces."""


def _keep(kept: list[_Candidate], candidate: _Candidate, apart: float) -> None:
    """Add a feature; of those within a distance in m, which are at one place, keep that which closes first, or the first.

    A second constraint there would only make the contact problem redundant: with the same normal and material points they
    differ by their velocity-dependent terms alone. An edge of a face crosses the other face at a corner of its own, and
    where a corner lies exactly on the edge of a face, it leaves over the edge or stays on the face, as the bodies turn.
    """
    state = candidate[1]
    at = next((i for i, other in enumerate(kept) if math.dist(state.point, other[1].point) <= apart), None)
    if at is None:
        kept.append(candidate)
        return
    other = kept[at][1]
    rounding = ACCELERATION_M_S2 + ACCELERATION * max(state.scale, other.scale)
    if state.bend < other.bend - rounding:  # its gap is less from the next instant on
        kept[at] = candidate


def _most_inside(candidates: list[tuple[GapFunction, FeatureState]]) -> list[GapFunction]:
    """The feature furthest inside its bounds: neighbouring edges and corners share the contact point within tolerance."""
    return [max(candidates, key=lambda candidate: candidate[1].inside)[0]] if candidates else []


def gap_function(a: Core, b: Core, sense: float) -> GapFunction | None:
    """The gap function of a core of geom a and a core of geom b.

    Args:
        a: Core of geom a, which the normal points away from.
        b: Core of geom b.
        sense: Sign of the normal along (direction of a) x (direction of b), for two lines or circles.

    Returns:
        None if the cores have none: the normal between two sharp points, or a sharp point and an edge, is undefined in
        contact; the contact is then at another feature.
    """
    swapped = _FIRST.index(type(a)) > _FIRST.index(type(b))
    first, second = (b, a) if swapped else (a, b)
    names = [second.name, first.name]
    name = " on ".join(sorted(names, key=_NAMES.index) if type(first) is type(second) else names)
    sharp = first.radius + second.radius <= 0.0
    feature: GapFunction | None = None
    match first, second:
        case Face(), Point():
            feature = PointOnFace(name, swapped, first, second)
        case Face(), Circle() | Ellipsoid():
            feature = RoundOnFace(name, swapped, first, second)
        case Ellipsoid(), Ellipsoid():
            feature = EllipsoidOnEllipsoid(name, swapped, first, second)
        case Ellipsoid(), Circle():
            feature = RimOnEllipsoid(name, swapped, first, second)
        case Ellipsoid(), Point() | Line():
            feature = OnEllipsoid(name, swapped, first, second)
        case Circle(), Line() if not sharp:
            feature = SideOnRim(name, swapped, first, second)
        case Circle(), Circle():
            feature = RimOnRim(name, swapped, first, second, sense)
        case Circle() | Line(), Line():
            feature = LineOnCurve(name, swapped, first, second, sense)
        case Circle() | Line(), Point() if not sharp:
            feature = PointOnCurve(name, swapped, first, second)
        case Point(), Point() if not sharp:
            feature = PointOnPoint(name, swapped, first, second)
    return feature


_GAPS = (PointOnFace, PointOnPoint, PointOnCurve, LineOnCurve, RimOnRim, SideOnRim, RimOnEllipsoid, PointOnCone, RoundOnCone)
_KINDS = {kind.__name__: kind for kind in (*_GAPS, LevelRimOnCone, RoundOnFace, OnEllipsoid, EllipsoidOnEllipsoid)}
_CORES = {kind.__name__: kind for kind in (Point, Line, Face, RegionFace, Circle, Ellipsoid, Cone)}


class StoredFeatures:
    """Writes the features of one state, or makes those of one state."""

    def __init__(self, model: Any) -> None:
        """Start without bodies.

        Args:
            model: MuJoCo model that has them.
        """
        self._model = model
        self._bodies: dict[int, Body] = {}

    def to_plain(self, feature: Feature) -> dict[str, Any]:
        """A feature as data: its kind, what it is made of, and what it remembers."""
        assert isinstance(feature, GapFunction)
        arguments = [self._as_data(argument) for argument in feature.arguments]
        return {"kind": type(feature).__name__, "made_of": arguments, "state": feature.get_state()}

    def from_plain(self, data: Any) -> GapFunction:
        """A feature from data.

        Raises:
            StateError: They are none.
        """
        try:
            feature: GapFunction = _KINDS[data["kind"]](*(self._from_data(argument) for argument in data["made_of"]))
            feature.set_state(data["state"])
        except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
            raise StateError(f"a contact feature in a state cannot be made: {error!r}") from error
        return feature

    def _as_data(self, part: Any) -> Any:
        if isinstance(part, Body):
            number = next((number for number, body in self._bodies.items() if body is part), len(self._bodies))
            self._bodies[number] = part
            return {"body": part.id, "number": number}
        if type(part).__name__ in _CORES:
            named = {field.name: self._as_data(getattr(part, field.name)) for field in fields(part)}
            return {"core": type(part).__name__, "of": named}
        if isinstance(part, UnionFace):
            return {"region": part.to_plain()}
        return tuple(map(self._as_data, part)) if isinstance(part, tuple) else part

    def _from_data(self, to_plain: Any) -> Any:
        if isinstance(to_plain, tuple):
            return tuple(map(self._from_data, to_plain))
        if not isinstance(to_plain, Mapping):
            return to_plain
        if "region" in to_plain:
            return UnionFace.from_plain(to_plain["region"])
        if "core" in to_plain:
            return _CORES[to_plain["core"]](**{name: self._from_data(part) for name, part in to_plain["of"].items()})
        body, number = to_plain["body"], to_plain["number"]
        if not 0 <= body < self._model.nbody:
            raise ValueError(f"no body {body}")
        known = self._bodies.setdefault(number, Body(self._model, body))
        if known.id != body:
            raise ValueError(f"body {body} is {known.id} elsewhere")
        return known
