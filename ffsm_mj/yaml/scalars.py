"""What a scalar of YAML means: the core schema of YAML 1.2, and nothing else.

Dates, numbers to base sixty and ``1_000`` of older YAML are texts here: a key that wants a number refuses them rather than
take another number than the one that was meant.
"""

from __future__ import annotations

import re
from typing import Any

_CORE = "tag:yaml.org,2002:"
_MOST_DIGITS = 300
_PATTERNS = {
    "null": re.compile(r"~|null|Null|NULL|"),
    "bool": re.compile(r"true|True|TRUE|false|False|FALSE"),
    "int": re.compile(r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+"),
    "float": re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)"),
}
SCALAR_TAGS = (*_PATTERNS, "str")


def core_tag(tag: str) -> str | None:
    """Name of a tag of YAML's own, such as ``int`` of ``!!int``; None of any other."""
    return tag.removeprefix(_CORE) if tag.startswith(_CORE) else None


def scalar(text: str, *, quoted: bool, tag: str | None) -> Any:
    """Value of a scalar.

    Args:
        text: As the parser gives it, without quotes.
        quoted: Whether it was written in quotes or as a block.
        tag: The tag that stands before it, if any.

    Raises:
        ValueError: The tag is none of the core schema, or the text is not of its kind; the message says what is allowed.
    """
    kind = _kind(text, quoted=quoted) if tag is None else "str" if tag == "!" else core_tag(tag)
    if kind not in SCALAR_TAGS:
        raise ValueError(f"the tag {shown_tag(str(tag))} means nothing here; leave it out")
    if kind == "str":
        return text
    if not _PATTERNS[kind].fullmatch(text):
        raise ValueError(f"!!{kind} stands before {text[:40]!r}, which is none; leave the tag out")
    return _VALUES[kind](text)


def shown_tag(tag: str) -> str:
    """A tag as somebody would write it."""
    core = core_tag(tag)
    return f"!!{core}" if core is not None else tag


def _kind(text: str, *, quoted: bool) -> str:
    if quoted:
        return "str"
    return next((kind for kind, pattern in _PATTERNS.items() if pattern.fullmatch(text)), "str")


def _whole_number(text: str) -> int:
    if len(text) > _MOST_DIGITS:
        raise ValueError(f"a number of {len(text)} digits; at most {_MOST_DIGITS} are read")
    return int(text, {"0o": 8, "0x": 16}.get(text[:2], 10))


def _number(text: str) -> float:
    return float(text.replace(".inf", "inf").replace(".nan", "nan") if text.lower().endswith(("inf", "nan")) else text)


_VALUES: dict[str, Any] = {
    "null": lambda _: None,
    "bool": lambda text: text.lower() == "true",
    "int": _whole_number,
    "float": lambda text: _number(text.lower()),
}
