"""Which sample changes which value of a scenario, found by dotted key and validated before the first run."""

from __future__ import annotations

import json
import types
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Union, get_args, get_origin

import numpy as np
from pydantic import BaseModel, ValidationError

from ffsm_mj.arrays import FloatArray
from ffsm_mj.assembly.initial_state import initial_state
from ffsm_mj.assembly.prepare import PreparedRun
from ffsm_mj.errors import Fault, InputError, ScenarioFaults, one_line, unknown_name
from ffsm_mj.experiments.design import Binding, Design, ValueOperation
from ffsm_mj.experiments.distributions import Dispersion, Operation, SampledScalar, axis_of, operation, sampled_scalars
from ffsm_mj.invocation import override
from ffsm_mj.model.properties import joint_friction, property_value
from ffsm_mj.scenario.source import YamlSource
from ffsm_mj.yaml import KeyPath

WILDCARD = "*"
_STATE = {"joints": 0, "rates": 1}
_PARTS = {
    ("free", "joints"): {"position": (0, 3), "quaternion": (3, 7)},
    ("ball", "joints"): {"quaternion": (0, 4)},
    ("free", "rates"): {"linear": (0, 3), "angular": (3, 6)},
    ("ball", "rates"): {"angular": (0, 3)},
}
"""Vectors and quaternions in the numbers of a joint by its kind: first and end position."""


@dataclass(frozen=True)
class Target:
    """A value of a scenario, or numbers in it.

    Attributes:
        key: Dotted key for an override, with positions for items of lists.
        value: Plain value: a number, a text, None, or a tuple of these.
        at: Position of one number in nested tuples.
        span: First and end position of a vector or quaternion in a tuple.
    """

    key: str
    value: Any
    at: tuple[int, ...] = ()
    span: tuple[int, int] | None = None

    @property
    def current(self) -> Any:
        """The number or the numbers at the target."""
        value = self.value if self.span is None else self.value[slice(*self.span)]
        for position in self.at:
            value = value[position]
        return value


class Targets:
    """Values of a scenario as a run reads them: with defaults, joints of the initial state, bodies as compiled."""

    def __init__(self, prepared: PreparedRun) -> None:
        """Bind to a prepared scenario."""
        self._scenario, self._system = prepared.scenario, prepared.system
        self._models = {"model": prepared.system, "controller_model": prepared.controller_system or prepared.system}

    def find(self, key: str) -> list[Target]:
        """Find the values of a dotted key; ``*`` matches every item of a list and every entry of a mapping.

        Raises:
            LookupError: The scenario has no such key; the message lists the existing ones.
            ScenarioFaults: No run can start from the initial state.
        """
        parts = tuple(key.split("."))
        targets = self._in_models(parts) if parts[0] in self._models else self._inside(self._scenario, parts, ())
        return list(targets)

    def _in_models(self, parts: tuple[str, ...]) -> Iterator[Target]:
        """Properties of bodies in the plant or in the controller model."""
        size = 6 if parts[3:4] in (("geoms",), ("joints",)) else 4
        if len(parts) < size:
            raise LookupError(f"{'.'.join(parts)} is not a property; write {parts[0]}.TREE.BODY.PROPERTY")
        model = self._models[parts[0]].mj
        for path in _properties(model, parts[:size]) if WILDCARD in parts[:size] else [parts[:size]]:
            key, value = ".".join(path), property_value(model, path)
            yield Target(key, value, *_place(value, parts[size:], key, {}))

    def _inside(self, node: Any, parts: tuple[str, ...], path: tuple[str, ...]) -> Iterator[Target]:
        where = ".".join(path) or "the scenario"
        if isinstance(node, BaseModel):
            yield from self._in_model(node, parts, path)
        elif path[:1] == ("initial",) and len(path) == 2:
            yield from self._in_state(parts, path[1])
        elif isinstance(node, Mapping):
            for name in _named(parts, node, f"{where} is a mapping"):
                yield from self._inside(node[name], parts[1:], (*path, name))
        elif isinstance(node, tuple) and (parts[:1] == (WILDCARD,) or any(isinstance(item, BaseModel) for item in node)):
            for position, rest in _items(node, parts, where):
                yield from self._inside(node[position], rest, (*path, str(position)))
        else:
            yield Target(".".join(path), node, *_place(node, parts, where, {}))

    def _in_model(self, node: BaseModel, parts: tuple[str, ...], path: tuple[str, ...]) -> Iterator[Target]:
        fields = {field.alias or name: (name, field) for name, field in type(node).model_fields.items()}
        if not parts or parts[0] == WILDCARD:
            raise LookupError(f"{'.'.join(path)} is a mapping; name one of its keys: {', '.join(sorted(fields))}")
        if parts[0] not in fields:
            raise LookupError(unknown_name("key", parts[0], fields))
        name, field = fields[parts[0]]
        value = getattr(node, name)
        if value is None and len(parts) > 1:
            value = _default(field.annotation)
            if value is None:
                raise LookupError(f"the scenario has no {'.'.join((*path, parts[0]))}")
        yield from self._inside(value, parts[1:], (*path, parts[0]))

    def _in_state(self, parts: tuple[str, ...], what: str) -> Iterator[Target]:
        stated: Mapping[str, Any] = getattr(self._scenario.initial, what)
        if not parts:
            raise LookupError(f"initial.{what} is a mapping; name a joint")
        for name in [*stated] if parts[0] == WILDCARD else [parts[0]]:
            joint = self._system.joint(name)
            # The scenario may already set the joint under another name, which must then be used: two would be ambiguous.
            written = next((other for other in stated if self._system.joint(other).name == joint.name), name)
            key, numbers = f"initial.{what}.{written}", joint.qpos if what == "joints" else joint.dofs
            value: Any = tuple(self._state[_STATE[what]][numbers].tolist())
            value = value if len(value) > 1 else value[0]
            yield Target(key, value, *_place(value, parts[1:], key, _PARTS.get((joint.kind, what), {})))

    @cached_property
    def _state(self) -> tuple[FloatArray, FloatArray]:
        return initial_state(self._scenario, self._system).stated


