"""Options that would have no effect are refused."""

from __future__ import annotations

import argparse
from typing import Any

from ffsm_mj.errors import InputError

_WORKS_WITH: dict[str, dict[str, tuple[str, ...]]] = {
    "run": {"--viewer": ("--live",), "--force": ("--out",)},
    "export": {"--table": ("--csv", "--parquet"), "--fps": ("--gif", "--mp4"), "--speed": ("--gif", "--mp4")},
    "validate": {"--long": ("--check",)},
}
"""Options by command and option of which at least one must be given for the option to have an effect."""


def refuse_idle(options: argparse.Namespace) -> None:
    """Refuse options that would be ignored.

    Raises:
        InputError: An option has no effect in combination with the others.
    """
    given = {name: value for name, value in vars(options).items() if value not in (None, False, [])}
    if options.version and options.command:
        raise InputError(f"ffsm: --version has no effect with the command {options.command}")
    if "list" in given:
        idle = [_as_written(name, value) for name, value in given.items() if name not in ("command", "action", "list")]
        if idle:
            command = " ".join(given[part] for part in ("command", "action") if part in given)
            raise InputError(f"ffsm {command}: {idle[0]} has no effect with --list")
    words = {_as_written(name, value) for name, value in given.items()}
    for option, others in _WORKS_WITH.get(options.command, {}).items():
        if option in words and not words & set(others):
            raise InputError(f"ffsm {options.command}: {option} has no effect without {' or '.join(others)}")


def _as_written(name: str, value: Any) -> str:
    """An argument as written on the command line."""
    return {"form": f"--{value}", "overrides": "-s", "scenario": str(value)}.get(name, f"--{name.replace('_', '-')}")
