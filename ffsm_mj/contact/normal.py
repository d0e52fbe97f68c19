"""Gap and contact normal of two convex geoms: distance queries of MuJoCo, refined on the support functions to rounding.

The normal is the direction of largest separation. The distance of a query is accurate to 1e-9 of the size or better, and
stationary in the direction, which is known to the square root only. The separation along n is -h1(n) - h2(-n) with the
support functions of the geoms, which are closed forms; its maximum is found by Newton's method on the sphere of directions.
Edges and faces are kinks of the separation: a normal perpendicular to an edge stays perpendicular to it, and two edges or a
face determine the normal.

``mj_geomDistance`` returns a distance and two witness points. Near contact the line between them has no defined direction,
so the normal comes from shifted queries: geom b is moved away along the current estimate and the query repeated a few times.
The result is then refined on the support functions, which also give the gap to rounding.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import chain, combinations, product
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_mj._core.polygons import opposite, segments_lie_along
from ffsm_mj._core.shapes import separation
from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.patch import facing, flush_offset
from ffsm_mj.contact.shape import Part, Shape
from ffsm_mj.dynamics.rigid_body import cross
from ffsm_mj.state import Stateful
from ffsm_mj.tolerances import CLEARLY_APART_M, CONTACT_GAP_M, EPSILON, FLUSH_M, PARALLEL

_AXES = np.eye(3)
_WIDTH = 1e-4
"""An estimate is accurate to about 1e-5 rad: edges and faces within this angle may be those in contact."""
_ROUNDING = 1e-15
"""Rounding of a separation in m and of a direction in rad: directions whose separations differ by less tie."""
_ITERATIONS = 20
"""Newton's steps: up to 8 in the tests until one is below :data:`_ROUNDING`; all where rounding keeps them above it."""
_LONGEST_STEP = 0.1
"""Longest Newton step, rad."""
_STRAYED = 3
"""Steps that are longer than the one before and than :data:`_LONGEST_STEP`, after which a direction is given up."""
_FLATTEST = 1e-9
"""Least curvature in m at which a Newton step is taken."""
_EIGENVALUE_ROUNDING = 16.0 * EPSILON
"""The least eigenvalue of a symmetric matrix is known to a few EPSILON of the largest one.

Close to the axis of a cylinder the rim has a radius of curvature of 1e7 m and more, and the other eigenvalue is rounding.
"""


def refine_normal(first: Shape, second: Shape, estimate: FloatArray) -> FloatArray:
    """Unit normal from the first geom to the second, from an estimate accurate to about 1e-4 rad.

    It is not known beforehand which of the edges and faces near the estimate are in contact. Each choice of them gives a
    direction, and the normal is the direction with the largest separation.
    """
    return _refined(first, second, estimate)[0]


def _refined(first: Shape, second: Shape, estimate: FloatArray) -> tuple[FloatArray, tuple[FloatArray, FloatArray] | None]:
    """The same with the features that face each other along it, where they are known to overlap across it."""
    edges = _edges(first, second, estimate, _WIDTH)
    if first.position_tolerance or second.position_tolerance:
        return _between_sides(first, second, _between_facets(first, second, estimate, edges)), None
    best, largest = estimate, -np.inf
    flush = flush_offset(first.side_radius + second.side_radius)
    for normal in chain(_of_edges(first, second, estimate, edges), (estimate,)):
        apart = separation(first, second, normal)
        # Of bodies that do not overlap, no direction has a larger separation than one along which features face each other.
        if apart >= -CONTACT_GAP_M and normal is not estimate:
            features = facing(first, second, normal)
            if opposite(*features, normal, flush):
                along = _between_sides(first, second, normal)
                return along, features if along is normal else None
        if apart > largest + _ROUNDING:
            best, largest = normal, apart
    return _between_sides(first, second, best), None


