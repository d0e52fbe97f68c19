"""Joints that a controller drives, resolved to dofs and actuators."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import IntArray
from ffsm_mj.errors import Fault, ScenarioFaults, unknown_name
from ffsm_mj.model.actuators import external_servos, servo_mask
from ffsm_mj.model.inputs import controller_of, input_of
from ffsm_mj.model.magnetorquers import magnetorquer_mask
from ffsm_mj.model.system import Joint, System, followers

_SCALAR = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)


@dataclass(frozen=True)
class DrivenJoints:
    """Hinge or slide joints of the robot and their actuators, in the requested order.

    Attributes:
        names: Full names of the joints.
        qpos: Their addresses in ``qpos``, (n,).
        dofs: Their addresses in ``qvel``, (n,).
        actuators: Ids of their motors, (n,); or of all servos that move them, one or more joints each.
    """

    names: tuple[str, ...]
    qpos: IntArray
    dofs: IntArray
    actuators: IntArray


def driven_joints(
    system: System, names: Sequence[str] | None, key: str = "joints", reserved: Collection[int] = ()
) -> DrivenJoints:
    """Resolve joints by name; ``None`` means every motor-driven joint of the robot that is not a base joint.

    Of joints that an equality constraint couples only the one that leads is driven.

    A law of an object has it in place of the robot. Joints of a grasped object are not the robot's.

    Args:
        system: The system.
        names: Full or unambiguous names, or None.
        key: Name of the list in the section of the controller.
        reserved: Ids of actuators whose joints are left out where no names are given.

    Raises:
        ScenarioFaults: A joint is unknown, does not belong to the robot, has no motor, or is driven by a servo.
    """
    motors = motors_of_joints(system)
    is_named = names is not None
    if names is None:
        independent = _independent(system, [joint.name for joint in _robot_joints(system) if joint.name in motors])
        names = [name for name in independent if motors[name] not in reserved]
        if independent and not names:
            raise ScenarioFaults([Fault("no joint is left to drive: other parts of the phase drive them all", (key,))])
    servos = joints_of_servos(system)
    by_name = {joint.name: servos.get(joint.name, []) for joint in _robot_joints(system)}
    left = {name: ids for name, ids in by_name.items() if set(ids).difference(reserved)}
    if not is_named and left:
        or_name = f", or name the joints to drive ({key!r})" if names else ""
        ids = [i for actuators in left.values() for i in actuators]
        raise ScenarioFaults([Fault(f"{needs_motors(system, ids)}{or_name}", (key,))])
    named, faults = _named_joints(system, names, key)
    for i, joint in enumerate(named):
        if joint is not None and joint.name in servos:
            faults.append(Fault(needs_motors(system, servos[joint.name]), (key, i)))
        elif joint is not None and joint.name not in motors:
            faults.append(Fault(unknown_name("motor-driven joint", names[i], motors), (key, i)))
    faults += _following(system, [joint for joint in named if joint is not None], key) if not faults else []
    if not names and is_named:
        faults.append(Fault("must contain at least one joint, or be left out", (key,)))
    elif not names:
        faults.append(Fault("the robot has no motor-driven joint; add <motor joint=.../> to its MJCF", (key,)))
    if faults:
        raise ScenarioFaults(faults)
    joints = [joint for joint in named if joint is not None]
    return _driven(joints, [motors[joint.name] for joint in joints])


def servo_joints(
    system: System, names: Sequence[str] | None, key: str = "joints", reserved: Collection[int] = ()
) -> DrivenJoints | None:
    """Resolve joints that servos drive, as :func:`driven_joints` those of motors; None: motors drive them, or nothing.

    ``actuators`` are all servos that move these joints: one may move several, by a tendon.

    Raises:
        ScenarioFaults: Servos drive some of them, and motors others.
    """
    servos = joints_of_servos(system)
    if names is None:
        motors, candidates = motors_of_joints(system), _robot_joints(system)
        of_servos = [joint for joint in candidates if set(servos.get(joint.name, ())).difference(reserved)]
        others = [joint.name for joint in candidates if joint.name in motors and motors[joint.name] not in reserved]
    else:
        named = [joint for joint in _named_joints(system, names, key)[0] if joint is not None]
        of_servos = [joint for joint in named if joint.name in servos]
        others = [joint.name for joint in named if joint.name not in servos]
    if not of_servos:
        return None
    if others:
        message = (
            f"servos drive {', '.join(joint.name for joint in of_servos)}, and not {', '.join(others)}; name the joints of "
            "one kind here, and those of the other in a part of the phase of its own ('controllers')"
        )
        raise ScenarioFaults([Fault(message, (key,))])
    return _driven(of_servos, sorted({i for joint in of_servos for i in servos[joint.name]}))


def _robot_joints(system: System) -> list[Joint]:
    """Joints of the robot that are not of its base, nor of a grasped object."""
    base = range(system.robot.base_dofs.start, system.robot.base_dofs.stop)
    others = system.grasped.joints if system.grasped is not None and system.grasped is not system.robot else ()
    return [joint for joint in system.robot.joints if joint.dofs.start not in base and joint not in others]


def _driven(joints: Sequence[Joint], actuators: Sequence[int]) -> DrivenJoints:
    return DrivenJoints(
        tuple(joint.name for joint in joints),
        np.array([joint.qpos.start for joint in joints]),
        np.array([joint.dofs.start for joint in joints]),
        np.array(actuators, dtype=np.intp),
    )


def _named_joints(system: System, names: Sequence[str], key: str) -> tuple[list[Joint | None], list[Fault]]:
    """Joints by name, None for those that are unknown, and a fault for each of these."""
    robot = [joint.name for joint in system.robot.joints]
    joints: list[Joint | None] = []
    faults = []
    for i, name in enumerate(names):
        try:
            joints.append(system.joint(name))
        except LookupError:
            joints.append(None)
            faults.append(Fault(unknown_name("joint of the robot", name, robot), (key, i)))
    return joints, faults


def needs_motors(system: System, servos: Iterable[int]) -> str:
    """Message for a law that computes efforts and drives servos, by their ids."""
    ids = sorted({controller_of(system.mj, i) for i in servos})
    names = [system.names("actuator")[i] for i in ids]
    joints = [joint for joint, moving in joints_of_servos(system).items() if {*moving} & {*ids}]
    entries = ", ".join(f"{name}: {{kind: torque}}" for name in names)
    drive = "a servo drives" if len(names) == 1 else "servos drive"
    what = f"{drive} {', '.join(joints)}" if joints else f"takes a setpoint: {', '.join(names)}"
    return f"the law computes efforts, and {what}; write 'actuators: {{{entries}}}' in the scenario"


def joints_of_servos(system: System) -> dict[str, list[int]]:
    """Ids of the servos that move each hinge or slide joint of the robot, by joint name; those without inputs hold none."""
    model, by_joint = system.mj, dict[str, list[int]]()
    # A servo that acts from outside moves the base through them, and holds none.
    inputless = model.actuator_ctrllimited.astype(bool) & ~model.actuator_ctrlrange.any(axis=1)
    servos = sorted(set(np.flatnonzero(servo_mask(model) & ~inputless).tolist()) - set(external_servos(model)))
    if servos:
        data, moments = mujoco.MjData(model), np.zeros((model.nout, model.nv))
        mujoco.mj_forward(model, data)  # moments are zero before
        mujoco.mju_sparse2dense(moments, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind)
        for joint in system.robot.joints:
            moving = [i for i in servos if moments[i, joint.dofs.start] != 0.0]
            if moving and joint.kind in ("hinge", "slide"):
                by_joint[joint.name] = moving
    return by_joint


def _leader(system: System, name: str, names: Collection[str]) -> str:
    """The nearest joint of some names that a joint follows by equality constraints; empty if there is none."""
    following, seen = followers(system.mj), set[int]()
    joint = int(system.mj.joint(name).id)
    while joint in following and joint not in seen:
        seen.add(joint)
        joint = following[joint]
        if (leader := str(system.mj.joint(joint).name)) in names and leader != name:
            return leader
    return ""


def _independent(system: System, names: Sequence[str]) -> list[str]:
    """Those of some joints that follow no other one of them: they have coordinates of their own."""
    return [name for name in names if not _leader(system, name, names)]


def _following(system: System, joints: Sequence[Joint], key: str) -> list[Fault]:
    """Faults of joints that follow other ones of them."""
    names = [joint.name for joint in joints]
    leaders = [(i, name, _leader(system, name, names)) for i, name in enumerate(names)]
    return [
        Fault(f"{name} follows {leader}, which is driven too: leave one of them out", (key, i))
        for i, name, leader in leaders
        if leader
    ]


def motors_of_joints(system: System) -> dict[str, int]:
    """Id of the motor of each hinge or slide joint of the robot, by joint name."""
    model = system.mj
    motors = {}
    for i in np.flatnonzero(~servo_mask(model)).tolist():
        if model.actuator_trntype[i] != mujoco.mjtTrn.mjTRN_JOINT:
            continue
        joint = system.joints[model.joint(model.actuator_trnid[i, 0]).name]
        if joint in system.robot.joints and joint.kind in ("hinge", "slide"):
            motors[joint.name] = i
    return motors


def drives_rotation(model: Any, actuator: int) -> bool:
    """Whether the effort of an actuator is a torque; otherwise it is a force."""
    kind = mujoco.mjtJoint.mjJNT_FREE
    if mujoco.mjtTrn(model.actuator_trntype[actuator]) in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT):
        kind = mujoco.mjtJoint(model.jnt_type[model.actuator_trnid[actuator, 0]])
    if kind == mujoco.mjtJoint.mjJNT_FREE:
        return not np.any(model.actuator_gear[actuator, :3])
    return bool(kind != mujoco.mjtJoint.mjJNT_SLIDE)


def control_unit(model: Any, actuator: int) -> str:
    """Unit of the command of an actuator: that of its effort, or of a servo's setpoint; empty for a number without one.

    The setpoint of a servo has a unit where its gain is the coefficient of a length or of a rate of a joint: the force is
    zero where these are at the setpoint. An input of a controller has that of its kind.
    """
    rotates = drives_rotation(model, actuator)
    if not servo_mask(model)[actuator]:
        return "A m^2" if magnetorquer_mask(model)[actuator] else "N m" if rotates else "N"
    units = {"pos": "rad", "vel": "rad/s", "ff": "N m"} if rotates else {"pos": "m", "vel": "m/s", "ff": "N"}
    token, on_joint = input_of(model, actuator), model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT
    if token == "voltage":
        return "V"
    gain, (_, of_length, of_rate) = float(model.actuator_gainprm[actuator, 0]), model.actuator_biasprm[actuator, :3].tolist()
    if not on_joint or model.actuator_gear[actuator, 0] != 1.0:
        return ""
    if mujoco.mjtJoint(model.jnt_type[model.actuator_trnid[actuator, 0]]) not in _SCALAR:
        return ""
    if not token and gain != 0.0:
        token = "pos" if gain == -of_length else "vel" if of_length == 0.0 and gain == -of_rate else ""
    return units.get(token, "")


def unit_suffix(unit: str) -> str:
    """End of the name of a column in a unit, with its underscore."""
    return f"_{unit}".replace(" ", "_").replace("/", "_").replace("^", "") if unit else ""
