"""Facts of a run: written to a log, read from it and validated in this module.

Facts are text by name. A log may be of unknown origin, so its reader calls :func:`fault_of_facts` first.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import one_line
from ffsm_mj.model.properties import PropertyChange, Value, shown
from ffsm_mj.records.signals import SUBSYSTEMS

FORMAT_VERSION = "3"
"""Version of the log format: names of topics, columns and record fields. A log of another version is refused by it."""
_ALL_FREE = "1 1 1 1 1 1"
_MODELS = ("model", "controller_model")
_TIMES = ("time_step_s", "control_period_s")
_DEEPEST = 5  # tree, body, geoms, geom, key


@dataclass(frozen=True)
class LoggedTask:
    """Target of the tip.

    Attributes:
        axes: Regulated world axes: 0 to 2 for x, y and z.
        target_m: Target along them, (number of axes,), m.
    """

    axes: list[int]
    target_m: FloatArray

    @property
    def point_m(self) -> FloatArray:
        """The target in world axes, zero along other axes, (3,), m."""
        point = np.zeros(3)
        point[self.axes] = self.target_m
        return point

    def errors_m(self, tip_m: FloatArray) -> FloatArray:
        """Positions of the tip, (n, 3), less the target, along the regulated axes, (n, number of axes), m."""
        return np.asarray(tip_m[:, self.axes] - self.target_m)


def task_facts(axes: Iterable[str], target_m: Iterable[float]) -> dict[str, str]:
    """Facts of a task: its axes as ``x``, ``y``, ``z``, and the target along them in m."""
    return {"task_axes": " ".join(axes), "task_target_m": " ".join(repr(float(x)) for x in target_m)}


def logged_task(facts: Mapping[str, str]) -> LoggedTask | None:
    """The task in the facts; None if there is none."""
    if "task_axes" not in facts:
        return None
    axes = ["xyz".index(axis) for axis in facts["task_axes"].split()]
    return LoggedTask(axes, np.array([float(x) for x in facts["task_target_m"].split()]))


def free_facts(free: FloatArray) -> dict[str, str]:
    """Facts of which components of (P, L about the origin) the base joints leave free: 1 or 0 by subsystem, (3, 6)."""
    return {_free(subsystem): " ".join(f"{x:.0f}" for x in row) for subsystem, row in zip(SUBSYSTEMS, free, strict=True)}


def free_components(facts: Mapping[str, str], subsystem: str) -> FloatArray:
    """1 for each component of (P, L about the origin) that the subsystem's base joints leave free, else 0, (6,)."""
    return np.array([float(x) for x in facts.get(_free(subsystem), _ALL_FREE).split()])


def _free(subsystem: str) -> str:
    return f"free_components_{subsystem}"


def conservative_facts(faults: Sequence[str]) -> dict[str, str]:
    """Facts of what breaks conservation; an empty list of faults means conservative."""
    return {"conservative": "false" if faults else "true", "not_conservative": "; ".join(faults)}


def gravity_facts(gravity: Iterable[float]) -> dict[str, str]:
    """Facts of uniform gravity, (3,), m/s^2; empty without gravity."""
    shown = [repr(float(g)) for g in gravity]
    return {"gravity_m_s2": " ".join(shown)} if any(float(g) for g in shown) else {}


def gravity_line(facts: Mapping[str, str]) -> str:
    """Line of a report on gravity; empty without gravity."""
    if "gravity_m_s2" not in facts:
        return ""
    return f"gravity {one_line(facts['gravity_m_s2'])} m/s2 is an external force: its impulse and work enter the balance"


def is_conservative(facts: Mapping[str, str]) -> bool:
    """Whether nothing in the models breaks conservation."""
    return facts.get("conservative") == "true"


def why_not_conservative(facts: Mapping[str, str]) -> str:
    """What in the models breaks conservation, as text; empty if nothing does."""
    return facts.get("not_conservative", "")


def model_facts(changes: Iterable[PropertyChange]) -> dict[str, str]:
    """Facts of the compiled values of body and geom properties that the scenario sets: JSON by the scenario's key."""
    nested: dict[str, Any] = {}
    for change in changes:
        place = nested
        for key in change.path[:-1]:
            place = place.setdefault(key, {})
        place[change.path[-1]] = change.after
    return {key: json.dumps(nested[key]) for key in _MODELS if key in nested}


def logged_models(facts: Mapping[str, str]) -> dict[str, Any]:
    """The properties in the facts, nested like the keys of the scenario; empty if none were set."""
    return {key: json.loads(facts[key]) for key in _MODELS if key in facts}


def changed_property_lines(facts: Mapping[str, str]) -> list[str]:
    """One line of text per property, e.g. ``model.box.lid.mass_kg = 7``."""
    return [f"{one_line('.'.join(path))} = {shown(value)}" for path, value in _leaves(logged_models(facts))]


def _leaves(node: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Value]]:
    if isinstance(node, dict):
        for key, value in node.items():
            yield from _leaves(value, (*path, key))
    else:
        yield path, node


def fault_of_version(facts: Mapping[str, str]) -> str:
    """Why a log of another format version cannot be read; empty for the current version."""
    version = facts.get("format_version", "")
    if version == FORMAT_VERSION:
        return ""
    return f"log format {one_line(version) or 'unknown'}; this version of ffsm-mj reads format {FORMAT_VERSION}"


def fault_of_facts(facts: Mapping[str, str]) -> str:
    """What is wrong with facts that are used as numbers; empty if they are valid."""
    for name in map(_free, SUBSYSTEMS):
        words = facts.get(name, _ALL_FREE).split()
        if len(words) != 6 or not set(words) <= {"0", "1"}:
            return f"its fact {name} is {facts[name]!r}; six of 0 and 1 are allowed"
    for name in _TIMES:
        if name in facts and not (_is_number(facts[name]) and float(facts[name]) > 0.0):
            return f"its fact {name} is {facts[name]!r}; a positive number of seconds is allowed"
    for name in _MODELS:
        if name in facts and not _is_numbers(facts[name]):
            return f"its fact {name} is {facts[name]!r}; JSON objects with finite numbers or lists of them are allowed"
    axes, target = (facts.get(name, "").split() for name in ("task_axes", "task_target_m"))
    if len(set(axes)) != len(axes) or not set(axes) <= set("xyz"):
        return f"its fact task_axes is {facts['task_axes']!r}; different axes of x, y and z are allowed"
    if len(target) != len(axes) or not all(map(_is_number, target)):
        return f"its fact task_target_m is {' '.join(target)!r}; a finite number for each of its task_axes is allowed"
    return ""


def _is_numbers(text: str) -> bool:
    """Whether a text is JSON of objects in objects down to finite numbers, or lists of them."""
    try:
        return _holds_numbers(json.loads(text), _DEEPEST)
    except (ValueError, RecursionError):
        return False


def _holds_numbers(value: Any, deep: int) -> bool:
    if isinstance(value, dict):
        return deep > 0 and all(_holds_numbers(each, deep - 1) for each in value.values())
    numbers = value if isinstance(value, list) else [value]
    return deep < _DEEPEST and all(isinstance(each, float) and math.isfinite(each) for each in numbers)


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False