def _of_edges(first: Shape, second: Shape, estimate: FloatArray, edges: FloatArray) -> Iterator[FloatArray]:
    """Directions of choices of edges: the best of those that two determine, then of one each, then of none."""
    if pairs := list(_pairs(edges)):
        yield _best_direction(first, second, estimate, pairs)[0]
    for fixed in (*edges[:, None], edges[:0]):
        yield _maximise(first, second, estimate, fixed)


def _between_facets(first: Shape, second: Shape, estimate: FloatArray, edges: FloatArray) -> FloatArray:
    """The normal where a geom is a mesh, whose points are in single precision."""
    best, _ = _best_direction(first, second, estimate, _choices(edges))
    # Facets of a fine mesh differ by less than the width, and which of them were tried depends on the estimate.
    best, apart = _best_direction(first, second, best, _choices(_edges(first, second, best, PARALLEL)))
    if is_normal(first, second, best):
        return best
    # For a face of a mesh only two directions that span it were tried; contact at one of its sides needs that edge.
    choices = _crossed_choices(first.hull_edges(best, _WIDTH), second.hull_edges(-best, _WIDTH))
    finer, at_side = _best_direction(first, second, best, choices)
    return finer if at_side >= apart - _ROUNDING else best


def _between_sides(first: Shape, second: Shape, normal: FloatArray) -> FloatArray:
    """The normal where round sides touch along each other: across the longer one, at the middle of the other.

    The direction across both is known to rounding over the angle between them only, which is too little at small angles.
    """
    radius = first.side_radius + second.side_radius
    if radius <= 0.0:
        return normal
    a, b = facing(first, second, normal)
    if not segments_lie_along(a, b, flush_offset(radius)):
        return normal
    along = max(a[1] - a[0], b[1] - b[0], key=lambda span: math.hypot(*span))
    offset = b.mean(axis=0) - a.mean(axis=0) + radius * normal  # from axis to axis
    middle = _unit(offset - (offset @ along) / (along @ along) * along)
    # Sides that lean against each other touch at one end, with the normal there.
    return middle if separation(first, second, middle) >= separation(first, second, normal) - FLUSH_M else normal


def _edges(first: Shape, second: Shape, normal: FloatArray, width: float) -> FloatArray:
    """Directions of edges of both geoms within ``width`` rad of perpendicular to a normal, (k, 3)."""
    return np.vstack((first.edges(normal, width), second.edges(-normal, width)))


def is_normal(first: Shape, second: Shape, direction: FloatArray) -> bool:
    """Whether the extreme features of both geoms along a direction overlap in projection, as along the contact normal."""
    flush = flush_offset(first.side_radius + second.side_radius)
    return opposite(*facing(first, second, direction), direction, flush)


def _best_direction(
    first: Shape, second: Shape, estimate: FloatArray, choices: Iterable[FloatArray]
) -> tuple[FloatArray, float]:
    """The direction of largest separation, and that in m, among those of some choices of edges and the estimate."""
    best, largest = estimate, -np.inf
    # If directions tie to rounding, the one with more edges wins; the estimate, which is less accurate, is last.
    for normal in (*(_maximise(first, second, estimate, fixed) for fixed in choices), estimate):
        value = separation(first, second, normal)
        if value > largest + _ROUNDING:
            best, largest = normal, value
    return best, largest


def _choices(edges: FloatArray) -> Iterator[FloatArray]:
    """Sets of edge directions that the normal may be perpendicular to: two, one or none, (k, 3) each."""
    yield from _pairs(edges)
    yield from edges[:, None]
    yield edges[:0]


def _pairs(edges: FloatArray) -> Iterator[FloatArray]:
    """Pairs of edge directions that determine a normal, (2, 3) each."""
    for one, other in combinations(edges, 2):
        if math.hypot(*cross(one, other)) > PARALLEL:
            yield np.array((one, other))


