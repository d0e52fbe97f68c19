"""The contact normal to rounding: the direction along which two convex geoms are furthest apart.

A distance query knows the distance to 1e-12 but, because that is stationary, the direction only to its square root. The
separation along n is -h1(n) - h2(-n) with the geoms' support functions, which are closed forms; its maximum is found by
Newton's method on the sphere of directions. Edges and faces are kinks there: a direction square to an edge stays square to
it, two edges or a face leave no choice.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ffsm_mj.model import FloatArray

Feature = Callable[[FloatArray, float], FloatArray]
"""Extreme points along a direction, those within an angle of being extreme included: (direction, angle) -> (k, 3)."""

# The query's direction is good to about 1e-5 rad: features are sought that wide, and as it says; the better one counts.
_WIDTHS = (1e-4, 1e-7)
_ROUNDING = 1e-13
_ITERATIONS = 8
_DIFFERENCE = 1e-5
_LONGEST_STEP = 0.1


def polished(first: Feature, second: Feature, estimate: FloatArray) -> FloatArray:
    """Unit normal from the first geom to the second, from an estimate that is good to about 1e-4 rad."""
    best = _maximise(first, second, estimate, _WIDTHS[-1])
    largest = separation(first, second, best)
    for normal in (_maximise(first, second, estimate, _WIDTHS[0]), estimate):
        value = separation(first, second, normal)
        if value > largest + _ROUNDING:
            best, largest = normal, value
    return best


def separation(first: Feature, second: Feature, normal: FloatArray) -> float:
    """Signed gap along a direction, m: the distance, or minus the depth, where the direction is the normal."""
    return float((second(-normal, 0.0) @ normal).min() - (first(normal, 0.0) @ normal).max())


def _maximise(first: Feature, second: Feature, normal: FloatArray, width: float) -> FloatArray:
    """Maximum of the separation, with the edges and faces that are extreme within ``width`` at the start kept so."""
    edges = _directions(first(normal, width), second(-normal, width))
    if len(edges) >= 2:
        return _towards(np.cross(edges[0], edges[1]), normal)
    if len(edges) == 1:
        normal = _towards(normal - (normal @ edges[0]) * edges[0], normal)
    for _ in range(_ITERATIONS):
        tangents = _tangents(normal, edges)
        residual = _offset(first, second, normal, width) @ tangents
        slope = np.stack(
            [
                (_offset(first, second, _unit(normal + _DIFFERENCE * t), width) @ tangents - residual) / _DIFFERENCE
                for t in tangents.T
            ],
            axis=1,
        )
        if abs(np.linalg.det(slope)) < 1e-12:
            break  # nothing is curved: the direction has no better neighbour
        step = np.linalg.solve(slope, -residual)
        length = float(np.linalg.norm(step))
        normal = _unit(normal + tangents @ step * min(1.0, _LONGEST_STEP / max(length, _LONGEST_STEP)))
        if length < 1e-15:
            break
    return normal


def _offset(first: Feature, second: Feature, normal: FloatArray, width: float) -> FloatArray:
    """From the extreme feature of the first geom to that of the second; along the normal where the direction is right."""
    return np.asarray(second(-normal, width).mean(axis=0) - first(normal, width).mean(axis=0))


def _directions(*features: FloatArray) -> FloatArray:
    """Orthonormal directions within the features: none for points, one for an edge, two or three for more."""
    spans = [points - points[0] for points in features if len(points) > 1]
    if not spans:
        return np.empty((0, 3))
    spread = np.vstack([span / np.abs(span).max() for span in spans])
    _, sizes, axes = np.linalg.svd(spread, full_matrices=False)
    return np.asarray(axes[sizes > 1e-3])


def _tangents(normal: FloatArray, edges: FloatArray) -> FloatArray:
    """Orthonormal directions across the normal and all edges, as columns."""
    fixed = np.vstack((normal, edges))
    return np.asarray(np.linalg.svd(fixed)[2][len(fixed) :].T)


def _towards(vector: FloatArray, reference: FloatArray) -> FloatArray:
    return _unit(vector if vector @ reference > 0.0 else -vector)


def _unit(vector: FloatArray) -> FloatArray:
    return np.asarray(vector / np.linalg.norm(vector))
