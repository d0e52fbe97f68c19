"""MuJoCo's warnings, kept: by itself it writes them to MUJOCO_LOG.TXT where the user stands, and on the console."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import mujoco


@contextmanager
def collected_warnings(messages: list[str]) -> Iterator[None]:
    """Add MuJoCo's warnings to some messages instead."""
    previous = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(messages.append)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(previous)