def _crossed_choices(of_first: FloatArray, of_second: FloatArray) -> Iterator[FloatArray]:
    """The same with at most one edge of each geom: two edges of one geom give no more than the face that they bound."""
    for one, other in product(of_first, of_second):
        if math.hypot(*cross(one, other)) > _WIDTH:
            yield np.array((one, other))
    yield from np.vstack((of_first, of_second))[:, None]
    yield of_first[:0]


def _maximise(first: Shape, second: Shape, normal: FloatArray, edges: FloatArray) -> FloatArray:
    """Direction of largest separation among those perpendicular to the edges."""
    if len(edges) == 2:
        return _towards(cross(edges[0], edges[1]), normal)
    if len(edges) == 1:
        normal = _towards(normal - (normal @ edges[0]) * edges[0], normal)
    before, strayed = math.inf, 0
    for _ in range(_ITERATIONS):
        tangents = _tangents(normal, edges)
        offset = _mean(second.extreme(-normal)) - _mean(first.extreme(normal))
        # Hessian on the sphere: radii of both geoms, and the gap, because a turned direction stays a unit vector.
        slope = tangents @ (first.radii(normal) + second.radii(-normal)) @ tangents.T
        slope += float(offset @ normal) * _AXES[: len(slope), : len(slope)]
        if _least_eigenvalue(slope) < max(_FLATTEST, _EIGENVALUE_ROUNDING * float(np.abs(slope).max())):
            break  # nothing is curved: the direction cannot be improved
        step = np.linalg.solve(slope, tangents @ offset)
        length = math.hypot(*step)
        normal = _unit(normal + step @ tangents * min(1.0, _LONGEST_STEP / max(length, _LONGEST_STEP)))
        # Between two corners that take turns there is no extremum: steps that grow again and again lead nowhere.
        strayed += length > max(before, _LONGEST_STEP)
        before = length
        if length < _ROUNDING or strayed == _STRAYED:
            break
    return normal


def _mean(points: FloatArray) -> FloatArray:
    """Mean of the extreme points."""
    return points[0] if len(points) == 1 else np.asarray(points.mean(axis=0))


def _least_eigenvalue(symmetric: FloatArray) -> float:
    """Least eigenvalue of a symmetric matrix of one or two rows."""
    if len(symmetric) == 1:
        return float(symmetric[0, 0])
    (a, b), (_, c) = symmetric.tolist()
    return float(0.5 * (a + c - math.hypot(a - c, 2.0 * b)))


def _tangents(normal: FloatArray, edges: FloatArray) -> FloatArray:
    """Orthonormal directions perpendicular to the normal and to the edge, if there is one, as rows."""
    if len(edges):
        return _unit(cross(normal, edges[0]))[None]
    first = _unit(cross(normal, _AXES[int(np.argmin(np.abs(normal)))]))
    return np.array((first, cross(normal, first)))


def _towards(vector: FloatArray, reference: FloatArray) -> FloatArray:
    """Unit vector along a vector or its opposite, whichever is closer to the reference."""
    return _unit(vector if vector @ reference > 0.0 else -vector)


def _unit(vector: FloatArray) -> FloatArray:
    return np.asarray(vector / math.hypot(*vector))


DISTANCE_LIMIT_M = 1e3
"""Limit of distance queries: larger distances are returned as this."""
_PASSES, _SAME_DIRECTION = 20, 1e-5
"""Passes of a shifted query, and the change of direction at which they end: refinement needs 1e-4 rad.

Each pass leaves shift / (shift + radius of curvature) of the error.
"""
_SHIFT_SHARE, _LARGEST_SHIFT_M = 0.2, 1e-2
"""Shift as a share of the size of the pair (half the thinnest extent), and its largest value."""
_LEAST_SHIFT_M = 1e-9
"""Least shift: witness points are known to about 1e-15 m, which leaves the direction accurate to 1e-6 rad."""


