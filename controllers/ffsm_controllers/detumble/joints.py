"""Joints that the law ``detumble`` drives: those of its wheels, then those of the arm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ffsm_controllers.detumble.config import DetumbleArm, DetumbleConfig
from ffsm_controllers.joint_servo import refuse_positions
from ffsm_mj.controller_protocol import (
    ControllerContext,
    Fault,
    Faults,
    IntArray,
    ScenarioFaults,
    StackMomentum,
    driven_joints,
    rotor_fault,
)


@dataclass(frozen=True)
class DetumbleJoints:
    """Joints by their part.

    Attributes:
        names: Full names: of the wheels, then of the arm.
        wheels: Places of the wheels among the rotors of the robot.
        wheel_names: Names of the wheels as a person calls them.
    """

    names: tuple[str, ...]
    wheels: IntArray
    wheel_names: tuple[str, ...]


def detumble_joints(config: DetumbleConfig, context: ControllerContext, stack: StackMomentum) -> DetumbleJoints:
    """Resolve wheels and joints of the arm, and check what the configuration says of them.

    Raises:
        ScenarioFaults: See :class:`ffsm_controllers.detumble.law.Detumble`.
    """
    wheels: list[int] = []
    with Faults() as faults:
        for i, name in enumerate(config.wheels):
            with faults.below("wheels", i):
                joint = _joint_of(name, context)
                if joint not in stack.wheels:
                    raise LookupError(_no_rotor(name, context, stack))
                wheels.append(stack.wheels.index(joint))
        for i in [i for i, wheel in enumerate(wheels) if wheel in wheels[:i]]:
            faults.add("is in the list twice", "wheels", i)
        faults.collected += _rate_faults(config, context.control_period_s)
    names = tuple(stack.wheels[i] for i in wheels)
    arm = _arm(config.arm, context, stack)
    both = [name for name in arm if name in names]
    if both:
        raise ScenarioFaults([Fault(f"{', '.join(both)} is a wheel", ("arm", "joints"))])
    return DetumbleJoints((*names, *arm), np.array(wheels, dtype=np.intp), tuple(name.split("/")[-1] for name in names))


def _no_rotor(actuator: str, context: ControllerContext, stack: StackMomentum) -> str:
    """Why an actuator, which exists, is not that of a rotor: the condition that fails."""
    system, joint = context.system, _joint_of(actuator, context)
    known = {one.name: one for one in system.robot.joints}
    why = rotor_fault(system, known[joint]) if joint in known else "it drives no joint of the robot"
    there = ", ".join(stack.wheels) or "there is none"
    return (
        f"{actuator!r} drives no rotor: {why}. A rotor is a balanced body on one unlimited hinge of the base. "
        f"Joints of rotors: {there}"
    )


def _joint_of(actuator: str, context: ControllerContext) -> str:
    """Joint that an actuator drives; empty if it drives none.

    Raises:
        LookupError: An unknown actuator.
    """
    model, index = context.system.mj, context.system.index("actuator", actuator)
    on_joint = model.actuator_trntype[index] == 0
    return str(model.joint(int(model.actuator_trnid[index, 0])).name) if on_joint else ""


def _arm(config: DetumbleArm, context: ControllerContext, stack: StackMomentum) -> tuple[str, ...]:
    """Full names of the joints of the arm.

    Raises:
        ScenarioFaults: Unknown ones, or positions that do not fit them; paths in the law's section.
    """
    system = context.system
    try:
        if config.joints is None:
            every = driven_joints(system, None, reserved=context.reserved).names
            names = tuple(name for name in every if name not in stack.wheels)
        else:
            names = driven_joints(system, config.joints).names
    except ScenarioFaults as error:
        if config.joints is None and config.positions is None:
            return ()  # a robot without an arm
        raise ScenarioFaults([Fault(f.message, ("arm", *f.path)) for f in error.faults]) from error
    if config.positions is not None:
        refuse_positions(system, names, config.positions, ("arm", "positions"))
    return names


def _rate_faults(config: DetumbleConfig, period_s: float) -> list[Fault]:
    """Rates that the control period cannot serve: an effort held for a period takes L to (1 - k dt) L."""
    rates = ((config.rate_1_s, ("rate_1_s",)), (config.arm.bandwidth_rad_s, ("arm", "bandwidth_rad_s")))
    return [
        Fault(f"is unstable at the control period of {period_s:g} s: stable below {1.0 / period_s:.4g}", path)
        for rate, path in rates
        if rate * period_s >= 1.0
    ]
