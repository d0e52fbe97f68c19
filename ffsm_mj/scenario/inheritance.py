"""``extends``: a scenario as the changes it makes to another one.

Keys of the scenario take the place of the parent's; mappings are merged key by key. ``null`` takes away what the parent has.
A mapping with another ``kind`` replaces the parent's whole, since its keys mean something else. A list replaces the
parent's, but an item with the ``name`` of one of the parent's items (a phase, an impact pair) starts from that one. ``name``
and ``description`` are never inherited: they say what the scenario itself is.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ffsm_mj.errors import InputError, unknown_name
from ffsm_mj.scenario.element_names import element_name
from ffsm_mj.scenario.shipped import scenario_names, scenarios_dir
from ffsm_mj.yaml.node import Node
from ffsm_mj.yaml.parser import read_node

EXTENDS = "extends"
MAX_DEPTH = 8
_OWN = ("name", "description")


def read_inherited(path: Path) -> Node:
    """Read a scenario file with everything that it takes from the scenarios it extends.

    Raises:
        InputError: A file cannot be read or parsed, is missing, or extends itself in the end.
    """
    return _resolve(path, ())


def _resolve(path: Path, descendants: tuple[Path, ...]) -> Node:
    root = read_node(path)
    reference = root.value.get(EXTENDS)
    if reference is None:
        return root
    chain = (*descendants, path)
    parent = _parent_path(reference)
    if any(parent.resolve() == known.resolve() for known in chain):
        circle = " -> ".join(file.name for file in (*chain, parent))
        raise _fault(reference, f"goes round in a circle: {circle}")
    if len(chain) >= MAX_DEPTH:
        raise _fault(reference, f"at most {MAX_DEPTH} scenarios may build on one another, this is one more")
    base = _resolve(parent, chain)
    inherited = {key: node for key, node in base.value.items() if key not in _OWN}
    changes = {key: node for key, node in root.value.items() if key != EXTENDS}
    return Node(_merged_mapping(inherited, changes), root.place)


def _parent_path(reference: Node) -> Path:
    """The file that an ``extends`` means: a path relative to its own file, or a shipped scenario."""
    text = reference.value
    if not isinstance(text, str) or not text:
        raise _fault(reference, "should be a scenario file, relative to this one, or the name of a shipped scenario")
    if text.endswith((".yaml", ".yml")) or "/" in text:
        path = reference.place.path.parent / text
        if not path.is_file():
            raise _fault(reference, f"no such scenario file: {path}")
        return path
    if text not in scenario_names():
        raise _fault(reference, unknown_name("shipped scenario", text, scenario_names()))
    return scenarios_dir() / f"{text}.yaml"


def _fault(reference: Node, message: str) -> InputError:
    return InputError(f"{reference.place}: {EXTENDS}: {message}")


def _merged(parent: Node, child: Node) -> Node:
    if isinstance(parent.value, dict) and isinstance(child.value, dict):
        return Node(_merged_mapping(parent.value, child.value), child.place)
    if isinstance(parent.value, list) and isinstance(child.value, list):
        return Node([_merged_item(parent.value, item) for item in child.value], child.place)
    return child


def _merged_mapping(parent: dict[Any, Node], child: dict[Any, Node]) -> dict[Any, Node]:
    kinds = [side["kind"].value for side in (parent, child) if "kind" in side]
    if len(kinds) == 2 and kinds[0] != kinds[1]:
        return child
    merged = dict(parent)
    for key, node in child.items():
        if key not in parent:
            merged[key] = node
        elif node.value is None:
            del merged[key]
        else:
            merged[key] = _merged(parent[key], node)
    return merged


def _merged_item(parents: list[Node], item: Node) -> Node:
    """An item of a list on top of the parent's item of the same name, where there is one."""
    if not isinstance(item.value, dict) or "name" not in item.value:
        return item
    name = element_name(item.plain())
    return next((_merged(parent, item) for parent in parents if name and element_name(parent.plain()) == name), item)