def _properties(model: Any, wanted: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
    """Paths of the properties that match a path with wildcards; of joints those that have dry friction."""
    inside_of = wanted[3] if len(wanted) == 6 else ""
    if inside_of == "geoms":
        bodies = [(int(body), model.geom(i).name) for i, body in enumerate(model.geom_bodyid)]
    elif inside_of == "joints":
        rubs = [j for j in range(model.njnt) if joint_friction(model, j)]
        bodies = [(int(model.jnt_bodyid[j]), model.joint(j).name) for j in rubs]
    else:
        bodies = [(i, "") for i in range(model.nbody)]
    for i, name in bodies:
        tree, _, body = model.body(i).name.partition("/")
        inside = (inside_of, name.partition("/")[2]) if inside_of else ()
        path = (wanted[0], tree, body, *inside, wanted[-1])
        if tree != "world" and all(part in (WILDCARD, there) for part, there in zip(wanted, path, strict=True)):
            yield path


def _named(parts: tuple[str, ...], entries: Mapping[str, Any], what: str) -> list[str]:
    if not parts:
        raise LookupError(f"{what}; name an entry: {', '.join(entries) or 'it has none'}")
    if parts[0] != WILDCARD and parts[0] not in entries:
        raise LookupError(unknown_name("name", parts[0], entries))
    return [*entries] if parts[0] == WILDCARD else [parts[0]]


def _items(items: tuple[Any, ...], parts: tuple[str, ...], where: str) -> list[tuple[int, tuple[str, ...]]]:
    """Positions in a list of named items that match the next parts of a key, each with the remaining parts."""
    names = [getattr(item, "name", None) for item in items]
    if not parts:
        raise LookupError(f"{where} is a list; name an item: {', '.join(name for name in names if name)}")
    if parts[0] == WILDCARD:
        return [(position, parts[1:]) for position in range(len(items))]
    if parts[0].isdecimal() and int(parts[0]) < len(items):
        return [(int(parts[0]), parts[1:])]
    for used in range(len(parts), 0, -1):  # a name may contain dots: the longest match wins
        if (name := ".".join(parts[:used])) in names:
            return [(names.index(name), parts[used:])]
    known = [name for name in names if name]
    raise LookupError(f"{where} is a list of {len(items)}: {unknown_name('position or name', parts[0], known)}")


def _place(
    value: Any, parts: tuple[str, ...], where: str, spans: Mapping[str, tuple[int, int]]
) -> tuple[tuple[int, ...], tuple[int, int] | None]:
    """Positions or span in a value from the last parts of a key."""
    if len(parts) == 1 and parts[0] in spans:
        return (), spans[parts[0]]
    at: tuple[int, ...] = ()
    for part in parts:
        if not isinstance(value, tuple):
            raise LookupError(f"{where} is a single value and has no {part!r}")
        if not part.isdecimal() or int(part) >= len(value):
            known = "".join(f", {name}" for name in spans)
            raise LookupError(f"{where} is a list of {len(value)}: its positions are 0 to {len(value) - 1}{known}")
        value, at = value[int(part)], (*at, int(part))
    return at, None


def _default(annotation: Any) -> BaseModel | None:
    """Default of an optional section; None if it has keys without a default."""
    for member in get_args(annotation) if get_origin(annotation) in (Union, types.UnionType) else (annotation,):
        if isinstance(member, type) and issubclass(member, BaseModel):
            try:
                return member()
            except ValidationError:
                return None
    return None


def bind_dispersions(dispersions: Mapping[str, Dispersion], targets: Targets) -> tuple[Binding, ...]:
    """Keys that a campaign sets, each with the operations on its value.

    Args:
        dispersions: Entries of the campaign file by name.
        targets: Values of the base scenario.

    Raises:
        ScenarioFaults: The scenario has no such key, a value cannot be changed in this way, or two entries change the same
            number.
    """
    faults: list[Fault] = []
    bindings: dict[str, Binding] = {}
    owners: dict[tuple[str, tuple[int, ...]], str] = {}
    column = 0
    for name, dispersion in dispersions.items():
        count = len(list(sampled_scalars(name, dispersion)))
        columns, column = tuple(range(column, column + count)), column + count
        for key, path in _keys(name, dispersion):
            try:
                for target in _matches(targets, key):
                    _refuse_second(owners, name, target, effect := _effect(dispersion, target, columns))
                    old = bindings.get(target.key, Binding(target.key, target.value, ()))
                    bindings[target.key] = Binding(old.key, old.base, (*old.effects, effect))
            except LookupError as error:
                faults.append(Fault(str(error.args[0]), path))
            except ScenarioFaults as error:
                faults += [Fault(fault.message, path) for fault in error.faults]
    if faults:
        raise ScenarioFaults(faults)
    return tuple(bindings.values())


def _keys(name: str, dispersion: Dispersion) -> Iterator[tuple[str, KeyPath]]:
    """Keys of an entry, each with its location in the campaign file."""
    if dispersion.keys is None:
        yield name, ("dispersions", name)
        return
    for i, key in enumerate(dispersion.keys):
        yield key, ("dispersions", name, "keys", i)


def _matches(targets: Targets, key: str) -> list[Target]:
    if "=" in key:
        raise LookupError("a key that contains '=' cannot be set")
    matching = targets.find(key)
    if not matching:
        raise LookupError(f"{key} matches nothing in this scenario")
    return matching


def _effect(dispersion: Dispersion, target: Target, columns: tuple[int, ...]) -> ValueOperation:
    how, axis = operation(dispersion), axis_of(dispersion)
    fixed = axis if isinstance(axis, tuple) else None
    if how in ("rotation", "vector", "vector_offset"):
        return ValueOperation(how, columns, span=_span(how, target), axis=fixed)
    current = target.current
    if isinstance(current, tuple) and how == "value" and dispersion.is_of_lists and target.span is None and not target.at:
        return ValueOperation(how, columns)
    if isinstance(current, tuple):
        raise LookupError(
            f"{target.key} is a list of {len(current)}: name one of its numbers ({target.key}.0), disperse it as a vector,"
            " or write a choice of lists"
        )
    if how != "value" and (not isinstance(current, int | float) or isinstance(current, bool)):
        has = "has no value" if current is None else f"is {current!r}, not a number"
        raise LookupError(
            f"{target.key} {has}, but {how} needs a number: set it under overrides, or disperse the value itself"
        )
    spread = dispersion.offset or dispersion.scale or dispersion
    if type(current) is int and spread.is_numeric and not spread.is_integer:
        raise LookupError(f"{target.key} is an integer: disperse it with integers in values, choice or grid (2, not 2.0)")
    return ValueOperation(how, columns, target.at)


def _span(how: Operation, target: Target) -> tuple[int, int]:
    """Positions of the quaternion or the vector in the value of a target."""
    size = 4 if how == "rotation" else 3
    value: Any = target.value
    if target.span is not None and target.span[1] - target.span[0] == size:
        return target.span
    whole = not target.at and target.span is None and isinstance(value, tuple) and all(isinstance(v, float) for v in value)
    if how == "rotation":
        pose = target.key.startswith("initial.joints.") and len(value) in (4, 7) if whole else False
        if pose or (whole and target.key.endswith(".quaternion")):
            return (len(value) - 4, len(value))
        raise LookupError(
            f"{target.key} is not an attitude; rotate a free or ball joint (initial.joints.NAME) or the quaternion of a pose"
        )
    if whole and len(value) == size:
        return (0, size)
    raise LookupError(
        f"{target.key} is not a vector of 3 numbers; for a free joint, name a part: position, linear or angular"
    )


def _refuse_second(
    owners: dict[tuple[str, tuple[int, ...]], str], name: str, target: Target, effect: ValueOperation
) -> None:
    """Refuse two entries that change the same number: the result would depend on their order."""
    whole = range(len(target.value)) if isinstance(target.value, tuple) and not effect.at else None
    span = range(*effect.span) if effect.span is not None else whole
    numbers = [effect.at] if span is None else [(i,) for i in span]
    for at in numbers:
        if (place := (target.key, at)) in owners:
            raise LookupError(f"{'.'.join([target.key, *map(str, at)])} is already dispersed by {owners[place]!r}")
        owners[place] = name


_ROUNDING = {"initial": 1e-12, "model": 1e-9, "controller_model": 1e-9}
"""Allowed difference of a number x of the run from its sample, times max(1, |x|), by first part of the key. Quaternions are
normalized and models compiled; all other numbers are used unchanged."""


def refuse_wrong_rows(base: PreparedRun, design: Design, source: YamlSource, scalars: Sequence[SampledScalar]) -> None:
    """Validate the first run, and the runs with the smallest and largest value, or each text, of every parameter.

    Args:
        base: The base scenario.
        design: The runs.
        source: The campaign file.
        scalars: Sampled scalars, the parameters of the design.

    Raises:
        InputError: The scenario refuses the values of such a run, or does not have them after they are set.
    """
    places = {b.key: ("dispersions", scalars[effect.columns[0]].entry) for b in design.bindings for effect in b.effects}
    for run in extreme_rows(design):
        values = design.overrides(run)
        changes = {f"{key}={json.dumps(value)}": places[key] for key, value in values.items()}
        try:
            targets = Targets(base.changed(base.source.overridden(list(changes))))
        except InputError as error:
            fault = override_faults(error, changes)[0] or Fault(error.lines[0], ("dispersions",))
            raise InputError(source.line(replace(fault, message=f"run {run}: {fault.message}"))) from error
        for key, value in values.items():
            if message := _not_applied(targets, key, value):
                raise InputError(source.line(Fault(f"run {run}: {message}", places[key])))


def override_faults(error: InputError, places: Mapping[str, KeyPath]) -> list[Fault | None]:
    """Faults of overrides that a campaign file states, at their places there; None for lines of something else.

    Args:
        error: Error of a scenario with overrides.
        places: Key of the campaign file by override.
    """
    return [
        Fault(line.removeprefix(one_line(f"{override(text)}: ")), places[text]) if text in places else None
        for line, text in zip(error.lines, error.overrides, strict=True)
    ]


def extreme_rows(design: Design) -> list[int]:
    """Indices of the first row, and of rows with the smallest and largest number, or each text, of a parameter."""
    chosen = {0}
    for column in zip(*design.rows, strict=True):
        if all(isinstance(value, int | float) and not isinstance(value, bool) for value in column):
            chosen |= {int(np.argmin(column)), int(np.argmax(column))}
        else:
            chosen |= {column.index(value) for value in dict.fromkeys(column)}
    return sorted(chosen)


def _not_applied(targets: Targets, key: str, sampled: Any) -> str:
    """Why a scenario does not have the sampled value; empty if it has."""
    try:
        there = [target.value for target in targets.find(key)]
    except LookupError as error:
        return str(error.args[0])
    except ScenarioFaults as error:
        return error.faults[0].message
    if len(there) == 1 and _same(there[0], sampled, _ROUNDING.get(key.partition(".")[0], 0.0)):
        return ""
    return f"{key} is {there[0] if len(there) == 1 else there} although {sampled} was sampled: the dispersion is not applied"


def _same(a: Any, b: Any, rounding: float) -> bool:
    if isinstance(a, tuple | list) and isinstance(b, tuple | list):
        return len(a) == len(b) and all(_same(*values, rounding) for values in zip(a, b, strict=True))
    if isinstance(a, float) and isinstance(b, int | float):
        return abs(a - b) <= rounding * max(1.0, abs(a))
    return type(a) is type(b) and bool(a == b)
