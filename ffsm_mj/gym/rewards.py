"""Reward functions: those that ship, those of other packages, and the call of one."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import entry_points
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.controller_protocol import ImpactRecord, Observation, System
from ffsm_mj.errors import FfsmError, described, raised_at, unknown_name

GROUP = "ffsm_mj.rewards"
"""Entry-point group of reward functions of other packages."""


class EnvError(FfsmError):
    """An environment was used in a way that its state does not allow, or a part of it, such as a reward, failed."""


@dataclass(frozen=True)
class Transition:
    """A step of an environment, as a reward function sees it.

    Attributes:
        time_s: Time at its end, s.
        action: Action, clipped to [-1, 1].
        before: Observation vector at its start.
        after: Observation vector at its end.
        events: Records of events in it.
        success: Whether the episode ended in it with success.
        failure: Whether the episode ended in it with failure.
        truncated: Whether the duration of the scenario is over.
        seen: What a control law sees at its end; ``seen.free`` are MuJoCo's data of the scene.
        system: Robot and objects.
        memory: What the reward function keeps from step to step; empty at the start of an episode.
    """

    time_s: float
    action: FloatArray
    before: FloatArray
    after: FloatArray
    events: tuple[Any, ...]
    success: bool
    failure: bool
    truncated: bool
    seen: Observation
    system: System
    memory: dict[str, Any]


Reward = Callable[..., float]
"""A function of a :class:`Transition` and of the arguments of the scenario, by name."""


def sparse(step: Transition) -> float:
    """1 for success, -1 for failure, otherwise 0."""
    return float(step.success) - float(step.failure)


def least_impulse(step: Transition, impulse_N_s: float = 1.0, time_s: float = 100.0) -> float:
    """:func:`sparse`, less the impulses of impacts over ``impulse_N_s`` and the time of the step over ``time_s``."""
    elapsed = step.time_s - step.memory.get("time_s", 0.0)
    step.memory["time_s"] = step.time_s
    impulse = sum(record.impulse_N_s for record in step.events if isinstance(record, ImpactRecord))
    return float(sparse(step) - impulse / impulse_N_s - elapsed / time_s)


def nearer(step: Transition, site: str, to: str, distance_m: float = 1.0) -> float:
    """:func:`sparse`, and the distance by which ``site`` came nearer to the site ``to``, over ``distance_m``."""
    data = step.seen.free
    ends = [data.site_xpos[step.system.index("site", name)] for name in (site, to)]
    now = math.dist(*ends)
    moved = step.memory.get("distance_m", now) - now
    step.memory["distance_m"] = now
    return float(sparse(step) + moved / distance_m)


SHIPPED: Mapping[str, Reward] = {reward.__name__: reward for reward in (sparse, least_impulse, nearer)}


@cache
def reward_named(name: str) -> Reward:
    """A shipped reward function, or that of an installed package.

    Raises:
        LookupError: There is none, or it cannot be loaded; the message lists what there is.
    """
    if name in SHIPPED:
        return SHIPPED[name]
    points = {point.name: point for point in entry_points(group=GROUP)}
    if name not in points:
        raise LookupError(unknown_name("reward function", name, [*SHIPPED, *points]))
    try:
        loaded: Reward = points[name].load()
    except Exception as error:
        raise LookupError(
            f"reward function {name!r} of {points[name].value} cannot be loaded ({described(error)})"
        ) from error
    return loaded


@dataclass(frozen=True)
class NamedReward:
    """A reward function with its arguments.

    Attributes:
        name: Its name, for messages.
        function: The function.
        arguments: Its arguments besides the transition.
    """

    name: str
    function: Reward
    arguments: Mapping[str, Any]

    def of(self, step: Transition) -> float:
        """The reward of a step.

        Raises:
            EnvError: The function raises, or returns something else than a finite number.
        """
        try:
            value = self.function(step, **self.arguments)
        except Exception as error:
            raise EnvError(
                f"reward {self.name!r} at t = {step.time_s:.6g} s: {described(error)}{raised_at(error)}"
            ) from error
        if not isinstance(value, int | float | np.number) or not math.isfinite(value):
            raise EnvError(f"reward {self.name!r} at t = {step.time_s:.6g} s: is {value!r}, not a finite number")
        return float(value)
