"""Data of a scenario, of a file with the location of each key or of a program, and overrides applied.

No other module handles YAML.
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

from ffsm_mj.errors import Fault, InputError, ScenarioFaults
from ffsm_mj.invocation import override
from ffsm_mj.scenario.element_names import element_name
from ffsm_mj.scenario.inheritance import ALTERNATIVES, read_inherited
from ffsm_mj.similar_names import did_you_mean
from ffsm_mj.yaml import MAX_DEPTH, KeyPath, Node, YamlFault, plain_value

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
        found = [path for path in self._overrides if _on_one_line(path, fault.path)]
        if found or (found := [path for path in self._overrides if self._makes(path, fault.path)]):
            # The override of the key itself rather than that of a mapping around it.
            return f"{override(self._overrides[max(found, key=len)])}: {label}{fault.message}"
        return f"{self._root.find(fault.path).place}: {label}{fault.message}" if self._root else f"{label}{fault.message}"

    def _makes(self, path: KeyPath, key: KeyPath) -> bool:
        """Whether an override at a path makes a mapping of a key that the file does not have."""
        root = self._root
        shared = next((k for k, (one, other) in enumerate(zip(path, key, strict=False)) if one != other), 0)
        return root is not None and any(root.find(path[:k]) is root.find(path[: k - 1]) for k in range(1, shared + 1))

    def lines(self, faults: Iterable[Fault]) -> list[str]:
        """One line per fault, in the order of the file."""
        root = self._root
        return [self.line(fault) for fault in (sorted(faults, key=lambda f: root.find(f.path).place) if root else faults)]

    def located(self, error: ScenarioFaults) -> InputError:
        """Faults by key as an error with their locations."""
        return InputError(self.lines(error.faults))

    @contextmanager
    def locating(self) -> Iterator[None]:
        """Context that raises faults by key as :class:`InputError` with their locations."""
        try:
            yield
        except ScenarioFaults as faults:
            raise self.located(faults) from faults

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


def _apply(source: YamlSource, given: str) -> None:
    key, equals, text = given.partition("=")
    if not equals or not key.strip():
        raise InputError(f"{override(given)}: an override is written key=value, e.g. task.target_m='[3, 0]'")
    try:
        value = plain_value(text)
    except YamlFault as fault:
        raise InputError(f"{override(given)}: in the value: {fault.problem}") from fault
    parts = key.strip().split(".")
    if len(parts) > MAX_DEPTH:
        raise InputError(f"{override(given)}: the key has {len(parts)} parts; a scenario is at most {MAX_DEPTH} deep")
    path: tuple[str | int, ...] = ()
    below: Any
    # Only what contains the key is copied: a campaign makes thousands of sources from the same data.
    node, done = copy(source.data), 0
    source.data = node
    while done < len(parts):
        part, used = _step(node, parts, done, given)
        path, done = (*path, part), done + used
        if part in ALTERNATIVES and path[:1] == ("phases",) and isinstance(node, dict) and value is not None:
            node.pop(ALTERNATIVES[1 - ALTERNATIVES.index(str(part))], None)  # as for 'extends'
        if done == len(parts):
            if part == _KIND and isinstance(node, dict) and node.get(part, value) != value:
                node.clear()  # as for 'extends': the keys of another kind differ in meaning
                source._overrides[path[:-1]] = given
            node[part] = value
        else:
            below = copy(node.get(part, {}) if isinstance(node, dict) else node[part])
            node[part], node = below, below
    source._overrides[path] = given


def _step(node: Any, parts: Sequence[str], done: int, given: str) -> tuple[str | int, int]:
    """Next key or list position along the path of an override, and the number of its parts that it consumes.

    Raises:
        InputError: There is no such key or position.
    """
    where = ".".join(parts[:done])
    if isinstance(node, dict):
        return parts[done], 1
    if not isinstance(node, list):
        raise InputError(f"{override(given)}: {where} is a scalar and has no {parts[done]!r}")
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
    raise InputError(
        f"{override(given)}: {where} is a list of {len(node)}{meant}: {positions}{known and f', its names {known}'}"
    )
