"""How the user called ffsm-mj: messages name options and commands in a form that works as it is written.

A program that calls ``ffsm_mj.run`` reads ``force=True``, a user of the command line ``--force``; and a command that is
proposed to a user who typed ``uv run ffsm run baseline`` begins with ``uv run ffsm``.
"""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from shlex import join, quote

_NAME = "ffsm"
_PACKAGE = "ffsm_mj"
_UNDER_UV = "UV_RUN_RECURSION_DEPTH"
"""Set by ``uv run`` for the command that it starts."""
_state = {"command line": False}


@contextmanager
def command_line() -> Iterator[None]:
    """Context in which messages are read on the command line; elsewhere they are read by a Python program."""
    before = _state["command line"]
    _state["command line"] = True
    try:
        yield
    finally:
        _state["command line"] = before


def on_command_line() -> bool:
    """Whether messages are read on the command line."""
    return _state["command line"]


def option(name: str, value: str = "...") -> str:
    """An option as the user would write it: ``--force``, or ``force=True`` in Python.

    Args:
        name: Name of the parameter in Python.
        value: Value of the parameter in Python; flags of the command line have none.
    """
    return f"--{name.replace('_', '-')}" if on_command_line() else f"{name}={value}"


def override(text: str) -> str:
    """An override ``key=value`` as the user would write it: ``-s key=value``, or ``overrides: key=value`` in Python."""
    return f"-s {text}" if on_command_line() else f"overrides: {text}"


def command(*words: object) -> str:
    """A command of ffsm-mj that works where the user typed the present one, e.g. ``uv run ffsm view logs/a``."""
    return f"{program()} {join(map(str, words))}"


def program(arguments: Sequence[str] | None = None) -> str:
    """How the program was started, e.g. ``ffsm``, ``uv run ffsm`` or ``python -m ffsm_mj``.

    Args:
        arguments: Command line of the interpreter; None: that of this process.
    """
    if not on_command_line():
        return _NAME
    words = list(sys.orig_argv if arguments is None else arguments)
    if "-m" in words and words[words.index("-m") + 1 :][:1] and words[words.index("-m") + 1].startswith(_PACKAGE):
        started = [short(words[0]), *words[1 : words.index("-m") + 2]]
    else:
        script = next((word for word in words[1:] if Path(word).stem == _NAME), _NAME)
        started = [short(script)]
    return under_uv(join(started))


def under_uv(words: str) -> str:
    """A command with ``uv run`` before it, if the present one was started so."""
    return f"uv run {project_option()}{words}" if _UNDER_UV in os.environ else words


def project_option() -> str:
    """``--project DIR`` where uv would not find the project of this environment from the current folder, else empty."""
    project = Path(sys.prefix).parent
    current = Path.cwd()
    nearest = next((folder for folder in (current, *current.parents) if (folder / "pyproject.toml").is_file()), None)
    known = nearest is not None and nearest.resolve() == project.resolve()
    return "" if known or not (project / "pyproject.toml").is_file() else f"--project {quote(str(project))} "


def short(program: str) -> str:
    """A program by its name alone, if the shell finds the same one under this name."""
    path = Path(program)
    on_path = shutil.which(path.name)
    return path.name if on_path is not None and path.exists() and Path(on_path).absolute() == path.absolute() else program
