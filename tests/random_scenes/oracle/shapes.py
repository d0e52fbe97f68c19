"""Convex shapes by their support functions, and bounds on the distance of two of them."""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

Array = np.ndarray


class Shape:
    """A geom at its place.

    Args:
        kind: MuJoCo's type.
        size: Its size, or vertices of a mesh, (n, 3).
        at: Position.
        frame: Rotation to world axes.
    """

    def __init__(self, kind: str, size: Array, at: Array, frame: Array) -> None:
        self.kind, self.size, self.at, self.frame = kind, size, at, frame

    def support(self, direction: Array) -> Array:
        """The point farthest along a direction."""
        if self.kind == "cone":
            return self.at  # planes that touch it across one of its normals pass through its apex
        d = self.frame.T @ direction
        return self.at + self.frame @ self._support(d / np.linalg.norm(d))

    def _support(self, d: Array) -> Array:
        size = self.size
        if self.kind == "sphere":
            return size[0] * d
        if self.kind == "capsule":
            return size[0] * d + [0.0, 0.0, np.sign(d[2]) * size[1]]
        if self.kind == "box":
            return np.where(d >= 0.0, size, -size)
        if self.kind == "ellipsoid":
            return size**2 * d / np.linalg.norm(size * d)
        if self.kind == "cylinder":
            across = np.hypot(d[0], d[1])
            rim = size[0] * d[:2] / across if across > 0.0 else np.zeros(2)
            return np.array([*rim, np.sign(d[2]) * size[1]])
        return size[np.argmax(size @ d)]

    @property
    def reach(self) -> float:
        """A length that bounds it, for roundings."""
        return float(np.abs(self.size).max())


UNKNOWN = ("solid", "hfield")
"""Kinds of shapes that are not convex and of which only the program knows the pieces."""


def gap_along(a: Shape, b: Shape, normal: Array) -> float:
    """Width of the slab between two shapes across a normal from a to b: never more than their distance."""
    return float(normal @ (b.support(-normal) - a.support(normal)))


def distance_bounds(a: Shape, b: Shape, tolerance: float = 1e-7, most: int = 40) -> tuple[float, float]:
    """Lower and upper bound of the distance of two shapes; the lower one is not above 0 if they overlap.

    Frank-Wolfe with full correction (Wolfe's minimum-norm point): the nearest point of the hull of supports so far is above
    the distance, the slab across the direction to it below.
    """
    points = [b.support(np.array([1.0, 0.0, 0.0])) - a.support(np.array([-1.0, 0.0, 0.0]))]
    lower, upper = -np.inf, np.inf
    for _ in range(most):
        stack = np.array(points)
        # The least norm of a convex combination: non-negative weights whose sum is one, by a heavy row.
        weight = 1e3 * (1.0 + np.abs(stack).max())
        weights, _ = nnls(np.vstack([stack.T, np.full(len(stack), weight)]), np.array([0.0, 0.0, 0.0, weight]))
        keep = weights > 0.0
        nearest = weights[keep] @ stack[keep] / weights.sum()
        upper = min(upper, float(np.linalg.norm(nearest)))
        if upper < 1e-12:
            return min(lower, 0.0), upper
        normal = nearest / np.linalg.norm(nearest)
        lower = max(lower, gap_along(a, b, normal))
        if upper - lower < tolerance:
            break
        points = [*stack[keep], b.support(-normal) - a.support(normal)]
    return lower, upper
