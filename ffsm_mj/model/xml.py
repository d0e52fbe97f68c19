"""Which files a model's XML refers to, by the rules by which MuJoCo finds them; nothing is opened here.

What MuJoCo reads and what this file finds must be the same, or a model could name a file that nobody has looked at. So the
text is taken as UTF-8 whatever it declares, document types (entities, default attributes) are refused, and so are plugins.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from xml.parsers import expat

from ffsm_mj.errors import InputError
from ffsm_mj.model.allowances import MOST_ELEMENTS, copies, refuse_giant, refuse_poison

_CUBE_SIDES = ("fileright", "fileleft", "fileup", "filedown", "filefront", "fileback")
_FOLDER_OF = {"mesh": "meshdir", "hfield": "meshdir", "skin": "meshdir", "flexcomp": "meshdir", "texture": "texturedir"}
_MAX_DEPTH = 200


@dataclass(frozen=True)
class Element:
    """An XML element.

    Attributes:
        tag: Its name in lower case: MuJoCo does not tell ``Include`` from ``include``.
        attributes: Its attributes.
        parents: Tags of the elements around it, the root first.
        place: ``file:line`` for messages.
        folder: Folder of the file that it stands in.
        copies: How often it is there: once for each time that a ``<replicate>`` around it repeats what it holds.
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
        folder: Where the model's settings look for it, relative to the model's own folder.
        name: Its path below that.
        place: ``file:line`` where it is named.
    """

    folder: str
    name: str
    place: str


def elements(xml: bytes, place: str, folder: str = "") -> list[Element]:
    """Elements of a document in their order, the root first.

    Args:
        xml: The document.
        place: Name of the file for messages.
        folder: Folder of the file.

    Raises:
        InputError: It is not UTF-8, not well-formed, too deep or too long, has a document type, asks for a plugin or for
            too much, or holds what MuJoCo cannot bear.
    """
    found: list[Element] = []
    parents: list[str] = []
    repeats: list[float] = []
    parser = expat.ParserCreate("UTF-8")

    def refuse(message: str) -> None:
        raise InputError(f"{place}:{parser.CurrentLineNumber}: {message}")

    def start(name: str, attributes: dict[str, str]) -> None:
        tag = name.lower()
        if tag in ("plugin", "extension") and parents[:2] != ["robot", "gazebo"]:  # a URDF's notes for another simulator
            refuse(f"<{name}>: plugins are not modelled, what they do is in no balance; remove it")
        if len(parents) >= _MAX_DEPTH or len(found) >= MOST_ELEMENTS:
            refuse(f"more than {_MAX_DEPTH} levels or {MOST_ELEMENTS} elements of XML")
        line = f"{place}:{parser.CurrentLineNumber}"
        refuse_giant(tag, attributes, line)
        refuse_poison(tag, attributes, line)
        found.append(Element(tag, attributes, tuple(parents), line, folder, repeats[-1] if repeats else 1.0))
        repeats.append(found[-1].copies * copies(tag, attributes))
        parents.append(tag)

    def end(_: str) -> None:
        parents.pop()
        repeats.pop()

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.StartDoctypeDeclHandler = lambda *_: refuse("<!DOCTYPE>: a model has no document type; remove it")
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


def strips_folders(document: Sequence[Element]) -> bool:
    """Whether a model's settings cut folders off the names of assets."""
    return _settings(document).get("strippath") == "true"


def assets(document: Sequence[Element], *, strip: bool) -> Iterator[Asset]:
    """Meshes, textures, height fields and skins that MuJoCo opens for a model.

    Args:
        document: The model, its includes filled in.
        strip: Cut folders off their names.
    """
    urdf, settings = is_urdf(document), _settings(document)
    for element in document:
        for name in _urdf_names(element, settings) if urdf else _mjcf_names(element):
            folder = settings.get(_FOLDER_OF.get(element.tag, ""), settings.get("assetdir", ""))
            yield Asset(folder, name.rsplit("/", 1)[-1] if strip else name, element.place)


def _settings(document: Sequence[Element]) -> dict[str, str]:
    settings = {"discardvisual": "true"} if is_urdf(document) else {}
    for element in document:
        if element.tag == "compiler":
            settings |= element.attributes
    return settings


def _mjcf_names(element: Element) -> Iterator[str]:
    """Files of an element of MJCF; what stands there and is ignored is not among them."""
    given = element.attributes
    if element.tag in ("include", "model") or (element.tag == "texture" and given.get("builtin", "none") != "none"):
        return
    if given.get("file"):
        yield given["file"]
    elif element.tag == "texture":
        yield from (given[side] for side in _CUBE_SIDES if given.get(side))


def _urdf_names(element: Element, settings: dict[str, str]) -> Iterator[str]:
    """Files of an element of URDF: of meshes; those that are only looked at count where visual geometry is kept."""
    seen = settings.get("discardvisual") != "true"
    name = element.attributes.get("filename")
    if element.tag == "mesh" and name and ("collision" in element.parents or (seen and "visual" in element.parents)):
        yield name
