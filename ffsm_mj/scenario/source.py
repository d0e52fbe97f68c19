"""Data of a scenario, of files with the location of each key or of a program, with what it extends and overrides applied.

``extends``: a scenario given as changes to another one. Keys of the scenario override those of the parent; mappings are
merged key by key. ``null`` removes a key of the parent. A mapping with another ``kind`` replaces the parent's mapping, since
its keys differ in meaning. A list replaces the parent's list, but an item with the ``name`` of one of the parent's items (a
phase, a contact rule) is merged with it. ``controllers`` of a phase replace the parent's ``controller``, and the other way
round. ``name`` and ``description`` are not inherited.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ffsm_mj.errors import Fault, InputError, ScenarioFaults, unknown_name
from ffsm_mj.invocation import override
from ffsm_mj.scenario.shipped import scenario_names, scenarios_dir
from ffsm_mj.similar_names import did_you_mean, similar_file
from ffsm_mj.yaml import MAX_DEPTH, KeyPath, Node, YamlFault, plain_value, read_node


def element_name(element: Any) -> str | None:
    """Name of an element: its ``name``, or ``<a>-<b>`` of a contact rule without one; None if it has none.

    Args:
        element: An item of a list in a scenario, as plain data before validation.
    """
    if not isinstance(element, dict):
        return None
    name = element.get("name")
    if name is None:
        sides = element.get("between")
        if not isinstance(sides, list | tuple) or not all(isinstance(side, str) for side in sides):
            return None
        return "-".join("all" if side == "*" else side.removesuffix("/*") for side in sides)
    return name if isinstance(name, str) else None


EXTENDS = "extends"
MAX_EXTENDED = 8
_NOT_INHERITED = ("name", "description")
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
    if len(chain) >= MAX_EXTENDED:
        raise _fault(reference, f"more than {MAX_EXTENDED} scenarios extend one another; allowed: at most {MAX_EXTENDED}")
    base = _resolve(parent, chain)
    inherited = {key: node for key, node in base.value.items() if key not in _NOT_INHERITED}
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


_KIND = "kind"
_POSITION = re.compile(r"[0-9]{1,9}")


@dataclass
class YamlSource:
    """Data of a scenario and its origin.

    Attributes:
        path: The file as given by the user; a name in the current folder for what a program states.
        data: Plain dicts, lists and scalars: of the file, of the scenarios it extends, and of overrides.
    """

    path: Path
    data: Any
    _root: Node | None
    _overrides: dict[KeyPath, str] = field(default_factory=dict)

    def line(self, fault: Fault) -> str:
        """``file:line:col: path.to.key: what is wrong``; for a key of an override, the override in place of the file."""
        name = ".".join(str(part) for part in fault.path)
        label = f"{name}: " if name else ""
        if text := self._override_of(fault.path):
            return f"{override(text)}: {label}{fault.message}"
        return f"{self._root.find(fault.path).place}: {label}{fault.message}" if self._root else f"{label}{fault.message}"

    def _override_of(self, key: KeyPath) -> str:
        """The override that sets a key; empty if none does."""
        overriding = [path for path in self._overrides if _on_one_line(path, key)]
        overriding = overriding or [path for path in self._overrides if self._makes(path, key)]
        # The override of the key itself rather than that of a mapping around it.
        return self._overrides[max(overriding, key=len)] if overriding else ""

    def _makes(self, path: KeyPath, key: KeyPath) -> bool:
        """Whether an override at a path makes a mapping of a key that the file does not have."""
        root = self._root
        shared = next((k for k, (one, other) in enumerate(zip(path, key, strict=False)) if one != other), 0)
        return root is not None and any(root.find(path[:k]) is root.find(path[: k - 1]) for k in range(1, shared + 1))

    def located(self, faults: Iterable[Fault]) -> InputError:
        """Faults by key as an error with one line each, in the order of the file."""
        root = self._root
        ordered = sorted(faults, key=lambda fault: root.find(fault.path).place) if root else [*faults]
        return InputError([*map(self.line, ordered)], [self._override_of(fault.path) for fault in ordered])

    @contextmanager
    def locating(self) -> Iterator[None]:
        """Context that raises faults by key as :class:`InputError` with their locations."""
        try:
            yield
        except ScenarioFaults as faults:
            raise self.located(faults.faults) from faults

    def folder(self, path: KeyPath) -> Path:
        """Folder of the file that sets a key; keys of an override belong to the file given by the user."""
        if self._root is None or any(path[: len(known)] == known for known in self._overrides):
            return self.path.parent
        return self._root.find(path).place.path.parent

    def beside(self, path: KeyPath, name: str) -> Path:
        """A file or folder that a key names, relative to the file that sets the key."""
        return Path(os.path.normpath(self.folder(path) / name))

    def with_data(self, data: Any) -> YamlSource:
        """The source with other data, whose keys stand where the nearest one of the file does."""
        return YamlSource(self.path, data, self._root, dict(self._overrides))

    def overridden(self, overrides: Sequence[str]) -> YamlSource:
        """Source with further ``key.to.value=yaml`` overrides, without reading files again.

        Raises:
            InputError: An override does not match the data.
        """
        source = self.with_data(self.data)
        # A new kind removes the keys of the former one, so it comes before keys of its own.
        for text in sorted(overrides, key=lambda text: not _sets_kind(text)):
            _apply(source, text)
        return source


def read_yaml(path: Path, overrides: Sequence[str] = ()) -> YamlSource:
    """Read a scenario with what it extends, and apply ``key.to.value=yaml`` overrides.

    A list item is addressed by its position or by its name (a phase, a contact rule).

    Raises:
        InputError: A file cannot be read or parsed, is no mapping, or an override has no place in it.
    """
    return source_of(read_inherited(path), path).overridden(overrides)


def source_of(root: Node, path: Path) -> YamlSource:
    """Source of a tree that was read from a file."""
    return YamlSource(path, root.plain(), root)


def _on_one_line(a: KeyPath, b: KeyPath) -> bool:
    """Whether one of two keys is the other one or contains it."""
    shared = min(len(a), len(b))
    return shared > 0 and a[:shared] == b[:shared]


def _sets_kind(text: str) -> bool:
    return text.partition("=")[0].strip().rpartition(".")[2] == _KIND


def _apply(source: YamlSource, override_text: str) -> None:
    key, value = key_and_value(override_text)
    parts = key.split(".")
    if len(parts) > MAX_DEPTH:
        raise _refused(override_text, f"the key has {len(parts)} parts; a scenario is at most {MAX_DEPTH} deep")
    path: tuple[str | int, ...] = ()
    below: Any
    # Only what contains the key is copied: a campaign makes thousands of sources from the same data.
    node, done = copy(source.data), 0
    source.data = node
    while done < len(parts):
        part, used = _step(node, parts, done, override_text)
        path, done = (*path, part), done + used
        if part in ALTERNATIVES and path[:1] == ("phases",) and isinstance(node, dict) and value is not None:
            node.pop(ALTERNATIVES[1 - ALTERNATIVES.index(str(part))], None)  # as for 'extends'
        if done == len(parts):
            if part == _KIND and isinstance(node, dict) and node.get(part, value) != value:
                node.clear()  # as for 'extends': the keys of another kind differ in meaning
                source._overrides[path[:-1]] = override_text
            node[part] = value
        else:
            below = copy(node.get(part, {}) if isinstance(node, dict) else node[part])
            node[part], node = below, below
    source._overrides[path] = override_text


def key_and_value(text: str) -> tuple[str, Any]:
    """Dotted key and value of an override.

    Raises:
        InputError: The text is not ``key=yaml``.
    """
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise _refused(text, "an override is written key=value, e.g. task.target_m='[3, 0]'")
    try:
        return key.strip(), plain_value(value)
    except YamlFault as fault:
        raise _refused(text, f"in the value: {fault.problem}") from fault


def _refused(text: str, message: str) -> InputError:
    """An override that has no place in the data."""
    return InputError(f"{override(text)}: {message}", [text])


def _step(node: Any, parts: Sequence[str], done: int, text: str) -> tuple[str | int, int]:
    """Next key or list position along the path of an override, and the number of its parts that it consumes.

    Raises:
        InputError: There is no such key or position.
    """
    where = ".".join(parts[:done])
    if isinstance(node, dict):
        return parts[done], 1
    if not isinstance(node, list):
        raise _refused(text, f"{where} is a scalar and has no {parts[done]!r}")
    if _POSITION.fullmatch(parts[done]) and int(parts[done]) < len(node):
        return int(parts[done]), 1
    names = [element_name(element) for element in node]
    # A name may contain dots: the longest match wins.
    for used in range(len(parts) - done, 0, -1):
        name = ".".join(parts[done : done + used])
        if name in names:
            return names.index(name), used
    positions = f"its positions are 0 to {len(node) - 1}" if node else "it has no positions"
    known = ", ".join(name for name in names if name)
    meant = did_you_mean(parts[done], filter(None, names))
    raise _refused(text, f"{where} is a list of {len(node)}{meant}: {positions}{known and f', its names {known}'}")
