"""Validation errors of pydantic as messages: the key as in the file, what is wrong, what is allowed; keys of a schema."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from types import UnionType
from typing import Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError

from ffsm_mj.errors import Fault, unknown_name
from ffsm_mj.fields.config import MAGNETIC_KINDS
from ffsm_mj.scenario.env_config import ACTION_KINDS
from ffsm_mj.scenario.source import element_name
from ffsm_mj.yaml import KeyPath

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
    for branch in (child for name in _BRANCHES for child in node.get(name, ())):
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
    paths = sorted((path for path in key_paths(schema) if path[-1] == name and len(path) > 1), key=len)
    return ".".join(paths[0]).replace(ANY, "NAME") if paths else ""


_ALMOST_EQUAL = 0.85


@dataclass(frozen=True)
class KindNames:
    """Names of kinds that messages need.

    Attributes:
        model: The root configuration model.
        controllers: Kinds of controllers.
        actuators: Kinds of actuators.
        broken: Why the kind of a plug-in cannot be used.
        of_scripts: Kinds whose control laws a script had passed to the run that wrote the scenario.
        estimators: Kinds of estimators.
    """

    model: type[BaseModel]
    controllers: Collection[str]
    actuators: Collection[str]
    broken: Mapping[str, str]
    of_scripts: Collection[str] = ()
    estimators: Collection[str] = ()


def plain_faults(error: ValidationError, names: KindNames) -> list[Fault]:
    """One fault per error, without consequential errors."""
    items = _without_other_members(error)
    return [_fault(item, names) for item in items if not _follows(item, items)]


def _follows(item: Any, items: list[Any]) -> bool:
    """Whether an error (a list that is too short, a default that cannot be created) only follows from another one."""
    place = item["loc"]
    if item["type"] == "default_factory_not_called":
        return True
    return item["type"] == "too_short" and any(len(o["loc"]) > len(place) and o["loc"][: len(place)] == place for o in items)


_PLAIN_WORDS = (
    ("Value error, ", ""),
    ("Input should", "should"),
    ("String should match pattern", "must be written like"),
    ("Tuple should", "should"),
    ("Dictionary should", "should"),
    (" after validation", ""),
    ("a valid dictionary", "a mapping of keys"),
    ("valid tuple", "list"),
    ("tuple", "list"),
)


def _fault(item: Any, names: KindNames) -> Fault:
    """Fault of a pydantic error: the path without union tags, the message with what is allowed."""
    kind, message = item["type"], item["msg"]
    path = _file_path(item["loc"], names)
    if kind == "extra_forbidden":
        return Fault(_unknown_key(names.model, item["loc"]), path)
    if kind == "union_tag_invalid":
        context = item["ctx"]
        return Fault(_unknown_kind(context["tag"], context["expected_tags"], path, names), (*path, "kind"))
    if kind == "union_tag_not_found":
        allowed = names.controllers if _is_law(path) else names.estimators if path == ("estimator",) else ()
        return Fault("needs a 'kind'; allowed: " + ", ".join(sorted(allowed)) if allowed else message, path)
    if kind == "missing":
        return Fault("is missing", path)
    if kind == "model_type":
        return Fault(_needs_mapping(names.model, item["loc"], item["input"]), path)
    for technical, plain in _PLAIN_WORDS:
        message = message.replace(technical, plain)
    value = item["input"]
    shown = f", got {json.dumps(value)}" if isinstance(value, str | int | float | bool) else ""
    return Fault(f"{message}{shown}", path)


def _is_law(path: KeyPath) -> bool:
    """Whether a path of the file leads to a control law or into one."""
    return "controller" in path or "controllers" in path


def _without_other_members(error: ValidationError) -> list[Any]:
    """Errors of only the best-fitting member of each plain union, so that one fault gives one line."""
    items: list[Any] = list(error.errors(include_url=False))
    members: dict[Any, dict[Any, list[Any]]] = {}
    out: list[Any] = []
    for item in items:
        at = next((i for i, part in enumerate(item["loc"]) if _is_union_member(part)), None)
        if at is None:
            out.append(item)
        else:
            members.setdefault(item["loc"][:at], {}).setdefault(item["loc"][at], []).append(item)
    for choices in members.values():
        best: list[Any] = max(choices.values(), key=_fit)
        out += best
    return out


def _fit(errors: list[Any]) -> tuple[int, bool, int]:
    """Rank of a union member by the depth of its errors, whether its type was right, and the number of errors."""
    wrong_shape = any(item["type"] in ("tuple_type", "literal_error", "string_type") for item in errors)
    return max(len(item["loc"]) for item in errors), not wrong_shape, -len(errors)


def _file_path(location: KeyPath, names: KindNames) -> KeyPath:
    """Keys of the file in a pydantic location, without union members and tags."""
    known = {*names.controllers, *names.actuators, *names.estimators, *ACTION_KINDS, *MAGNETIC_KINDS}
    out: list[str | int] = []
    for i, part in enumerate(location):
        after_union = i > 0 and (
            location[i - 1] in ("controller", "estimator", "magnetic_field")
            or (len(out) >= 2 and out[-2] in ("actuators", "controllers", "actions"))
        )
        if isinstance(part, str) and ((after_union and part in known) or _is_union_member(part)):
            continue
        out.append(part)
    return tuple(out)


def _is_union_member(part: str | int) -> bool:
    """Whether a step of a pydantic location names a member of a plain union rather than a key."""
    name = str(part)
    return (
        name in ("float", "int", "str", "bool", "[key]")
        or name.startswith(("constrained-", "literal[", "tuple[", "function-"))
        or name.endswith("Config")
    )


def _unknown_key(model: Any, location: KeyPath) -> str:
    """Message for an unknown key, with the known ones."""
    for part in location[:-1]:
        model = _member(model, part)
    if not _is_model(model):
        return "unknown key"
    key, keys = str(location[-1]), _keys(model)
    refused: Mapping[str, str] = getattr(model, "refused_keys", {})
    for word, reason in refused.items():
        if word in key.lower():
            return f"unknown key: {reason}; allowed: {', '.join(sorted(keys))}"
    at_root = len(location) == 1 and not get_close_matches(key, keys, cutoff=_ALMOST_EQUAL)
    if at_root and (nested := nested_key(key, model.model_json_schema())):
        return f"unknown key at this level (did you mean {nested!r}?); allowed: {', '.join(sorted(keys))}"
    return unknown_name("key", key, keys).replace(f"key {key!r}", "key", 1)


def _needs_mapping(model: Any, location: KeyPath, value: Any) -> str:
    """Message for a value where keys are expected; YAML reads 'key:value' as text."""
    for part in location:
        model = _member(model, part)
    allowed = f"; allowed: {', '.join(sorted(_keys(model)))}" if _is_model(model) else ""
    shown = f", got {json.dumps(value)}" if isinstance(value, str | int | float | bool) else ""
    space = " (a space follows the colon of a key)" if isinstance(value, str) and ":" in value else ""
    return f"should be a mapping of keys{shown}{space}{allowed}"


def _keys(model: Any) -> Mapping[str, Any]:
    """Fields of a model by the keys that a file has for them."""
    return {field.alias or name: field for name, field in model.model_fields.items()}


def _member(node: Any, part: str | int) -> Any:
    """Model or annotation of one element of a pydantic location: a field, a list position, a key, or a union's tag."""
    if _is_model(node):
        field = _keys(node).get(str(part))
        return _unwrap(field.annotation) if field is not None else None
    if models := getattr(node, "of_kind", {}):
        return models.get(str(part))
    members = [_unwrap(arg) for arg in getattr(node, "__args__", ()) if arg is not type(None)]
    tagged = {m.model_fields["kind"].annotation.__args__[0]: m for m in members if _is_model(m) and "kind" in m.model_fields}
    if part in tagged:
        return tagged[part]
    models = [_unwrap(member) for member in members if member not in (str, Ellipsis)]
    return models[-1] if models else None


