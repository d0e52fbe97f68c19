"""Set-up of an environment: its section of the scenario, its resets, and its parts bound to a run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ffsm_mj.assembly.assemble import Assembly
from ffsm_mj.assembly.prepare import PreparedRun
from ffsm_mj.errors import Fault, Faults, InputError, ScenarioFaults
from ffsm_mj.experiments.bindings import Targets, bind_dispersions
from ffsm_mj.experiments.design import Design
from ffsm_mj.experiments.planning import Plan, load_plan
from ffsm_mj.gym.actions import Actions
from ffsm_mj.gym.endings import Endings, Episode, Overlaps
from ffsm_mj.gym.observations import Observations, Values
from ffsm_mj.gym.rewards import NamedReward, reward_named
from ffsm_mj.model.system import System
from ffsm_mj.scenario.env_config import EnvConfig, RewardConfig
from ffsm_mj.scenario.overrides import Overrides, as_texts
from ffsm_mj.scenario.scenario import ScenarioConfig


@dataclass(frozen=True)
class Bound:
    """Parts of an environment, bound to one run.

    Attributes:
        system: Robot and objects.
        data: MuJoCo data of the run.
        actions: Its actions.
        observations: Its observations.
        episode: Its metrics so far.
        endings: Its ends.
    """

    system: System
    data: Any
    actions: Actions
    observations: Observations
    episode: Episode
    endings: Endings


def bind(config: EnvConfig, assembly: Assembly, overlaps: Overlaps) -> Bound:
    """Resolve all names.

    Args:
        config: Section of the scenario.
        assembly: Components of the run.
        overlaps: See :class:`~ffsm_mj.gym.endings.Endings`.

    Raises:
        ScenarioFaults: One fault per unknown name of every part.
    """
    values, episode = Values(assembly), Episode(assembly)
    parts: list[Any] = []
    with Faults() as faults:
        for make in (
            lambda: Actions(config, assembly),
            lambda: Observations(config, values),
            lambda: Endings(config, values, episode, overlaps),
        ):
            with faults.below():
                parts.append(make())
    actions, observations, endings = parts
    return Bound(assembly.system, assembly.data, actions, observations, episode, endings)


def split_env(env: Mapping[str, Any] | None, overrides: Overrides) -> tuple[Callable[..., float] | None, list[str]]:
    """The reward function of a script, and the overrides of a scenario with those of its section ``env``.

    Raises:
        InputError: A value is not one of YAML.
    """
    texts, keys = as_texts(overrides), dict(env or {})
    reward = keys.pop("reward") if callable(keys.get("reward")) else None
    return reward, [*texts, *as_texts({f"env.{key}": value for key, value in keys.items()})]


def env_of(prepared: PreparedRun) -> EnvConfig:
    """The section ``env`` of a scenario.

    Raises:
        InputError: There is none.
    """
    if prepared.scenario.env is None:
        fault = Fault("is missing: the scenario is no environment yet; see docs/gymnasium.md", ("env",))
        raise InputError(prepared.source.line(fault))
    return prepared.scenario.env


def reward_of(function: Callable[..., float] | None, prepared: PreparedRun) -> NamedReward:
    """The reward function of a script, or else that of the scenario.

    Raises:
        InputError: There is no reward function of that name.
    """
    if function is not None:
        return NamedReward(getattr(function, "__name__", repr(function)), function, {})
    config = env_of(prepared).reward
    is_long = isinstance(config, RewardConfig)
    name, arguments = (config.function, config.arguments) if isinstance(config, RewardConfig) else (config, {})
    try:
        return NamedReward(name, reward_named(name), arguments)
    except LookupError as error:
        path = ("env", "reward", "function") if is_long else ("env", "reward")
        raise InputError(prepared.source.line(Fault(str(error.args[0]), path))) from error


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
        raise plan.source.located(faults.faults) from faults
    return Resets(replace(plan, base=base, bindings=bindings).design(), base.scenario.seed)
