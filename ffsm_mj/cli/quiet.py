"""Suppress warnings of libraries while a command reads a file of unknown origin; its faults have messages of our own."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def quiet_libraries() -> Iterator[None]:
    """Keep warnings of NumPy, Matplotlib, MuJoCo and other libraries from stderr."""
    import numpy as np

    from ffsm_mj.model.mujoco_process import collected_warnings

    nobody = logging.NullHandler()  # without a handler, logging writes to stderr itself
    logging.getLogger().addHandler(nobody)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"), collected_warnings([]):
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.getLogger().removeHandler(nobody)
