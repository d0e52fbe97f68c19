from ffsm_mj_fast.row_memory cimport RowMemory

cdef void find_slips(RowMemory own, double* slips) noexcept
cdef double find_directions(
    RowMemory own,
    const double* slips,
    const double[:, ::1] at_start,
    const unsigned char[::1] slides,
    const unsigned char[::1] straight,
    double* found,
) noexcept
