from ffsm_mj._core.functions cimport mjData


cdef class Bodies:
    cdef readonly tuple names
    cdef readonly object mass_kg, inertia_kg_m2, position_m, axes, velocity_m_s, angular_velocity_rad_s
    cdef object forces, torques
    cdef Py_ssize_t count
    cdef double[::1] mass
    cdef const double[::1] control
    cdef double[:, ::1] inertia, position, turn, velocity, spin, force, torque


cdef class CompiledField:
    cdef bint by_controls

    cpdef int add_wrenches(self, double time_s, Bodies bodies) except -1


cdef class FieldForces:
    cdef readonly Bodies bodies
    cdef readonly object done
    cdef tuple fields
    cdef object data, bound
    cdef const mjData* d
    cdef Py_ssize_t[::1] ids, trees, roots
    cdef const int[::1] parents, dof_bodies
    cdef const double[::1] qpos, qvel
    cdef const double[:, ::1] centres, frames, twists, subtree_centres, axes_of_dofs
    cdef double[:, ::1] total, rates, sums, work
    cdef double[::1] applied, generalised
    cdef bint is_lasting, is_rated  # whether the forces follow from the state; whether the rates are those evaluated last
    cdef bint by_controls
    cdef double[::1] last_qpos, last_qvel, last_control
    cdef double last_s

    cpdef int push(self, data) except -1
    cdef int bind(self, data) except -1
    cdef bint is_last(self, double now) noexcept
    cdef int evaluate(self, data) except -1
    cdef int refuse_numbers(self, field, double now, Bodies bodies) except -1
    cdef void see(self, Bodies bodies) noexcept
    cdef void generalise(self, Bodies bodies) noexcept
    cdef void add_generalised(self, double* applied) noexcept
    cdef void rate(self) noexcept
    cpdef int begin(self) except -1
    cpdef int add(self, double weight) except -1
    cpdef int end(self, double duration_s) except -1
