"""What a command writes: seen by canaries beside its folder, by the folder itself, and by every write that Python makes.

Links of a case lead to the canaries, so a write through one of them changes what is looked at, whichever library made it.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

OUTSIDE = "outside"
"""Folder of the canaries, beside that of the case."""
CANARIES = {"precious": b"mine\n", "log.mcap": b"\x89MCAP0\r\n", "folder/kept": b"mine too\n"}
_READING = {"check", "schema", "completion", "view"}
_SQLITES = ("-journal", "-wal", "-shm")
_HALF = re.compile("[\ud800-\udbff]|[\udc00-\udc7f]|[\udd00-\udfff]")
"""Characters that no name of a file can have."""
_WRITE = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC
_BOTH = ("os.rename", "os.link", "os.symlink", "shutil.move", "shutil.copyfile")
_ONE = ("os.remove", "os.mkdir", "os.rmdir", "os.truncate", "os.chmod", "shutil.rmtree", "sqlite3.connect")


def put_canaries(folder: Path) -> None:
    """Make them."""
    for name, content in CANARIES.items():
        (folder / OUTSIDE / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / OUTSIDE / name).write_bytes(content)


def touched_canary(folder: Path) -> str:
    """A canary that is not as it was, or something new among them; empty where there is none."""
    found = {str(p.relative_to(folder / OUTSIDE)): p.read_bytes() for p in (folder / OUTSIDE).rglob("*") if p.is_file()}
    return next((name for name in sorted({*found, *CANARIES}) if found.get(name) != CANARIES.get(name)), "")


def only_reads(command: Sequence[str]) -> bool:
    """Whether a command has nothing to write."""
    name, *rest = command or ("",)
    return name in _READING or (name == "analyze" and "--plots" not in rest) or (name, *rest[:1]) == ("campaign", "status")


def listing(folder: Path) -> dict[str, tuple[int, int]]:
    """Every file below a folder with its size and time of change, without those that SQLite takes away when it reads."""
    files = (path for path in folder.rglob("*") if not path.is_dir() and not path.name.endswith(_SQLITES))
    status = {str(path.relative_to(folder)): path.lstat() for path in files}
    return {name: (each.st_size, each.st_mtime_ns) for name, each in status.items()}


class _Watch:
    """The audit hook of this process; one cannot be taken away, so it is there once and mostly does nothing."""

    def __init__(self) -> None:
        self.places: list[str] | None = None
        self._hooked = False

    def begin(self) -> None:
        if not self._hooked:
            sys.addaudithook(self._heard)
            self._hooked = True
        self.places = []

    def _heard(self, event: str, arguments: tuple[Any, ...]) -> None:
        if self.places is None:
            return
        if event == "open":
            path, _, flags = arguments
            written = [path] if isinstance(flags, int) and flags & _WRITE else []
        else:
            written = list(arguments[:2]) if event in _BOTH else list(arguments[:1]) if event in _ONE else []
        for path in written:
            if isinstance(path, str | bytes | os.PathLike):
                place = os.fsdecode(path)
                # The last part is not followed where an entry of a folder is changed, as all but opening does.
                folder, name = os.path.split(os.path.abspath(place))
                self.places.append(
                    os.path.realpath(place) if event == "open" else os.path.join(os.path.realpath(folder), name)
                )


_WATCH = _Watch()


@contextmanager
def watched() -> Iterator[list[str]]:
    """Where Python wrote, made or removed something meanwhile; complete at the end."""
    found: list[str] = []
    _WATCH.begin()
    try:
        yield found
    finally:
        found += _WATCH.places or []
        _WATCH.places = None


def stray(places: Sequence[str], folder: Path, command: Sequence[str]) -> str:
    """A place outside a folder that nobody asked to be written; empty where there is none."""
    named = [os.path.realpath(word) for word in command[1:] if word and "\0" not in word and not _HALF.search(word)]
    allowed = (os.path.realpath(folder), "/dev", "/proc", *(name for name in named if name != "/"))
    return next((place for place in places if not _below(place, allowed)), "")


def _below(place: str, roots: Sequence[str]) -> bool:
    return any(place == root or place.startswith(f"{root}/") for root in roots)
