from ffsm_mj._core.forces cimport ActiveForces, StuckPatches
from ffsm_mj._core.row_evaluator cimport RowEvaluator
from ffsm_mj._core.rows cimport RowMemory
from ffsm_mj._core.stages cimport Smooth, StageInMemory


cdef class ContactEvaluation:
    cdef readonly object contact_points, rows, modes
    cdef RowMemory memory
    cdef object kept_problem
    cdef bytearray block
    # Accelerations without contact forces, forces of sticking points, (m,); rounding, (k,); generalised forces, (nv,)
    cdef double* b
    cdef double* along
    cdef double* roughness
    cdef double* slips
    cdef double* speeds
    cdef double* pushed
    cdef const double[::1] mu
    cdef double kept_margin, forward
    cdef bint has_margin, has_rounding, has_forces

    cdef int set_up(self, contact_points, rows, RowMemory memory, modes) except -1
    cdef ActiveForces active(self)
    cdef double* present_forces(self) except NULL
    cdef double* roundings(self) except NULL
    cdef double largest_slip(self) noexcept
    cdef bint only_drifts(self) noexcept
    cdef bint stays_idle(self) except -1
    cdef double presses(self, Py_ssize_t p) except? -2.0
    cdef double margin(self) except? -2.0
    cdef bint slides_on(self) except -1
    cdef double margin_of(self) except? -2.0
    cdef StageInMemory stage_into(self, double* generalised)

cdef bint slips_along_a_line(const double* G, Py_ssize_t m, Py_ssize_t p, double* largest) noexcept
cdef double directions_of_slip(
    RowMemory memory,
    const unsigned char[::1] sliding,
    const unsigned char[::1] straight,
    const double[:, ::1] starts,
    double* slips,
) except? -1.0
cdef object structure_of(modes, RowMemory memory)
cdef ContactEvaluation state_under(contact_points, rows, RowMemory memory, modes, Smooth smooth, const double* pushes)
cdef double largest_ratio(const double* forces, const double[::1] mu, double* ratios) noexcept


cdef class StageForces:
    cdef readonly object contact_points, modes
    cdef object structure
    cdef Smooth smooth
    cdef RowEvaluator evaluator
    cdef RowMemory memory
    cdef ActiveForces active
    cdef StuckPatches patches
    cdef list states
    cdef bint any_sliding
    cdef double[::1] force, b, sums
    # Of points that slide with friction: which, which go straight on, directions at the start of the step, and directions
    cdef const unsigned char[::1] sliding, straight
    cdef const double[:, ::1] directions
    cdef double[:, ::1] slips

    cdef object add_to(self, double[::1] applied)
    cdef object add_one_by_one(self, double[::1] applied)
    cdef int hold_rows(self, StageInMemory stage) except -1
    cdef int hold(self) except -1
