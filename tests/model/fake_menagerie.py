"""What ffsm-mj uses of the package ``mujoco-menagerie``, with robots of local files in place of downloads."""

from __future__ import annotations

from pathlib import Path


class MenagerieError(Exception):
    """As the package's own."""


class UnknownRobotError(MenagerieError, LookupError):
    """As the package's own."""


class Robot:
    """A robot whose main file is ``arm.xml``."""

    default_model = "arm"

    def __init__(self, shelf: Menagerie, folder: Path) -> None:
        self._shelf, self._folder = shelf, folder

    def xml(self, entry: str) -> Path:
        """Path of a file, after the download."""
        self._shelf.downloads += 1
        path = self._folder / f"{entry}.xml"
        if not path.is_file():
            raise MenagerieError(f"{self._folder.name!r} has no entry point {entry!r}; available: arm")
        return path


class Menagerie:
    """A module with one robot, which has the name of its folder."""

    MenagerieError = MenagerieError

    def __init__(self, folder: Path) -> None:
        self._folder, self.downloads = folder, 0

    def get(self, name: str) -> Robot:
        """The robot."""
        if name != self._folder.name:
            raise UnknownRobotError(f"Unknown robot {name!r}. Did you mean {self._folder.name!r}?")
        return Robot(self, self._folder)
