"""Metadata of a run: written to a log, read from it and validated in this module.

Metadata are texts by name. A log may be of unknown origin, so its reader calls :func:`fault_of_metadata` first.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import one_line
from ffsm_mj.model.properties import PropertyChange, Value, value_text
from ffsm_mj.records.signals import SUBSYSTEMS, TARGET, TIP, Layout

FORMAT_VERSION = "4"
"""Version of the log format: names of topics, columns and record fields. A log of another version is refused by it."""
_ALL_FREE = "1 1 1 1 1 1"
_MODELS = ("model", "controller_model")
_START = "start_s"
_ORBIT_RATE = "orbit_rate_rad_s"
TERMINAL_UNITS = {
    "stack_momentum_N_m_s": "N m s",
    "base_rate_rad_s": "rad/s",
    "base_speed_m_s": "m/s",
    "relative_rate_rad_s": "rad/s",
}
"""Units of the bounds on the last state of a run, by key of the section ``terminal`` of a scenario."""
_TERMINAL = {key: f"terminal_{key}" for key in TERMINAL_UNITS}
_POSITIVE = dict.fromkeys(("time_step_s", "control_period_s", _START), "seconds") | {
    _TERMINAL[key]: unit for key, unit in TERMINAL_UNITS.items()
}
"""Entries that are positive numbers, with their units."""
_DEEPEST = 5  # tree, body, geoms, geom, key


@dataclass(frozen=True)
class LoggedTask:
    """Target of the tip.

    Attributes:
        axes: Regulated world axes: 0 to 2 for x, y and z.
        target_m: Target along them, (number of axes,), m; of one that moves where it begins.
    """

    axes: list[int]
    target_m: FloatArray

    @property
    def point_m(self) -> FloatArray:
        """The target in world axes, zero along other axes, (3,), m."""
        point = np.zeros(3)
        point[self.axes] = self.target_m
        return point

    @staticmethod
    def moving_columns(layout: Layout) -> list[int]:
        """Columns of the target's position in world axes; none of one that stands still."""
        return [layout.index[name] for name in TARGET] if TARGET[0] in layout.index else []

    def errors_m(self, layout: Layout, column: Callable[[str], FloatArray]) -> FloatArray:
        """Position of the tip less the target along the regulated axes, (n, number of axes), m.

        Args:
            layout: Columns that there are.
            column: Returns one by its key, (n,).
        """
        tip = np.column_stack([column(TIP[axis]) for axis in self.axes])
        if TARGET[0] not in layout.index:
            return np.asarray(tip - self.target_m)
        return np.asarray(tip - np.column_stack([column(TARGET[axis]) for axis in self.axes]))


def start_metadata(start_s: float) -> dict[str, str]:
    """Metadata of a run that goes on from a state at a later time than 0, s; empty for others."""
    return {_START: repr(float(start_s))} if start_s > 0.0 else {}


def logged_start_s(metadata: Mapping[str, str]) -> float:
    """Time of the state from which a run goes on, s; 0 if it begins at the initial state of its scenario."""
    return float(metadata.get(_START, 0.0))


def task_metadata(axes: Iterable[str], target_m: Iterable[float]) -> dict[str, str]:
    """Metadata of a task: its axes as ``x``, ``y``, ``z``, and the target along them in m."""
    return {"task_axes": " ".join(axes), "task_target_m": " ".join(repr(float(x)) for x in target_m)}


def logged_task(metadata: Mapping[str, str]) -> LoggedTask | None:
    """The task in the metadata; None if there is none."""
    if "task_axes" not in metadata:
        return None
    axes = ["xyz".index(axis) for axis in metadata["task_axes"].split()]
    return LoggedTask(axes, np.array([float(x) for x in metadata["task_target_m"].split()]))


def terminal_metadata(bounds: Mapping[str, float | None]) -> dict[str, str]:
    """Metadata of the bounds on the last state of a run, by the keys of ``TERMINAL_UNITS``."""
    return {_TERMINAL[key]: repr(float(bound)) for key, bound in bounds.items() if bound is not None}