def _unwrap(annotation: Any) -> Any:
    """An annotation without its metadata and without None."""
    while getattr(annotation, "__metadata__", None):
        annotation = annotation.__origin__
    members = [arg for arg in get_args(annotation) if arg is not type(None)]
    return _unwrap(members[0]) if len(members) == 1 and get_origin(annotation) in (Union, UnionType) else annotation


def _is_model(node: Any) -> bool:
    return isinstance(node, type) and issubclass(node, BaseModel)


def _unknown_kind(tag: str, expected: str, path: KeyPath, names: KindNames) -> str:
    usable = [kind.strip("' ") for kind in expected.split(",")]
    is_estimator = path == ("estimator",)
    broken = names.broken.get(tag) if _is_law(path) or is_estimator else None
    if broken:
        return f"the plugin for kind {tag!r} cannot be used ({broken}); usable: {', '.join(usable)}"
    if tag in names.of_scripts and (_is_law(path) or is_estimator):
        what, option = ("estimator", "estimators") if is_estimator else ("control law", "controllers")
        return (
            f"the {what} of kind {tag!r} was passed by a script and is not in the file: run it from Python again, "
            f"ffsm_mj.run(..., {option}={{{tag!r}: ...}}); usable without: {', '.join(usable)}"
        )
    return unknown_name("kind", tag, usable)
