from ffsm_mj._core.fields cimport FieldForces
from ffsm_mj._core.functions cimport mjData, mjModel
from ffsm_mj._core.tick cimport Limits, TickLaw


cdef class TipKinematics:
    cdef readonly object J, jac_dot, W, point
    cdef const mjModel* m
    cdef mjData* d
    cdef int site, body
    cdef const int[::1] axes
    cdef double[:, ::1] jacp, rows, dot, w
    cdef double[::1] place
    cdef object kept

    cpdef void update(self) noexcept


cdef class OutputLaw:
    cdef readonly object effort, report
    cdef TipKinematics kinematics
    cdef const double[:, ::1] driven
    cdef double[:, ::1] gains, rows, damped
    cdef double[::1] qvel, bias, passive, u, figures, extremes, lengths
    cdef bint whole_stack
    cdef double damping
    cdef double[::1] pushed
    cdef object data
    cdef FieldForces field

    cdef int push(self) except -1

    cdef Py_ssize_t outputs(self, riccati) except -1
    cdef object begin(self, axes, target_m)
    cdef double decompose(self) noexcept
    cdef void finish(self) noexcept
    cpdef int tick(self) except -1


cdef class CommandingLaw(TickLaw):
    cdef OutputLaw law
    cdef double[::1] effort, telemetry
    cdef unsigned char[::1] powered
    cdef const Py_ssize_t[::1] actuators, places
    cdef object before
