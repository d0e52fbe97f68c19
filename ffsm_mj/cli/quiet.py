"""Silence of libraries while a command works on somebody else's file: what is wrong with it is told in lines of our own."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def quiet_libraries() -> Iterator[None]:
    """Let no warning of NumPy, Matplotlib, MuJoCo or another library reach stderr."""
    import numpy as np

    from ffsm_mj.model.mujoco_warnings import collected_warnings

    nobody = logging.NullHandler()  # without any, logging writes to stderr itself
    logging.getLogger().addHandler(nobody)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"), collected_warnings([]):
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.getLogger().removeHandler(nobody)
