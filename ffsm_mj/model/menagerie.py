"""Robots of MuJoCo Menagerie by name, from the package ``mujoco-menagerie``, which downloads each of them once.

Run folder and log keep the files, so that nothing is downloaded for a rerun or a replay.
"""

from __future__ import annotations

from pathlib import Path

from ffsm_mj.errors import InputError
from ffsm_mj.installation import add_extra

_EXTRA, _PACKAGE = "menagerie", "mujoco-menagerie"


def menagerie_file(name: str) -> Path:
    """Absolute path of a robot's main file; it is downloaded if it is not there yet.

    Args:
        name: Name of the robot; ``NAME/FILE`` for another one of its files, without ``.xml``.

    Raises:
        InputError: The package is not installed, knows no such robot, or cannot download it.
    """
    try:
        import mujoco_menagerie as package  # type: ignore[import-not-found,unused-ignore]
    except ImportError as error:
        command = add_extra(_EXTRA, _PACKAGE)
        raise InputError(f"robots of MuJoCo Menagerie need the package {_PACKAGE}; install it: {command}") from error
    robot, _, entry = name.partition("/")
    try:
        found = package.get(robot)
        return Path(found.xml(entry or found.default_model)).absolute()
    except (package.MenagerieError, OSError) as error:  # its messages name what is similar
        raise InputError(f"{name}: MuJoCo Menagerie: {' '.join(str(error).split())}") from error
