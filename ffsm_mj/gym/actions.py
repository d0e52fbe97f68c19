"""Actions: a vector of numbers from -1 to 1 as a command of actuators and requests, and of the motion of a site."""

from __future__ import annotations

from typing import Any

import numpy as np

from ffsm_controllers.task_space.singularity import damped_inverse
from ffsm_mj.arrays import FloatArray
from ffsm_mj.assembly.assemble import Assembly
from ffsm_mj.assembly.control_laws import task_of
from ffsm_mj.controller_protocol import Command, ControllerContext, ExternalCommand, Observation
from ffsm_mj.errors import Fault, Faults, ScenarioFaults, described, unknown_name
from ffsm_mj.gym.rewards import EnvError
from ffsm_mj.scenario.env_config import EffortAction, EnvConfig, RequestAction, TipVelocityAction, TipWrenchAction
from ffsm_mj.task_model import OutputModel

_AXES = {"x": 0, "y": 1, "z": 2}


class TipAction:
    """Efforts of joints for a velocity or a wrench of a site.

    Velocity: u = alpha^T Lambda (k (v - ydot) - drift - B d) + d, with Lambda the inverse of alpha M_c^-1 alpha^T, so that
    yddot = k (v - ydot) exactly while no actuator is at its limit; d is the damping of the joints, of which the site feels
    nothing. Wrench: u = alpha^T w + d. While an object is grasped, the robot is the one that holds it.

    Attributes:
        actuators: Ids of the motors, (n,).
        scale: Velocity or wrench of the action of ones, in m/s and rad/s, or N and N m, (p,).
    """

    def __init__(self, config: TipVelocityAction | TipWrenchAction, assembly: Assembly) -> None:
        """Resolve site and joints.

        Raises:
            ScenarioFaults: There is no such site or joint, or neither a site nor a task.
        """
        scenario, system = assembly.scenario, assembly.system
        if config.site is None and scenario.task is None:
            raise ScenarioFaults([Fault("is missing: the scenario has no task whose tip could be used", ("site",))])
        site = config.site if config.site is not None else str(system.mj.site(assembly.task.tip_site).name)  # type: ignore[union-attr]
        axes = [_AXES[axis] for axis in config.axes]
        systems = {"": system} | {name: grasped.system for name, grasped in assembly.grasped_systems.items()}
        contexts = {
            name: ControllerContext(
                one, task_of(scenario, one), scenario.control_period_s, external_field=assembly.plant.fields_in(one)
            )
            for name, one in systems.items()
        }
        self._tasks = {
            name: OutputModel(context, config.joints, site=site, axes=axes, attitude=config.rotation)
            for name, context in contexts.items()
        }
        self._config = config
        self.actuators = self._tasks[""].joints.actuators
        linear, angular = (
            (config.max_speed_m_s, config.max_rate_rad_s)
            if isinstance(config, TipVelocityAction)
            else (config.max_force_N, config.max_torque_N_m)
        )
        self.scale = np.array([linear] * len(axes) + [angular or 0.0] * (3 if config.rotation else 0))

    def efforts(self, action: FloatArray, observation: Observation) -> FloatArray:
        """Efforts of the motors, N or N m, (n,), for numbers from -1 to 1, (p,)."""
        config, task, wanted = self._config, self._tasks[observation.attached], action * self.scale
        task.update(observation.data)
        damped = -config.damping_N_m_s_rad * task.qd
        if isinstance(config, TipWrenchAction):
            return np.asarray(wanted.dot(task.alpha) + damped)
        acceleration = config.gain_1_s * (wanted - task.yd) - task.drift - task.B.dot(damped)
        inertia, _ = damped_inverse(task.B.dot(task.alpha.T), config.singular_mass_kg)
        return np.asarray(damped + inertia.dot(acceleration).dot(task.alpha))


_ARM = ".arm"


class Efforts:
    """Efforts of actuators in proportion to the action."""

    def __init__(self, config: EffortAction, assembly: Assembly) -> None:
        """Resolve the actuators and their greatest efforts.

        Raises:
            ScenarioFaults: There is no such actuator, or it has no limit and ``max_effort`` is missing.
        """
        ids = []
        with Faults() as faults:
            for i, name in enumerate(config.actuators):
                with faults.below("actuators", i):
                    ids.append(assembly.system.index("actuator", name))
        self.actuators = np.array(ids, dtype=np.intp)
        self.scale = _greatest(config, assembly, self.actuators)

    def efforts(self, action: FloatArray, _: Observation) -> FloatArray:
        """Efforts, N or N m, (n,), for numbers from -1 to 1, (n,)."""
        return action * self.scale


def _greatest(config: EffortAction, assembly: Assembly, actuators: Any) -> FloatArray:
    stated = config.max_effort
    if isinstance(stated, tuple) and len(stated) != len(actuators):
        raise ScenarioFaults([Fault(f"has {len(stated)} efforts for {len(actuators)} actuators", ("max_effort",))])
    if stated is not None:
        return np.broadcast_to(np.array(stated, dtype=np.float64), len(actuators)).copy()
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
        self.size = 0
        self._named = np.zeros(assembly.system.mj.nu, dtype=np.bool_)
        handled = [name for source in assembly.plant.integrator.event_sources for name in source.requests]
        with Faults() as faults:
            for i, part in enumerate(config.actions):
                with faults.below("env", "actions", i):
                    if isinstance(part, RequestAction):
                        self._add_request(part, handled)
                    elif isinstance(part, EffortAction):
                        self._add_efforts(Efforts(part, assembly))
                    else:
                        self._add_efforts(TipAction(part, assembly))
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

    def command(self, action: FloatArray, observation: Observation) -> ExternalCommand:
        """Command at a control tick for a checked action; the control laws of the phase command the other actuators.

        A closed grasp is not armed.
        """
        command = self._command
        command.clear()
        for place, part in self._parts:
            command.drive(part.actuators, part.efforts(action[place], observation))
        asked = {request for place, request in self._requests if action[place] > 0.0}
        command.requests.update(asked.difference(f"{name}{_ARM}" for name in observation.grasps))
        return ExternalCommand(command, self._named)
