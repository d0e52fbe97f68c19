# cython: boundscheck=False, wraparound=False, cdivision=True
"""Rows of contact points in one block of memory, of which arrays are made when Python asks for them."""

import numpy as np


cdef class RowMemory:
    """Rows at one state: J and J M^-1, (m, nv), gamma, (m,), and with friction axes, (k, 3, 3), and rates, (nv,).

    The Delassus matrix J M^-1 J^T, (m, m), is computed when it is needed.
    """

    def __init__(self, Py_ssize_t points, Py_ssize_t rows, Py_ssize_t nv, block=None):
        cdef double[::1] memory
        self.points, self.rows, self.nv = points, rows, nv
        size = 2 * rows * nv + rows + (9 * points + nv if rows > points else 0)
        self.block = np.zeros(size + 1) if block is None else block  # one more: no array is empty
        memory = self.block
        self.start = self.J = &memory[0]
        self.response, self.gamma = self.J + rows * nv, self.J + 2 * rows * nv
        self.axes = self.gamma + rows
        self.qvel = self.axes + 9 * points

    def __reduce__(self):
        """How a saved state of a simulation holds it."""
        return type(self), (self.points, self.rows, self.nv, self.block)

    cdef double* delassus(self) except NULL:
        cdef Py_ssize_t i, j, d
        cdef double total
        cdef double[::1] memory
        cdef const double* response
        cdef const double* J
        if self.G == NULL:
            self.G_block = np.empty(self.rows * self.rows + 1)
            memory = self.G_block
            self.G = &memory[0]
            for i in range(self.rows):
                response = self.response + i * self.nv
                for j in range(i + 1):
                    J, total = self.J + j * self.nv, 0.0
                    for d in range(self.nv):
                        total += response[d] * J[d]
                    self.G[i * self.rows + j] = self.G[j * self.rows + i] = total
        return self.G

    def array(self, str name):
        """One of the arrays."""
        cdef Py_ssize_t m = self.rows, nv = self.nv
        if name == "J":
            return self.block[: m * nv].reshape(m, nv)
        if name == "response":
            return self.block[m * nv : 2 * m * nv].reshape(m, nv)
        if name == "gamma":
            return self.block[2 * m * nv : 2 * m * nv + m]
        if name == "G":
            self.delassus()
            return self.G_block[: m * m].reshape(m, m)
        at = 2 * m * nv + m
        if name == "axes":
            return self.block[at : at + 9 * self.points].reshape(self.points, 3, 3)
        at += 9 * self.points
        return self.block[at : at + nv]
