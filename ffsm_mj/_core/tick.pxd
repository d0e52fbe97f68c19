from ffsm_mj._core.functions cimport mjData, mjModel


cdef class OnSample:
    cdef int sample(self, double time_s) except -1


cdef struct Copy:
    const char* live
    char* table
    size_t size, stride, lines


cdef class Sampler:
    cdef readonly object jacp, jacr, twist
    cdef const mjModel* m
    cdef mjData* d
    cdef int base, tip
    cdef double[:, ::1] p, r
    cdef double[::1] v
    cdef Copy* copies
    cdef int count
    cdef object keep

    cpdef int take(self, size_t line) except -1


cdef class RowFiller:
    cdef Sampler sampler
    cdef tuple on_sample

    cpdef int fill(self, size_t line, double time_s) except -1


cdef class StepWork:
    cdef double[::1] ctrl, length, force, account, start
    cdef const double[::1] on_joint, external
    cdef bint working, pushed
    cdef tuple always, outside
    cdef double[::1] gained, contact, fixed

    cpdef int open(self) except -1
    cpdef int close(self, double duration_s) except -1
    cdef void add(self, const double* energy, const double* contact, const double* fixed) noexcept


cdef class SteadyForces:
    cpdef bint goes_on(self, double left_s=*) except -1
    cdef bint exchange_into(self, double duration_s, double* sums) except -1


cdef class TickLaw:
    cdef bint command(self, Limits limits) except -1
    cdef bint arrives(self) except -1


cdef class Limits:
    cdef double[::1] effort, velocity, ctrl
    cdef const double[::1] low, high, stall, slope, saturation, gear
    cdef const unsigned char[::1] powered, keeps
    cdef double[:, ::1] table

    cpdef bint apply(self) except? -1
