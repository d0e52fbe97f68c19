"""A YAML file as a tree that knows, for every key and item, in which file and on which line it stands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import MarkedYAMLError, YAMLError

from ffsm_mj.errors import InputError

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
    """

    value: Any
    place: Place

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


def read_node(path: Path) -> Node:
    """Read a YAML 1.2 file.

    Raises:
        InputError: The file cannot be read or parsed, or is no mapping.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})") from error
    try:
        document = YAML(typ="rt").load(text)
    except MarkedYAMLError as error:
        raise InputError(_parse_line(path, error)) from error
    except YAMLError as error:
        raise InputError(f"{path}: {' '.join(str(error).split())}") from error
    if not isinstance(document, CommentedMap):
        raise InputError(f"{path}:1:1: a scenario is a mapping of keys to values; see 'ffsm schema'")
    return _node(document, Place(path))


def plain_value(text: str) -> Any:
    """Plain data of a piece of YAML.

    Raises:
        YAMLError: It is malformed.
    """
    return _node(YAML(typ="rt").load(text), Place(Path())).plain()


def _parse_line(path: Path, error: MarkedYAMLError) -> str:
    mark = error.problem_mark or error.context_mark
    where = Place(path, mark.line + 1, mark.column + 1) if mark is not None else path
    problem = " ".join((error.problem or error.context or "not YAML").split())
    return f"{where}: malformed YAML: {problem}"


def _node(raw: Any, place: Place) -> Node:
    """The tree below a ruamel node, without ruamel's own types: comments, anchors, formatting."""
    if isinstance(raw, CommentedMap):
        children = ((_scalar(key), value, _place(raw, key, place)) for key, value in raw.items())
        return Node({key: _node(value, where) for key, value, where in children}, place)
    if isinstance(raw, CommentedSeq):
        return Node([_node(item, _place(raw, i, place)) for i, item in enumerate(raw)], place)
    return Node(_scalar(raw), place)


def _place(container: CommentedMap | CommentedSeq, part: Any, parent: Place) -> Place:
    """Where a key or item stands; a key merged in by ``<<`` stands where its mapping does."""
    position: Sequence[int] | None = (container.lc.data or {}).get(part)
    return parent if position is None else Place(parent.path, position[0] + 1, position[1] + 1)


def _scalar(value: Any) -> Any:
    for base in (bool, int, float, str):
        if isinstance(value, base):
            return base(value)
    return value
