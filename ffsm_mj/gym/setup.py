"""Set-up of an environment: its section of the scenario, and its parts bound to a run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from ffsm_mj.assembly.assemble import Assembly
from ffsm_mj.assembly.prepare import PreparedRun, as_overrides
from ffsm_mj.errors import Fault, InputError, ScenarioFaults
from ffsm_mj.gym.actions import Actions
from ffsm_mj.gym.endings import Endings, Overlaps
from ffsm_mj.gym.episode import Episode
from ffsm_mj.gym.observations import Observations
from ffsm_mj.gym.rewards import NamedReward, reward_named
from ffsm_mj.gym.values import Values
from ffsm_mj.scenario.env_config import EnvConfig, RewardConfig


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

    def __init__(self, config: EnvConfig, assembly: Assembly, overlaps: Overlaps = tuple) -> None:
        """Resolve all names.

        Args:
            config: Section of the scenario.
            assembly: Components of the run.
            overlaps: See :class:`~ffsm_mj.gym.endings.Endings`.

        Raises:
            ScenarioFaults: One fault per unknown name of every part.
        """
        self.system, self.data = assembly.system, assembly.data
        values, self.episode = Values(assembly), Episode(assembly)
        faults: list[Fault] = []
        parts: list[Any] = []
        for make in (
            lambda: Actions(config, assembly),
            lambda: Observations(config, values),
            lambda: Endings(config, values, self.episode, overlaps),
        ):
            try:
                parts.append(make())
            except ScenarioFaults as error:
                faults += error.faults
        if faults:
            raise ScenarioFaults(faults)
        self.actions: Actions
        self.observations: Observations
        self.endings: Endings
        self.actions, self.observations, self.endings = parts


def split_env(
    env: Mapping[str, Any] | None, overrides: Sequence[str] | Mapping[str, Any]
) -> tuple[Callable[..., float] | None, list[str]]:
    """The reward function of a script, and the overrides of a scenario with those of its section ``env``.

    Raises:
        InputError: A value is not one of YAML.
    """
    given, keys = as_overrides(overrides), dict(env or {})
    reward = keys.pop("reward") if callable(keys.get("reward")) else None
    return reward, [*given, *as_overrides({f"env.{key}": value for key, value in keys.items()})]


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
