"""The suite. BLAS is kept to one thread, as in a run: with two workers a second one each only spins, for minutes."""

from ffsm_mj.cli.main import one_blas_thread

one_blas_thread()  # here, because it must come before the first import of numpy
