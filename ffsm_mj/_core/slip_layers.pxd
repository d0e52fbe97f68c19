from ffsm_mj._core.contacts cimport FrictionState


cdef bint allows_step(FrictionState here, modes, double left_s, double time_s, efforts) except -1
