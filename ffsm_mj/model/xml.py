"""Elements of a model's XML and the files that it refers to, by MuJoCo's rules; no file is opened here.

This parser must find every file that MuJoCo would open, or a model could refer to a file that was not checked. Therefore the
text is parsed as UTF-8 whatever it declares, and document types (entities, default attributes) and plugins are refused.

There are limits on what a model file may request: repeated elements, generated meshes and textures, images, reserved memory.
Values that MuJoCo does not survive are refused too: NaN, with which some of its loops never end, and percent signs in names,
which it passes to ``printf`` as a format.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from xml.parsers import expat

from ffsm_mj.errors import InputError

MOST_ELEMENTS = 200_000
"""Greatest number of elements of a model, including the copies made by ``<replicate>``."""
MOST_PIXELS = 1 << 26
"""Greatest number of pixels of all textures and height fields of a model."""
_PNG = b"\x89PNG\r\n\x1a\n"
_UNITS = {"": 1.0, "K": 2.0**10, "M": 2.0**20, "G": 2.0**30, "T": 2.0**40, "P": 2.0**50, "E": 2.0**60}
_MOST: dict[tuple[str, str], float] = {
    ("composite", "count"): 1e4,
    ("flexcomp", "count"): 1e5,
    ("numeric", "size"): 1e6,
    ("user", "dim"): 1e6,
    ("mesh", "params"): 1e6,
    ("size", "memory"): 2.0**30,
    ("size", "nstack"): 2.0**27,
}
_MOST_OF_OTHER_SIZES = 1e5
_NOT_FINITE = re.compile(r"[-+]?(nan|inf|infinity)", re.IGNORECASE)
# Attributes that hold names: a body may be called "nan".
_NAMES = frozenset(
    (
        *("name", "class", "childclass", "model", "prefix", "file", "material", "mesh", "hfield", "texture", "joint"),
        *("joint1", "joint2", "body", "body1", "body2", "geom", "geom1", "geom2", "site", "site1", "site2", "tendon"),
        *("refsite", "slidersite", "cranksite", "jointinparent", "objname", "refname", "target", "actuator", "link"),
        *("parent", "child"),
    )
)


def refuse_giant(tag: str, attributes: Mapping[str, str], place: str) -> None:
    """Refuse an element that requests more than a model needs.

    Args:
        tag: Its tag in lower case.
        attributes: Its attributes.
        place: ``file:line``.

    Raises:
        InputError: The product of the numbers of an attribute exceeds its limit.
    """
    for name, text in attributes.items():
        limit = _MOST.get((tag, name), _MOST_OF_OTHER_SIZES if tag == "size" else math.inf)
        if _product(text) > limit:
            raise InputError(f"{place}: <{tag} {name}={text[:40]!r}> requests more than {limit:g}")


def refuse_unsafe(tag: str, attributes: Mapping[str, str], place: str) -> None:
    """Refuse an element with a number that is not finite or with a percent sign.

    MuJoCo passes names to ``printf`` as a format: ``class="%n"`` crashes the process.

    Args:
        tag: Its tag in lower case.
        attributes: Its attributes.
        place: ``file:line``.

    Raises:
        InputError: An attribute contains a percent sign, or one that is not a name contains such a number.
    """
    for name, text in attributes.items():
        if "%" in text:
            raise InputError(f"{place}: <{tag} {name}={text[:40]!r}>: a model must not contain a percent sign; rename it")
        if name.lower() not in _NAMES and any(_NOT_FINITE.fullmatch(word) for word in text.split()):
            raise InputError(f"{place}: <{tag} {name}={text[:40]!r}>: every number must be finite")


def copies(tag: str, attributes: Mapping[str, str]) -> float:
    """Number of copies of the content of an element."""
    return max(1.0, _product(attributes.get("count", "1"))) if tag == "replicate" else 1.0


def pixels(tag: str, attributes: Mapping[str, str]) -> float:
    """Number of pixels that an element generates without a file."""
    if tag == "texture" and attributes.get("builtin", "none") != "none":
        width = _product(attributes.get("width", "0"))
        return width * (_product(attributes.get("height", "0")) if attributes.get("type") == "2d" else 6.0 * width)
    return _product(f"{attributes.get('nrow', '0')} {attributes.get('ncol', '0')}") if tag == "hfield" else 0.0


def image_pixels(content: bytes) -> float:
    """Number of pixels stated in the header of a PNG; zero for other content."""
    if not content.startswith(_PNG):
        return 0.0
    return float(int.from_bytes(content[16:20], "big")) * int.from_bytes(content[20:24], "big")


def _product(text: str) -> float:
    """Product of the numbers in a text, with MuJoCo's units of memory; numbers below 1 count as 1."""
    product = 1.0
    for word in text.split():
        number = re.fullmatch(r"([-+.\deE]+?)([KMGTPE]?)", word, re.IGNORECASE)
        try:
            product *= max(1.0, float(number[1]) * _UNITS[number[2].upper()]) if number else 1.0
        except ValueError:
            continue  # not a number: MuJoCo reports it
    return product


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
    collected: list[Element] = []
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
        if len(parents) >= _MAX_DEPTH or len(collected) >= MOST_ELEMENTS:
            refuse(f"more than {_MAX_DEPTH} levels or {MOST_ELEMENTS} elements of XML")
        line = f"{place}:{parser.CurrentLineNumber}"
        refuse_giant(tag, attributes, line)
        refuse_unsafe(tag, attributes, line)
        collected.append(Element(tag, attributes, tuple(parents), line, folder, repeats[-1] if repeats else 1.0))
        repeats.append(collected[-1].copies * copies(tag, attributes))
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
    return collected


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
    attributes = element.attributes
    if element.tag in ("include", "model") or (element.tag == "texture" and attributes.get("builtin", "none") != "none"):
        return
    if attributes.get("file"):
        yield attributes["file"]
    elif element.tag == "texture":
        yield from (attributes[side] for side in _CUBE_SIDES if attributes.get(side))


def _urdf_names(element: Element, settings: dict[str, str]) -> Iterator[str]:
    """Mesh file of a URDF element; meshes of visual geometry only if MuJoCo keeps it."""
    with_visual = settings.get("discardvisual") != "true"
    name = element.attributes.get("filename")
    if element.tag == "mesh" and name and ("collision" in element.parents or (with_visual and "visual" in element.parents)):
        yield name
