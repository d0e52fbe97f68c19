from ffsm_mj_fast.held_rows cimport HeldForces
from ffsm_mj_fast.patches cimport StuckPatches
from ffsm_mj_fast.row_memory cimport RowMemory
from ffsm_mj_fast.rows cimport RowEvaluator
from ffsm_mj_fast.smooth cimport Smooth
from ffsm_mj_fast.stage_in_memory cimport StageInMemory

cdef class StageForces:
    cdef readonly object contact_points, modes
    cdef object given, other, structure
    cdef Smooth smooth
    cdef RowEvaluator evaluator
    cdef RowMemory own
    cdef HeldForces held
    cdef StuckPatches patches
    cdef list states
    cdef bint frictional
    cdef double[::1] force, b, sums

    cdef object add_to(self, double[::1] applied)
    cdef int hold_rows(self, StageInMemory stage) except -1
    cdef int hold(self) except -1
