"""Validation of rows of a design against the scenario: the values are allowed, and the run has them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ffsm_mj.assembly.prepare import PreparedRun
from ffsm_mj.campaign.plan.design import Design
from ffsm_mj.campaign.plan.dispersions import SampledScalar
from ffsm_mj.campaign.plan.targets import Targets
from ffsm_mj.errors import Fault, InputError, ScenarioFaults, one_line
from ffsm_mj.invocation import override
from ffsm_mj.scenario.source import YamlSource

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
    owners = {b.key: scalars[effect.columns[0]].entry for b in design.bindings for effect in b.effects}
    for run in extreme_rows(design):
        values = design.overrides(run)
        changes = {key: f"{key}={json.dumps(value)}" for key, value in values.items()}
        try:
            changed = base.source.overridden(list(changes.values()))
            targets = Targets(base.changed(changed))
        except InputError as error:
            raise InputError(_message(error.lines[0], run, changes, owners, source)) from error
        for key, value in values.items():
            if message := _not_applied(targets, key, value):
                raise InputError(source.line(Fault(f"run {run}: {message}", ("dispersions", owners[key]))))


def extreme_rows(design: Design) -> list[int]:
    """Indices of the first row, and of rows with the smallest and largest number, or each text, of a parameter."""
    found = {0}
    for column in zip(*design.rows, strict=True):
        if all(isinstance(value, int | float) and not isinstance(value, bool) for value in column):
            found |= {int(np.argmin(column)), int(np.argmax(column))}
        else:
            found |= {column.index(value) for value in dict.fromkeys(column)}
    return sorted(found)


def _message(line: str, run: int, changes: Mapping[str, str], owners: Mapping[str, str], source: YamlSource) -> str:
    """Fault of the scenario of a run, located in the campaign file."""
    for key, change in changes.items():
        if line.startswith(prefix := one_line(f"{override(change)}: ")):
            return source.line(Fault(f"run {run}: {line.removeprefix(prefix)}", ("dispersions", owners[key])))
    return source.line(Fault(f"run {run}: {line}", ("dispersions",)))


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
        return len(a) == len(b) and all(_same(*each, rounding) for each in zip(a, b, strict=True))
    if isinstance(a, float) and isinstance(b, int | float):
        return abs(a - b) <= rounding * max(1.0, abs(a))
    return type(a) is type(b) and bool(a == b)
