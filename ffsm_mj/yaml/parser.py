"""YAML text to a tree of nodes: one document, keys that are texts, no tags but the plain ones, and no more than was written.

The tree is built from the parser's events rather than by its constructors: they make objects out of tags, follow aliases of
aliases until the memory is full, and recurse as deep as the file likes.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
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
from ffsm_mj.yaml.node import Node, Place
from ffsm_mj.yaml.scalars import core_tag, scalar, shown_tag

MAX_CHARACTERS = 1 << 18
"""Characters that a text may have: the parser takes some seconds for them."""
_MAX_BYTES = 4 * MAX_CHARACTERS  # a character of UTF-8 has four bytes at most
MAX_VALUES = 20_000
"""Values that a text may hold, those behind aliases counted each time."""
MAX_DEPTH = 32
"""Mappings and lists that may lie inside one another."""
_KEPT = 64  # trees of texts read last: a file is asked for its kind before it is loaded, and is what others extend


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
        raise InputError(f"{path}:1:1: a {what} is a mapping of keys to values; see 'ffsm schema'")
    return Node(root.value, Place(path))


def plain_value(text: str) -> Any:
    """Plain data of a piece of YAML.

    Raises:
        YamlFault: It is malformed.
    """
    return parse(text, Path()).plain()


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
    builder = _Builder(path)
    try:
        for event in YAML(typ="safe", pure=True).parse(text):
            builder.take(event)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        problem = " ".join((error.problem or error.context or "not YAML").split())
        raise YamlFault(_place(path, mark), f"malformed YAML: {problem}") from error
    except ReaderError as error:
        raise YamlFault(_at(path, text[: error.position]), _unreadable(error.character)) from error
    except (YAMLError, ValueError, OverflowError) as error:  # the number of a character, of a version
        problem = " ".join(str(error).split())
        raise YamlFault(builder.place, f"malformed YAML behind this place: {problem}") from error
    return builder.root


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


@dataclass
class _Open:
    """A mapping or list that has begun.

    Attributes:
        place: Where it begins.
        anchor: Its name for aliases.
        mapping: Values by key; None of a list.
        items: Values of a list.
        key: A key whose value is still to come, and where it stands; a key of None is a merge, ``<<``.
        merged: Mappings that were merged in; the first has the last word, and what stands in the mapping itself before all.
    """

    place: Place
    anchor: str | None
    mapping: dict[str, Node] | None
    items: list[Node] = field(default_factory=list)
    key: tuple[str | None, Place] | None = None
    merged: list[Node] = field(default_factory=list)

    def add(self, node: Node) -> None:
        """A key, the value of the last key, or an item."""
        if self.mapping is None:
            self.items.append(node)
        elif self.key is None:
            self.key = _key(node, self.mapping), node.place
        else:
            (name, place), self.key = self.key, None
            if name is None:
                self.merged += _mappings(node, place)
            else:
                self.mapping[name] = Node(node.value, place, node.size, node.depth)

    def node(self) -> Node:
        """The whole, once it has ended."""
        value: dict[str, Node] | list[Node] = self.items
        if self.mapping is not None:
            value = self.mapping
            for merged in self.merged:
                value = {
                    key: Node(node.value, self.place, node.size, node.depth) for key, node in merged.value.items()
                } | value
        inside = value.values() if isinstance(value, dict) else value
        size = 1 + sum(node.size for node in inside)
        return Node(value, self.place, size, 1 + max((node.depth for node in inside), default=0))


class _Merge:
    """Stands for the plain key ``<<``."""


def _key(node: Node, mapping: dict[str, Node]) -> str | None:
    if isinstance(node.value, _Merge):
        return None
    if not isinstance(node.value, str):
        what = {dict: "a mapping", list: "a list", type(None): "nothing"}.get(type(node.value), str(node.value))
        raise YamlFault(node.place, f"a key must be a text, this is {what}; write it in quotes")
    if node.value in mapping:
        first = mapping[node.value].place
        raise YamlFault(node.place, f"the key {node.value!r} stands twice in one mapping; first in line {first.line}")
    return node.value


def _mappings(node: Node, place: Place) -> list[Node]:
    found = node.value if isinstance(node.value, list) else [node]
    if not all(isinstance(item.value, dict) for item in found):
        raise YamlFault(place, "'<<' takes a mapping, or a list of mappings, to merge in")
    return [Node(item.value, place) for item in found]


class _Builder:
    """Puts events together.

    Attributes:
        root: The tree; null of an empty text.
        place: Of the last event.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._anchors: dict[str, Node | None] = {}
        self._open: list[_Open] = []
        self._documents = self._values = 0
        self.place = Place(path)
        self.root = Node(None, self.place)

    def take(self, event: Any) -> None:
        """The next event of the parser."""
        self.place = _place(self._path, event.start_mark)
        self._values += 1
        if self._values > 2 * MAX_VALUES:  # a mapping's keys are no values, and the end of a list is an event
            raise YamlFault(self.place, f"more than {MAX_VALUES} values")
        if isinstance(event, AliasEvent):
            self._add(self._known(event.anchor))
        elif isinstance(event, ScalarEvent):
            self._anchored(event.anchor, Node(self._scalar(event), self.place))
        elif isinstance(event, CollectionStartEvent):
            self._begin(event)
        elif isinstance(event, CollectionEndEvent):
            ended = self._open.pop()
            self._anchored(ended.anchor, ended.node())
        elif isinstance(event, DocumentStartEvent):
            self._documents += 1
            if self._documents > 1:
                raise YamlFault(self.place, "a second document begins here; a file holds one")

    def _scalar(self, event: Any) -> Any:
        is_key = bool(self._open) and self._open[-1].mapping is not None and self._open[-1].key is None
        if is_key and event.value == "<<" and event.style is None and event.ctag is None:
            return _Merge()
        try:
            return scalar(event.value, quoted=event.style is not None, tag=None if event.ctag is None else str(event.ctag))
        except ValueError as error:
            raise YamlFault(self.place, str(error)) from error

    def _begin(self, event: Any) -> None:
        mapping = isinstance(event, MappingStartEvent)
        if event.ctag is not None and str(event.ctag) != "!" and core_tag(str(event.ctag)) != ("map" if mapping else "seq"):
            raise YamlFault(self.place, f"the tag {shown_tag(str(event.ctag))} means nothing here; leave it out")
        if len(self._open) >= MAX_DEPTH:
            raise YamlFault(self.place, f"more than {MAX_DEPTH} lists and mappings inside one another")
        if event.anchor is not None:
            self._anchors[event.anchor] = None  # not whole yet
        self._open.append(_Open(self.place, event.anchor, {} if mapping else None))

    def _known(self, anchor: str) -> Node:
        if anchor not in self._anchors:
            raise YamlFault(self.place, f"the alias *{anchor} stands for nothing: there is no &{anchor} before it")
        node = self._anchors[anchor]
        if node is None:
            raise YamlFault(self.place, f"the alias *{anchor} stands inside of what it stands for")
        return Node(node.value, self.place, node.size, node.depth)

    def _anchored(self, anchor: str | None, node: Node) -> None:
        if anchor is not None:
            self._anchors[anchor] = node
        self._add(node)

    def _add(self, node: Node) -> None:
        if node.size > MAX_VALUES:
            raise YamlFault(node.place, f"{node.size} values, aliases counted each time; at most {MAX_VALUES} are read")
        if node.depth + len(self._open) > MAX_DEPTH:
            raise YamlFault(self.place, f"more than {MAX_DEPTH} lists and mappings inside one another, aliases followed")
        if self._open:
            self._open[-1].add(node)
        else:
            self.root = node
