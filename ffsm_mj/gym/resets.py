"""Resets of an environment: rows of the design of a campaign, and seeds of the noise."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ffsm_mj.assembly.prepare import PreparedRun
from ffsm_mj.errors import Fault, InputError, ScenarioFaults
from ffsm_mj.experiments.bindings import Targets, bind_dispersions
from ffsm_mj.experiments.design import Design
from ffsm_mj.experiments.planning import Plan, load_plan
from ffsm_mj.scenario.scenario import ScenarioConfig

_SEEDS = 2**63


@dataclass(frozen=True)
class Reset:
    """One reset.

    Attributes:
        overrides: Values by dotted key of the scenario.
        seed: Seed of the noise: that of the scenario plus the number of the reset, as in a campaign.
        row: Row of the design; -1 without a design.
    """

    overrides: dict[str, Any]
    seed: int
    row: int


@dataclass(frozen=True)
class Resets:
    """Numbered resets: number k is row k modulo n of the design, with noise of its own.

    Attributes:
        design: The design; None: every reset is that of the scenario, with other noise.
        seed: Key ``seed`` of the scenario.
    """

    design: Design | None
    seed: int

    def reset(self, number: int) -> Reset:
        """A reset by its number, from 0."""
        row = -1 if self.design is None else number % len(self.design.rows)
        overrides = {} if self.design is None else self.design.overrides(row)
        return Reset(overrides, overrides.get("seed", (self.seed + number) % _SEEDS), row)


def campaign_of(prepared: PreparedRun) -> Plan | None:
    """The campaign that the key ``env.design`` of a scenario names; None without the key.

    Raises:
        InputError: There is no such campaign, or it is invalid.
    """
    config: ScenarioConfig = prepared.scenario
    if config.env is None or config.env.design is None:
        return None
    path, text = ("env", "design"), config.env.design
    is_file = text.endswith((".yaml", ".yml")) or "/" in text
    campaign: str | Path = prepared.source.folder(path) / text if is_file else text
    try:
        return load_plan(campaign)
    except InputError as error:
        raise InputError([prepared.source.line(Fault(line, path)) for line in error.lines]) from error


def resets_of(plan: Plan | None, base: PreparedRun) -> Resets:
    """Resets of an environment.

    Args:
        plan: The campaign; its own scenario may be another one, as long as this one has the dispersed keys.
        base: The scenario of the environment, with the overrides of the campaign.

    Raises:
        InputError: The scenario does not have the dispersed keys, or refuses their values.
    """
    if plan is None:
        return Resets(None, base.scenario.seed)
    try:
        bindings = bind_dispersions(plan.config.dispersions, Targets(base))
    except ScenarioFaults as faults:
        raise plan.source.located(faults) from faults
    return Resets(replace(plan, base=base, bindings=bindings).design(), base.scenario.seed)
