"""Every file that a model is made of: the MJCF or URDF itself, what it includes, meshes and textures.

They are attached to the log and copied into the run folder, so that a run can be repeated from what it left behind.
"""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

# Attributes that name a file, by element; URDF's <mesh> uses `filename`.
_FILE_ATTRIBUTES = ("file", "filename", "fileright", "fileleft", "fileup", "filedown", "filefront", "fileback")
_DIRECTORY_OF = {"mesh": "meshdir", "hfield": "meshdir", "skin": "meshdir", "flexcomp": "meshdir", "texture": "texturedir"}


@dataclass(frozen=True)
class ModelFiles:
    """Files of one model.

    Attributes:
        main: The MJCF or URDF file.
        files: All files, ``main`` first, absolute and in reading order.
    """

    main: Path
    files: tuple[Path, ...]

    @property
    def root(self) -> Path:
        """Deepest folder that holds all files: relative references survive a copy below it."""
        return Path(os.path.commonpath([path.parent for path in self.files]))

    def relative(self, path: Path) -> str:
        """Path of one of the files below :attr:`root`, with forward slashes."""
        return path.relative_to(self.root).as_posix()


def model_files(main: Path) -> ModelFiles:
    """List the files of a model by reading its XML; what cannot be parsed is left to MuJoCo to complain about."""
    main = main.resolve()
    found: dict[Path, None] = {main: None}
    _collect(main, main.parent, found)
    return ModelFiles(main=main, files=tuple(found))


def _collect(xml_path: Path, base: Path, found: dict[Path, None]) -> None:
    """Add what ``xml_path`` refers to; MuJoCo resolves includes and assets against the main file's folder."""
    try:
        root = ET.parse(xml_path).getroot()
    except (ET.ParseError, OSError):
        return
    compiler = root.find("compiler")
    settings = compiler.attrib if compiler is not None else {}
    for element in root.iter():
        if element.tag == "include":
            included = (base / element.get("file", "")).resolve()
            if included.is_file() and included not in found:
                found[included] = None
                _collect(included, base, found)
            continue
        directory = settings.get(_DIRECTORY_OF.get(element.tag, ""), settings.get("assetdir", ""))
        for attribute in _FILE_ATTRIBUTES:
            name = element.get(attribute)
            if name and (path := (base / directory / name).resolve()).is_file():
                found[path] = None
