"""Files of a model in memory: the MJCF or URDF itself, files that it includes or attaches, meshes and textures.

They are read once, compiled from memory, stored in the log and copied to the run folder, so that a run can be repeated from
its folder or its log. Files that the model does not use, and files outside the folders that it may use, are never read.
"""

from __future__ import annotations

import os
import posixpath
import stat
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

from ffsm_mj.errors import InputError
from ffsm_mj.installation import add_extra
from ffsm_mj.model.collection import Shelf, collect
from ffsm_mj.model.flex import JointFlex
from ffsm_mj.model.packages import SCHEME, find_in_package
from ffsm_mj.model.properties import Overrides, Pose
from ffsm_mj.model.sites import AddedSite
from ffsm_mj.model.xml import has_urdf_root

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
        strip: Elements to remove before compilation; see :mod:`ffsm_mj.model.strip`.
        motors: Servos to make motors of before compilation; see :func:`ffsm_mj.model.actuators.make_motors`.
        sites: Sites to add before compilation; see :mod:`ffsm_mj.model.sites`.
        flex: Flexible drives by joint; see :mod:`ffsm_mj.model.flex`.
        overrides: Layers of changed properties of bodies and geoms, the last on top; see :mod:`ffsm_mj.model.overrides`.
        pose: Pose at which it is fixed to the world; None: it floats.
        body: Root of the tree of the file that it is, ``world`` for what is fixed; empty: the whole file.
    """

    main: str
    files: Mapping[str, bytes]
    label: str = ""
    strip: tuple[str, ...] = ()
    motors: tuple[str, ...] = ()
    sites: tuple[AddedSite, ...] = ()
    flex: Mapping[str, JointFlex] = field(default_factory=dict)
    overrides: tuple[Overrides, ...] = ()
    pose: Pose | None = None
    body: str = ""

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


def stored_with(model: str, models: Mapping[str, ModelFiles]) -> str:
    """Name of the model whose files in the log are also those of a model: the first one of the same file."""
    own = models[model]
    same = (name for name, each in models.items() if each.body and own.body and each.files == own.files)
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
    given: Mapping[str, bytes] = MappingProxyType({}),
) -> ModelFiles:
    """Read a model from disk.

    A file of a package is stored under its name in the URDF without ``package://``, by which it is found again.

    Args:
        main: The MJCF or URDF file.
        folders: Folders, in addition to its own, from which the model may use files.
        packages: Folders in which to look for packages of a URDF, in addition to those above it.
        given: Contents of files that are in memory, by names relative to the folder of the main one.

    Raises:
        InputError: A file is missing, malformed, outside these folders or too large, or the model has too many.
    """
    home = Path(os.path.abspath(main.parent))
    shelf = _Disk(main.parent, [home, *folders], [Path(os.path.abspath(each)) for each in packages], given)
    found = collect(main.name, shelf)
    paths = {Path(os.path.normpath(home / name)): content for name, content in found.items()}
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

    def __init__(self, home: Path, folders: Sequence[Path], packages: Sequence[Path], given: Mapping[str, bytes]) -> None:
        self._home, self._folders, self._packages = home, [folder.resolve() for folder in folders], packages
        self._given = given
        self._count = self._bytes = 0

    def label(self, name: str) -> str:
        return os.path.normpath(self._home / name)

    def has(self, name: str) -> bool:
        return name in self._given or os.path.isfile(
            self.label(name)
        )  # unlike Path.is_file, False for a name that is too long

    def take(self, name: str, place: str) -> bytes:
        if name in self._given:
            return self._given[name]
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
        found = package.get(robot)
        return Path(found.xml(entry or found.default_model)).absolute()
    except (package.MenagerieError, OSError) as error:  # its messages name what is similar
        raise InputError(f"{name}: MuJoCo Menagerie: {' '.join(str(error).split())}") from error
