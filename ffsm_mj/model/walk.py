"""From one file of a model to all that it uses: includes, attached models and assets, by the names MuJoCo looks for."""

from __future__ import annotations

import posixpath
from dataclasses import dataclass, replace
from typing import Protocol

from ffsm_mj.errors import InputError
from ffsm_mj.model.allowances import MOST_ELEMENTS, MOST_PIXELS, image_pixels, pixels
from ffsm_mj.model.packages import SCHEME
from ffsm_mj.model.xml import Element, assets, elements, is_urdf, strips_folders

_MAX_DEPTH = 8


class Shelf(Protocol):
    """Where files are taken from, by normal name relative to the folder of the first one."""

    def label(self, name: str) -> str:
        """The file as messages name it."""

    def has(self, name: str) -> bool:
        """Whether there is such a file."""

    def take(self, name: str, place: str) -> bytes:
        """Its content, for whoever names it at a place (``file:line``; empty for the first one).

        Raises:
            InputError: It cannot be had, or must not.
        """

    def packaged(self, written: str, home: str, place: str) -> bytes:
        """Content of a file of a package, written ``NAME/path`` at a place in a URDF that lies in the folder ``home``.

        Raises:
            InputError: It cannot be had, or must not.
        """


def collect(main: str, shelf: Shelf) -> dict[str, bytes]:
    """Content of everything that a model uses by name, ``main`` first, in reading order.

    Raises:
        InputError: A file cannot be had, is malformed, or is named otherwise than by a path relative to the model.
    """
    if not main.lower().endswith((".xml", ".urdf")):
        raise InputError(f"{shelf.label(main)}: no model file by its name: MJCF ends in .xml, URDF in .urdf")
    if "%" in main:
        raise InputError(f"{shelf.label(main)}: the name of a model file must not hold a percent sign; rename it")
    walk = _Walk(shelf)
    walk.model(main, main, "", (), _AttachSettings())
    walk.refuse_doubt()
    return walk.found


@dataclass(frozen=True)
class _AttachSettings:
    """What a model is told by the one that attaches it.

    Attributes:
        copies: How often it is there.
        strip: Whether folders are cut off the names of assets: only the first model's ``strippath`` counts.
        astray: Whether MuJoCo looks for its files in another folder, and finds them by the last part of their names alone.
    """

    copies: float = 1.0
    strip: bool = False
    astray: bool = False


class _Walk:
    def __init__(self, shelf: Shelf) -> None:
        self._shelf, self.found = shelf, dict[str, bytes]()
        self._by_last_part: dict[str, str] = {}
        self._elements = self._pixels = 0.0

    def model(self, name: str, written: str, place: str, chain: tuple[str, ...], given: _AttachSettings) -> None:
        """A model and all that it attaches, each with its own settings."""
        home = posixpath.dirname(name)
        whole = self._document(name, written, place, home, chain, given.astray)
        strip = given.strip or (strips_folders(whole) and (not chain or is_urdf(whole)))
        copies = given.copies * max(element.copies for element in whole)
        for element in whole:
            self._count(element.place, element.copies * given.copies, pixels(element.tag, element.attributes))
        for element in whole if not is_urdf(whole) else ():
            inner = element.attributes.get("file")
            if element.tag == "model" and inner:
                # On disk it is looked for beside the file that names it; in memory its assets are as if that were the first.
                told = _AttachSettings(copies, strip, astray=given.astray or element.folder != home)
                self.model(_join(element.folder, inner), inner, element.place, (*chain, name), told)
        for asset in assets(whole, strip=strip):
            packaged = asset.name.removeprefix(SCHEME) if is_urdf(whole) else asset.name
            package = (packaged, home) if packaged != asset.name else None
            path, guessed = posixpath.join(asset.folder, packaged), strip or given.astray
            content = self._take(_join(home, path), path, asset.place, package, by_last_part=guessed)
            self._count(asset.place, 0.0, image_pixels(content))

    def _document(
        self, name: str, written: str, place: str, home: str, chain: tuple[str, ...], by_last_part: bool
    ) -> list[Element]:
        """Elements of a file, those of what it includes in the place of each include."""
        if name in chain or len(chain) > _MAX_DEPTH:
            raise InputError(f"{place}: {written!r} comes round to itself, or is more than {_MAX_DEPTH} files deep")
        content = self._take(name, written, place, by_last_part=by_last_part)
        own = elements(content, self._shelf.label(name), posixpath.dirname(name))
        if is_urdf(own):
            return own
        filled: list[Element] = []
        for element in own:
            inner = element.attributes.get("file")
            if element.tag != "include" or not inner:
                filled.append(element)
                continue
            path, guessed = _join(home, inner), by_last_part
            if not self._shelf.has(path) and self._shelf.has(beside := _join(posixpath.dirname(name), inner)):
                path, guessed = beside, True
            included = self._document(path, inner, element.place, home, (*chain, name), guessed)[1:]
            filled += [replace(each, copies=each.copies * element.copies) for each in included]
        return filled

    def _count(self, place: str, elements: float, pixels: float) -> None:
        """Add to what the model asks for in all."""
        self._elements, self._pixels = self._elements + elements, self._pixels + pixels
        if self._elements > MOST_ELEMENTS:
            raise InputError(f"{place}: with this the model has more than {MOST_ELEMENTS} elements, repeated ones included")
        if self._pixels > MOST_PIXELS:
            raise InputError(f"{place}: with this the model's images have more than {MOST_PIXELS} pixels")

    def _take(
        self, name: str, written: str, place: str, package: tuple[str, str] | None = None, *, by_last_part: bool
    ) -> bytes:
        """A file by its name; what a package holds as well, if it is not there, which then has this name."""
        if name not in self.found:
            if posixpath.isabs(written) or any(c in written for c in ":\\") or not written.isprintable():
                before = place or self._shelf.label(name)
                raise InputError(f"{before}: {written!r} is no path relative to the model, with forward slashes")
            if package and not self._shelf.has(name):
                self.found[name] = self._shelf.packaged(*package, place)
            else:
                self.found[name] = self._shelf.take(name, place)
        if by_last_part:
            self._by_last_part[name] = place
        return self.found[name]

    def refuse_doubt(self) -> None:
        """MuJoCo finds some virtual files by the last part of their name alone: that must be one file's only."""
        for name, place in self._by_last_part.items():
            others = [other for other in self.found if other != name and _last(other) == _last(name)]
            if others:
                raise InputError(f"{place}: {name} and {others[0]} have the same name; rename one of them")


def _last(name: str) -> str:
    return posixpath.basename(name).lower()


def _join(home: str, name: str) -> str:
    return posixpath.normpath(posixpath.join(home, name))
