"""Elements of a model's XML, and the files that it refers to, by MuJoCo's rules; no file is opened here.

This parser must find every file that MuJoCo would open, or a model could refer to a file that was not checked. Therefore the
text is parsed as UTF-8 whatever it declares, and document types (entities, default attributes) and plugins are refused.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from xml.parsers import expat

from ffsm_mj.errors import InputError
from ffsm_mj.model.limits import MOST_ELEMENTS, copies, refuse_giant, refuse_unsafe

_CUBE_SIDES = ("fileright", "fileleft", "fileup", "filedown", "filefront", "fileback")
_FOLDER_OF = {"mesh": "meshdir", "hfield": "meshdir", "skin": "meshdir", "flexcomp": "meshdir", "texture": "texturedir"}
_MESHES = ("", ".stl", ".obj", ".msh")
_MAX_DEPTH = 200


@dataclass(frozen=True)
class Element:
    """An XML element.

    Attributes:
        tag: Its tag in lower case, as MuJoCo ignores case.
        attributes: Its attributes.
        parents: Tags of the enclosing elements, root first.
        place: ``file:line`` for messages.
        folder: Folder of its file.
        copies: Number of copies made by the ``<replicate>`` elements around it.
    """

    tag: str
    attributes: dict[str, str]
    parents: tuple[str, ...]
    place: str
    folder: str
    copies: float


@dataclass(frozen=True)
class Asset:
    """A file that a model uses.

    Attributes:
        folder: Folder given by the settings of the model, relative to the folder of the model.
        name: Path below that folder.
        place: ``file:line`` of the reference.
    """

    folder: str
    name: str
    place: str


def elements(xml: bytes, place: str, folder: str = "") -> list[Element]:
    """Elements of a document in order, root first.

    Args:
        xml: The document.
        place: Name of the file for messages.
        folder: Folder of the file.

    Raises:
        InputError: It is not UTF-8, not well-formed, too deep or too long, has a document type or a plugin, exceeds a limit,
            or contains values that MuJoCo does not survive.
    """
    found: list[Element] = []
    parents: list[str] = []
    repeats: list[float] = []
    parser = expat.ParserCreate("UTF-8")

    def refuse(message: str) -> None:
        raise InputError(f"{place}:{parser.CurrentLineNumber}: {message}")

    def start(name: str, attributes: dict[str, str]) -> None:
        tag = name.lower()
        # MuJoCo ignores what it does not know in a URDF, such as <ros2_control>, <transmission> and <gazebo>.
        if tag in ("plugin", "extension") and parents[:1] != ["robot"]:
            refuse(f"<{name}>: plugins are not modelled, as their effects do not enter the balance; remove it")
        if len(parents) >= _MAX_DEPTH or len(found) >= MOST_ELEMENTS:
            refuse(f"more than {_MAX_DEPTH} levels or {MOST_ELEMENTS} elements of XML")
        line = f"{place}:{parser.CurrentLineNumber}"
        refuse_giant(tag, attributes, line)
        refuse_unsafe(tag, attributes, line)
        found.append(Element(tag, attributes, tuple(parents), line, folder, repeats[-1] if repeats else 1.0))
        repeats.append(found[-1].copies * copies(tag, attributes))
        parents.append(tag)

    def end(_: str) -> None:
        parents.pop()
        repeats.pop()

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.StartDoctypeDeclHandler = lambda *_: refuse("<!DOCTYPE>: document types are not supported; remove it")
    try:
        parser.Parse(xml, True)
    except expat.ExpatError as error:
        raise InputError(
            f"{place}:{error.lineno}:{error.offset + 1}: malformed XML: {expat.ErrorString(error.code)}"
        ) from error
    return found


def is_urdf(document: Sequence[Element]) -> bool:
    """Whether MuJoCo reads a document as URDF."""
    return document[0].tag == "robot"


def has_urdf_root(xml: bytes) -> bool:
    """Whether MuJoCo reads a file as URDF, by the first tag of a document that :func:`elements` has accepted."""
    # Comments and the declaration may precede the root; document types are refused.
    return re.match(rb"(\xef\xbb\xbf)?(\s|<\?.*?\?>|<!--.*?-->)*<robot[\s/>]", xml, re.DOTALL) is not None


def strips_folders(document: Sequence[Element]) -> bool:
    """Whether the settings of a model remove folders from the names of assets."""
    return _settings(document).get("strippath") == "true"


def assets(document: Sequence[Element], *, strip: bool) -> Iterator[Asset]:
    """Meshes, textures, height fields and skins that MuJoCo opens for a model.

    Args:
        document: The model, with includes replaced by their elements.
        strip: Remove folders from their names.

    Raises:
        InputError: A mesh of a format that MuJoCo does not read.
    """
    urdf, settings = is_urdf(document), _settings(document)
    for element in document:
        for name in _urdf_names(element, settings) if urdf else _mjcf_names(element):
            if (
                element.tag == "mesh"
                and "content_type" not in element.attributes
                and os.path.splitext(name)[1].lower() not in _MESHES
            ):
                raise InputError(
                    f"{element.place}: {name!r}: meshes are read from {', '.join(_MESHES[1:])} files; convert it"
                )
            folder = settings.get(_FOLDER_OF.get(element.tag, ""), settings.get("assetdir", ""))
            yield Asset(folder, name.rsplit("/", 1)[-1] if strip else name, element.place)


def _settings(document: Sequence[Element]) -> dict[str, str]:
    settings = {"discardvisual": "true"} if is_urdf(document) else {}
    for element in document:
        if element.tag == "compiler":
            settings |= element.attributes
    return settings


def _mjcf_names(element: Element) -> Iterator[str]:
    """Files of an MJCF element, without those that MuJoCo ignores."""
    given = element.attributes
    if element.tag in ("include", "model") or (element.tag == "texture" and given.get("builtin", "none") != "none"):
        return
    if given.get("file"):
        yield given["file"]
    elif element.tag == "texture":
        yield from (given[side] for side in _CUBE_SIDES if given.get(side))


def _urdf_names(element: Element, settings: dict[str, str]) -> Iterator[str]:
    """Mesh file of a URDF element; meshes of visual geometry only if MuJoCo keeps it."""
    with_visual = settings.get("discardvisual") != "true"
    name = element.attributes.get("filename")
    if element.tag == "mesh" and name and ("collision" in element.parents or (with_visual and "visual" in element.parents)):
        yield name
