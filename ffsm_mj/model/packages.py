"""Search for ``package://NAME/path``, by which a URDF refers to a file of a ROS package, without ROS."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath

from ffsm_mj.errors import InputError

SCHEME = "package://"


def find_in_package(written: str, home: Path, folders: Sequence[Path], place: str) -> tuple[Path, Path]:
    """Find the file ``NAME/path``: in the folder of the model, then upwards, then in further folders.

    Args:
        written: ``NAME/path``.
        home: Folder of the model, absolute.
        folders: Further folders that contain packages or are packages.
        place: ``file:line`` of the reference, for messages.

    Returns:
        The file, and the folder of its package.

    Raises:
        InputError: No such file.
    """
    name, *rest = PurePosixPath(written).parts
    if not rest or ".." in (name, *rest):
        raise InputError(f"{place}: '{SCHEME}{written}' is not of the form {SCHEME}NAME/path")
    packages = list(dict.fromkeys(_packages(name, home, folders)))
    for package in packages:
        if os.path.isfile(path := package.joinpath(*rest)):  # unlike Path.is_file, False for a name that is too long
            return path, package
    found = (
        f"no {'/'.join(rest)} in {', '.join(map(str, packages))}"
        if packages
        else f"no folder {name!r} above the model or in 'package_paths'"
    )
    raise InputError(
        f"{place}: '{SCHEME}{written}': {found}; list the folder that contains it in 'package_paths', beside 'mjcf' "
        "in the scenario"
    )


def _packages(name: str, home: Path, folders: Sequence[Path]) -> Iterator[Path]:
    """Folders with the name of a package: beside or above the model, except the file system's root, then in the others."""
    above = [folder for folder in (home, *home.parents) if folder != folder.parent]
    for folder in (*above, *folders):
        if os.path.isdir(folder / name):
            yield folder / name
        if folder.name == name:
            yield folder
