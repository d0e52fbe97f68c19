from ffsm_mj._core.functions cimport mjData, mjModel
from ffsm_mj._core.rows cimport RowMemory


cdef class Smooth:
    cdef readonly object motion
    cdef object seen
    cdef const mjModel* m
    cdef mjData* d
    cdef double[::1] qpos, qvel, ctrl, data_ctrl, act, passive, bias, actuator
    cdef double[::1] last_qpos, last_qvel, last_ctrl, last_pushes, last_act
    cdef object last_kinematics, last_load, last_state
    cdef bint follows

    cdef void write_force(self, const double* pushes, double* force) noexcept
    cpdef object kinematics(self)
    cpdef object load(self, double[::1] pushes)
    cpdef object state(self, double[::1] pushes)
    cpdef object force(self, double[::1] pushes)


cdef class StageInMemory:
    cdef bytearray block
    cdef readonly Py_ssize_t count, nv, groups
    cdef bint any_sliding
    cdef double* along
    cdef double* powers
    cdef double* wrenches
    # Heat of each point, W, and slip speed of each sliding one, m/s, (k,); only if a point slides with friction
    cdef double* heats
    cdef double* speeds

    cdef void write_slide(self, RowMemory memory, const unsigned char[::1] sliding) noexcept

cdef StageInMemory new_stage(bytearray block, Py_ssize_t count, Py_ssize_t nv, Py_ssize_t groups, bint any_sliding)
cdef StageInMemory empty_stage(Py_ssize_t count, Py_ssize_t nv, Py_ssize_t groups, bint any_sliding)
cdef int finish_stage(StageInMemory stage, RowMemory memory, const double* qvel, const double* generalised) except -1
cdef void generalise(const double* along, RowMemory memory, double* generalised) noexcept
