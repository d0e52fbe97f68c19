"""``extends``: a scenario given as changes to another one.

Keys of the scenario override those of the parent; mappings are merged key by key. ``null`` removes a key of the parent.
A mapping with another ``kind`` replaces the parent's mapping, since its keys differ in meaning. A list replaces the
parent's list, but an item with the ``name`` of one of the parent's items (a phase, a contact rule) is merged with it.
``controllers`` of a phase replace the parent's ``controller``, and the other way round.
``name`` and ``description`` are not inherited.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ffsm_mj.errors import InputError, unknown_name
from ffsm_mj.scenario.element_names import element_name
from ffsm_mj.scenario.shipped import scenario_names, scenarios_dir
from ffsm_mj.similar_names import similar_file
from ffsm_mj.yaml import Node, read_node

EXTENDS = "extends"
MAX_DEPTH = 8
_OWN = ("name", "description")
ALTERNATIVES = ("controller", "controllers")
"""Keys of a phase of which one replaces the other."""


def read_inherited(path: Path) -> Node:
    """Read a scenario file, merged with the scenarios that it extends.

    Raises:
        InputError: A file cannot be read or parsed, is missing, or extends itself, directly or not.
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
        raise _fault(reference, f"is circular: {circle}")
    if len(chain) >= MAX_DEPTH:
        raise _fault(reference, f"more than {MAX_DEPTH} scenarios extend one another; allowed: at most {MAX_DEPTH}")
    base = _resolve(parent, chain)
    inherited = {key: node for key, node in base.value.items() if key not in _OWN}
    changes = {key: node for key, node in root.value.items() if key != EXTENDS}
    return Node(_merged_mapping(inherited, changes), root.place)


def _parent_path(reference: Node) -> Path:
    """File of an ``extends`` key: a path relative to its own file, or a shipped scenario."""
    text = reference.value
    if not isinstance(text, str) or not text:
        raise _fault(reference, "should be a scenario file, relative to this one, or the name of a shipped scenario")
    if text.endswith((".yaml", ".yml")) or "/" in text:
        path = reference.place.path.parent / text
        if not path.is_file():
            raise _fault(reference, f"no such scenario file: {path}{similar_file(path)}")
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
    for one, other in (ALTERNATIVES, ALTERNATIVES[::-1]):
        if one in parent and other in child and one not in child:
            parent = {key: node for key, node in parent.items() if key != one}
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
    """An item of a list, merged with the parent's item of the same name if there is one."""
    if not isinstance(item.value, dict) or "name" not in item.value:
        return item
    name = element_name(item.plain())
    return next((_merged(parent, item) for parent in parents if name and element_name(parent.plain()) == name), item)