class ContactNormal(NamedTuple):
    """A normal with the features that it was found from.

    Attributes:
        normal: Unit normal from a to b, world axes, (3,).
        features: Extreme points of a along the normal and of b opposite to it, (m, 3) and (n, 3).
        witness: Point midway between the witness points of the query, (3,), m.
        gap: Separation along the normal, m.
    """

    normal: FloatArray
    features: tuple[FloatArray, FloatArray]
    witness: FloatArray
    gap: float


class NormalSearch(Stateful):
    """Distance queries of one pair of geoms; the last normal is the estimate for the next one."""

    @dataclass
    class State:
        """The last normal, (3,); None: there is no estimate."""

        last: FloatArray | None

    def __init__(self, geoms: tuple[int, int], size: float, flush: float = 0.0) -> None:
        """Start without an estimate.

        Args:
            geoms: Ids of geoms a and b.
            size: Half the thinnest extent of both, m.
            flush: Offset of sides that lie along each other; see :func:`~ffsm_mj.contact.patch.flush_offset`.
        """
        self._flush = flush
        self._a, self._b = geoms
        self._shift = min(_LARGEST_SHIFT_M, _SHIFT_SHARE * size)
        self._fromto = np.zeros(6)
        self._last: FloatArray | None = None

    def start_from(self, normal: FloatArray) -> None:
        """Take a normal, (3,), as the estimate for the next search."""
        self._last = normal

    def distance(self, model: Any, data: Any, limit: float) -> float:
        """Signed distance in m, negative when overlapping; ``limit`` if it is larger."""
        distance = float(mujoco.mj_geomDistance(model, data, self._a, self._b, limit, self._fromto))
        if 0.0 < distance < limit:
            # For faces in contact the query returns, in about one of a hundred poses, centimetres with coinciding witnesses.
            x, y, z, u, v, w = self._fromto.tolist()
            return min(distance, math.hypot(u - x, v - y, w - z))
        return distance

    def normal(self, model: Any, data: Any, shapes: tuple[Shape, Shape]) -> ContactNormal:
        """Contact normal at the state in ``data``.

        Args:
            model: MuJoCo model.
            data: Its data, kinematics current; moved and restored during the search.
            shapes: Both geoms at this state.
        """
        estimate, witness = self._shifted_query(model, data, self._estimate(model, data), self._shift)
        normal, known = _refined(*shapes, estimate)
        features = known or facing(*shapes, normal)
        if not known and not opposite(*features, normal, self._flush):
            # The extreme features do not overlap across the direction, so it is no normal: corners are too close.
            normal, witness = self._nearer_queries(model, data, shapes, (normal, witness))
            features = facing(*shapes, normal)
        self._last = normal
        return ContactNormal(normal, features, witness, separation(*shapes, normal))

    def _nearer_queries(
        self, model: Any, data: Any, shapes: tuple[Shape, Shape], better: tuple[FloatArray, FloatArray]
    ) -> tuple[FloatArray, FloatArray]:
        """Normal and witness from queries at smaller and smaller shifts, for corners very close to each other.

        Each pass of a query turns the direction by at most the offset of the corners across it, over the shift. A smaller
        shift turns it far enough to reach the faces and edges that meet at the corners. Of all directions the contact normal
        has the largest separation, so only directions that increase it are kept.
        """
        (best, witness), shift = better, self._shift
        while shift > _LEAST_SHIFT_M and not is_normal(*shapes, best):
            shift *= 0.1
            direction, between = self._shifted_query(model, data, best, shift)
            normal = refine_normal(*shapes, direction)
            if separation(*shapes, normal) > separation(*shapes, best):
                best, witness = normal, between
        return best, witness

    def _shifted_query(self, model: Any, data: Any, normal: FloatArray, shift: float) -> tuple[FloatArray, FloatArray]:
        """Normal, and the midpoint of the witness points, from queries with b moved away from a, first along an estimate."""
        centre = data.geom_xpos[self._b].copy()
        try:
            for _ in range(_PASSES):
                data.geom_xpos[self._b] = centre + shift * normal
                distance = mujoco.mj_geomDistance(model, data, self._a, self._b, DISTANCE_LIMIT_M, self._fromto)
                if distance <= 0.0:  # the overlap is deeper than the shift: move further out
                    shift *= 4.0
                    continue
                before, normal = normal, _direction(self._fromto)
                if math.dist(before, normal) < _SAME_DIRECTION:
                    break
        finally:
            data.geom_xpos[self._b] = centre
        return normal, 0.5 * (self._fromto[:3] + self._fromto[3:] - shift * normal)

    def _estimate(self, model: Any, data: Any) -> FloatArray:
        """First estimate of the normal: the witness points if clearly apart, else the last normal, else the centres."""
        if self.distance(model, data, DISTANCE_LIMIT_M) > CLEARLY_APART_M:
            return _direction(self._fromto)
        if self._last is not None:
            return self._last
        direction = data.geom_xpos[self._b] - data.geom_xpos[self._a]
        length = float(np.linalg.norm(direction))
        return np.asarray(direction / length) if length > 0.0 else np.array([1.0, 0.0, 0.0])


