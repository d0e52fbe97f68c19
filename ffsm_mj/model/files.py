"""Files of a model in memory: the MJCF or URDF itself, files that it includes or attaches, meshes and textures.

They are found by the names that MuJoCo searches for, read once, compiled from memory, stored in the log and copied to the
run folder, so that a run can be repeated from its folder or its log. Files that the model does not use, and files outside
the folders that it may use, are never read. ``package://NAME/path``, by which a URDF refers to a file of a ROS package, is
searched without ROS.
"""

from __future__ import annotations

import os
import posixpath
import stat
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath
from types import MappingProxyType
from typing import Any, Protocol

from ffsm_mj.decomposition.stored import Decomposition
from ffsm_mj.errors import InputError
from ffsm_mj.installation import add_extra
from ffsm_mj.model.cones import ConeConfig
from ffsm_mj.model.edits import AddedSite, JointFlex
from ffsm_mj.model.properties import Overrides, Pose
from ffsm_mj.model.xml import (
    MOST_ELEMENTS,
    MOST_PIXELS,
    Element,
    assets,
    elements,
    has_urdf_root,
    image_pixels,
    is_urdf,
    pixels,
    strips_folders,
)

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
    reason = (
        f"no {'/'.join(rest)} in {', '.join(map(str, packages))}"
        if packages
        else f"no folder {name!r} above the model or in 'package_paths'"
    )
    raise InputError(
        f"{place}: '{SCHEME}{written}': {reason}; list the folder that contains it in 'package_paths', beside 'mjcf' "
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


_MAX_DEPTH = 8
_LFS_POINTER = b"version https://git-lfs"


class Shelf(Protocol):
    """Source of files, by normalised name relative to the folder of the first one."""

    def label(self, name: str) -> str:
        """Name of the file in messages."""

    def has(self, name: str) -> bool:
        """Whether there is such a file."""

    def take(self, name: str, place: str) -> bytes:
        """Content of a file that is named at a place (``file:line``; empty for the first file).

        Raises:
            InputError: It cannot be read, or may not be.
        """

    def packaged(self, written: str, home: str, place: str) -> bytes:
        """Content of a file of a package, named ``NAME/path`` at a place in a URDF in the folder ``home``.

        Raises:
            InputError: It cannot be read, or may not be.
        """


def collect(main: str, shelf: Shelf) -> dict[str, bytes]:
    """Contents of all files that a model uses, by name, ``main`` first, in reading order.

    Raises:
        InputError: A file cannot be read, is malformed, or its name is not a path relative to the model.
    """
    if not main.lower().endswith((".xml", ".urdf")):
        raise InputError(f"{shelf.label(main)}: not the name of a model file: MJCF ends in .xml, URDF in .urdf")
    if "%" in main:
        raise InputError(f"{shelf.label(main)}: the name of a model file must not contain a percent sign; rename it")
    walk = _Walk(shelf)
    walk.model(main, main, "", (), _AttachSettings())
    walk.refuse_ambiguous()
    return walk.contents


@dataclass(frozen=True)
class _AttachSettings:
    """Settings that a model takes over from the one that attaches it.

    Attributes:
        copies: Number of copies of the model.
        strip: Whether folders are removed from the names of assets: only the ``strippath`` of the first model counts.
        by_base_name: Whether MuJoCo searches for its files in another folder, and finds them by their base names only.
    """

    copies: float = 1.0
    strip: bool = False
    by_base_name: bool = False


class _Walk:
    def __init__(self, shelf: Shelf) -> None:
        self._shelf, self.contents = shelf, dict[str, bytes]()
        self._places_by_name: dict[str, str] = {}
        self._elements = self._pixels = 0.0

    def model(self, name: str, written: str, place: str, chain: tuple[str, ...], attached: _AttachSettings) -> None:
        """Collect a model and everything that it attaches, each with its own settings."""
        home = posixpath.dirname(name)
        whole = self._elements_of(name, written, place, home, chain, attached.by_base_name)
        strip = attached.strip or (strips_folders(whole) and (not chain or is_urdf(whole)))
        copies = attached.copies * max(element.copies for element in whole)
        for element in whole:
            self._count(element.place, element.copies * attached.copies, pixels(element.tag, element.attributes))
        for element in whole if not is_urdf(whole) else ():
            inner = element.attributes.get("file")
            if element.tag == "model" and inner:
                # MuJoCo searches for it beside the file that names it, and for its assets as if that were the first file.
                settings = _AttachSettings(copies, strip, by_base_name=attached.by_base_name or element.folder != home)
                self.model(_joined(element.folder, inner), inner, element.place, (*chain, name), settings)
        for asset in assets(whole, strip=strip):
            packaged = asset.name.removeprefix(SCHEME) if is_urdf(whole) else asset.name
            package = (packaged, home) if packaged != asset.name else None
            path, guessed = posixpath.join(asset.folder, packaged), strip or attached.by_base_name
            content = self._take(_joined(home, path), path, asset.place, package, by_base_name=guessed)
            if content.startswith(_LFS_POINTER):
                raise InputError(
                    f"{asset.place}: {self._shelf.label(path)}: a Git LFS pointer, not the file: run 'git lfs pull'"
                )
            self._count(asset.place, 0.0, image_pixels(content))

    def _elements_of(
        self, name: str, written: str, place: str, home: str, chain: tuple[str, ...], by_base_name: bool
    ) -> list[Element]:
        """Elements of a file, with each include replaced by the elements of the included file."""
        # The chain holds the including files only: a file may be included twice, but not by itself.
        if name in chain or len(chain) > _MAX_DEPTH:
            raise InputError(f"{place}: {written!r} includes itself, or is nested more than {_MAX_DEPTH} files deep")
        content = self._take(name, written, place, by_base_name=by_base_name)
        parsed = elements(content, self._shelf.label(name), posixpath.dirname(name))
        if is_urdf(parsed):
            return parsed
        filled: list[Element] = []
        for element in parsed:
            inner = element.attributes.get("file")
            if element.tag != "include" or not inner:
                filled.append(element)
                continue
            # MuJoCo searches for an include in the folder of the main file first, then beside the including file.
            path, guessed = _joined(home, inner), by_base_name
            if not self._shelf.has(path) and self._shelf.has(beside := _joined(posixpath.dirname(name), inner)):
                path, guessed = beside, True
            included = self._elements_of(path, inner, element.place, home, (*chain, name), guessed)[1:]
            filled += [replace(other, copies=other.copies * element.copies) for other in included]
        return filled

    def _count(self, place: str, elements: float, pixels: float) -> None:
        """Add to the numbers of elements and pixels of the whole model, and check their limits."""
        self._elements, self._pixels = self._elements + elements, self._pixels + pixels
        if self._elements > MOST_ELEMENTS:
            raise InputError(f"{place}: the model has more than {MOST_ELEMENTS} elements, including repeated ones")
        if self._pixels > MOST_PIXELS:
            raise InputError(f"{place}: the images of the model have more than {MOST_PIXELS} pixels")

    def _take(
        self, name: str, written: str, place: str, package: tuple[str, str] | None = None, *, by_base_name: bool
    ) -> bytes:
        """Content of a file; if it does not exist, that of the file of a package, which is stored under this name."""
        if name not in self.contents:
            if posixpath.isabs(written) or any(c in written for c in ":\\") or not written.isprintable():
                before = place or self._shelf.label(name)
                raise InputError(f"{before}: {written!r} is not a path relative to the model with forward slashes")
            if package and not self._shelf.has(name):
                self.contents[name] = self._shelf.packaged(*package, place)
            else:
                self.contents[name] = self._shelf.take(name, place)
        if by_base_name:
            self._places_by_name[name] = place
        return self.contents[name]

    def refuse_ambiguous(self) -> None:
        """Refuse files with the same base name if MuJoCo searches for one of them by its base name only."""
        for name, place in self._places_by_name.items():
            others = [other for other in self.contents if other != name and _base_of(other) == _base_of(name)]
            if others:
                raise InputError(f"{place}: {name} and {others[0]} have the same name; rename one of them")


def _base_of(name: str) -> str:
    return posixpath.basename(name).lower()


def _joined(home: str, name: str) -> str:
    return posixpath.normpath(posixpath.join(home, name))


REST = "world"
"""In place of the body of a model: the geoms and bodies of its file that are fixed to the world."""
MAX_FILES = 1000
MAX_BYTES = 256 * 1024**2


@dataclass(frozen=True)
class ModelFiles:
    """Files of one model.

    Attributes:
        main: Name of the MJCF or URDF file.
        files: Content by name, ``main`` first, in reading order; names are relative to one folder, with forward slashes.
        label: Prefix of file names in messages: the folder with a slash, or the log.
        strip: Elements to remove before compilation; see :mod:`ffsm_mj.model.edits`.
        motors: Servos to make motors of before compilation; see :func:`ffsm_mj.model.edits.make_motors`.
        sites: Sites to add before compilation; see :mod:`ffsm_mj.model.edits`.
        cones: Inner surfaces of cones to add before compilation; see :mod:`ffsm_mj.model.cones`.
        flex: Flexible drives by joint; see :mod:`ffsm_mj.model.edits`.
        overrides: Layers of changed properties of bodies and geoms, the last on top; see :mod:`ffsm_mj.model.overrides`.
        pose: Pose at which it is fixed to the world; None: it floats.
        body: Root of the tree of the file that it is, ``world`` for what is fixed; empty: the whole file.
        pieces: Decompositions of meshes by their names; the files hold them too.
    """

    main: str
    files: Mapping[str, bytes]
    label: str = ""
    strip: tuple[str, ...] = ()
    motors: tuple[str, ...] = ()
    sites: tuple[AddedSite, ...] = ()
    cones: tuple[ConeConfig, ...] = ()
    flex: Mapping[str, JointFlex] = field(default_factory=dict)
    overrides: tuple[Overrides, ...] = ()
    pose: Pose | None = None
    body: str = ""
    pieces: Mapping[str, Decomposition] = field(default_factory=dict)

    @property
    def place(self) -> str:
        """Name of the main file in messages."""
        return self.place_of(self.main)

    def place_of(self, name: str) -> str:
        """Name of a file in messages, without a way up and down again from the current folder."""
        place = self.label + name
        return os.path.relpath(place) if place.startswith("..") else place

    @property
    def urdf(self) -> bool:
        """Whether the main file is a URDF: MuJoCo knows one by its root element, whatever its name."""
        return has_urdf_root(self.files[self.main])

    @property
    def beside(self) -> bool:
        """Whether all files are in the folder of the main file or below."""
        folder = posixpath.dirname(self.main)
        return not folder or all(name.startswith(f"{folder}/") for name in self.files)

    def elements(self, *words: str) -> Iterator[Element]:
        """XML elements of all files, or of those in which one of some words stands: parsing takes as long as compiling."""
        for name, xml in self.files.items():
            if name.lower().endswith((".xml", ".urdf")) and (not words or any(word.encode() in xml for word in words)):
                yield from elements(xml, self.place_of(name))


def stored_with(model: str, models: Mapping[str, ModelFiles]) -> str:
    """Name of the model whose files in the log are also those of a model: the first one of the same file."""
    stored = models[model]
    same = (name for name, file in models.items() if file.body and stored.body and file.files == stored.files)
    return next(same, model)


def logged_name(model: str, name: str) -> str:
    """Name of a file of a model in the log and in the run folder.

    Args:
        model: ``robot`` or the name of an object.
        name: Name of the file in :class:`ModelFiles`.
    """
    return f"mjcf/{model}/{name}"


def read_model(
    main: Path,
    folders: Sequence[Path] = (),
    packages: Sequence[Path] = (),
    contents: Mapping[str, bytes] = MappingProxyType({}),
) -> ModelFiles:
    """Read a model from disk.

    A file of a package is stored under its name in the URDF without ``package://``, by which it is found again.

    Args:
        main: The MJCF or URDF file.
        folders: Folders, in addition to its own, from which the model may use files.
        packages: Folders in which to look for packages of a URDF, in addition to those above it.
        contents: Contents of files that are in memory, by names relative to the folder of the main one.

    Raises:
        InputError: A file is missing, malformed, outside these folders or too large, or the model has too many.
    """
    home = Path(os.path.abspath(main.parent))
    shelf = _Disk(main.parent, [home, *folders], [Path(os.path.abspath(package)) for package in packages], contents)
    collected = collect(main.name, shelf)
    paths = {Path(os.path.normpath(home / name)): content for name, content in collected.items()}
    root = Path(os.path.commonpath([path.parent for path in paths]))
    label = os.path.normpath(main.parent / os.path.relpath(root, home))
    return ModelFiles(
        main=(home / main.name).relative_to(root).as_posix(),
        files={path.relative_to(root).as_posix(): content for path, content in paths.items()},
        label="" if label == "." else f"{label.rstrip('/')}/",
    )


def logged_model(main: str, files: Mapping[str, bytes], label: str) -> ModelFiles:
    """A model from the files in a log; files that it does not use are left out.

    Args:
        main: Name of the MJCF or URDF file.
        files: Content by name.
        label: Prefix of file names in messages.

    Raises:
        InputError: A file is missing or malformed; no file is read from disk.
    """
    return ModelFiles(main, collect(main, _LogFiles(files, label)), label)


class _Disk(Shelf):
    """Files in memory, or else on disk, in permitted folders or in packages of a URDF, within the limits of one model."""

    def __init__(self, home: Path, folders: Sequence[Path], packages: Sequence[Path], contents: Mapping[str, bytes]) -> None:
        self._home, self._folders, self._packages = home, [folder.resolve() for folder in folders], packages
        self._contents = contents
        self._count = self._bytes = 0

    def label(self, name: str) -> str:
        return os.path.normpath(self._home / name)

    def has(self, name: str) -> bool:
        return name in self._contents or os.path.isfile(
            self.label(name)
        )  # unlike Path.is_file, False for a name that is too long

    def take(self, name: str, place: str) -> bytes:
        if name in self._contents:
            return self._contents[name]
        path = Path(self.label(name))
        if place:
            self._refuse_outside(path, self._folders, place)
        return self._read(path, place)

    def packaged(self, written: str, home: str, place: str) -> bytes:
        path, package = find_in_package(written, Path(os.path.abspath(self.label(home))), self._packages, place)
        self._refuse_outside(path, [package.resolve(), *self._folders], place)
        return self._read(path, place)

    def _refuse_outside(self, path: Path, folders: Sequence[Path], place: str) -> None:
        if not any(path.resolve().is_relative_to(folder) for folder in folders):
            raise InputError(
                f"{place}: {path} is outside the folder of the model: move it there, or list its folder in 'asset_folders', "
                "beside 'mjcf' in the scenario"
            )

    def _read(self, path: Path, place: str) -> bytes:
        before = f"{place}: " if place else ""
        try:
            state = path.stat()
            if not stat.S_ISREG(state.st_mode):
                raise InputError(f"{before}{path}: not a file")
            self._count, self._bytes = self._count + 1, self._bytes + state.st_size
            if self._count > MAX_FILES or self._bytes > MAX_BYTES:
                limit = f"{MAX_FILES} files and {MAX_BYTES >> 20} MiB"
                raise InputError(f"{before}{path}: with this file the model exceeds {limit}")
            return path.read_bytes()
        except FileNotFoundError as error:
            raise InputError(f"{before}{path}: no such {'' if place else 'model '}file") from error
        except OSError as error:
            raise InputError(f"{before}{path}: cannot be read ({error.strerror})") from error


@dataclass(frozen=True)
class _LogFiles(Shelf):
    """Files of a log."""

    files: Mapping[str, bytes]
    before: str

    def label(self, name: str) -> str:
        return self.before + name

    def has(self, name: str) -> bool:
        return name in self.files

    def take(self, name: str, place: str) -> bytes:
        if name not in self.files:
            raise InputError(f"{place + ': ' if place else ''}{self.label(name)} is not in the log")
        return self.files[name]

    def packaged(self, written: str, home: str, place: str) -> bytes:  # noqa: ARG002
        raise InputError(f"{place}: {SCHEME}{written} is not in the log")


def menagerie_file(name: str) -> Path:
    """Absolute path of the main file of a robot of MuJoCo Menagerie; it is downloaded if it is not there yet.

    The package ``mujoco-menagerie`` does that once. Run folder and log keep the files: no rerun or replay downloads any.

    Args:
        name: Name of the robot; ``NAME/FILE`` for another one of its files, without ``.xml``.

    Raises:
        InputError: The package is not installed, knows no such robot, or cannot download it.
    """
    try:
        import mujoco_menagerie as package  # type: ignore[import-not-found,unused-ignore]
    except ImportError as error:
        command = add_extra("menagerie", "mujoco-menagerie")
        raise InputError(f"robots of MuJoCo Menagerie need the package mujoco-menagerie; install it: {command}") from error
    robot, _, entry = name.partition("/")
    try:
        robot_package = package.get(robot)
        _download(package, robot_package)
        return Path(robot_package.xml(entry or robot_package.default_model)).absolute()
    except (package.DownloadError, OSError) as error:
        raise InputError(
            f"{name}: MuJoCo Menagerie: the download failed ({' '.join(str(error).split())}); repeat it with a connection "
            "to the network, or give a model file that is there"
        ) from error
    except package.MenagerieError as error:  # its messages name what is similar
        raise InputError(f"{name}: MuJoCo Menagerie: {' '.join(str(error).split())}") from error


def _download(package: Any, robot: Any) -> None:
    """Download a robot of MuJoCo Menagerie that is not there yet; size and time are said on stderr.

    Args:
        package: The module ``mujoco_menagerie``.
        robot: Its description of the robot.
    """
    cache = package.Cache()
    if cache.root is not None or cache.is_cached(robot):
        return
    begun = time.monotonic()
    print(f"download of {robot.name}: {robot.download_size / 1e6:.1f} MB, once", file=sys.stderr)
    robot.path(cache, None)  # without its own progress bar, which would be drawn across ours
    print(f"download of {robot.name}: done in {time.monotonic() - begun:.1f} s", file=sys.stderr)
