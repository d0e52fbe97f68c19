"""stdout and stderr of a command: a closed pipe does not end the command; lost output is reported.

Everything a command prints passes through here; control characters from files are escaped.
"""

from __future__ import annotations

import errno
import io
import os
import sys

from ffsm_mj.errors import one_line, printable

_GONE = {errno.EPIPE, errno.EBADF}
"""Errors of a pipe that its reader has closed (``| head``), or of a stdout that was closed from the start."""


def secure() -> None:
    """Open closed standard streams on the null device, and let every stream encode any text.

    A log that is opened while descriptor 1 or 2 is free would get that number, and receive what libraries print.
    """
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        try:
            os.fstat(number)
        except OSError:
            nowhere = os.open(os.devnull, os.O_RDWR)  # gets the lowest free number, which is this one
            os.set_inheritable(nowhere, True)
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, mode, encoding="utf-8", closefd=False))  # noqa: SIM115 (as long as the process)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


class Output:
    """Standard output. After the first failure nothing more is written.

    Attributes:
        lost: Why output was lost; empty if all was written or the reader closed the pipe.
    """

    def __init__(self) -> None:
        """Start without lost output."""
        self.lost, self._open = "", True

    def say(self, text: str) -> None:
        """Print one or more lines; control characters (colours, bidirectional marks) are escaped."""
        if not self._open:
            return
        try:
            print(printable(text), flush=True)
        except OSError as error:
            self._open = False
            if error.errno not in _GONE:
                self.lost = error.strerror or str(error)
            _silence(1)


def complain(text: str) -> None:
    """Print a line to stderr with control characters escaped; a failure to print is ignored."""
    try:
        print(one_line(text), file=sys.stderr, flush=True)
    except OSError:
        _silence(2)


def _silence(number: int) -> None:
    """Redirect a descriptor to the null device: Python would report the error again when it flushes at exit."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, number)
    os.close(nowhere)
