"""Boxes around the pieces of a solid, and around blocks of them: which pieces are near a place or another solid.

A tree of three levels: the box of the solid, blocks of neighbouring pieces, and pieces. Its lower levels are compared as
whole arrays, for which numpy takes less time than a descent node by node through a deeper tree: 640 pieces are 40 blocks.
"""

from __future__ import annotations

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
        # Greatest coordinates with the opposite sign: what is left of a gap is one sum for each side.
        self._boxes = np.concatenate((bounds[self._ids, 0], -bounds[self._ids, 1]), axis=1)
        self._blocks = np.minimum.reduceat(self._boxes, np.arange(0, len(bounds), _BLOCK))

    def near(self, lower: FloatArray, upper: FloatArray, reach: float) -> IntArray:
        """Ids of the boxes that are no farther than a reach from a box, both in the axes of this solid, ascending, (k,)."""
        opposite, squared = np.concatenate((-upper, lower)), reach * reach
        blocks = np.flatnonzero(_squared_gaps(self._blocks, opposite) <= squared)
        members, _ = _expanded(blocks, blocks, len(self._ids))
        return np.sort(self._ids[members[_squared_gaps(self._boxes[members], opposite) <= squared]])

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
        squared, turn, shift = reach * reach, *_turn(rotation, position)
        blocks = other._blocks @ turn + shift
        ours, theirs = np.nonzero(_squared_gaps(self._blocks[:, None], blocks) <= squared)
        # Of a pair of blocks first the boxes of one that are near the other block: few are near the seam of both.
        ours, theirs = _expanded(ours, theirs, len(self._ids))
        near = _squared_gaps(self._boxes[ours], blocks[theirs]) <= squared
        theirs, ours = _expanded(theirs[near], ours[near], len(other._ids))
        near = _squared_gaps(self._boxes[ours], other._boxes[theirs] @ turn + shift) <= squared
        pairs = np.stack((self._ids[ours[near]], other._ids[theirs[near]]), axis=1)
        return np.asarray(pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))])


def _turn(rotation: FloatArray, position: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Matrix, (6, 6), and offset, (6,), of boxes along other axes around given ones, opposite to them.

    Boxes (least, -greatest coordinates) become (-greatest, least). Of the coordinates along an axis, those that a positive
    number of the matrix multiplies stay on their side, and the others change it.
    """
    sizes, matrix = np.abs(rotation.T), np.empty((6, 6))  # filled by parts: np.block takes as long as a query
    matrix[:3, 3:] = matrix[3:, :3] = 0.5 * (sizes + rotation.T)
    matrix[:3, :3] = matrix[3:, 3:] = 0.5 * (sizes - rotation.T)
    return matrix, np.concatenate((-position, position))


def _squared_gaps(boxes: FloatArray, opposite: FloatArray) -> FloatArray:
    """Squared distances of boxes (least, -greatest) from others that are given as (-greatest, least), m2."""
    gaps = boxes + opposite
    np.maximum(gaps, 0.0, out=gaps)  # of two opposite sides one at most is beyond the other box
    return np.asarray(np.einsum("...i,...i->...", gaps, gaps))


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
