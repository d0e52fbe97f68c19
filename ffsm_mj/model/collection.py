"""Collection of all files that a model uses: includes, attached models and assets, by the names that MuJoCo searches for."""

from __future__ import annotations

import posixpath
from dataclasses import dataclass, replace
from typing import Protocol

from ffsm_mj.errors import InputError
from ffsm_mj.model.limits import MOST_ELEMENTS, MOST_PIXELS, image_pixels, pixels
from ffsm_mj.model.packages import SCHEME
from ffsm_mj.model.xml import Element, assets, elements, is_urdf, strips_folders

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
    return walk.found


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
        self._shelf, self.found = shelf, dict[str, bytes]()
        self._found_by_base_name: dict[str, str] = {}
        self._elements = self._pixels = 0.0

    def model(self, name: str, written: str, place: str, chain: tuple[str, ...], given: _AttachSettings) -> None:
        """Collect a model and everything that it attaches, each with its own settings."""
        home = posixpath.dirname(name)
        whole = self._elements_of(name, written, place, home, chain, given.by_base_name)
        strip = given.strip or (strips_folders(whole) and (not chain or is_urdf(whole)))
        copies = given.copies * max(element.copies for element in whole)
        for element in whole:
            self._count(element.place, element.copies * given.copies, pixels(element.tag, element.attributes))
        for element in whole if not is_urdf(whole) else ():
            inner = element.attributes.get("file")
            if element.tag == "model" and inner:
                # MuJoCo searches for it beside the file that names it, and for its assets as if that were the first file.
                settings = _AttachSettings(copies, strip, by_base_name=given.by_base_name or element.folder != home)
                self.model(_join(element.folder, inner), inner, element.place, (*chain, name), settings)
        for asset in assets(whole, strip=strip):
            packaged = asset.name.removeprefix(SCHEME) if is_urdf(whole) else asset.name
            package = (packaged, home) if packaged != asset.name else None
            path, guessed = posixpath.join(asset.folder, packaged), strip or given.by_base_name
            content = self._take(_join(home, path), path, asset.place, package, by_base_name=guessed)
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
        own = elements(content, self._shelf.label(name), posixpath.dirname(name))
        if is_urdf(own):
            return own
        filled: list[Element] = []
        for element in own:
            inner = element.attributes.get("file")
            if element.tag != "include" or not inner:
                filled.append(element)
                continue
            # MuJoCo searches for an include in the folder of the main file first, then beside the including file.
            path, guessed = _join(home, inner), by_base_name
            if not self._shelf.has(path) and self._shelf.has(beside := _join(posixpath.dirname(name), inner)):
                path, guessed = beside, True
            included = self._elements_of(path, inner, element.place, home, (*chain, name), guessed)[1:]
            filled += [replace(each, copies=each.copies * element.copies) for each in included]
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
        if name not in self.found:
            if posixpath.isabs(written) or any(c in written for c in ":\\") or not written.isprintable():
                before = place or self._shelf.label(name)
                raise InputError(f"{before}: {written!r} is not a path relative to the model with forward slashes")
            if package and not self._shelf.has(name):
                self.found[name] = self._shelf.packaged(*package, place)
            else:
                self.found[name] = self._shelf.take(name, place)
        if by_base_name:
            self._found_by_base_name[name] = place
        return self.found[name]

    def refuse_ambiguous(self) -> None:
        """Refuse files with the same base name if MuJoCo searches for one of them by its base name only."""
        for name, place in self._found_by_base_name.items():
            others = [other for other in self.found if other != name and _base_name(other) == _base_name(name)]
            if others:
                raise InputError(f"{place}: {name} and {others[0]} have the same name; rename one of them")


def _base_name(name: str) -> str:
    return posixpath.basename(name).lower()


def _join(home: str, name: str) -> str:
    return posixpath.normpath(posixpath.join(home, name))
