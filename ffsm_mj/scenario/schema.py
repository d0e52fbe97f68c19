"""JSON Schema of scenario files for editors: of a complete scenario, and of one that extends another.

A scenario that extends another may omit required keys, and ``null`` removes an entry.
"""

from __future__ import annotations

from copy import deepcopy
from typing import Any

from ffsm_mj.scenario.models import SCENE
from ffsm_mj.scenario.scenario import ScenarioConfig
from ffsm_mj.scenario.source import EXTENDS

_WHOLE, _CHANGES = "Scenario", "Changes"
_NAMED_ITEMS = ("PhaseConfig", "ContactRuleConfig")  # list items that are merged with the parent's item of the same name
_REF = "#/$defs/"
_WITH_FILES = ("Robot", "Model", "SceneConfig")
_MENAGERIE = {
    "type": "string",
    "minLength": 1,
    "description": "Robot of MuJoCo Menagerie in place of 'mjcf': NAME, or NAME/FILE for another one of its files; the "
    "package mujoco-menagerie downloads it once, and run folder and log keep its files.",
}


def scenario_schema() -> dict[str, Any]:
    """Schema of a scenario file."""
    whole = ScenarioConfig.model_json_schema()
    models = whole.pop("$defs") | {_WHOLE: whole}
    changes: dict[str, Any] = {}
    _loosen(_WHOLE, models, changes)
    changes[_WHOLE + _CHANGES]["required"] = [EXTENDS, "name"]
    _either(whole, "robot", SCENE)
    for name in _WITH_FILES:
        for schema in filter(None, (models[name], changes.get(name + _CHANGES))):
            schema["properties"] = {"menagerie": _MENAGERIE, **schema["properties"]}
        _either(models[name], "mjcf", "menagerie")
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "ffsm-mj scenario",
        "if": {"type": "object", "required": [EXTENDS]},
        "then": {"$ref": f"{_REF}{_WHOLE}{_CHANGES}"},
        "else": {"$ref": f"{_REF}{_WHOLE}"},
        "$defs": models | changes,
    }


def _either(schema: dict[str, Any], key: str, other: str) -> None:
    """Let a required key be left out where another one is given."""
    schema["required"].remove(key)
    schema["anyOf"] = [{"required": [key]}, {"required": [other]}]


def _loosen(name: str, models: dict[str, Any], changes: dict[str, Any]) -> None:
    """Add the schema of changes to a model and to the models in it."""
    if name + _CHANGES in changes:
        return
    schema = changes[name + _CHANGES] = deepcopy(models[name])
    schema["required"] = ["name"] if name in _NAMED_ITEMS and "name" in schema.get("required", ()) else []
    if "oneOf" in schema:  # an item that names one of the parent's may omit what this requires
        schema["anyOf"] = [{"required": ["name"]}, *schema.pop("oneOf")]
    for part in _loose(schema):
        _loosen(part, models, changes)


def _loose(node: Any) -> list[str]:
    """Convert a schema, in place, into that of changes; return the models to which it now refers in that form."""
    models = []
    if isinstance(node, list):
        return [name for item in node for name in _loose(item)]
    if not isinstance(node, dict):
        return []
    if "items" in node and node["items"].get("$ref", "").removeprefix(_REF) not in _NAMED_ITEMS:
        return []  # a list replaces the parent's, so its items are complete
    if "$ref" in node:
        models.append(node["$ref"].removeprefix(_REF))
        node["$ref"] += _CHANGES
    if "discriminator" in node:  # without a kind, the parent's applies, and more than one member may fit
        del node["discriminator"]
        node["anyOf"] = node.pop("oneOf")
    for part in (list(node.get("properties", {}).values()), node.get("items"), node.get("anyOf")):
        models += _loose(part)
    entries = node.get("additionalProperties")
    if isinstance(entries, dict):
        models += _loose(entries)
        node["additionalProperties"] = {"anyOf": [entries, {"type": "null"}]}
    return models