def terminal_bounds(metadata: Mapping[str, str]) -> dict[str, float]:
    """The bounds of :func:`terminal_metadata` by key."""
    return {key: float(metadata[name]) for key, name in _TERMINAL.items() if name in metadata}


def phase_graph_metadata(edges: Sequence[tuple[int, str, int]]) -> dict[str, str]:
    """Metadata of phases that branch: position of a phase, what ends it, position of the phase that follows."""
    return {"phase_graph": json.dumps(edges)}


def logged_phase_graph(metadata: Mapping[str, str]) -> tuple[list[str], list[tuple[int, str, int]]]:
    """Names of the phases, and the ways between them; without ways where the phases do not branch."""
    names = metadata.get("phases", "").split("\n")
    try:
        edges = [(int(start), str(trigger), int(to)) for start, trigger, to in json.loads(metadata.get("phase_graph", "[]"))]
    except (ValueError, TypeError, OverflowError, RecursionError):
        return names, []  # the log of a stranger
    there = range(len(names))
    return names, [edge for edge in edges if edge[0] in there and edge[2] in there]


def free_metadata(free: FloatArray) -> dict[str, str]:
    """Metadata of which components of (P, L about the origin) the base joints leave free: 1 or 0 by subsystem, (3, 6)."""
    return {_free(subsystem): " ".join(f"{x:.0f}" for x in row) for subsystem, row in zip(SUBSYSTEMS, free, strict=True)}


def free_components(metadata: Mapping[str, str], subsystem: str) -> FloatArray:
    """1 for each component of (P, L about the origin) that the subsystem's base joints leave free, else 0, (6,)."""
    return np.array([float(x) for x in metadata.get(_free(subsystem), _ALL_FREE).split()])


def _free(subsystem: str) -> str:
    return f"free_components_{subsystem}"


def conservative_metadata(faults: Sequence[str]) -> dict[str, str]:
    """Metadata of what breaks conservation; an empty list of faults means conservative."""
    return {"conservative": "false" if faults else "true", "not_conservative": "; ".join(faults)}


def gravity_metadata(gravity: Iterable[float]) -> dict[str, str]:
    """Metadata of uniform gravity, (3,), m/s^2; empty without gravity."""
    texts = [repr(float(g)) for g in gravity]
    return {"gravity_m_s2": " ".join(texts)} if any(float(g) for g in texts) else {}


def orbit_metadata(rate_rad_s: Sequence[float] | None, epoch: str | None) -> dict[str, str]:
    """Metadata of an orbit.

    Args:
        rate_rad_s: Angular velocity of a circular orbit that is the only field, world axes, (3,); None: another orbit.
        epoch: Date and time of t = 0 in UTC; None: not stated.
    """
    rate = {} if rate_rad_s is None else {_ORBIT_RATE: " ".join(repr(float(x)) for x in rate_rad_s)}
    return rate | ({} if epoch is None else {"epoch_utc": epoch})


def orbit_rate(metadata: Mapping[str, str]) -> FloatArray | None:
    """Angular velocity of a circular orbit that is the only field, world axes, rad/s, (3,); None: there is none."""
    text = metadata.get(_ORBIT_RATE)
    return None if text is None else np.array([float(x) for x in text.split()])


def gravity_line(metadata: Mapping[str, str]) -> str:
    """Line of a report on gravity; empty without gravity."""
    if "gravity_m_s2" not in metadata:
        return ""
    return f"gravity {one_line(metadata['gravity_m_s2'])} m/s2 is an external force: its impulse and work enter the balance"


def is_conservative(metadata: Mapping[str, str]) -> bool:
    """Whether nothing in the models breaks conservation."""
    return metadata.get("conservative") == "true"


def why_not_conservative(metadata: Mapping[str, str]) -> str:
    """What in the models breaks conservation, as text; empty if nothing does."""
    return metadata.get("not_conservative", "")


