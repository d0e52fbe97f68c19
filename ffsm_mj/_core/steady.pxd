from ffsm_mj._core.contacts cimport ContactEvaluation, StageForces
from ffsm_mj._core.forces cimport StuckPatches
from ffsm_mj._core.row_evaluator cimport RowEvaluator
from ffsm_mj._core.rows cimport RowMemory
from ffsm_mj._core.stages cimport Smooth, StageInMemory
from ffsm_mj._core.tick cimport SteadyForces


cdef class RuleColumns:
    cdef Py_ssize_t[:, ::1] parts
    cdef double[:, ::1] values, friction_values
    cdef double[::1] work_J
    cdef double mode

    cdef int write(
        self,
        list groups,
        const double* axes,
        const double* normal_forces,
        const double* forces,
        const double* use,
        const double* speeds,
    ) except -1
    cdef int write_idle(self) except -1
    cdef void clear(self) noexcept
    cdef void finish(self) noexcept
    cdef void add_pair(self, Py_ssize_t i, const double* out) noexcept
    cdef void add_friction(
        self, Py_ssize_t i, const double* axes, const double* forces, const double* use, const double* speeds, double* out
    ) noexcept
    cdef double add_slide(self, double part, StageInMemory stage) noexcept
    cdef void add_impulses(self, double part, const double* wrenches) noexcept


cdef class SteadyContacts(SteadyForces):
    cdef object closed, modes, solver, system, tables, accounts
    # Closed contacts, as they were taken over
    cdef object points, pressing, generation, point_modes, evaluator
    cdef public bint is_varied  # whether forces are varied by rounding, and those of a decision count
    cdef bint possible, rubs, sliding, idle, others, is_level
    cdef Smooth smooth
    cdef StageForces inside
    cdef StuckPatches patches
    cdef object data, pushes
    cdef double[::1] applied, other, sums, deepest, heat_J
    cdef bytearray block
    cdef double* normal_forces
    cdef double* use
    cdef RuleColumns columns
    cdef const double[::1] from_robot
    cdef const double[:, ::1] outside
    cdef Py_ssize_t robot_start, robot_stop
    cdef const double[::1] mu
    # State seen last
    cdef object kinematics, state, rows
    cdef RowMemory memory
    cdef list groups
    cdef ContactEvaluation evaluation
    cdef double[4] extremes
    cdef double lowest
    cdef bint is_steady, is_reduced

    cdef bint may_be(self) except -1
    cdef int take(self) except -1
    cpdef bint holds(self) except -1
    cdef bint evaluate(self, kinematics, load, pushes) except -1
    cdef int find_rows(self, kinematics) except -1
    cdef bint touches_nowhere_else(self) except -1
    cdef bint slide_on(self, double left_s) except -1
