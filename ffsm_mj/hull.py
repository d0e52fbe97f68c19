"""The convex hull of points in the plane."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ffsm_mj.arrays import FloatArray

Point = Sequence[float] | FloatArray


def hull(points: FloatArray, *, merge: float = 0.0, straight: float = 0.0) -> FloatArray:
    """Corners of the convex hull, counter-clockwise; one or two where the points are a point or a segment.

    Andrew's monotone chain.

    Args:
        points: (n, 2), n > 0.
        merge: Points no farther apart than this (sum of both distances along the axes) are one.
        straight: A corner that turns by no more than this area over the square of the points' extent is none.
    """
    distinct: list[tuple[float, ...]] = sorted(set(map(tuple, points.tolist())))
    if merge > 0.0:
        distinct = _merged(distinct, merge)
    if len(distinct) < 3:
        return np.array(distinct)
    span = float(np.max(np.ptp(distinct, axis=0)))
    least = straight * span * span
    chain: list[tuple[float, ...]] = []
    for half in (distinct, distinct[::-1]):
        start = len(chain)
        for p in half:
            while len(chain) - start >= 2 and turn(chain[-2], chain[-1], p) <= least:
                chain.pop()
            chain.append(p)
        chain.pop()
    return np.array(chain)


def turn(o: Point, a: Point, b: Point) -> float:
    """Twice the area of the triangle o, a, b: positive where the way from o by a to b turns left."""
    return float((a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]))


def _merged(ordered: Sequence[tuple[float, ...]], reach: float) -> list[tuple[float, ...]]:
    """The first of each cluster."""
    kept: list[tuple[float, ...]] = []
    for p in ordered:
        if all(abs(p[0] - q[0]) + abs(p[1] - q[1]) > reach for q in kept):
            kept.append(p)
    return kept
