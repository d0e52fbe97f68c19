"""Opens or closes the fingers of a gripper, or presses with a stated force.

To open or close, every finger goes to an end of its range with a stated bandwidth; ``force_N`` bounds the force with which
it presses on what it meets on the way. With ``force_N`` alone each finger is pushed with that force, whatever its position.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field, PositiveFloat, model_validator

from ffsm_controllers.finger_directions import closing_signs
from ffsm_controllers.joint_law import JointLaw
from ffsm_controllers.joint_servo import ServoConfig, joint_range, refuse_positions
from ffsm_controllers.pd import per_joint
from ffsm_mj.controller_protocol import (
    Command,
    ControllerContext,
    Damping,
    DrivenJoints,
    Fault,
    FloatArray,
    Observation,
    ScenarioFaults,
    Signal,
    System,
)

_Positions = tuple[float, ...] | float


class GripperConfig(ServoConfig):
    """Fingers on slides or hinges."""

    kind: Literal["gripper"]
    joints: Annotated[tuple[str, ...], Field(min_length=1)]
    """Joints of the fingers."""
    action: Literal["open", "close"] | None = None
    """Where the fingers go; left out: they are pushed with ``force_N``."""
    force_N: float | None = None
    """Force of each finger, N: with an action its bound, without one the force itself, positive to close and negative to
    open."""
    lever_m: tuple[PositiveFloat, ...] | PositiveFloat | None = None
    """Distance from the axis of each hinge to where its finger presses, m, one for all or one each: the torque is the force
    times this. Slides need none."""
    closed_at: _Positions | None = None
    """Position of each joint where the gripper is closed, rad or m, one for all or one each; left out: the end of its range
    towards the other fingers."""
    open_at: _Positions | None = None
    """Position where it is open; left out: the other end of its range."""

    def needs_bandwidth(self) -> bool:
        """Whether the fingers go somewhere."""
        return self.action is not None

    @model_validator(mode="after")
    def _does_something(self) -> GripperConfig:
        if self.action is None and self.force_N is None:
            raise ValueError("write 'action: open', 'action: close' or 'force_N'")
        if self.action is not None and self.force_N is not None and self.force_N <= 0.0:
            raise ValueError(f"with an action, force_N is a bound and must be positive, got {self.force_N:g}")
        return self


class Gripper(JointLaw):
    """Fingers that open, close, or press."""

    @dataclass
    class State:
        """Gains of the phase, (n, n)."""

        stiffness: FloatArray
        damping: FloatArray

    Config = GripperConfig
    telemetry_signals: ClassVar[tuple[Signal, ...]] = ()

    def __init__(self, config: GripperConfig, context: ControllerContext) -> None:
        """Resolve the fingers.

        Raises:
            ScenarioFaults: An unknown joint, an end that is not known, or a hinge without lever whose force is stated.
        """
        super().__init__(config, context)
        system = context.system
        if self._setpoints is not None:
            _refuse_force(config, system, self._joints)
        self._end: FloatArray | None = None
        if config.action is not None:
            self._end = _end(config, system, self._joints.names)
        n = len(self._joints.names)
        self._most, self._stiffness, self._damping = np.full(n, np.inf), np.zeros((n, n)), np.zeros((n, n))
        if config.force_N is not None:
            self._most = abs(config.force_N) * _levers(config, system, self._joints.names)
            if config.action is None:
                self._push = np.sign(config.force_N) * self._most * _closing(config, system, self._joints.names)

    def start(self, observation: Observation) -> None:
        """Take the gains."""
        data = observation.data
        if self._end is not None and self._setpoints is None:
            self._stiffness[:], self._damping[:] = self.gains_at(data, data.qpos[self._joints.qpos])

    def control(self, observation: Observation, command: Command) -> None:
        """Drive the fingers."""
        data, joints = observation.data, self._joints
        if self._end is None:
            command.drive(joints.actuators, self._push)
            return
        if self._setpoints is not None:
            command.set(joints.actuators, self._setpoints.at(data, self._end))
            return
        effort = -self._stiffness.dot(data.qpos[joints.qpos] - self._end) - self._damping.dot(data.qvel[joints.dofs])
        command.drive(joints.actuators, np.clip(effort, -self._most, self._most))

    def damping_at(self, data: Any) -> Damping | None:
        """That of the feedback; None where the fingers are only pushed, or driven by servos."""
        return super().damping_at(data) if self._end is not None else None

    def telemetry(self) -> Sequence[float]:
        """Nothing to report."""
        return ()


def _refuse_force(config: GripperConfig, system: System, joints: DrivenJoints) -> None:
    """Refuse a force where servos drive the fingers.

    Raises:
        ScenarioFaults: There is one.
    """
    if config.force_N is not None:
        names = [system.names("actuator")[i] for i in joints.actuators.tolist()]
        entries = ", ".join(f"{name}: {{kind: torque}}" for name in names)
        message = (
            f"a servo presses as its model file says; leave it out, or write 'actuators: {{{entries}}}' in the scenario"
        )
        raise ScenarioFaults([Fault(message, ("force_N",))])


def _end(config: GripperConfig, system: System, names: Sequence[str]) -> FloatArray:
    """Positions to go to.

    Raises:
        ScenarioFaults: The scenario does not state them and a joint has no range, or they are beyond it.
    """
    key = "closed_at" if config.action == "close" else "open_at"
    stated = config.closed_at if config.action == "close" else config.open_at
    if stated is not None:
        positions = per_joint(stated, len(names), key)
        refuse_positions(system, names, positions.tolist(), (key,))
        return positions
    low, high = np.array([joint_range(system, name) for name in names]).T
    unlimited = [name for name, ends in zip(names, np.isfinite(low), strict=True) if not ends]
    if unlimited:
        raise ScenarioFaults([Fault(f"{', '.join(unlimited)} has no range; write {key!r}", ("action",))])
    towards = _closing(config, system, names) * (1.0 if config.action == "close" else -1.0)
    return np.asarray(np.where(towards > 0.0, high, low), dtype=np.float64)


def _closing(config: GripperConfig, system: System, names: Sequence[str]) -> FloatArray:
    """Sign of the motion of each joint that closes the gripper.

    Raises:
        ScenarioFaults: Neither the scenario nor the places of the fingers tell.
    """
    if config.closed_at is not None and config.open_at is not None:
        closed, opened = (per_joint(getattr(config, key), len(names), key) for key in ("closed_at", "open_at"))
        return np.asarray(np.sign(closed - opened), dtype=np.float64)
    signs = closing_signs(system, names)
    unknown = [name for name, sign in zip(names, signs, strict=True) if not sign]
    if unknown:
        message = f"which way {', '.join(unknown)} closes the gripper does not follow from the model"
        raise ScenarioFaults([Fault(f"{message}; write 'closed_at' and 'open_at'", ("joints",))])
    return signs


def _levers(config: GripperConfig, system: System, names: Sequence[str]) -> FloatArray:
    """Effort of each joint per force of its finger: 1 for slides, levers for hinges, m.

    Raises:
        ScenarioFaults: A hinge has none.
    """
    hinges = np.array([system.joints[name].kind == "hinge" for name in names])
    if config.lever_m is None:
        if hinges.any():
            which = ", ".join(name for name, hinge in zip(names, hinges, strict=True) if hinge)
            message = f"needs 'lever_m', the distance from the axis of {which} to where the finger presses"
            raise ScenarioFaults([Fault(message, ("force_N",))])
        return np.ones(len(names))
    return np.where(hinges, per_joint(config.lever_m, len(names), "lever_m"), 1.0)
