from ffsm_mj_fast.functions cimport mjData, mjModel


cdef class TipKinematics:
    cdef readonly object J, jac_dot, W, point
    cdef const mjModel* m
    cdef mjData* d
    cdef int site, body
    cdef const int[::1] axes
    cdef double[:, ::1] jacp, rows, dot, w
    cdef double[::1] place
    cdef object made_of

    cpdef void update(self) noexcept
