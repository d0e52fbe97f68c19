"""A YAML document as a tree in which anything can be put anywhere, and its text."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from ruamel.yaml import YAML

from ffsm_mj.scenario.shipped import scenarios_dir


@dataclass
class Raw:
    """YAML text that is written as it is."""

    text: str


@dataclass
class Map:
    """A mapping whose keys are texts, in order; a key may stand there twice."""

    pairs: list[tuple[str, Any]] = field(default_factory=list)


Place = tuple[Any, int]
"""A mapping or list, and a position in it."""


def shipped(name: str) -> Map:
    """A shipped scenario as a tree; ``extends`` and the models are named as a copy of the folders would have them."""
    tree = tree_of(YAML(typ="safe", pure=True).load((scenarios_dir() / f"{name}.yaml").read_text()))
    assert isinstance(tree, Map)
    return tree


def tree_of(data: Any) -> Any:
    """A document of mappings and lists as a tree."""
    if isinstance(data, dict):
        return Map([(str(key), tree_of(value)) for key, value in data.items()])
    return [tree_of(item) for item in data] if isinstance(data, list) else data


def places(node: Any) -> Iterator[Place]:
    """Every position in a tree, outer ones first."""
    items = node.pairs if isinstance(node, Map) else node if isinstance(node, list) else ()
    for i, item in enumerate(items):
        yield node, i
        yield from places(item[1] if isinstance(node, Map) else item)


def get(place: Place) -> Any:
    """Value at a place."""
    container, i = place
    return container.pairs[i][1] if isinstance(container, Map) else container[i]


def put(place: Place, value: Any) -> None:
    """Replace the value at a place."""
    container, i = place
    if isinstance(container, Map):
        container.pairs[i] = (container.pairs[i][0], value)
    else:
        container[i] = value


def text(node: Any, indent: int = 0) -> str:
    """YAML text of a tree, in block style."""
    margin = " " * indent
    if isinstance(node, Map) and node.pairs:
        lines = [f"{margin}{key}:{_child(value, indent + 2)}" for key, value in node.pairs]
    elif isinstance(node, list) and node:
        lines = [f"{margin}-{_child(value, indent + 2)}" for value in node]
    else:
        return f"{margin}{_scalar(node)}"
    return "\n".join(lines)


def _child(value: Any, indent: int) -> str:
    nested = (isinstance(value, Map) and value.pairs) or (isinstance(value, list) and value)
    return f"\n{text(value, indent)}" if nested else f" {_scalar(value)}"


def _scalar(value: Any) -> str:
    if isinstance(value, Raw):
        return value.text
    if isinstance(value, Map):
        return "{}"
    return json.dumps(value)
