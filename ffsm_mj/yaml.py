"""YAML 1.2 with the place of every key and value.

A text is one document with text keys, no tags beyond those of the core schema, of bounded depth and size. Scalars mean what
the core schema says and nothing else: dates, numbers to base sixty and ``1_000`` of older YAML are texts, which a key that
wants a number refuses, rather than another number than the one that was meant.

ruamel.yaml parses the text to events, which have positions. Its constructors are not used: they make objects out of tags,
lose positions, and expand aliases of aliases until memory is exhausted.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from io import StringIO
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.events import (
    AliasEvent,
    CollectionEndEvent,
    CollectionStartEvent,
    DocumentStartEvent,
    MappingStartEvent,
    ScalarEvent,
)
from ruamel.yaml.reader import ReaderError

from ffsm_mj.errors import InputError
from ffsm_mj.invocation import command

MAX_CHARACTERS = 1 << 18
"""Characters that a text may have: the parser takes some seconds for them."""
_MAX_BYTES = 4 * MAX_CHARACTERS  # a character of UTF-8 has four bytes at most
MAX_VALUES = 20_000
"""Values that a text may hold, those behind aliases counted each time."""
MAX_DEPTH = 32
"""Mappings and lists that may lie inside one another."""
_KEPT = 64  # trees of texts read last: a file is asked for its kind before it is loaded, and is what others extend
_MOST_DIGITS = 300

_NUMBER = re.compile(r"-?[0-9]{1,20}(\.[0-9]{1,20})?(e[-+]?[0-9]{1,3})?", re.ASCII)
_CORE = "tag:yaml.org,2002:"
_PATTERNS = {
    "null": re.compile(r"~|null|Null|NULL|"),
    "bool": re.compile(r"true|True|TRUE|false|False|FALSE"),
    "int": re.compile(r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+"),
    "float": re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)"),
}
KeyPath = tuple[str | int, ...]


@dataclass(frozen=True, order=True)
class Place:
    """A file, and line and column in it from 1."""

    path: Path
    line: int = 1
    column: int = 1

    def __str__(self) -> str:
        """``file:line:column``."""
        return f"{self.path}:{self.line}:{self.column}"


@dataclass(frozen=True)
class Node:
    """A value and where its key or item stands.

    Attributes:
        value: A dict of nodes, a list of nodes, or a plain scalar.
        place: Where it stands.
        size: Values in it, itself and those behind aliases counted.
        depth: How many mappings and lists lie inside one another below it.
    """

    value: Any
    place: Place
    size: int = 1
    depth: int = 0

    def plain(self) -> Any:
        """The value without places."""
        if isinstance(self.value, dict):
            return {key: node.plain() for key, node in self.value.items()}
        return [node.plain() for node in self.value] if isinstance(self.value, list) else self.value

    def find(self, path: KeyPath) -> Node:
        """The deepest node on a path of keys and list positions."""
        node = self
        for part in path:
            inside = isinstance(node.value, dict) and part in node.value
            if not inside and not (isinstance(node.value, list) and isinstance(part, int) and part < len(node.value)):
                break
            node = node.value[part]
        return node


class YamlFault(Exception):
    """What is wrong with a text, and where."""

    def __init__(self, place: Place, problem: str) -> None:
        self.place, self.problem = place, problem
        super().__init__(f"{place}: {problem}")


def read_node(path: Path, what: str = "scenario") -> Node:
    """Read a YAML 1.2 file.

    Args:
        path: The file.
        what: What it is to be, for messages.

    Raises:
        InputError: The file cannot be read or parsed, or is no mapping.
    """
    try:
        with path.open("rb") as stream:
            content = stream.read(_MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})") from error
    if len(content) > _MAX_BYTES:
        raise InputError(f"{path}:1:1: more than {_MAX_BYTES >> 20} MB; a {what} has at most {MAX_CHARACTERS} characters")
    try:
        root = parse(_decoded(content, path), path)
    except YamlFault as fault:
        raise InputError(str(fault)) from fault
    if not isinstance(root.value, dict):
        raise InputError(f"{path}:1:1: a {what} is a mapping of keys to values; see '{command('schema')}'")
    return Node(root.value, Place(path))


def plain_value(text: str) -> Any:
    """Plain data of a piece of YAML.

    Raises:
        YamlFault: It is malformed.
    """
    # The parser would take a hundred times as long for the numbers of a campaign's runs.
    return _scalar(text, quoted=False, tag=None) if _NUMBER.fullmatch(text) else parse(text, Path()).plain()


@lru_cache(_KEPT)
def parse(text: str, path: Path) -> Node:
    """Tree of a text with at most one document; the same text from the same file gives the same object, to be only read.

    Args:
        text: YAML.
        path: The file it came from, for the places of the nodes.

    Raises:
        YamlFault: It is malformed, too large, or uses what a scenario has no use for.
    """
    if len(text) > MAX_CHARACTERS:
        raise YamlFault(Place(path), f"{len(text)} characters; at most {MAX_CHARACTERS} are read")
    tree = _Tree(path, YAML(typ="safe", pure=True).parse(text))
    try:
        return tree.document()
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        problem = " ".join((error.problem or error.context or "not YAML").split())
        raise YamlFault(_place(path, mark), f"malformed YAML: {problem}") from error
    except ReaderError as error:
        raise YamlFault(_at(path, text[: error.position]), _unreadable(error.character)) from error
    except (YAMLError, ValueError, OverflowError) as error:  # the number of a character, of a version
        problem = " ".join(str(error).split())
        raise YamlFault(tree.place, f"malformed YAML behind this place: {problem}") from error


def _decoded(content: bytes, path: Path) -> str:
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = content[: error.start].decode("utf-8", "replace")
        raise YamlFault(
            _at(path, before), f"is not UTF-8: byte {content[error.start]:#04x}; save the file as UTF-8"
        ) from error


def _unreadable(character: int) -> str:
    return f"malformed YAML: the character {character:#06x} is not allowed in a file; write it as an escape in double quotes"


def _at(path: Path, before: str) -> Place:
    """The place behind some text."""
    lines = before.split("\n")
    return Place(path, len(lines), len(lines[-1]) + 1)


def _place(path: Path, mark: Any) -> Place:
    return Place(path, mark.line + 1, mark.column + 1) if mark is not None else Place(path)


class _Tree:
    """Builds the tree of a text from ruamel's events; what an alias stands for is built once, where its anchor stands.

    Attributes:
        place: Where the last node begins; the file before the first.
    """

    def __init__(self, path: Path, events: Iterator[Any]) -> None:
        self.place, self._path, self._events = Place(path), path, events
        self._anchors: dict[str, Node | None] = {}  # None: a collection that has not ended
        self._nodes = 0

    def document(self) -> Node:
        """The only document; a node without value if there is none."""
        root = None
        for event in self._events:
            if isinstance(event, DocumentStartEvent):
                if root is not None:
                    place = _place(self._path, event.start_mark)
                    raise YamlFault(place, "a second document begins here; a file holds one")
                root = self._node(next(self._events), 0)
        return Node(None, Place(self._path)) if root is None else root

    def _node(self, event: Any, depth: int) -> Node:
        """The node that begins with an event, inside of so many mappings and lists.

        Raises:
            YamlFault: It has a tag or a key that is not allowed, or is too large.
        """
        self.place = place = _place(self._path, event.start_mark)
        self._nodes += 1
        if self._nodes > 2 * MAX_VALUES:  # keys are counted here, they are no values
            raise YamlFault(place, f"more than {MAX_VALUES} values")
        if isinstance(event, AliasEvent):
            target = self._target(event.anchor)
            node = Node(target.value, place, target.size, target.depth)
        elif isinstance(event, ScalarEvent):
            node = Node(_value(event, place), place)
        else:
            node = self._collection(event, place, depth)
        if node.size > MAX_VALUES:
            raise YamlFault(place, f"{node.size} values, aliases counted each time; at most {MAX_VALUES} are read")
        if node.depth + depth > MAX_DEPTH:
            raise YamlFault(place, f"more than {MAX_DEPTH} lists and mappings inside one another, aliases followed")
        # An anchor may be defined again, also inside of what it stands for: the last one in the text counts.
        if isinstance(event, ScalarEvent) or (event.anchor and self._anchors[event.anchor] is None):
            self._anchors[event.anchor] = node
        return node

    def _target(self, anchor: str) -> Node:
        if anchor not in self._anchors:
            raise YamlFault(self.place, f"the alias *{anchor} stands for nothing: there is no &{anchor} before it")
        if (target := self._anchors[anchor]) is None:
            raise YamlFault(self.place, f"the alias *{anchor} stands inside of what it stands for")
        return target

    def _collection(self, event: CollectionStartEvent, place: Place, depth: int) -> Node:
        if depth >= MAX_DEPTH:
            raise YamlFault(place, f"more than {MAX_DEPTH} lists and mappings inside one another")
        is_mapping, tag = isinstance(event, MappingStartEvent), str(event.ctag or "!")
        if tag not in ("!", f"{_CORE}{'map' if is_mapping else 'seq'}"):
            raise YamlFault(place, f"the tag {_shown(tag)} means nothing here; leave it out")
        if event.anchor:
            self._anchors[event.anchor] = None
        value: dict[str, Node] | list[Node]
        value = self._mapping(place, depth + 1) if is_mapping else [self._node(part, depth + 1) for part in self._inside()]
        inside = value.values() if isinstance(value, dict) else value
        size = 1 + sum(node.size for node in inside)
        return Node(value, place, size, 1 + max((node.depth for node in inside), default=0))

    def _inside(self) -> Iterator[Any]:
        """First events of what is in a collection, each taken when the node before it is complete."""
        while not isinstance(event := next(self._events), CollectionEndEvent):
            yield event

    def _mapping(self, place: Place, depth: int) -> dict[str, Node]:
        """Values by key, with the place of the key; a merged key yields to one written here and to one merged before."""
        entries: dict[str, Node] = {}
        merged: list[Node] = []
        for event in self._inside():
            key = self._node(event, depth)
            is_merge = isinstance(event, ScalarEvent) and (event.value, event.style, event.ctag) == ("<<", None, None)
            name = "<<" if is_merge else _key(key, entries)
            node = self._node(next(self._events), depth)
            if is_merge:
                merged += _mappings(node, key.place)
            else:
                entries[name] = Node(node.value, key.place, node.size, node.depth)
        for mapping in merged:
            entries = {key: Node(node.value, place, node.size, node.depth) for key, node in mapping.value.items()} | entries
        return entries


def _key(node: Node, mapping: dict[str, Node]) -> str:
    if not isinstance(node.value, str):
        what = {dict: "a mapping", list: "a list", type(None): "nothing"}.get(type(node.value), str(node.value))
        raise YamlFault(node.place, f"a key must be a text, this is {what}; write it in quotes")
    if node.value in mapping:
        first = mapping[node.value].place
        raise YamlFault(node.place, f"the key {node.value!r} stands twice in one mapping; first in line {first.line}")
    return node.value


def _mappings(node: Node, place: Place) -> list[Node]:
    nodes = node.value if isinstance(node.value, list) else [node]
    if not all(isinstance(item.value, dict) for item in nodes):
        raise YamlFault(place, "'<<' takes a mapping, or a list of mappings, to merge in")
    return nodes


def _value(event: ScalarEvent, place: Place) -> Any:
    try:
        return _scalar(event.value, quoted=event.style is not None, tag=str(event.ctag) if event.ctag else None)
    except ValueError as error:
        raise YamlFault(place, str(error)) from error


def _scalar(text: str, *, quoted: bool, tag: str | None) -> Any:
    """Value of a scalar, in quotes or as a block, with the tag that stands before it, if any.

    Raises:
        ValueError: The tag is none of the core schema, or the text is not of its kind; the message says what is allowed.
    """
    if tag is None:
        matching = (kind for kind, pattern in _PATTERNS.items() if pattern.fullmatch(text))
        kind = "str" if quoted else next(matching, "str")
    else:
        kind = "str" if tag == "!" else tag.removeprefix(_CORE) if tag.startswith(_CORE) else ""
    if kind == "str":
        return text
    if kind not in _PATTERNS:
        raise ValueError(f"the tag {_shown(str(tag))} means nothing here; leave it out")
    if not _PATTERNS[kind].fullmatch(text):
        raise ValueError(f"!!{kind} stands before {text[:40]!r}, which is none; leave the tag out")
    if kind == "float":
        return float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))
    if kind != "int":
        return text.lower() == "true" if kind == "bool" else None
    if len(text) > _MOST_DIGITS:
        raise ValueError(f"a number of {len(text)} digits; at most {_MOST_DIGITS} are read")
    return int(text, {"0o": 8, "0x": 16}.get(text[:2], 10))


def _shown(tag: str) -> str:
    """A tag as somebody would write it."""
    return f"!!{tag.removeprefix(_CORE)}" if tag.startswith(_CORE) else tag


def write_yaml(data: Any) -> str:
    """YAML text of plain data; the order of keys is kept."""
    return _written(data, None, 100)


def write_flow(data: Any) -> str:
    """YAML text of plain data on one line."""
    # A scalar alone would be followed by a mark of the end of the document.
    return _written([data], True, sys.maxsize)[1:-2]


def _written(data: Any, flow: bool | None, width: int) -> str:
    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = flow
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    yaml.width = width
    out = StringIO()
    yaml.dump(data, out)
    return out.getvalue()
