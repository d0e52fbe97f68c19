"""stdout and stderr of a command: a reader who has gone away ends nothing, output that is lost is told.

All that a command prints passes here, and nothing of it steers the terminal, whoever wrote the files that it speaks of.
"""

from __future__ import annotations

import errno
import io
import os
import sys

from ffsm_mj.errors import one_line, printable

_GONE = {errno.EPIPE, errno.EBADF}
"""The reader of a pipe has closed it (``| head``), or stdout was closed from the start: nobody wants the output."""


def secure() -> None:
    """Give every standard stream a file, and every text a way out, whatever the shell and the locale are.

    A log that is opened while descriptor 1 or 2 is free would get that number, and with it what any library prints.
    """
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        try:
            os.fstat(number)
        except OSError:
            nowhere = os.open(os.devnull, os.O_RDWR)  # the lowest free number, which is this one
            os.set_inheritable(nowhere, True)
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, mode, encoding="utf-8", closefd=False))  # noqa: SIM115 (as long as the process)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


class Output:
    """Standard output. The first failure is kept; what comes after it is not tried.

    Attributes:
        lost: Why output was lost; empty where all was written, or nobody wanted it.
    """

    def __init__(self) -> None:
        """Nothing is lost yet."""
        self.lost, self._open = "", True

    def say(self, text: str) -> None:
        """Print a line, or several; what a file may hold besides text (colours, bidirectional marks) is escaped."""
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
    """Print a line to stderr, what is no text in it escaped; there is nowhere to tell that this fails."""
    try:
        print(one_line(text), file=sys.stderr, flush=True)
    except OSError:
        _silence(2)


def _silence(number: int) -> None:
    """Let a descriptor lead nowhere: Python would complain of it again when it flushes at exit."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, number)
    os.close(nowhere)
