# Types of ffsm_controllers/osdre/osdre_planar.py, which is compiled unchanged.

cimport cython

from ffsm_mj_fast.riccati_planar cimport PlanarRiccati as Solver, blocks_t, matrix_t, pair_t

cpdef pair_t turned_pair(pair_t x, pair_t axes)

@cython.locals(y0=double, y1=double, scale=double)
cpdef blocks_t lower_block(pair_t drift, pair_t y, pair_t y_dot, bint whole_stack)

@cython.locals(P2=matrix_t, P3=matrix_t)
cpdef pair_t feedback(blocks_t blocks, pair_t error, pair_t y_dot)

@cython.locals(A21=matrix_t, A22=matrix_t, blocks=blocks_t, residual=double, fallback=bint)
cpdef (pair_t, pair_t, double, bint) answer(
    Solver riccati, pair_t S, pair_t axes, pair_t drift, pair_t y, pair_t error, pair_t y_dot, bint whole_stack
)
