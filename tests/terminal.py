"""A command on a terminal: a pseudo-terminal of any size around it, and what its screen shows in the end."""

from __future__ import annotations

import fcntl
import os
import pty
import select
import struct
import subprocess
import sys
import termios
import time
from dataclasses import dataclass
from pathlib import Path

import pyte

_ROWS = 200
_ENVIRONMENT_OF_RICH = ("COLUMNS", "LINES", "NO_COLOR", "FORCE_COLOR", "TTY_COMPATIBLE", "TTY_INTERACTIVE")


@dataclass(frozen=True)
class Shown:
    """What came of a command.

    Attributes:
        code: Its exit code.
        written: Everything it wrote to the terminal.
        screen: The lines that stand there in the end, without blanks at their ends.
        cursor: Whether the cursor can be seen again.
    """

    code: int
    written: str
    screen: list[str]
    cursor: bool


def on_terminal(
    command: list[str],
    *,
    columns: int = 120,
    stdout: Path | None = None,
    keys: dict[str, bytes] | None = None,
    limit_s: float = 120.0,
    **environment: str,
) -> Shown:
    """Run a command on a terminal of its own, as its stdin, stdout (or a file in its place) and stderr.

    Args:
        command: The command with its arguments.
        columns: Width of the terminal.
        stdout: A file in place of the terminal.
        keys: What is typed when a text has been written.
        limit_s: It must be done after this time.
        environment: Variables to set.
    """
    ours, its = pty.openpty()
    fcntl.ioctl(its, termios.TIOCSWINSZ, struct.pack("HHHH", _ROWS, columns, 0, 0))
    kept = {key: value for key, value in os.environ.items() if key not in _ENVIRONMENT_OF_RICH}
    out = os.open(stdout, os.O_WRONLY | os.O_CREAT) if stdout is not None else os.dup(its)
    process = subprocess.Popen(
        command,
        stdin=its,
        stdout=out,
        stderr=its,
        preexec_fn=_own_terminal,  # noqa: PLW1509 (no threads are about)
        env=kept | {"TERM": "xterm"} | environment,
    )
    os.close(its)
    os.close(out)
    written = _read(ours, time.monotonic() + limit_s, dict(keys or {}))
    os.close(ours)
    code = process.wait(timeout=10.0)
    screen = pyte.Screen(columns, _ROWS)
    pyte.Stream(screen).feed(written)
    lines = [line.rstrip() for line in screen.display]
    while lines and not lines[-1]:
        lines.pop()
    return Shown(code, written, lines, not screen.cursor.hidden)


def ffsm(*arguments: str) -> list[str]:
    """The command line, as this Python has it."""
    return [sys.executable, "-m", "ffsm_mj.cli.main", *arguments]


def _own_terminal() -> None:
    """In the child: the terminal on stdin controls it, so that Ctrl-C there interrupts it."""
    os.setsid()
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)


def _read(terminal: int, end: float, keys: dict[str, bytes]) -> str:
    """Everything that is written until nobody holds the other side any more; keys are typed where they are due."""
    parts: list[bytes] = []
    while time.monotonic() < end:
        if not select.select([terminal], [], [], 0.1)[0]:
            continue
        try:
            part = os.read(terminal, 1 << 16)
        except OSError:  # EIO: the other side is closed
            part = b""
        if not part:
            return b"".join(parts).decode()
        parts.append(part)
        for text in [text for text in keys if text.encode() in b"".join(parts)]:
            os.write(terminal, keys.pop(text))
    raise TimeoutError(b"".join(parts).decode(errors="replace"))
