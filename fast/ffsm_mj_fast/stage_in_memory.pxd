from ffsm_mj_fast.row_memory cimport RowMemory

cdef class StageInMemory:
    cdef readonly object rows
    cdef bytearray block
    cdef readonly Py_ssize_t count, nv, groups
    cdef bint frictional
    cdef double* along
    cdef double* powers
    cdef double* found

cdef StageInMemory new_stage(rows, bytearray block, Py_ssize_t count, Py_ssize_t nv, Py_ssize_t groups, bint frictional)
cdef StageInMemory empty_stage(rows, Py_ssize_t count, Py_ssize_t nv, Py_ssize_t groups, bint frictional)
cdef int finish_stage(StageInMemory stage, RowMemory own, const double* qvel, const double* generalised) except -1
cdef void generalise(const double* along, RowMemory own, double* generalised) noexcept
