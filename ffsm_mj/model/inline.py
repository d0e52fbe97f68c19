"""Models that a program gives in place of a file: as text, or as a ``mujoco.MjSpec``, which becomes text and its assets."""

from __future__ import annotations

import ctypes
import os
import posixpath
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.errors import InputError
from ffsm_mj.model.mujoco_process import library
from ffsm_mj.model.source import REFUSALS

_EXACT_DIGITS = 17
"""Decimal digits by which a double is read back exactly; MuJoCo writes six."""
_SAME = 1e-9
"""Relative difference between a compiled specification and its text: MuJoCo converts angles and recentres meshes twice."""
_NOT_COMPARED = ("geom_size", "site_size", "paths")
"""Arrays with numbers that mean nothing: a sphere has three sizes, of which XML has one; its bounding box is compared."""
_XML = Lock()


@dataclass(frozen=True)
class InlineModel:
    """A model in memory; it can be pickled, and compared.

    Attributes:
        xml: MJCF or URDF.
        assets: Contents of the files that it uses, by the names in it; others are searched in the current folder.
    """

    xml: str
    assets: Mapping[str, bytes] = field(default_factory=dict)

    def files(self, main: str) -> dict[str, bytes]:
        """Contents by name, with the model itself as ``main``."""
        return {main: self.xml.encode("utf-8", "surrogatepass")} | {
            posixpath.normpath(name): content for name, content in self.assets.items()
        }


def inline_model(model: Any) -> Any:
    """A model given as a ``mujoco.MjSpec`` or as text, as it is kept; anything else is returned unchanged.

    Args:
        model: A text whose first character, except for spaces, is ``<``; a specification; a path.

    Raises:
        InputError: MuJoCo cannot compile the specification, or it uses a file that is not found.
    """
    if isinstance(model, mujoco.MjSpec):
        return _of_spec(model)
    if isinstance(model, str) and model.lstrip("\ufeff \t\r\n").startswith("<"):
        return InlineModel(model)
    return str(model) if isinstance(model, Path) else model


def _of_spec(spec: Any) -> InlineModel:
    """The text of a specification, which is not changed, with every digit, and the files that it uses."""
    try:
        copied, assets = spec.copy(), dict[str, bytes]()
        for kind, folder in (("meshes", spec.meshdir), ("hfields", spec.meshdir), ("skins", spec.meshdir)):
            for element in getattr(copied, kind):
                if element.file:
                    element.file = _kept(element.file, folder, spec, assets)
        for texture in copied.textures:
            if texture.file:
                texture.file = _kept(texture.file, spec.texturedir, spec, assets)
            for i, file in enumerate(texture.cubefiles):
                if file:
                    texture.cubefiles[i] = _kept(file, spec.texturedir, spec, assets)
        copied.meshdir = copied.texturedir = copied.modelfiledir = ""
        copied.assets = assets
        with _exact_numbers():
            model = InlineModel(copied.to_xml(), assets)
        lost = _difference(spec.compile(), mujoco.MjSpec.from_string(model.xml, assets=assets).compile())
    except REFUSALS as error:
        raise InputError(f"MuJoCo cannot compile the specification: {' '.join(str(error).split())}") from error
    if lost:
        raise InputError(
            f"the specification as XML is another model: {lost} differs; attached models that use different files of one "
            "name need them in spec.assets, under different names"
        )
    return model


def _kept(file: str, folder: str, spec: Any, assets: dict[str, bytes]) -> str:
    """Name under which a file of a specification is kept among the assets: its own, or below a number if that is taken.

    Raises:
        InputError: There is no such file.
    """
    places = (file, posixpath.join(folder, file))
    content = next((bytes(spec.assets[place]) for place in places if place in spec.assets), None)
    if content is None:
        path = Path(spec.modelfiledir, folder, file)
        try:
            content = path.read_bytes()
        except OSError as error:
            hint = "put its content into spec.assets"
            raise InputError(f"{path}: the specification uses this file, which cannot be read; {hint}") from error
    base, number = os.path.basename(file), 1
    name = base
    while assets.setdefault(name, content) != content:
        number += 1
        name = f"{number}/{base}"
    return name


def _difference(one: Any, other: Any) -> str:
    """Name of an array in which two compiled models differ by more than rounding; empty if none does."""
    for name in dir(one):
        value = getattr(one, name)
        if not isinstance(value, np.ndarray) or name in _NOT_COMPARED:
            continue
        read = getattr(other, name)
        if value.shape != read.shape:
            return name
        if value.dtype.kind == "f" and value.size:
            scale = 1.0 + float(np.abs(value[np.isfinite(value)]).max(initial=0.0))
            if not np.allclose(value, read, rtol=_SAME, atol=_SAME * scale, equal_nan=True):
                return name
    return ""


@contextmanager
def _exact_numbers() -> Iterator[None]:
    """Context in which MuJoCo writes XML with all digits, a setting of the process."""
    c = library()
    with _XML:
        before = c._mjPRIVATE__get_xml_precision()
        c._mjPRIVATE__set_xml_precision(ctypes.c_int(_EXACT_DIGITS))
        try:
            yield
        finally:
            c._mjPRIVATE__set_xml_precision(ctypes.c_int(before))
