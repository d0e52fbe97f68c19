from ffsm_mj._core.contacts cimport ContactEvaluation


cdef bint allows_step(ContactEvaluation evaluation, modes, double left_s, double time_s, efforts) except -1
