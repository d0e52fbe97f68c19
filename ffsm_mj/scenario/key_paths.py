"""Dotted keys that a scenario or a campaign file can have, from its JSON Schema."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

ANY = "*"
"""In place of a list position, or of a name that the file chooses."""
_DEEPEST = 8
_BRANCHES = ("anyOf", "oneOf", "allOf")


def key_paths(schema: Mapping[str, Any]) -> Iterator[tuple[str, ...]]:
    """Every key of a schema with the keys that lead to it, outer keys first; see :data:`ANY`."""
    yield from dict.fromkeys(_paths(schema, schema.get("$defs", {}), ()))


def _paths(node: Any, definitions: Mapping[str, Any], above: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
    if not isinstance(node, Mapping) or len(above) > _DEEPEST:
        return
    if "$ref" in node:
        yield from _paths(definitions.get(node["$ref"].rpartition("/")[2]), definitions, above)
    for name, value in node.get("properties", {}).items():
        yield (*above, name)
        yield from _paths(value, definitions, (*above, name))
    for each in (node.get("additionalProperties"), node.get("items")):
        yield from _paths(each, definitions, (*above, ANY))
    for branch in (each for name in _BRANCHES for each in node.get(name, ())):
        yield from _paths(branch, definitions, above)


def nested_key(name: str, schema: Mapping[str, Any]) -> str:
    """Dotted path of the key of this name that is nested least deep, e.g. ``task.target_m``; empty if there is none."""
    found = [path for path in key_paths(schema) if path[-1] == name and len(path) > 1]
    found.sort(key=len)
    return ".".join(found[0]).replace(ANY, "NAME") if found else ""
