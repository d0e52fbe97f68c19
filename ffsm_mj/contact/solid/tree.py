"""Boxes around the pieces of a solid, and around blocks of them: which pieces are near a place or another solid.

A tree of three levels: the box of the solid, blocks of neighbouring pieces, and pieces. Its lower levels are compared as
whole arrays, for which numpy takes less time than a descent node by node through a deeper tree: 640 pieces are 40 blocks.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from heapq import heapify, heappop

import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray

_BLOCK = 16
"""Pieces in a block: near the square root of what solids have, so that both levels cost about the same."""


class BoxTree:
    """Boxes along the axes of a solid.

    Attributes:
        bounds: Least and greatest coordinates of all boxes, (2, 3), m.
    """

    def __init__(self, bounds: FloatArray) -> None:
        """Sort boxes into blocks.

        Args:
            bounds: Least and greatest coordinates of the boxes, (n, 2, 3), n > 0, m.
        """
        self.bounds = np.stack((bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)))
        self._centre, self._half = self.bounds.mean(axis=0), 0.5 * (self.bounds[1] - self.bounds[0])
        self._radius = float(np.linalg.norm(self._half))
        self._ids = _sorted(bounds.mean(axis=1), np.arange(len(bounds)))
        lower, upper = bounds[self._ids].swapaxes(0, 1)
        self._boxes = _Boxes(np.ascontiguousarray(lower), np.ascontiguousarray(upper))
        starts = np.arange(0, len(bounds), _BLOCK)
        self._blocks = _Boxes(np.minimum.reduceat(lower, starts), np.maximum.reduceat(upper, starts))

    def near(self, lower: FloatArray, upper: FloatArray, reach: float) -> IntArray:
        """Ids of the boxes that are no farther than a reach from a box, both in the axes of this solid, ascending, (k,)."""
        box, squared = _Boxes(lower, upper), reach * reach
        blocks = np.flatnonzero(self._blocks.squared_distances(box) <= squared)
        members, _ = _expanded(blocks, blocks, len(self._ids))
        near = self._boxes.part(members).squared_distances(box) <= squared
        return np.sort(self._ids[members[near]])

    def pairs(self, other: BoxTree, rotation: FloatArray, position: FloatArray, reach: float) -> IntArray:
        """Pairs of a box of this tree and one of another that are no farther apart than a reach in m, (k, 2).

        The boxes of the other tree are turned, and replaced by their boxes along the axes of this solid.

        Args:
            other: Tree of the other solid.
            rotation: Matrix that turns vectors from the axes of the other solid into those of this one, (3, 3).
            position: Origin of the other solid in the axes of this one, (3,), m.
            reach: Farther pairs are left out, m.
        """
        # Of solids that are apart, as they nearly always are, the sphere around one is clear of the box of the other.
        outside = np.abs(rotation @ other._centre + position - self._centre) - self._half
        if float(np.linalg.norm(np.maximum(outside, 0.0))) > other._radius + reach:
            return np.empty((0, 2), dtype=np.intp)
        squared, blocks = reach * reach, other._blocks.turned(rotation, position)
        ours, theirs = np.nonzero(self._blocks.squared_gaps(blocks) <= squared)
        # Of a pair of blocks first the boxes of one that are near the other block: few are near the seam of both.
        ours, theirs = _expanded(ours, theirs, len(self._ids))
        near = self._boxes.part(ours).squared_distances(blocks.part(theirs)) <= squared
        theirs, ours = _expanded(theirs[near], ours[near], len(other._ids))
        turned = other._boxes.turned(rotation, position).part(theirs)
        near = self._boxes.part(ours).squared_distances(turned) <= squared
        pairs = np.stack((self._ids[ours[near]], other._ids[theirs[near]]), axis=1)
        return np.asarray(pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))])

    def nearest_first(
        self, other: BoxTree, rotation: FloatArray, position: FloatArray, limit: float
    ) -> Iterator[tuple[float, int, int]]:
        """Distances of the boxes of pairs in m, ascending, and the pairs, up to a limit in m; see :meth:`pairs`.

        No pair of pieces is nearer than its boxes: who seeks the nearest pieces stops at the first distance that exceeds
        theirs, before most blocks have been looked into.
        """
        blocks, boxes = (level.turned(rotation, position) for level in (other._blocks, other._boxes))
        squared = self._blocks.squared_gaps(blocks)
        near = np.flatnonzero(squared.ravel() <= limit * limit)
        order = near[np.argsort(squared.ravel()[near], kind="stable")].tolist()
        waiting: list[tuple[float, int, int]] = []
        for block in order:
            k, i = (slice(start * _BLOCK, (start + 1) * _BLOCK) for start in divmod(block, len(blocks)))
            least = float(squared.flat[block])
            while waiting and waiting[0][0] <= least:
                distance, one, two = heappop(waiting)
                yield math.sqrt(distance), one, two
            gaps = self._boxes.part(k).squared_gaps(boxes.part(i))
            ours, theirs = np.nonzero(gaps <= limit * limit)
            ids = self._ids[k][ours].tolist(), other._ids[i][theirs].tolist()
            waiting += zip(gaps[ours, theirs].tolist(), *ids, strict=True)
            heapify(waiting)
        yield from ((math.sqrt(distance), one, two) for distance, one, two in sorted(waiting))


class _Boxes:
    """Boxes as arrays of least and greatest coordinates, (n, 3)."""

    def __init__(self, lower: FloatArray, upper: FloatArray) -> None:
        self.lower, self.upper = lower, upper

    def __len__(self) -> int:
        return len(self.lower)

    def part(self, places: IntArray | slice) -> _Boxes:
        return _Boxes(self.lower[places], self.upper[places])

    def turned(self, rotation: FloatArray, position: FloatArray) -> _Boxes:
        """Boxes along other axes around these."""
        centre, half = 0.5 * (self.lower + self.upper) @ rotation.T + position, 0.5 * (self.upper - self.lower)
        half = half @ np.abs(rotation).T
        return _Boxes(centre - half, centre + half)

    def squared_gaps(self, other: _Boxes) -> FloatArray:
        """Squared distances of all boxes from all others, (n, m), m2."""
        gaps = np.maximum(self.lower[:, None] - other.upper, other.lower - self.upper[:, None])
        np.maximum(gaps, 0.0, out=gaps)
        return np.asarray(np.einsum("nmi,nmi->nm", gaps, gaps))

    def squared_distances(self, other: _Boxes) -> FloatArray:
        """Squared distances of boxes from their counterparts, or from one box, (n,), m2."""
        gaps = np.maximum(np.maximum(self.lower - other.upper, other.lower - self.upper), 0.0)
        return np.asarray(np.einsum("ni,ni->n", gaps, gaps))


def _sorted(centres: FloatArray, ids: IntArray) -> IntArray:
    """Ids of boxes in an order in which blocks of _BLOCK are neighbours: halved along the longest extent."""
    if len(ids) <= _BLOCK:
        return ids
    half = (len(ids) + _BLOCK) // (2 * _BLOCK) * _BLOCK
    axis = int(np.argmax(np.ptp(centres[ids], axis=0)))
    order = ids[np.argsort(centres[ids, axis], kind="stable")]
    return np.concatenate((_sorted(centres, order[:half]), _sorted(centres, order[half:])))


def _expanded(blocks: IntArray, partners: IntArray, count: int) -> tuple[IntArray, IntArray]:
    """Places of the boxes in blocks, and the partner of the block for each of them."""
    members = (blocks[:, None] * _BLOCK + np.arange(_BLOCK)).ravel()
    full = members < count
    return members[full], np.repeat(partners, _BLOCK)[full]
