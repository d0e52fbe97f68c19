# cython: boundscheck=False, wraparound=False, cdivision=True
"""Boxes around the pieces of a solid, and around blocks of them: which pieces are near a place or another solid."""

import numpy as np


cdef enum:
    BLOCK = 16  # pieces: near the square root of what solids have, so that both levels cost about the same


cdef double squared_gap(const double* box, const double* opposite) noexcept nogil:
    """Squared distance of a box (least, -greatest) from another that is given as (-greatest, least), m2."""
    cdef double gap, total = 0.0
    cdef int i
    for i in range(6):
        gap = max(box[i] + opposite[i], 0.0)  # of two opposite sides one at most is beyond the other box
        total += gap * gap
    return total


cdef class BoxTree:
    """Boxes along the axes of a solid, in three levels: that of the solid, blocks of neighbouring pieces, and pieces.

    Attributes:
        bounds: Least and greatest coordinates of all boxes, (2, 3), m.
    """

    cdef readonly object bounds
    cdef double[:, ::1] boxes, blocks  # greatest coordinates with the opposite sign
    cdef const Py_ssize_t[::1] ids

    def __init__(self, bounds):
        """Sort boxes into blocks.

        Args:
            bounds: Least and greatest coordinates of the boxes, (n, 2, 3), n > 0, m.
        """
        self.bounds = np.stack((bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)))
        self.ids = ids = in_blocks(bounds.mean(axis=1), np.arange(len(bounds)))
        self.boxes = boxes = np.concatenate((bounds[ids, 0], -bounds[ids, 1]), axis=1)
        self.blocks = np.minimum.reduceat(boxes, np.arange(0, len(boxes), BLOCK))

    def near(self, const double[:] lower not None, const double[:] upper not None, double reach):
        """Ids of the boxes that are no farther than a reach from a box, both in the axes of this solid, ascending."""
        cdef double[6] opposite
        cdef double squared = reach * reach
        cdef Py_ssize_t b, i
        cdef list near = []
        for i in range(3):
            opposite[i], opposite[3 + i] = -upper[i], lower[i]
        for b in range(self.blocks.shape[0]):
            if squared_gap(&self.blocks[b, 0], opposite) <= squared:
                for i in range(BLOCK * b, min(BLOCK * (b + 1), self.boxes.shape[0])):
                    if squared_gap(&self.boxes[i, 0], opposite) <= squared:
                        near.append(self.ids[i])
        near.sort()
        return near

    def pairs(self, BoxTree other not None, const double[:, :] rotation, const double[:] position, double reach):
        """Pairs of a box of this tree and one of another that are no farther apart than a reach in m, ascending, (k, 2).

        The boxes of the other tree are turned, and replaced by their boxes along the axes of this solid.

        Args:
            other: Tree of the other solid.
            rotation: Matrix that turns vectors from the axes of the other solid into those of this one, (3, 3).
            position: Origin of the other solid in the axes of this one, (3,), m.
            reach: Farther pairs are left out, m.
        """
        cdef double squared = reach * reach
        cdef Py_ssize_t b, c, i, k, count = len(other.ids)
        cdef double[:, ::1] whole = np.concatenate((self.bounds[0], -self.bounds[1]))[None]
        cdef double[:, ::1] blocks = around(other.blocks, rotation, position), boxes
        cdef list near = []
        # Of solids that are apart, as they nearly always are, few blocks of one are near all of the other.
        cdef list theirs = [c for c in range(len(blocks)) if squared_gap(&whole[0, 0], &blocks[c, 0]) <= squared]
        if not theirs:
            return np.empty((0, 2), dtype=np.intp)
        boxes = around(other.boxes, rotation, position)
        for b in range(self.blocks.shape[0]):
            for c in theirs:
                if squared_gap(&self.blocks[b, 0], &blocks[c, 0]) <= squared:
                    for i in range(BLOCK * b, min(BLOCK * (b + 1), self.boxes.shape[0])):
                        if squared_gap(&self.boxes[i, 0], &blocks[c, 0]) <= squared:
                            for k in range(BLOCK * c, min(BLOCK * (c + 1), count)):
                                if squared_gap(&self.boxes[i, 0], &boxes[k, 0]) <= squared:
                                    near.append(self.ids[i] * count + other.ids[k])
        return np.stack(np.divmod(np.array(sorted(near), dtype=np.intp), count), axis=1)


def around(const double[:, ::1] boxes, const double[:, :] rotation, const double[:] position):
    """Boxes along other axes around turned and moved ones, opposite to them: (-greatest, least) of (least, -greatest)."""
    cdef double[:, ::1] turned = np.empty((len(boxes), 6))
    cdef double low, high
    cdef Py_ssize_t n, i, k
    for n in range(boxes.shape[0]):
        for i in range(3):
            turned[n, i], turned[n, 3 + i] = -position[i], position[i]
            for k in range(3):
                low, high = rotation[i, k] * boxes[n, k], -rotation[i, k] * boxes[n, 3 + k]
                turned[n, i] -= max(low, high)
                turned[n, 3 + i] += min(low, high)
    return turned.base


def in_blocks(centres, ids):
    """Ids of boxes in an order in which blocks of BLOCK are neighbours: halved along the longest extent."""
    if len(ids) <= BLOCK:
        return ids
    half = (len(ids) + BLOCK) // (2 * BLOCK) * BLOCK
    axis = int(np.argmax(np.ptp(centres[ids], axis=0)))
    order = ids[np.argsort(centres[ids, axis], kind="stable")]
    return np.concatenate((in_blocks(centres, order[:half]), in_blocks(centres, order[half:])))
