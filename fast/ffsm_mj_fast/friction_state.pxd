from ffsm_mj_fast.row_memory cimport RowMemory

cdef object structure_of(modes, RowMemory own)
