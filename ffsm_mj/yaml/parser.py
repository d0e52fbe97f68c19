"""YAML text to a tree of nodes, and plain data to YAML text.

A text is one document with text keys, no tags beyond those of the core schema, of bounded depth and size.

ruamel.yaml composes the text into its own nodes, which have positions; they are converted here. Its constructors are not
used: they make objects out of tags, lose positions, and expand aliases of aliases until memory is exhausted.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache
from io import StringIO
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.composer import Composer, ComposerError
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.events import AliasEvent, CollectionStartEvent, ScalarEvent
from ruamel.yaml.nodes import MappingNode, ScalarNode
from ruamel.yaml.reader import ReaderError
from ruamel.yaml.tag import Tag

from ffsm_mj.errors import InputError
from ffsm_mj.invocation import command
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


_NUMBER = re.compile(r"-?[0-9]{1,20}(\.[0-9]{1,20})?(e[-+]?[0-9]{1,3})?", re.ASCII)


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
    # The composer would take a hundred times as long for the numbers of a campaign's runs.
    return scalar(text, quoted=False, tag=None) if _NUMBER.fullmatch(text) else parse(text, Path()).plain()


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
    reader = YAML(typ="safe", pure=True)
    reader.Composer = _LimitedComposer
    reader.composer.place = Place(path)
    try:
        composed = reader.compose(text)
    except ComposerError as error:  # the one that is left: undefined aliases are found before
        raise YamlFault(_place(path, error.problem_mark), "a second document begins here; a file holds one") from error
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        problem = " ".join((error.problem or error.context or "not YAML").split())
        raise YamlFault(_place(path, mark), f"malformed YAML: {problem}") from error
    except ReaderError as error:
        raise YamlFault(_at(path, text[: error.position]), _unreadable(error.character)) from error
    except (YAMLError, ValueError, OverflowError) as error:  # the number of a character, of a version
        problem = " ".join(str(error).split())
        raise YamlFault(reader.composer.place, f"malformed YAML behind this place: {problem}") from error
    return Node(None, Place(path)) if composed is None else _Converter(path).node(composed)


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


@dataclass(frozen=True)
class _Alias:
    """Stands in ruamel's tree for an alias, whose position would be lost otherwise."""

    target: Any
    place: Place


_UNTAGGED = Tag(suffix="?")  # YAML's name for it; compared by identity, since a file can write any tag
_TEXT = Tag(suffix="tag:yaml.org,2002:str")


class _LimitedComposer(Composer):
    """ruamel's composer with limits; it keeps the positions of aliases and tells a written tag from a resolved one.

    Attributes:
        place: Where the last node begins; set to the file before the first.
    """

    place: Place
    _nodes = 0

    def __init__(self, loader: Any = None) -> None:
        super().__init__(loader)
        self.warn_double_anchors = False  # YAML lets an anchor be defined again

    def compose_node(self, parent: Any, index: Any) -> Any:
        """Compose the next node; called by ruamel for the root, each key, value and item."""
        event = self.parser.peek_event()
        self.place = place = _place(self.place.path, event.start_mark)
        self._nodes += 1
        if self._nodes > 2 * MAX_VALUES:  # keys are counted here, they are no values
            raise YamlFault(self.place, f"more than {MAX_VALUES} values")
        if isinstance(event, AliasEvent):
            self._check_alias(event.anchor)
            return _Alias(super().compose_node(parent, index), place)
        if isinstance(event, CollectionStartEvent) and self.depth >= MAX_DEPTH:
            raise YamlFault(self.place, f"more than {MAX_DEPTH} lists and mappings inside one another")
        # ruamel resolves what has no tag by another schema than ours, and "!" like no tag where it means a text.
        if event.ctag is None:
            event.ctag = _UNTAGGED
        elif isinstance(event, ScalarEvent) and str(event.ctag) == "!":
            event.ctag = _TEXT
        return super().compose_node(parent, index)

    def _check_alias(self, anchor: str) -> None:
        if anchor not in self.anchors:
            raise YamlFault(self.place, f"the alias *{anchor} stands for nothing: there is no &{anchor} before it")
        if self.anchors[anchor].end_mark is None:  # a collection that has not ended
            raise YamlFault(self.place, f"the alias *{anchor} stands inside of what it stands for")


class _Converter:
    """Converts ruamel's nodes; what an alias stands for is converted once, before the alias."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._converted: dict[int, Node] = {}

    def node(self, composed: Any, depth: int = 0) -> Node:
        """Convert a node that lies inside of so many mappings and lists.

        Raises:
            YamlFault: It has a tag or a key that is not allowed, or is too large.
        """
        place = composed.place if isinstance(composed, _Alias) else _place(self._path, composed.start_mark)
        if isinstance(composed, _Alias):
            target = self._converted[id(composed.target)]
            node = Node(target.value, place, target.size, target.depth)
        elif isinstance(composed, ScalarNode):
            node = Node(_scalar(composed, place), place)
        else:
            node = self._collection(composed, place, depth)
        if node.size > MAX_VALUES:
            raise YamlFault(place, f"{node.size} values, aliases counted each time; at most {MAX_VALUES} are read")
        if node.depth + depth > MAX_DEPTH:
            raise YamlFault(place, f"more than {MAX_DEPTH} lists and mappings inside one another, aliases followed")
        self._converted[id(composed)] = node
        return node

    def _collection(self, composed: Any, place: Place, depth: int) -> Node:
        is_mapping, tag = isinstance(composed, MappingNode), str(composed.ctag)
        if composed.ctag is not _UNTAGGED and core_tag(tag) != ("map" if is_mapping else "seq"):
            raise YamlFault(place, f"the tag {shown_tag(tag)} means nothing here; leave it out")
        value: dict[str, Node] | list[Node]
        if is_mapping:
            value = self._mapping(composed, place, depth + 1)
        else:
            value = [self.node(item, depth + 1) for item in composed.value]
        inside = value.values() if isinstance(value, dict) else value
        size = 1 + sum(node.size for node in inside)
        return Node(value, place, size, 1 + max((node.depth for node in inside), default=0))

    def _mapping(self, composed: Any, place: Place, depth: int) -> dict[str, Node]:
        """Values by key, with the place of the key; a merged key yields to one written here and to one merged before."""
        own: dict[str, Node] = {}
        merged: list[Node] = []
        for composed_key, composed_value in composed.value:
            key = self.node(composed_key, depth)
            is_merge = _is_merge(composed_key)
            name = "<<" if is_merge else _key(key, own)
            node = self.node(composed_value, depth)
            if is_merge:
                merged += _mappings(node, key.place)
            else:
                own[name] = Node(node.value, key.place, node.size, node.depth)
        for mapping in merged:
            own = {key: Node(node.value, place, node.size, node.depth) for key, node in mapping.value.items()} | own
        return own


def _scalar(composed: Any, place: Place) -> Any:
    tag = None if composed.ctag is _UNTAGGED else str(composed.ctag)
    try:
        return scalar(composed.value, quoted=composed.style is not None, tag=tag)
    except ValueError as error:
        raise YamlFault(place, str(error)) from error


def _is_merge(key: Any) -> bool:
    """Whether a key is a plain ``<<``."""
    return isinstance(key, ScalarNode) and key.value == "<<" and key.style is None and key.ctag is _UNTAGGED


def _key(node: Node, mapping: dict[str, Node]) -> str:
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


def write_yaml(data: Any) -> str:
    """YAML text of plain data; the order of keys is kept."""
    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = None
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    yaml.width = 100
    out = StringIO()
    yaml.dump(data, out)
    return out.getvalue()
