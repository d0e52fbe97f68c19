"""stdout and stderr of a command: a closed pipe does not end the command; lost output is reported.

Everything a command prints passes through here; control characters from files are escaped.
"""

from __future__ import annotations

import errno
import io
import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TextIO

from ffsm_mj.cli.progress import Progress, Stage
from ffsm_mj.errors import one_line, printable
from ffsm_mj.report.terminal import FOLD, wrapped, wrapped_command

_COLOURS = (
    (re.compile(r"\b(FAILED|DAMAGED|NOT VERIFIED|DO NOT AGREE)\b|^(damaged|incomplete|[a-z_]+_failed|diverged): "), "1;31"),
    (re.compile(rf"truncation($|{FOLD})|\bby the truncation of the step alone\b"), "33"),
    (re.compile(r"^all \d+ checks pass"), "32"),
)
"""Colours of lines by their text: what fails is in capitals, so that it is seen without colours too."""
_DUMB = ("", "dumb", "unknown")
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


@contextmanager
def progress() -> Iterator[Progress]:
    """Display progress on the last line of the terminal; the line is removed at exit of the context."""
    # Standard error must be a terminal that can redraw a line.
    if not sys.stderr.isatty() or (os.name != "nt" and os.environ.get("TERM", "").lower() in _DUMB):
        yield Progress()
        return
    from ffsm_mj.cli.progress_line import ProgressLine  # rich is slow to import

    line = ProgressLine()
    try:
        yield line
    finally:
        line.hide()


class Output:
    """Standard output. After the first failure nothing more is written.

    Attributes:
        lost: Why output was lost; empty if all was written or the reader closed the pipe.
    """

    def __init__(self) -> None:
        """Start without lost output."""
        self.lost, self._open, self._progress = "", True, Progress()

    @contextmanager
    def progress(self) -> Iterator[Stage]:
        """Display the progress of a command, hidden while something is printed; gives what begins its stages."""
        with progress() as self._progress:
            yield self._progress.stage
        self._progress = Progress()

    def say(self, text: str) -> None:
        """Print lines of prose and tables, on a terminal wrapped at its width; control characters are escaped."""
        self._print("\n".join(_coloured(line, wrapped(line), sys.stdout) for line in _rows(text)))

    def command(self, command: str, label: str = "") -> None:
        """Print a command after a label; on a narrow terminal it goes on in further lines, to be copied as a whole."""
        self._print(wrapped_command(label, one_line(command)))

    def write(self, text: str) -> None:
        """Print data and commands, whose lines are as they are on a terminal too; control characters are escaped."""
        self._print(printable(text))

    def _print(self, text: str) -> None:
        if not self._open:
            return
        try:
            with self._progress.hidden():
                print(text, flush=True)
        except OSError as error:
            self._open = False
            if error.errno not in _GONE:
                self.lost = error.strerror or str(error)
            _silence(1)


def _rows(text: str) -> list[str]:
    """Lines, and rows of tables with all of their lines, with control characters escaped."""
    return [FOLD.join(map(one_line, row.split(FOLD))) for row in text.split("\n")]


def complain(text: str) -> None:
    """Print a line to stderr, wrapped on a terminal, with control characters escaped; a failure to print is ignored."""
    line = one_line(text)
    try:
        print(_coloured(line, wrapped(line, sys.stderr), sys.stderr), file=sys.stderr, flush=True)
    except OSError:
        _silence(2)


def _coloured(line: str, shown: str, stream: TextIO) -> str:
    """What is shown of a line, in its colour, if the stream is a terminal that shows colours and the user wants them."""
    if os.environ.get("NO_COLOR") or os.environ.get("TERM", "").lower() in _DUMB or not stream.isatty():
        return shown
    colour = next((code for pattern, code in _COLOURS if pattern.search(line)), "")
    return "\n".join(f"\x1b[{colour}m{part}\x1b[0m" for part in shown.split("\n")) if colour else shown


def _silence(number: int) -> None:
    """Redirect a descriptor to the null device: Python would report the error again when it flushes at exit."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, number)
    os.close(nowhere)
