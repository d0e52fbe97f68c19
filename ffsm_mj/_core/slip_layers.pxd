from ffsm_mj._core.contacts cimport ContactEvaluation


cdef bint allows_step(ContactEvaluation here, modes, double left_s, double time_s, efforts) except -1
