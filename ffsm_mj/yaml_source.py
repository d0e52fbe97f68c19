"""A YAML file as plain data, with the line and column of every key; overrides merged in. YAML ends here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import MarkedYAMLError, YAMLError

from ffsm_mj.errors import Fault, InputError

KeyPath = tuple[str | int, ...]


@dataclass
class YamlSource:
    """Data of one file and where it came from.

    Attributes:
        path: The file as the user named it.
        data: Plain dicts, lists and scalars, overrides included.
    """

    path: Path
    data: Any
    _document: Any = None
    _overrides: dict[KeyPath, str] = field(default_factory=dict)

    def line(self, fault: Fault) -> str:
        """``file:line:col: path.to.key: what is wrong``; the override in place of the file where one is to blame."""
        name = ".".join(str(part) for part in fault.path)
        label = f"{name}: " if name else ""
        for path, text in self._overrides.items():
            shared = min(len(path), len(fault.path))
            if shared and path[:shared] == fault.path[:shared]:
                return f"-s {text}: {label}{fault.message}"
        line, column = self._position(fault.path)
        return f"{self.path}:{line}:{column}: {label}{fault.message}"

    def _position(self, path: KeyPath) -> tuple[int, int]:
        """Line and column, from 1, of the deepest key of the path that the file holds."""
        node, where = self._document, (0, 0)
        for part in path:
            if isinstance(node, CommentedMap) and part in node:
                where = node.lc.key(part)
            elif isinstance(node, CommentedSeq) and isinstance(part, int) and part < len(node):
                where = node.lc.item(part)
            else:
                break
            node = node[part]
        return where[0] + 1, where[1] + 1


def read_yaml(path: Path, overrides: Sequence[str] = ()) -> YamlSource:
    """Read a YAML 1.2 file and apply ``key.to.value=yaml`` overrides; numbers in a key are list positions.

    Raises:
        InputError: The file cannot be read or parsed, is no mapping, or an override has no place in it.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})") from error
    try:
        document = YAML(typ="rt").load(text)
    except MarkedYAMLError as error:
        raise InputError(_parse_line(path, error)) from error
    except YAMLError as error:
        raise InputError(f"{path}: {' '.join(str(error).split())}") from error
    if not isinstance(document, CommentedMap):
        raise InputError(f"{path}:1:1: a scenario is a mapping of keys to values; see 'ffsm schema'")
    source = YamlSource(path, _plain(document), document)
    for override in overrides:
        _apply(source, override)
    return source


def write_yaml(data: Any) -> str:
    """YAML text of plain data, keys in their order."""
    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = None
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    yaml.width = 100
    out = StringIO()
    yaml.dump(data, out)
    return out.getvalue()


def _parse_line(path: Path, error: MarkedYAMLError) -> str:
    mark = error.problem_mark or error.context_mark
    where = f"{path}:{mark.line + 1}:{mark.column + 1}" if mark is not None else str(path)
    problem = " ".join((error.problem or error.context or "not YAML").split())
    return f"{where}: malformed YAML: {problem}"


def _plain(node: Any) -> Any:
    """Drop ruamel's own types: comments, anchors, formatting."""
    if isinstance(node, dict):
        return {_plain(key): _plain(value) for key, value in node.items()}
    if isinstance(node, list):
        return [_plain(item) for item in node]
    for base in (bool, int, float, str):
        if isinstance(node, base):
            return base(node)
    return node


def _apply(source: YamlSource, override: str) -> None:
    key, equals, text = override.partition("=")
    if not equals or not key.strip():
        raise InputError(f"-s {override}: an override is written key=value, e.g. -s task.target_m='[3, 0]'")
    try:
        value = _plain(YAML(typ="rt").load(text))
    except YAMLError as error:
        raise InputError(f"-s {override}: the value is malformed YAML") from error
    parts = key.strip().split(".")
    path: tuple[str | int, ...] = ()
    node = source.data
    for depth, name in enumerate(parts):
        last = depth == len(parts) - 1
        part: str | int = int(name) if isinstance(node, list) and name.isdigit() else name
        path += (part,)
        if isinstance(node, list):
            if not isinstance(part, int) or part >= len(node):
                where = ".".join(parts[:depth])
                raise InputError(f"-s {override}: {where} is a list of {len(node)}: its positions are 0 to {len(node) - 1}")
        elif not isinstance(node, dict):
            raise InputError(f"-s {override}: {'.'.join(parts[:depth])} is a single value and has no {part!r}")
        elif not last and part not in node:
            node[part] = {}
        if last:
            node[part] = value
        else:
            node = node[part]
    source._overrides[path] = override
