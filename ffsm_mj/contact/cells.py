"""Cells: which normals a contact may have at one point of two unions of convex pieces.

At a point x each piece has the tangent cone of its active faces. Two pieces that touch at x can part along the separating
normals, the cone of n with n in the normal cone of the piece of a and -n in that of the piece of b; S are its extreme rays.
A motion w of b relative to a overlaps a pair of pieces only if n . w < 0 for all n in S. So w is free of overlap if

    for every pair of pieces that touch at x, some n in S has n . w >= 0.

Expanded into a disjunction, each term is a cell: a set of normals that all must not approach. A term that another one
contains is no cell of its own, and with it the normals of covered faces vanish: over the seam of two coplanar boxes the
pairs say {z} and {z or x}, and the only cell is {z}. In a concave corner both normals are in one cell.

Reference: M. Anitescu and F. Potra state the frictional problem for convex pairs only; the polar of a union is the
intersection of the polars (Rockafellar, *Convex Analysis*, sec. 16).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations, product

import numpy as np

from ffsm_mj.arrays import FloatArray

_Ray = Sequence[float]
"""A vector of three numbers: of few, lists are faster than arrays."""
_SAME = 1e-9
"""Unit vectors that differ by less are one; residual below which a unit vector is in a cone. Normals are known to 1e-10."""
_SLIM = 1e-6
"""Rays whose plane or volume is less than this leave it to a solver whether a vector is between them."""
_MOST_TERMS = 256
"""Terms of a disjunction that are expanded; two pieces meet at a point in a handful."""


def nnls(columns: FloatArray, target: FloatArray) -> tuple[FloatArray, float]:
    """Non-negative shares of columns that come nearest to a target, and what is left of it."""
    from scipy.optimize import nnls as solve  # takes long to import: only contacts of unions pay

    shares, left = solve(columns, target)
    return shares, float(left)


def in_cone(rays: FloatArray, vector: FloatArray, tolerance: float = _SAME) -> bool:
    """Whether a unit vector is a combination of some unit rays, (k, 3), with no negative share, within a tolerance."""
    return _inside(rays.tolist(), vector.tolist(), tolerance)


def _inside(rows: Sequence[_Ray], v: _Ray, tolerance: float = _SAME) -> bool:
    """The same of lists: plain numbers decide most cases, and SciPy's solver takes several times as long as all of them."""
    if any(math.dist(row, v) <= tolerance for row in rows):
        return True
    if len(rows) < 2:
        return False
    if len(rows) == 2:
        n = _cross(*rows)
        size = math.hypot(*n)
        if size > _SLIM:
            beyond = min(_dot(_cross(rows[0], v), n), _dot(_cross(v, rows[1]), n))
            return abs(_dot(n, v)) <= tolerance * size and beyond >= 0.0
    elif len(rows) == 3:
        sides = [_cross(rows[k - 2], rows[k - 1]) for k in range(3)]
        volume = _dot(rows[0], sides[0])
        if abs(volume) > _SLIM:
            sense = math.copysign(1.0, volume)
            inside = min(sense * _dot(side, v) / math.hypot(*side) for side in sides)
            if inside >= 0.0 or inside < -tolerance:
                return inside >= 0.0
    return nnls(np.array(rows).T, np.array(v))[1] <= tolerance


def _cross(a: _Ray, b: _Ray) -> _Ray:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _dot(a: _Ray, b: _Ray) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def separating_normals(normals_a: FloatArray, normals_b: FloatArray) -> FloatArray:
    """Extreme rays of the cone of normals along which two pieces part, (k, 3); empty if they overlap.

    Args:
        normals_a: Outward normals of the faces of the piece of a that meet at the point, (m, 3).
        normals_b: The same of b, (n, 3).
    """
    return intersection(normals_a, -normals_b)


def intersection(first: FloatArray, second: FloatArray) -> FloatArray:
    """Extreme rays of the intersection of two cones that are given by rays, (m, 3) and (n, 3)."""
    if len(first) == len(second) == 1:
        return first if np.linalg.norm(first[0] - second[0]) <= _SAME else np.empty((0, 3))
    ones, others = first.tolist(), second.tolist()
    rays: list[_Ray] = [ray for ray in ones if _inside(others, ray)] + [ray for ray in others if _inside(ones, ray)]
    # Where faces of both cones cross: along the line that two of their planes share.
    for (a, b), (c, d) in product(combinations(ones, 2), combinations(others, 2)):
        x, y, z = _cross(_cross(a, b), _cross(c, d))
        length = math.hypot(x, y, z)
        if length > _SAME:
            for share in (1.0 / length, -1.0 / length):
                ray = x * share, y * share, z * share
                if not any(_is_same(ray, known) for known in rays) and _inside(ones, ray) and _inside(others, ray):
                    rays.append(ray)
    return _extreme(rays)


def _is_same(one: _Ray, other: _Ray) -> bool:
    return math.dist(one, other) <= _SAME


