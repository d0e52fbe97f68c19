"""Binding of dispersions to keys of a scenario: which sample changes which value, validated before the first run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from ffsm_mj.campaign.plan.design import Binding
from ffsm_mj.campaign.plan.dispersions import Dispersion, Operation, axis_of, operation, sampled_scalars
from ffsm_mj.campaign.plan.targets import Target, Targets
from ffsm_mj.campaign.plan.value_operations import ValueOperation
from ffsm_mj.errors import Fault, ScenarioFaults

KeyPath = tuple[str | int, ...]


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
                for target in _found(targets, key):
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


def _found(targets: Targets, key: str) -> list[Target]:
    if "=" in key:
        raise LookupError("a key that contains '=' cannot be set")
    found = targets.find(key)
    if not found:
        raise LookupError(f"{key} matches nothing in this scenario")
    return found


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
