"""Commands that install something into the environment of this process, and remove nothing from it.

``uv sync --extra NAME`` would remove every package that the project does not name, such as a control law of the user.
"""

from __future__ import annotations

import os
import sys
import tomllib
from importlib.util import find_spec
from pathlib import Path
from shlex import join, quote

from ffsm_mj.invocation import on_command_line, program, project_option, short, under_uv

_PROJECT = "ffsm-mj"


def add_extra(extra: str, package: str) -> str:
    """Command that installs an extra of ffsm-mj; outside a checkout, the package that the extra stands for.

    Args:
        extra: Name of the extra.
        package: Package that the extra installs.
    """
    if not _in_checkout():
        return add(package)
    if on_command_line() and under_uv(""):
        return f"uv run {project_option()}--extra {extra} {program().removeprefix(under_uv(''))} {join(sys.argv[1:])}"
    return f"uv sync {project_option()}--inexact --extra {extra}"


def build_again() -> str:
    """Command that builds ffsm-mj again; outside a checkout, what to do."""
    if not _in_checkout():
        return "install it once more"
    return f"uv sync {project_option()}--inexact --reinstall-package {_PROJECT}"


def add(*what: str) -> str:
    """Command that installs packages, or with ``-e`` a folder, into this environment."""
    if _is_uv_project():
        return f"uv pip install {'' if _is_uv_environment() else f'--python {quote(sys.executable)} '}{join(what)}"
    return f"{_python()} -m pip install {join(what)}"


def run_tests(folder: Path) -> str:
    """Command that runs the tests in a folder by pytest, which may have to be installed before."""
    return under_uv(f"{'python' if under_uv('') else _python()} -m pytest {quote(str(folder))}")


def has_pytest() -> bool:
    """Whether pytest is installed."""
    return find_spec("pytest") is not None


def _python() -> str:
    return quote(short(sys.executable))


def _in_checkout() -> bool:
    """Whether this is the environment that uv made for a checkout of ffsm-mj."""
    try:
        project = tomllib.loads((Path(sys.prefix).parent / "pyproject.toml").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return _is_uv_project() and project.get("project", {}).get("name") == _PROJECT


def _is_uv_project() -> bool:
    """Whether uv made this environment, which then has no pip."""
    try:
        lines = (Path(sys.prefix) / "pyvenv.cfg").read_text(encoding="utf-8").splitlines()
    except OSError:
        return False
    return any(line.partition("=")[0].strip() == "uv" for line in lines)


def _is_uv_environment() -> bool:
    """Whether ``uv pip``, typed where the present command was typed, uses this environment."""
    prefix = Path(sys.prefix).resolve()
    activated = os.environ.get("VIRTUAL_ENV")
    if activated and not under_uv(""):  # uv run sets the variable for its child only
        return Path(activated).resolve() == prefix
    current = Path.cwd()
    nearest = next((folder / ".venv" for folder in (current, *current.parents) if (folder / ".venv").is_dir()), None)
    return nearest is not None and nearest.resolve() == prefix
