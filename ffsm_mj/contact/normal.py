"""The contact normal to rounding: the direction along which two convex geoms are furthest apart.

A distance query knows the distance to 1e-12 but, because that is stationary, the direction only to its square root. The
separation along n is -h1(n) - h2(-n) with the geoms' support functions, which are closed forms; its maximum is found by
Newton's method on the sphere of directions. Edges and faces are kinks there: a direction square to an edge stays square to
it, two edges or a face leave no choice.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from itertools import combinations, product

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.manifold import facing, opposite
from ffsm_mj.contact.shape import Shape
from ffsm_mj.dynamics.rigid_body import cross
from ffsm_mj.tolerances import EPSILON

_WIDTH = 1e-4
"""The query's direction is good to about 1e-5 rad: edges and faces within this may be the ones that touch."""
_ROUNDING = 1e-15
_ITERATIONS = 20
_LONGEST_STEP = 0.1
_FLATTEST = 1e-9
# The smallest eigenvalue of a symmetric matrix is known to a few units of rounding of its largest: close to the axis of a
# cylinder a turn of the rim has a radius of 1e7 m and more, and what is left of the other one is noise, zero at times.
_EIGENVALUE_ROUNDING = 16.0 * EPSILON


def refine_normal(first: Shape, second: Shape, estimate: FloatArray) -> FloatArray:
    """Unit normal from the first geom to the second, from an estimate that is good to about 1e-4 rad.

    Which of the edges and faces near the estimate touch is not known beforehand: every choice of them gives a direction,
    and the separation along none is larger than that along the normal.
    """
    edges = np.vstack((first.edges(estimate, _WIDTH), second.edges(-estimate, _WIDTH)))
    best = _best(first, second, estimate, _choices(edges))
    if (first.position_tolerance or second.position_tolerance) and not is_normal(first, second, best):
        # Of a face of a mesh two directions that span it were asked; what touches at its side needs that very edge.
        finer = _best(first, second, best, _crossed(first.hull_edges(best, _WIDTH), second.hull_edges(-best, _WIDTH)))
        if separation(first, second, finer) >= separation(first, second, best) - _ROUNDING:
            best = finer
    return best


def is_normal(first: Shape, second: Shape, direction: FloatArray) -> bool:
    """Whether what is extreme along a direction in one geom lies opposite what is extreme against it in the other."""
    return opposite(*facing(first, second, direction), direction)


def _best(first: Shape, second: Shape, estimate: FloatArray, choices: Iterable[FloatArray]) -> FloatArray:
    """The direction of largest separation among those of some choices of edges, and an estimate."""
    best, largest = estimate, -np.inf
    # Where directions tie to rounding the one with more edges counts, and the estimate itself, which is less exact, last.
    for normal in (*(_maximise(first, second, estimate, fixed) for fixed in choices), estimate):
        value = separation(first, second, normal)
        if value > largest + _ROUNDING:
            best, largest = normal, value
    return best


def separation(first: Shape, second: Shape, normal: FloatArray) -> float:
    """Signed gap along a direction, m: the distance, or minus the depth, where the direction is the normal."""
    return float((second.extreme(-normal) @ normal).min() - (first.extreme(normal) @ normal).max())


def _choices(edges: FloatArray) -> Iterator[FloatArray]:
    """Sets of edge directions that the normal may have to be square to: two, one or none, (k, 3) each."""
    for one, other in combinations(edges, 2):
        if math.hypot(*cross(one, other)) > _WIDTH:
            yield np.stack((one, other))
    yield from edges[:, None]
    yield edges[:0]


def _crossed(of_first: FloatArray, of_second: FloatArray) -> Iterator[FloatArray]:
    """The same of one edge of each geom at most: two of one geom say no more than the face that they bound."""
    for one, other in product(of_first, of_second):
        if math.hypot(*cross(one, other)) > _WIDTH:
            yield np.stack((one, other))
    yield from np.vstack((of_first, of_second))[:, None]
    yield of_first[:0]


def _maximise(first: Shape, second: Shape, normal: FloatArray, edges: FloatArray) -> FloatArray:
    """Maximum of the separation among the directions square to the edges."""
    if len(edges) == 2:
        return _towards(cross(edges[0], edges[1]), normal)
    if len(edges) == 1:
        normal = _towards(normal - (normal @ edges[0]) * edges[0], normal)
    for _ in range(_ITERATIONS):
        tangents = _tangents(normal, edges)
        offset = _middle(second.extreme(-normal)) - _middle(first.extreme(normal))
        # The Hessian on the sphere: both geoms' radii, and the gap because a turned direction stays a unit vector.
        slope = tangents @ (first.radii(normal) + second.radii(-normal)) @ tangents.T
        slope += float(offset @ normal) * np.eye(len(slope))
        if _least_eigenvalue(slope) < max(_FLATTEST, _EIGENVALUE_ROUNDING * float(np.abs(slope).max())):
            break  # nothing is curved: the direction has no better neighbour
        step = np.linalg.solve(slope, tangents @ offset)
        length = math.hypot(*step)
        normal = _unit(normal + step @ tangents * min(1.0, _LONGEST_STEP / max(length, _LONGEST_STEP)))
        if length < 1e-15:
            break
    return normal


def _middle(points: FloatArray) -> FloatArray:
    return points[0] if len(points) == 1 else np.asarray(points.mean(axis=0))


def _least_eigenvalue(symmetric: FloatArray) -> float:
    """Of a matrix of one or two rows."""
    if len(symmetric) == 1:
        return float(symmetric[0, 0])
    (a, b), (_, c) = symmetric.tolist()
    return float(0.5 * (a + c - math.hypot(a - c, 2.0 * b)))


def _tangents(normal: FloatArray, edges: FloatArray) -> FloatArray:
    """Orthonormal directions across the normal and the edge, if there is one, as rows."""
    if len(edges):
        return _unit(cross(normal, edges[0]))[None]
    first = _unit(cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))]))
    return np.stack((first, cross(normal, first)))


def _towards(vector: FloatArray, reference: FloatArray) -> FloatArray:
    return _unit(vector if vector @ reference > 0.0 else -vector)


def _unit(vector: FloatArray) -> FloatArray:
    return np.asarray(vector / math.hypot(*vector))