def model_metadata(changes: Iterable[PropertyChange]) -> dict[str, str]:
    """Metadata of the compiled values of body and geom properties that the scenario sets: JSON by the scenario's key."""
    nested: dict[str, Any] = {}
    for change in changes:
        place = nested
        for key in change.path[:-1]:
            place = place.setdefault(key, {})
        place[change.path[-1]] = change.after
    return {key: json.dumps(nested[key]) for key in _MODELS if key in nested}


def logged_models(metadata: Mapping[str, str]) -> dict[str, Any]:
    """The properties in the metadata, nested like the keys of the scenario; empty if none were set."""
    return {key: json.loads(metadata[key]) for key in _MODELS if key in metadata}


def logged_properties(metadata: Mapping[str, str]) -> dict[str, Value]:
    """The properties in the metadata by dotted key, e.g. ``model.box.lid.mass_kg``."""
    return dict(_leaves(logged_models(metadata)))


def changed_property_lines(metadata: Mapping[str, str]) -> list[str]:
    """One line of text per property, e.g. ``model.box.lid.mass_kg = 7``."""
    return [f"{one_line(key)} = {value_text(value)}" for key, value in logged_properties(metadata).items()]


def _leaves(node: Any, key: str = "") -> Iterator[tuple[str, Value]]:
    if isinstance(node, dict):
        for name, value in node.items():
            yield from _leaves(value, f"{key}.{name}" if key else name)
    else:
        yield key, node


def fault_of_version(metadata: Mapping[str, str]) -> str:
    """Why a log of another format version cannot be read; empty for the current version."""
    version = metadata.get("format_version", "")
    if version == FORMAT_VERSION:
        return ""
    return f"log format {one_line(version) or 'unknown'}; this version of ffsm-mj reads format {FORMAT_VERSION}"


def fault_of_metadata(metadata: Mapping[str, str]) -> str:
    """What is wrong with metadata that are used as numbers; empty if they are valid."""
    return next(_faults(metadata), "")


def _faults(metadata: Mapping[str, str]) -> Iterator[str]:
    for name in map(_free, SUBSYSTEMS):
        words = metadata.get(name, _ALL_FREE).split()
        if len(words) != 6 or not set(words) <= {"0", "1"}:
            yield f"its metadata entry {name} is {metadata[name]!r}; six of 0 and 1 are allowed"
    for name, unit in _POSITIVE.items():
        if name in metadata and not (_is_number(metadata[name]) and float(metadata[name]) > 0.0):
            yield f"its metadata entry {name} is {metadata[name]!r}; a positive number of {unit} is allowed"
    for name in _MODELS:
        if name in metadata and not _is_numbers(metadata[name]):
            allowed = "JSON objects with finite numbers or lists of them are allowed"
            yield f"its metadata entry {name} is {metadata[name]!r}; {allowed}"
    axes, target = (metadata.get(name, "").split() for name in ("task_axes", "task_target_m"))
    if len(set(axes)) != len(axes) or not set(axes) <= set("xyz"):
        yield f"its metadata entry task_axes is {metadata['task_axes']!r}; different axes of x, y and z are allowed"
    if len(target) != len(axes) or not all(map(_is_number, target)):
        yield (
            f"its metadata entry task_target_m is {' '.join(target)!r}; a finite number for each of its task_axes is allowed"
        )
    rate = metadata.get(_ORBIT_RATE, "0 0 0").split()
    if len(rate) != 3 or not all(map(_is_number, rate)):
        yield f"its metadata entry {_ORBIT_RATE} is {metadata[_ORBIT_RATE]!r}; three finite numbers are allowed"


def _is_numbers(text: str) -> bool:
    """Whether a text is JSON of objects in objects down to finite numbers, or lists of them."""
    try:
        return _holds_numbers(json.loads(text), _DEEPEST)
    except (ValueError, RecursionError):
        return False


def _holds_numbers(value: Any, deep: int) -> bool:
    if isinstance(value, dict):
        return deep > 0 and all(_holds_numbers(part, deep - 1) for part in value.values())
    numbers = value if isinstance(value, list) else [value]
    return deep < _DEEPEST and all(isinstance(number, float) and math.isfinite(number) for number in numbers)


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False
