"""A YAML file as a tree that knows, for every key and item, in which file and on which line it stands."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

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
