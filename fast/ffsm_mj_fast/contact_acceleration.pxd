from ffsm_mj_fast.held_rows cimport HeldForces
from ffsm_mj_fast.row_memory cimport RowMemory
from ffsm_mj_fast.smooth cimport Smooth
from ffsm_mj_fast.stage_in_memory cimport StageInMemory

cdef class ContactAcceleration:
    cdef readonly object rows
    cdef object M
    cdef dict held
    cdef RowMemory own
    cdef bytearray block
    # Second rates of gaps without contact forces, their rounding, forces that hold all contacts, (k,); forces, (nv,)
    cdef double* without
    cdef double* allowed
    cdef double* holding
    cdef double* pushed
    cdef bint is_rounded, has_forces

    cdef int set_up(self, M, rows, RowMemory own) except -1
    cdef void accelerate(self) noexcept
    cdef double* roundings(self) except NULL
    cdef double* all_held(self) except NULL
    cdef HeldForces problem(self, key)
    cdef StageInMemory held_stage(self, const double* qvel, double* generalised)
    cdef bint holds_all(self) except -1

cdef ContactAcceleration problem_under(M, rows, RowMemory own, Smooth smooth, const double* pushes)
