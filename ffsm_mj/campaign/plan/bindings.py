"""Dispersions bound to the keys of a scenario: what each draw does to which value, checked before anything runs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from ffsm_mj.campaign.plan.design import Binding
from ffsm_mj.campaign.plan.dispersions import Dispersion, Operation, axis_of, operation, sampled_scalars
from ffsm_mj.campaign.plan.targets import Target, Targets
from ffsm_mj.campaign.plan.value_operations import ValueOperation
from ffsm_mj.errors import Fault, ScenarioFaults

KeyPath = tuple[str | int, ...]


def bound(dispersions: Mapping[str, Dispersion], targets: Targets) -> tuple[Binding, ...]:
    """Keys that a campaign sets, each with what is done to its value.

    Args:
        dispersions: Entries by name.
        targets: Values of the base scenario.

    Raises:
        ScenarioFaults: A key that the scenario does not have, a value that cannot be changed in this way, or numbers that
            two entries would change.
    """
    faults: list[Fault] = []
    bindings: dict[str, Binding] = {}
    owners: dict[tuple[str, tuple[int, ...]], str] = {}
    column = 0
    for name, dispersion in dispersions.items():
        drawn = len(list(sampled_scalars(name, dispersion)))
        columns, column = tuple(range(column, column + drawn)), column + drawn
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
    """Keys of an entry, and where each is stated."""
    if dispersion.keys is None:
        yield name, ("dispersions", name)
        return
    for i, key in enumerate(dispersion.keys):
        yield key, ("dispersions", name, "keys", i)


def _found(targets: Targets, key: str) -> list[Target]:
    if "=" in key:
        raise LookupError("a key with '=' in it cannot be set")
    found = targets.find(key)
    if not found:
        raise LookupError(f"{key} means nothing in this scenario: there is no entry for '*' to stand for")
    return found


def _effect(dispersion: Dispersion, target: Target, columns: tuple[int, ...]) -> ValueOperation:
    how, axis = operation(dispersion), axis_of(dispersion)
    fixed = axis if isinstance(axis, tuple) else None
    if how in ("rotation", "vector", "vector_offset"):
        return ValueOperation(how, columns, span=_span(how, target), axis=fixed)
    meant = target.meant
    if isinstance(meant, tuple) and how == "value" and dispersion.is_of_lists and target.span is None and not target.at:
        return ValueOperation(how, columns)
    if isinstance(meant, tuple):
        raise LookupError(
            f"{target.key} is a list of {len(meant)}: name one of its numbers ({target.key}.0), disperse it as a vector,"
            " or write a choice of lists"
        )
    if how != "value" and (not isinstance(meant, int | float) or isinstance(meant, bool)):
        has = "has no value" if meant is None else f"is {meant!r}, no number"
        raise LookupError(
            f"{target.key} {has} for the {how} to start from; state one under overrides, or draw the value itself"
        )
    spread = dispersion.offset or dispersion.scale or dispersion
    if type(meant) is int and spread.is_numeric and not spread.is_integer:
        raise LookupError(f"{target.key} is an integer: draw it from integers by values, choice or grid (2, not 2.0)")
    return ValueOperation(how, columns, target.at)


def _span(how: Operation, target: Target) -> tuple[int, int]:
    """Where the quaternion or the vector of a target is."""
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
            f"{target.key} is no attitude to rotate: a free or ball joint (initial.joints.NAME) and a pose's quaternion are"
        )
    if whole and len(value) == size:
        return (0, size)
    raise LookupError(f"{target.key} is no vector of 3 numbers; of a free joint name a part: position, linear or angular")


def _refuse_second(
    owners: dict[tuple[str, tuple[int, ...]], str], name: str, target: Target, effect: ValueOperation
) -> None:
    """Refuse that two entries change the same numbers: the order would matter."""
    whole = range(len(target.value)) if isinstance(target.value, tuple) and not effect.at else None
    span = range(*effect.span) if effect.span is not None else whole
    numbers = [effect.at] if span is None else [(i,) for i in span]
    for at in numbers:
        if (place := (target.key, at)) in owners:
            raise LookupError(f"{'.'.join([target.key, *map(str, at)])} is dispersed by {owners[place]!r} already")
        owners[place] = name