def _direction(fromto: FloatArray) -> FloatArray:
    """Unit vector between two witness points; not divided by the returned distance, which is less accurate."""
    difference = fromto[3:] - fromto[:3]
    return np.asarray(difference / np.linalg.norm(difference))


class HalfSpaceNormal(NormalSearch):
    """Gap and normal of a pair of which one geom is a plane, in closed form; nothing is searched, and no estimate is kept.

    MuJoCo gives planes to fixed bodies only, and the size of a plane is that of its picture: it bounds a half-space. The
    normal is its z axis, from a or towards it, whatever the other geom does, and the gap is the height of the lowest point
    of that one, be it a part of a geom.
    """

    def __init__(
        self, geoms: tuple[int, int], size: float, flush: float = 0.0, parts: tuple[Part | None, Part | None] = (None, None)
    ) -> None:
        """Take both geoms, or parts of them."""
        super().__init__(geoms, size, flush)
        self._parts = parts

    def distance(self, model: Any, data: Any, limit: float) -> float:
        """Signed distance in m, negative when overlapping; ``limit`` if it is larger."""
        one, other = self._parts
        shapes = Shape(model, data, self._a, one), Shape(model, data, self._b, other)
        return min(separation(*shapes, _of_plane(shapes)), limit)

    def normal(self, model: Any, data: Any, shapes: tuple[Shape, Shape]) -> ContactNormal:  # noqa: ARG002
        """Contact normal at the state of both geoms; see :meth:`NormalSearch.normal`."""
        normal = _of_plane(shapes)
        features = facing(*shapes, normal)
        middle = 0.5 * (features[0].mean(axis=0) + features[1].mean(axis=0))
        return ContactNormal(normal, features, middle, separation(*shapes, normal))


class SphereNormal(NormalSearch):
    """Gap and normal of a sphere and a sphere, capsule, cylinder or box, in closed form; see :meth:`Shape.nearest`.

    Nothing is searched, and no estimate is kept.
    """

    def normal(self, model: Any, data: Any, shapes: tuple[Shape, Shape]) -> ContactNormal:  # noqa: ARG002
        """Contact normal at the state of both geoms; see :meth:`NormalSearch.normal`."""
        first, second = (shape.ball for shape in shapes)
        ball, other = (first, shapes[1]) if first else (second, shapes[0])
        assert ball
        (centre, radius), (outward, height) = ball, other.nearest(ball[0])
        points = (centre - radius * outward)[None], (centre - height * outward)[None]
        gap, middle = height - radius, 0.5 * (points[0] + points[1])[0]
        return ContactNormal(-outward, points, middle, gap) if first else ContactNormal(outward, points[::-1], middle, gap)


def _of_plane(shapes: tuple[Shape, Shape]) -> FloatArray:
    """Unit normal of a pair of a plane and a geom, from a to b, world axes, (3,)."""
    a, b = shapes
    return np.array(a.axis) if a.is_plane else -b.axis