def _extreme(rays: Sequence[_Ray]) -> FloatArray:
    """Those of some rays that are not combinations of the others, in an order that depends on them alone, (k, 3)."""
    distinct: list[_Ray] = []
    for ray in rays:
        if not any(_is_same(ray, other) for other in distinct):
            distinct.append(ray)
    kept = list(distinct)
    for ray in distinct:
        others = [other for other in kept if other is not ray]
        if others and _inside(others, ray):
            kept = others
    return np.array(sorted(kept, key=_order)).reshape(-1, 3)


def _order(ray: _Ray) -> tuple[float, ...]:
    """Sort key of a ray, in which rounding does not decide."""
    return tuple(round(value, 6) for value in ray)


def nearest_in_cone(rays: FloatArray, vector: FloatArray) -> FloatArray:
    """The unit vector of a cone that is nearest to a unit vector, (3,)."""
    shares, _ = nnls(rays.T, vector)
    along = rays.T @ shares
    length = float(np.linalg.norm(along))
    return np.asarray(along / length) if length > 0.0 else rays[0]


def cells(clauses: Sequence[FloatArray]) -> list[FloatArray]:
    """Cells of the conjunction of some clauses.

    Args:
        clauses: Separating normals of each pair of pieces that touch at the point, (k, 3) each, none empty.

    Returns:
        Sets of normals, (k, 3) each, sorted; no cell contains another one.
    """
    terms: list[FloatArray] = [np.empty((0, 3))]
    distinct: list[FloatArray] = []
    for clause in sorted(clauses, key=len):
        # Coplanar pieces say the same, and a clause that is fulfilled by a normal of each term adds nothing.
        if any(len(clause) == len(other) and all(map(_is_same, clause.tolist(), other.tolist())) for other in distinct):
            continue
        distinct.append(clause)
        if len(terms) == 1 and len(terms[0]) == 1 and any(_is_same(terms[0][0].tolist(), ray) for ray in clause.tolist()):
            continue
        wider = [_extreme([*term.tolist(), ray]) for term in terms for ray in clause.tolist()]
        terms = _absorbed(term for term in wider if _is_solid(term))[:_MOST_TERMS]
    return terms


def _absorbed(terms: object) -> list[FloatArray]:
    """Terms without those that another one contains."""
    kept: list[FloatArray] = []
    for term in sorted(terms, key=lambda rays: (len(rays), *map(_order, rays.tolist()))):  # type: ignore[call-overload]
        # The motions of a term are those of another one if each normal of that one follows from its own.
        if not any(all(in_cone(term, ray) for ray in other) for other in kept):
            kept = [other for other in kept if not all(in_cone(other, ray) for ray in term)]
            kept.append(term)
    return kept


def _is_solid(term: FloatArray) -> bool:
    """Whether some motion opens all normals of a term at once: opposite normals leave a plane of motions, no cell."""
    if len(term) == 1:
        return True
    # 0 is in the convex hull of the normals if and only if no motion opens all: the least norm of means is its distance.
    weighted = np.vstack((term.T, np.ones(len(term))))
    shares, _ = nnls(weighted, np.array((0.0, 0.0, 0.0, 1.0)))
    total = float(shares.sum())
    return total <= 0.0 or float(np.linalg.norm(term.T @ shares)) > _SAME * total


def chosen_cell(every: Sequence[FloatArray], motions: FloatArray, tolerance: float, preferred: FloatArray) -> FloatArray:
    """The cell that the motions at some points are in, or the nearest one, (k, 3).

    Args:
        every: Cells, the same at all points; without any, no normal is chosen.
        motions: Velocities of b relative to a at the points, m/s, (points, 3).
        tolerance: Approach within this is none, m/s.
        preferred: Of several cells that the motions are in, as those at rest are in all, that with this normal counts.
    """
    if not every or not len(every[0]):
        return np.empty((0, 3))
    free = [cell for cell in every if (motions @ cell.T >= -tolerance).all()]
    if free:
        return min(free, key=lambda cell: float(np.linalg.norm(cell - preferred, axis=1).min()))
    if (between := _parting_all(every, motions, tolerance)) is not None:
        return between
    return min(every, key=lambda cell: max(_distance(cell, motion) for motion in motions))


def _parting_all(every: Sequence[FloatArray], motions: FloatArray, tolerance: float) -> FloatArray | None:
    """A normal between those of two cells that no point approaches along, (1, 3); None without one.

    An edge that turns on another one opens at one end along the normal of one face and at the other end along that of the
    other face: a normal between parts them all along. Of two points the least rate is greatest where both are equal.
    """
    if any(len(cell) > 1 for cell in every):
        return None
    for (one, other), (p, q) in product(combinations(np.concatenate(every), 2), combinations(motions, 2)):
        across = float((one - other) @ (p - q))
        share = float(other @ (q - p)) / across if across else 0.0
        if 0.0 < share < 1.0:
            normal = share * one + (1.0 - share) * other
            normal /= np.linalg.norm(normal)
            if (motions @ normal >= -tolerance).all():
                return np.asarray(normal[None])
    return None


def _distance(cell: FloatArray, motion: FloatArray) -> float:
    """Distance of a motion from the motions of a cell, m/s: the length of the part that its normals must take away."""
    # By Moreau's decomposition it is the length of the projection of -w on the cone of the normals.
    shares, _ = nnls(cell.T, -motion)
    return float(np.linalg.norm(cell.T @ shares))
