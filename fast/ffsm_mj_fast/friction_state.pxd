from ffsm_mj_fast.held_rows cimport HeldForces
from ffsm_mj_fast.row_memory cimport RowMemory
from ffsm_mj_fast.smooth cimport Smooth
from ffsm_mj_fast.stage_in_memory cimport StageInMemory

cdef class FrictionState:
    cdef readonly object contact_points, rows, modes
    cdef RowMemory own
    cdef object kept_problem
    cdef bytearray block
    # Accelerations without contact forces, forces of sticking points, (m,); rounding, (k,); generalised forces, (nv,)
    cdef double* b
    cdef double* stuck
    cdef double* roughness
    cdef double* pushed
    cdef const double[::1] mu
    cdef double kept_margin
    cdef bint has_margin, has_rounding, has_forces

    cdef int set_up(self, contact_points, rows, RowMemory own, modes) except -1
    cdef void accelerate(self) noexcept
    cdef HeldForces held(self)
    cdef double* stuck_forces(self) except NULL
    cdef double* roundings(self) except NULL
    cdef double largest_slip(self) noexcept
    cdef bint creeps(self) noexcept
    cdef double margin(self) except? -2.0
    cdef double own_margin(self) except? -2.0
    cdef StageInMemory stuck_into(self, double* generalised)

cdef object structure_of(modes, RowMemory own)
cdef FrictionState state_under(contact_points, rows, RowMemory own, modes, Smooth smooth, const double* pushes)
cdef double largest_ratio(const double* forces, const double[::1] mu, double* ratios) noexcept
