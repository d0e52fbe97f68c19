"""``package://NAME/path``, as URDF names meshes: a file of a ROS package, looked for without ROS."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath

from ffsm_mj.errors import InputError

SCHEME = "package://"


def find_in_package(written: str, home: Path, folders: Sequence[Path], place: str) -> tuple[Path, Path]:
    """The file that ``NAME/path`` means: the first there is, from the model's folder upwards, then in further folders.

    Args:
        written: ``NAME/path``.
        home: Folder of the model, absolute.
        folders: Further folders that packages lie in, or packages themselves.
        place: ``file:line`` where it is written, for messages.

    Returns:
        The file, and the folder of its package.

    Raises:
        InputError: There is none.
    """
    name, *rest = PurePosixPath(written).parts
    if not rest or ".." in (name, *rest):
        raise InputError(f"{place}: '{SCHEME}{written}' is no {SCHEME}NAME/path")
    packages = list(_packages(name, home, folders))
    for package in packages:
        if os.path.isfile(path := package.joinpath(*rest)):  # without an exception for a name that is too long
            return path, package
    found = (
        f"no {'/'.join(rest)} in {', '.join(map(str, packages))}"
        if packages
        else f"no folder {name!r} above the model or in 'package_paths'"
    )
    raise InputError(
        f"{place}: '{SCHEME}{written}': {found}; name the folder that it lies in under 'package_paths', beside 'mjcf' "
        "in the scenario"
    )


def _packages(name: str, home: Path, folders: Sequence[Path]) -> Iterator[Path]:
    """Folders of a package's name: beside or around the model, the root of the file system left out, then the others."""
    above = [folder for folder in (home, *home.parents) if folder != folder.parent]
    for folder in (*above, *folders):
        if os.path.isdir(folder / name):
            yield folder / name
        if folder.name == name:
            yield folder
