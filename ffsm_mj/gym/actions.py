"""Actions: a vector of numbers from -1 to 1 as a command of actuators and requests."""

from __future__ import annotations

from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.assembly.assemble import Assembly
from ffsm_mj.controller_protocol import Command, GivenCommand, Observation
from ffsm_mj.errors import Fault, ScenarioFaults, described, unknown_name
from ffsm_mj.gym.errors import EnvError
from ffsm_mj.gym.tip_action import TipAction
from ffsm_mj.scenario.env_config import EffortAction, EnvConfig, RequestAction

_ARM = ".arm"


class Efforts:
    """Efforts of actuators in proportion to the action."""

    def __init__(self, config: EffortAction, assembly: Assembly) -> None:
        """Resolve the actuators and their greatest efforts.

        Raises:
            ScenarioFaults: There is no such actuator, or it has no limit and ``max_effort`` is missing.
        """
        found, faults = [], []
        for i, name in enumerate(config.actuators):
            try:
                found.append(assembly.system.index("actuator", name))
            except LookupError as error:
                faults.append(Fault(str(error.args[0]), ("actuators", i)))
        if faults:
            raise ScenarioFaults(faults)
        self.actuators = np.array(found, dtype=np.intp)
        self.scale = _greatest(config, assembly, self.actuators)

    def efforts(self, action: FloatArray, _: Observation) -> FloatArray:
        """Efforts, N or N m, (n,), for numbers from -1 to 1, (n,)."""
        return action * self.scale


def _greatest(config: EffortAction, assembly: Assembly, actuators: Any) -> FloatArray:
    given = config.max_effort
    if isinstance(given, tuple) and len(given) != len(actuators):
        raise ScenarioFaults([Fault(f"has {len(given)} efforts for {len(actuators)} actuators", ("max_effort",))])
    if given is not None:
        return np.broadcast_to(np.array(given, dtype=np.float64), len(actuators)).copy()
    low, high = assembly.actuation.envelope.bounds(np.zeros(assembly.system.mj.nu))
    greatest = np.maximum(-low, high)[actuators]
    free = [name for name, effort in zip(config.actuators, greatest, strict=True) if not np.isfinite(effort)]
    if free:
        raise ScenarioFaults([Fault(f"is missing: no limit is known of {', '.join(free)}", ("max_effort",))])
    return np.asarray(greatest)


class Actions:
    """Command of one step of an environment.

    Attributes:
        size: Length of the action vector.
    """

    def __init__(self, config: EnvConfig, assembly: Assembly) -> None:
        """Bind the parts of the action vector to a run.

        Raises:
            ScenarioFaults: One fault per unknown name, or actuators that two parts drive.
        """
        self._parts: list[tuple[slice, Efforts | TipAction]] = []
        self._requests: list[tuple[int, str]] = []
        self.size, faults = 0, []
        self._named = np.zeros(assembly.system.mj.nu, dtype=np.bool_)
        handled = [name for source in assembly.plant.integrator.event_sources for name in source.requests]
        for i, part in enumerate(config.actions):
            try:
                if isinstance(part, RequestAction):
                    self._add_request(part, handled)
                else:
                    self._add_efforts(
                        Efforts(part, assembly) if isinstance(part, EffortAction) else TipAction(part, assembly)
                    )
            except ScenarioFaults as error:
                faults += [Fault(fault.message, ("env", "actions", i, *fault.path)) for fault in error.faults]
        if faults:
            raise ScenarioFaults(faults)
        self._command = Command.off(len(self._named))

    def _add_request(self, part: RequestAction, handled: list[str]) -> None:
        if part.request not in handled:
            raise ScenarioFaults([Fault(unknown_name("request", part.request, handled), ("request",))])
        self._requests.append((self.size, part.request))
        self.size += 1

    def _add_efforts(self, part: Efforts | TipAction) -> None:
        if self._named[part.actuators].any() or len(set(part.actuators.tolist())) != len(part.actuators):
            raise ScenarioFaults([Fault("drives actuators that are driven already")])
        self._named[part.actuators] = True
        self._parts.append((slice(self.size, self.size + len(part.scale)), part))
        self.size += len(part.scale)

    def checked(self, action: Any) -> FloatArray:
        """An action as a vector of doubles, clipped to [-1, 1].

        Raises:
            EnvError: It has another shape, or is not finite.
        """
        try:
            numbers = np.asarray(action, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise EnvError(f"action: not numbers ({described(error)})") from error
        if numbers.shape != (self.size,):
            raise EnvError(f"action: shape {numbers.shape}, but ({self.size},) is needed")
        if not np.isfinite(numbers).all():
            bad = ", ".join(str(i) for i in np.flatnonzero(~np.isfinite(numbers)))
            raise EnvError(f"action: must be finite, but is not at {bad}: {numbers.tolist()}")
        return np.clip(numbers, -1.0, 1.0)

    def command(self, action: FloatArray, observation: Observation) -> GivenCommand:
        """Command at a control tick for a checked action; the control laws of the phase command the other actuators.

        A closed grasp is not armed.
        """
        command = self._command
        command.clear()
        for place, part in self._parts:
            command.drive(part.actuators, part.efforts(action[place], observation))
        asked = {request for place, request in self._requests if action[place] > 0.0}
        command.requests.update(asked.difference(f"{name}{_ARM}" for name in observation.grasps))
        return GivenCommand(command, self._named)
