"""What ffsm-mj uses of the package ``mujoco-menagerie``, with robots of local files in place of downloads."""

from __future__ import annotations

from pathlib import Path


class MenagerieError(Exception):
    """As the package's own."""


class UnknownRobotError(MenagerieError, LookupError):
    """As the package's own."""


class DownloadError(MenagerieError):
    """As the package's own."""


class Robot:
    """A robot whose main file is ``arm.xml``."""

    default_model = "arm"

    def __init__(self, shelf: Menagerie, folder: Path) -> None:
        self._shelf, self._folder = shelf, folder

    @property
    def name(self) -> str:
        """Name of the robot."""
        return self._folder.name

    @property
    def download_size(self) -> int:
        """Size of its files, bytes."""
        return sum(file.stat().st_size for file in self._folder.rglob("*") if file.is_file())

    def path(self, cache: Cache, progress: None) -> Path:
        """Its folder, after the download."""
        assert progress is None  # a bar of the package would be drawn across that of a command
        cache.robots.add(self.name)
        return self._folder

    def xml(self, entry: str) -> Path:
        """Path of a file, after the download."""
        self._shelf.downloads += 1
        path = self._folder / f"{entry}.xml"
        if not path.is_file():
            raise MenagerieError(f"{self._folder.name!r} has no entry point {entry!r}; available: arm")
        return path


class Cache:
    """Where downloads are kept."""

    root = None

    def __init__(self, robots: set[str]) -> None:
        self.robots = robots

    def is_cached(self, robot: Robot) -> bool:
        """Whether the robot is there."""
        return robot.name in self.robots


class Menagerie:
    """A module with one robot, which has the name of its folder."""

    MenagerieError, DownloadError = MenagerieError, DownloadError

    def __init__(self, folder: Path) -> None:
        self._folder, self.downloads, self._robots = folder, 0, set[str]()

    def Cache(self) -> Cache:
        """The downloads so far."""
        return Cache(self._robots)

    def get(self, name: str) -> Robot:
        """The robot."""
        if name != self._folder.name:
            raise UnknownRobotError(f"Unknown robot {name!r}. Did you mean {self._folder.name!r}?")
        return Robot(self, self._folder)
