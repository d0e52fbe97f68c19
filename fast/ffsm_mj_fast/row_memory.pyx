# cython: boundscheck=False, wraparound=False, cdivision=True
"""Rows of contact points in one block of memory, of which arrays are made when Python asks for them."""

cimport cython

import numpy as np

from libc.string cimport memset

from ffsm_mj_fast.memory cimport numbers, room, zeros


@cython.no_gc  # no cycle contains it
cdef class RowMemory:
    """Rows of groups of points at one state.

    J and J M^-1, (m, nv), gamma, (m,), the wrench rows, (m, 6), and their centres, (g, 3); with friction axes, (k, 3, 3), and
    rates, (nv,). The Delassus matrix J M^-1 J^T, (m, m), is computed when it is needed.
    """

    def __init__(self, Py_ssize_t points, tuple counts, Py_ssize_t nv, bint frictional, block=None):
        cdef Py_ssize_t rows = 0, count, size
        for count in counts:
            rows += count
        self.points, self.rows, self.nv, self.counts, self.frictional = points, rows, nv, counts, frictional
        size = 2 * rows * nv + 7 * rows + 3 * len(counts) + (9 * points + nv if frictional else 0)
        self.block = zeros(size + 1) if block is None else bytearray(block)
        self.start = self.J = numbers(self.block)
        self.response, self.gamma = self.J + rows * nv, self.J + 2 * rows * nv
        self.wrenches = self.gamma + rows
        self.centres = self.wrenches + 6 * rows
        self.axes = self.centres + 3 * <Py_ssize_t>len(counts)
        self.qvel = self.axes + 9 * points

    def __reduce__(self):
        """How a saved state of a simulation holds it."""
        return type(self), (self.points, self.counts, self.nv, self.frictional, bytes(self.block))

    cdef int write_resultants(self, const double* forces, double* out) except -1:
        """Write force, and moment about the world origin, on geom b of each group, (g, 6), for forces along the rows."""
        cdef const double* row = self.wrenches
        cdef const double* centre = self.centres
        cdef double[6] wrench
        cdef Py_ssize_t count
        cdef int j
        for count in self.counts:
            for j in range(6):
                wrench[j] = 0.0
            for _ in range(count):
                for j in range(6):
                    wrench[j] += forces[0] * row[j]
                forces, row = forces + 1, row + 6
            for j in range(3):
                out[j] = wrench[3 + j]
            out[3] = wrench[0] + centre[1] * wrench[5] - centre[2] * wrench[4]
            out[4] = wrench[1] + centre[2] * wrench[3] - centre[0] * wrench[5]
            out[5] = wrench[2] + centre[0] * wrench[4] - centre[1] * wrench[3]
            out, centre = out + 6, centre + 3
        return 0

    def resultants(self, const double[:] forces not None):
        """The same as a table, (g, 6)."""
        cdef double[::1] given = np.ascontiguousarray(forces)
        cdef double[:, ::1] found
        table = np.empty((len(self.counts), 6))
        found = table
        if self.rows:
            self.write_resultants(&given[0], &found[0, 0])
        return table

    cdef void renew(self) noexcept:
        """Set all rows to zero, for another state."""
        memset(self.start, 0, (2 * self.rows * self.nv + 7 * self.rows) * sizeof(double))
        self.has_G = False

    cdef double* delassus(self) except NULL:
        cdef Py_ssize_t i, j, d, rows = self.rows, nv = self.nv
        cdef double total
        cdef double* G
        cdef const double* response
        cdef const double* J
        if not self.has_G:
            if self.G == NULL:
                self.G_block = room(rows * rows + 1)
                self.G = numbers(self.G_block)
            G, self.has_G = self.G, True
            for i in range(rows):
                response = self.response + i * nv
                for j in range(i + 1):
                    J, total = self.J + j * nv, 0.0
                    for d in range(nv):
                        total += response[d] * J[d]
                    G[i * rows + j] = G[j * rows + i] = total
        return self.G

    cdef double velocity(self, Py_ssize_t i) noexcept:
        """Velocity along a row, m/s; with friction."""
        cdef Py_ssize_t d
        cdef const double* J = self.J + i * self.nv
        cdef double total = 0.0
        for d in range(self.nv):
            total += J[d] * self.qvel[d]
        return total

    cdef double inverse_mass(self, Py_ssize_t i) noexcept:
        """Diagonal element of the Delassus matrix, 1/kg."""
        cdef Py_ssize_t d
        cdef double total = 0.0
        for d in range(i * self.nv, (i + 1) * self.nv):
            total += self.response[d] * self.J[d]
        return total

    def array(self, str name):
        """One of the arrays."""
        cdef Py_ssize_t m = self.rows, nv = self.nv
        if name == "G":
            self.delassus()
            return np.frombuffer(self.G_block)[: m * m].reshape(m, m)
        block = np.frombuffer(self.block)
        if name == "J":
            return block[: m * nv].reshape(m, nv)
        if name == "response":
            return block[m * nv : 2 * m * nv].reshape(m, nv)
        if name == "gamma":
            return block[2 * m * nv : 2 * m * nv + m]
        at = 2 * m * nv + m
        if name == "wrenches":
            return block[at : at + 6 * m].reshape(m, 6)
        at += 6 * m + 3 * len(self.counts)
        if name == "axes":
            return block[at : at + 9 * self.points].reshape(self.points, 3, 3)
        at += 9 * self.points
        return block[at : at + nv]
