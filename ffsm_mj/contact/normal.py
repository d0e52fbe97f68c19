"""Refinement of a contact normal to rounding: the direction of largest separation of two convex geoms.

The distance of a query is accurate to 1e-9 of the size or better, and stationary in the direction, which is known to the
square root only. The separation along n is -h1(n) - h2(-n) with the support functions of the geoms, which are closed forms;
its maximum is found by Newton's method on the sphere of directions. Edges and faces are kinks of the separation: a normal
perpendicular to an edge stays perpendicular to it, and two edges or a face determine the normal.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from itertools import combinations, product

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.manifold import facing, flush_offset, opposite, segments_lie_along
from ffsm_mj.contact.shape import Shape
from ffsm_mj.dynamics.rigid_body import cross
from ffsm_mj.tolerances import CONTACT_GAP_M, EPSILON, FLUSH_M, PARALLEL

_WIDTH = 1e-4
"""An estimate is accurate to about 1e-5 rad: edges and faces within this angle may be those in contact."""
_ROUNDING = 1e-15
"""Rounding of a separation in m and of a direction in rad: directions whose separations differ by less tie."""
_ITERATIONS = 20
_LONGEST_STEP = 0.1
"""Longest Newton step, rad."""
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
    edges = _edges(first, second, estimate, _WIDTH)
    exact = not first.position_tolerance and not second.position_tolerance
    if exact and (found := _between_edges(first, second, estimate, edges)) is not None:
        return _between_sides(first, second, found)
    best = _best_direction(first, second, estimate, _choices(edges))
    if exact:
        return _between_sides(first, second, best)
    # Facets of a fine mesh differ by less than the width, and which of them were tried depends on the estimate.
    best = _best_direction(first, second, best, _choices(_edges(first, second, best, PARALLEL)))
    if not is_normal(first, second, best):
        # For a face of a mesh only two directions that span it were tried; contact at one of its sides needs that edge.
        finer = _best_direction(
            first, second, best, _crossed_choices(first.hull_edges(best, _WIDTH), second.hull_edges(-best, _WIDTH))
        )
        if separation(first, second, finer) >= separation(first, second, best) - _ROUNDING:
            best = finer
    return _between_sides(first, second, best)


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


def _between_edges(first: Shape, second: Shape, estimate: FloatArray, edges: FloatArray) -> FloatArray | None:
    """The normal of a face or of two edges, if it is the one of contact; None if other directions must be tried.

    Of bodies that do not overlap, no direction has a larger separation than one along which their features face each other.
    """
    pairs = list(_pairs(edges))
    if not pairs:
        return None
    best = _best_direction(first, second, estimate, pairs)
    if best is estimate or separation(first, second, best) < -CONTACT_GAP_M:
        return None
    return best if is_normal(first, second, best) else None


def _edges(first: Shape, second: Shape, normal: FloatArray, width: float) -> FloatArray:
    """Directions of edges of both geoms within ``width`` rad of perpendicular to a normal, (k, 3)."""
    return np.vstack((first.edges(normal, width), second.edges(-normal, width)))


def is_normal(first: Shape, second: Shape, direction: FloatArray) -> bool:
    """Whether the extreme features of both geoms along a direction overlap in projection, as along the contact normal."""
    flush = flush_offset(first.side_radius + second.side_radius)
    return opposite(*facing(first, second, direction), direction, flush)


def _best_direction(first: Shape, second: Shape, estimate: FloatArray, choices: Iterable[FloatArray]) -> FloatArray:
    """The direction of largest separation among those of some choices of edges and the estimate."""
    best, largest = estimate, -np.inf
    # If directions tie to rounding, the one with more edges wins; the estimate, which is less accurate, is last.
    for normal in (*(_maximise(first, second, estimate, fixed) for fixed in choices), estimate):
        value = separation(first, second, normal)
        if value > largest + _ROUNDING:
            best, largest = normal, value
    return best


def separation(first: Shape, second: Shape, normal: FloatArray) -> float:
    """Separation along a direction, m: the signed gap if the direction is the normal."""
    return float((second.extreme(-normal) @ normal).min() - (first.extreme(normal) @ normal).max())


def _choices(edges: FloatArray) -> Iterator[FloatArray]:
    """Sets of edge directions that the normal may be perpendicular to: two, one or none, (k, 3) each."""
    yield from _pairs(edges)
    yield from edges[:, None]
    yield edges[:0]


def _pairs(edges: FloatArray) -> Iterator[FloatArray]:
    """Pairs of edge directions that determine a normal, (2, 3) each."""
    for one, other in combinations(edges, 2):
        if math.hypot(*cross(one, other)) > PARALLEL:
            yield np.stack((one, other))


def _crossed_choices(of_first: FloatArray, of_second: FloatArray) -> Iterator[FloatArray]:
    """The same with at most one edge of each geom: two edges of one geom give no more than the face that they bound."""
    for one, other in product(of_first, of_second):
        if math.hypot(*cross(one, other)) > _WIDTH:
            yield np.stack((one, other))
    yield from np.vstack((of_first, of_second))[:, None]
    yield of_first[:0]


def _maximise(first: Shape, second: Shape, normal: FloatArray, edges: FloatArray) -> FloatArray:
    """Direction of largest separation among those perpendicular to the edges."""
    if len(edges) == 2:
        return _towards(cross(edges[0], edges[1]), normal)
    if len(edges) == 1:
        normal = _towards(normal - (normal @ edges[0]) * edges[0], normal)
    for _ in range(_ITERATIONS):
        tangents = _tangents(normal, edges)
        offset = _mean(second.extreme(-normal)) - _mean(first.extreme(normal))
        # Hessian on the sphere: radii of both geoms, and the gap, because a turned direction stays a unit vector.
        slope = tangents @ (first.radii(normal) + second.radii(-normal)) @ tangents.T
        slope += float(offset @ normal) * np.eye(len(slope))
        if _least_eigenvalue(slope) < max(_FLATTEST, _EIGENVALUE_ROUNDING * float(np.abs(slope).max())):
            break  # nothing is curved: the direction cannot be improved
        step = np.linalg.solve(slope, tangents @ offset)
        length = math.hypot(*step)
        normal = _unit(normal + step @ tangents * min(1.0, _LONGEST_STEP / max(length, _LONGEST_STEP)))
        if length < _ROUNDING:
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
    first = _unit(cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))]))
    return np.stack((first, cross(normal, first)))


def _towards(vector: FloatArray, reference: FloatArray) -> FloatArray:
    """Unit vector along a vector or its opposite, whichever is closer to the reference."""
    return _unit(vector if vector @ reference > 0.0 else -vector)


def _unit(vector: FloatArray) -> FloatArray:
    return np.asarray(vector / math.hypot(*vector))
