"""Joints that a controller drives, resolved to dofs and actuators."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import IntArray
from ffsm_mj.errors import Fault, ScenarioFaults, unknown_name
from ffsm_mj.model.actuators import servo_mask
from ffsm_mj.model.system import System


@dataclass(frozen=True)
class DrivenJoints:
    """Hinge or slide joints of the robot and their motors, in the requested order.

    Attributes:
        names: Full names of the joints.
        qpos: Their addresses in ``qpos``, (n,).
        dofs: Their addresses in ``qvel``, (n,).
        actuators: Ids of their motors, (n,).
    """

    names: tuple[str, ...]
    qpos: IntArray
    dofs: IntArray
    actuators: IntArray


def driven_joints(
    system: System, names: Sequence[str] | None, key: str = "joints", reserved: Collection[int] = ()
) -> DrivenJoints:
    """Resolve joints by name; ``None`` means every motor-driven joint of the robot that is not a base joint.

    A law of an object has it in place of the robot. Joints of a grasped object are not the robot's.

    Args:
        system: The system.
        names: Full or unambiguous names, or None.
        key: Name of the list in the section of the controller.
        reserved: Ids of actuators whose joints are left out where no names are given.

    Raises:
        ScenarioFaults: A joint is unknown, does not belong to the robot, or has no motor.
    """
    motors = _motors(system)
    key_given = names is not None
    base = range(system.robot.base_dofs.start, system.robot.base_dofs.stop)
    if names is None:
        others = system.grasped.joints if system.grasped is not None and system.grasped is not system.robot else ()
        own = [
            joint.name
            for joint in system.robot.joints
            if joint.name in motors and joint.dofs.start not in base and joint not in others
        ]
        names = [name for name in own if motors[name] not in reserved]
        if own and not names:
            raise ScenarioFaults([Fault("no joint is left to drive: other parts of the phase drive them all", (key,))])
    robot = [joint.name for joint in system.robot.joints]
    faults, found = [], []
    for i, name in enumerate(names):
        try:
            joint = system.joint(name)
        except LookupError:
            faults.append(Fault(unknown_name("joint of the robot", name, robot), (key, i)))
            continue
        if joint.name not in motors:
            faults.append(Fault(unknown_name("motor-driven joint", name, motors), (key, i)))
        found.append(joint)
    if not names and key_given:
        faults.append(Fault("must contain at least one joint, or be left out", (key,)))
    elif not found and not faults:
        faults.append(Fault("the robot has no motor-driven joint; add <motor joint=.../> to its MJCF", (key,)))
    if faults:
        raise ScenarioFaults(faults)
    return DrivenJoints(
        tuple(joint.name for joint in found),
        np.array([joint.qpos.start for joint in found]),
        np.array([joint.dofs.start for joint in found]),
        np.array([motors[joint.name] for joint in found]),
    )


def _motors(system: System) -> dict[str, int]:
    """Id of the actuator of each hinge or slide joint of the robot, by joint name."""
    model = system.mj
    motors = {}
    for i in range(model.nu):
        if model.actuator_trntype[i] != mujoco.mjtTrn.mjTRN_JOINT:
            continue
        joint = system.joints[model.joint(model.actuator_trnid[i, 0]).name]
        if joint in system.robot.joints and joint.kind in ("hinge", "slide"):
            motors[joint.name] = i
    return motors


def drives_rotation(model: Any, actuator: int) -> bool:
    """Whether the effort of an actuator is a torque; otherwise it is a force."""
    if model.actuator_trntype[actuator] != mujoco.mjtTrn.mjTRN_JOINT:
        return not np.any(model.actuator_gear[actuator, :3])
    return bool(model.jnt_type[model.actuator_trnid[actuator, 0]] == mujoco.mjtJoint.mjJNT_HINGE)


def control_unit(model: Any, actuator: int) -> str:
    """Unit of the command of an actuator: that of its effort, or of a servo's setpoint; empty for a number without one.

    The setpoint of a servo has a unit where its gain is the coefficient of a length or of a rate of a joint: the force is
    zero where these are at the setpoint.
    """
    rotates = drives_rotation(model, actuator)
    if not servo_mask(model)[actuator]:
        return "N m" if rotates else "N"
    on_joint = model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT
    gain, (_, of_length, of_rate) = float(model.actuator_gainprm[actuator, 0]), model.actuator_biasprm[actuator, :3].tolist()
    if not on_joint or model.actuator_gear[actuator, 0] != 1.0 or gain == 0.0:
        return ""
    if gain == -of_length:
        return "rad" if rotates else "m"
    return ("rad/s" if rotates else "m/s") if of_length == 0.0 and gain == -of_rate else ""


def unit_suffix(unit: str) -> str:
    """End of the name of a column in a unit, with its underscore."""
    return f"_{unit}".replace(" ", "_").replace("/", "_") if unit else ""
