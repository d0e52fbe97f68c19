"""The Rerun viewer as a program: whether it can open here, and how it is called."""

from __future__ import annotations

import os
import sys


def has_display() -> bool:
    """Whether a window can open on this machine."""
    return not sys.platform.startswith("linux") or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))


def viewer_command(*arguments: str) -> list[str]:
    """Command line of the viewer that belongs to this Python."""
    return [sys.executable, "-m", "rerun", *arguments]
