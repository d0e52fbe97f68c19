"""A Rerun viewer to stream to while a run goes: the one that listens already, or a new one."""

from __future__ import annotations

import os
import socket
import sys
import time

from ffsm_mj.errors import ViewerError

PORT = 9876
"""Where Rerun's viewer listens unless told otherwise."""
_PATIENCE_S = 10.0


def find_viewer(port: int = PORT) -> str:
    """Address of a viewer on this machine; one is started where none listens.

    Raises:
        ViewerError: None listens, and none can be started.
    """
    if not _listens(port):
        _start(port)
    return f"rerun+http://127.0.0.1:{port}/proxy"


def _listens(port: int) -> bool:
    try:
        socket.create_connection(("127.0.0.1", port), timeout=0.5).close()
    except OSError:
        return False
    return True


def _start(port: int) -> None:
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise ViewerError(f"there is no display to open a viewer on, and none listens on port {port}")
    import rerun as rr

    try:
        rr.spawn(port=port, connect=False, hide_welcome_screen=True)
    except RuntimeError as error:
        raise ViewerError(f"the Rerun viewer did not start ({error})") from error
    until = time.monotonic() + _PATIENCE_S
    while not _listens(port):
        if time.monotonic() > until:
            raise ViewerError(f"the Rerun viewer does not listen on port {port} after {_PATIENCE_S:g} s")
        time.sleep(0.1)
