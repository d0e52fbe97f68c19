"""Limits on what a model file may request: repeated elements, generated meshes and textures, images, reserved memory.

Values that MuJoCo does not survive are refused too: NaN, with which some of its loops never end, and percent signs in names,
which it passes to ``printf`` as a format.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

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
