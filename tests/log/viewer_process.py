"""A viewer in a process, with a reliable end."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def viewer_process(command: list[str]) -> Iterator[None]:
    """Run a viewer, and end it with its child: the command is a wrapper of the program."""
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True) as server:
        try:
            yield
        finally:
            os.killpg(server.pid, signal.SIGTERM)
