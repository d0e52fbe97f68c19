"""Dotted keys that a scenario or a campaign file can have, from its JSON Schema."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from ffsm_mj.scenario.element_names import element_name

ANY = "*"
"""In place of a list position, or of a name that the file chooses."""
_DEEPEST = 8
_BRANCHES = ("anyOf", "oneOf", "allOf")
_KIND = "kind"
_UNKNOWN = object()
_ABSENT = object()
"""A value that the file does not give: its keys are listed, those below them are not."""


def key_paths(schema: Mapping[str, Any], data: Any = _UNKNOWN) -> Iterator[tuple[str, ...]]:
    """Every key of a schema with the keys that lead to it, outer keys first.

    Args:
        schema: JSON Schema.
        data: A file: its entries and named list items take the place of :data:`ANY`, and of kinds only those in use count.
    """
    yield from dict.fromkeys(_paths(schema, schema.get("$defs", {}), data, ()))


def _paths(node: Any, definitions: Mapping[str, Any], data: Any, above: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
    if not isinstance(node, Mapping) or len(above) > _DEEPEST:
        return
    if "$ref" in node:
        yield from _paths(definitions.get(node["$ref"].rpartition("/")[2]), definitions, data, above)
    for name, value in node.get("properties", {}).items():
        yield (*above, name)
        if data is _UNKNOWN:
            yield from _paths(value, definitions, _UNKNOWN, (*above, name))
        elif isinstance(data, Mapping):
            yield from _paths(value, definitions, data.get(name, _ABSENT), (*above, name))
    for key in ("additionalProperties", "items"):
        if key in node:
            for name, inner in _entries(data, key):
                if data is not _UNKNOWN:
                    yield (*above, name)
                yield from _paths(node[key], definitions, inner, (*above, name))
    for branch in (each for name in _BRANCHES for each in node.get(name, ())):
        if _is_in_use(branch, definitions, data):
            yield from _paths(branch, definitions, data, above)


def _entries(data: Any, key: str) -> Iterator[tuple[str, Any]]:
    """Names of entries of a mapping or list, with their values."""
    if data is _UNKNOWN:
        yield ANY, _UNKNOWN
    elif key == "additionalProperties" and isinstance(data, Mapping):
        yield from data.items()
    elif key == "items" and isinstance(data, list) and any(isinstance(item, Mapping) for item in data):
        for i, item in enumerate(data):
            yield element_name(item) or str(i), item


def _is_in_use(branch: Any, definitions: Mapping[str, Any], data: Any) -> bool:
    """Whether a member of a union can describe the data: a member with another kind cannot."""
    if not isinstance(data, Mapping) or _KIND not in data:
        return True
    model = definitions.get(branch.get("$ref", "").rpartition("/")[2], branch)
    kind = model.get("properties", {}).get(_KIND, {}).get("const", data[_KIND])
    return bool(kind == data[_KIND])


def nested_key(name: str, schema: Mapping[str, Any]) -> str:
    """Dotted path of the key of this name that is nested least deep, e.g. ``task.target_m``; empty if there is none."""
    found = sorted((path for path in key_paths(schema) if path[-1] == name and len(path) > 1), key=len)
    return ".".join(found[0]).replace(ANY, "NAME") if found else ""
