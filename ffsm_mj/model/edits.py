"""What a scenario changes in a specification before it is compiled: sites, flexible drives, motors, what it strips.

The files are not changed; a run, a log replay and a rerun make the same changes.

A flexible joint is the inertia of the motor behind a spring (Spong, 1987). The joint of the file becomes the motor side,
after the gear: its coordinate is what an encoder on the motor reads, and its actuators, limits and damping act there. A
joint ``<name>_flex`` about the same axis follows, with the spring and the damper: the angle of the link is the sum of both.
The rotor is an ``armature`` of gear^2 times its inertia: kinetic energy of its own spin. It has no mass, and its spin no
angular momentum, so momenta are those of the links, and are conserved exactly.

M. W. Spong, Modeling and control of elastic joint robots, J. Dyn. Sys. Meas. Control 109(4), 310-318.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

import mujoco
from pydantic import NonNegativeFloat, PositiveFloat

from ffsm_mj.config import StrictModel
from ffsm_mj.errors import Faults, first_few, plural, unknown_name


@dataclass(frozen=True)
class AddedSite:
    """A site to add to a model: MJCF cannot add one to a body of an attached model.

    Attributes:
        name: Its name in the model.
        body: Name in the model of the body that it is fixed to.
        pos_m: Position in the frame of the body, (3,), m.
        quaternion: Its axes in those of the body, w, x, y, z, (4,).
    """

    name: str
    body: str
    pos_m: tuple[float, float, float]
    quaternion: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0)


def add_sites(spec: Any, sites: Iterable[AddedSite], keys: tuple[str, ...]) -> None:
    """Add sites to a specification before it is compiled.

    Args:
        spec: Specification of the model; all its elements have names.
        sites: The sites.
        keys: Path of the model in the scenario.

    Raises:
        ScenarioFaults: A body does not exist, or a site of that name exists.
    """
    with Faults() as faults:
        for site in sites:
            body = spec.body(site.body)
            if body is None or body.name == "world":
                names = [parent.name for parent in spec.bodies[1:]]
                faults.add(unknown_name("body", site.body, names), *keys, "sites", site.name, "body")
            elif site.name in {present.name for present in spec.sites}:
                faults.add("the model already has a site of this name; choose another", *keys, "sites", site.name)
            else:
                body.add_site(name=site.name, pos=site.pos_m, quat=site.quaternion)


_SCALAR = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
SUFFIX = "_flex"
"""End of the name of the joint with the spring."""


class JointFlex(StrictModel):
    """A flexible drive: the inertia of the rotor, a gear, then a spring with a damper to the link."""

    stiffness: PositiveFloat
    """Stiffness between the output of the gear and the link, N m/rad; N/m for a slide joint."""
    damping: NonNegativeFloat = 0.0
    """Damping across the spring, N m s/rad; N s/m for a slide joint."""
    gear: PositiveFloat = 1.0
    """Rate of the rotor over that of the joint; 1/m for a slide joint."""
    rotor_inertia: PositiveFloat
    """Inertia of the rotor about its axis, kg m^2; the joint feels gear^2 times it, in place of an armature of the file."""


def add_flex(spec: Any, flex: Mapping[str, JointFlex]) -> None:
    """Make joints of a specification flexible before it is compiled.

    Args:
        spec: Specification of the robot; all its elements have names.
        flex: Flexible drives by the name of the joint in the file.

    Raises:
        ScenarioFaults: A joint does not exist, is one of the base, is no hinge or slide, or is not the only one of its body.
    """
    with Faults() as faults:
        for name, deflection in flex.items():
            joint = spec.joint(name)
            if fault := _flex_fault(spec, name, joint):
                faults.add(fault, "robot", "joint_flex", name)
            else:
                _make_flexible(joint, deflection)
    if flex:
        for key in list(spec.keys):  # keyframes have a value per coordinate; they are not used in a scene
            spec.delete(key)


def _flex_fault(spec: Any, name: str, joint: Any) -> str:
    """Why a joint cannot be made flexible; empty if it can."""
    if joint is None:
        return unknown_name("joint", name, [candidate.name for candidate in spec.joints])
    if joint.parent.parent.name == "world":
        return "is a joint of the base, between the robot and the world"
    if joint.type not in _SCALAR:
        return "must be a hinge or slide joint"
    if len(joint.parent.joints) > 1:
        return f"must be the only joint of its body; {joint.parent.name!r} has {len(joint.parent.joints)}"
    if spec.joint(name + SUFFIX) is not None:
        return f"the model already has a joint {name + SUFFIX!r}"
    return ""


def _make_flexible(joint: Any, flex: JointFlex) -> None:
    """Put the rotor on a joint, and add the joint with the spring after it."""
    joint.armature = flex.gear**2 * flex.rotor_inertia
    spring = joint.parent.add_joint(name=joint.name + SUFFIX, type=joint.type)
    spring.pos, spring.axis = joint.pos, joint.axis
    if joint.frame is not None:
        spring.set_frame(joint.frame)
    # Defaults of the file are for its own joints.
    spring.stiffness, spring.damping = (flex.stiffness, 0.0, 0.0), (flex.damping, 0.0, 0.0)
    spring.armature, spring.frictionloss, spring.ref, spring.springref = 0.0, 0.0, 0.0, 0.0
    spring.limited, spring.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE, mujoco.mjtLimited.mjLIMITED_FALSE


Strippable = Literal[
    "damping", "frictionloss", "stiffness", "limits", "equalities", "tendons", "servos", "gravcomp", "sensors"
]
STRIPPABLE: tuple[str, ...] = get_args(Strippable)
LimitsMode = Literal["stop", "ignore"]
"""``stop``: a joint cannot move past the limits of its model; ``ignore``: they are removed."""


def is_limited(element: Any) -> bool:
    """Whether a joint or tendon of a specification has limits, or a range that MuJoCo would take for none."""
    limited = mujoco.mjtLimited(element.limited)
    return limited == mujoco.mjtLimited.mjLIMITED_TRUE or (
        limited == mujoco.mjtLimited.mjLIMITED_AUTO and bool(element.range.any())
    )


def to_strip(words: Iterable[str] | None, limits: str | None) -> tuple[str, ...]:
    """Elements to remove from a model by the keys ``strip`` and ``limits`` of a scenario; None: not given."""
    chosen = tuple(words or ())
    return (*chosen, "limits") if limits == "ignore" and "limits" not in chosen else chosen


def strip(spec: Any, what: Iterable[str]) -> list[str]:
    """Remove elements from a specification before it is compiled.

    Args:
        spec: Specification of the model; all its elements have names.
        what: ``damping``, ``frictionloss`` and ``stiffness`` of joints, tendons and actuators (a ``springdamper`` goes with
            either of its two), ``limits`` of joints and tendons, ``equalities``, ``tendons`` with the actuators, sensors and
            equalities that need them, ``servos``: the actuators that are no plain motors, with the sensors that need them,
            and ``gravcomp`` of bodies, and ``sensors``.

    Returns:
        A phrase for each kind of removed element, such as ``damping of 2 joints (elbow, wrist)``.
    """
    wanted, removed = set(what), []
    for word in STRIPPABLE:
        if word not in wanted:
            continue
        if word == "equalities":
            removed += _deleted(spec, "equality constraint", list(spec.equalities))
        elif word == "sensors":
            removed += _deleted(spec, "sensor", list(spec.sensors))
        elif word == "tendons":
            removed += _without_tendons(spec)
        elif word == "gravcomp":
            names = [body.name for body in spec.bodies if _clear_gravcomp(body)]
            removed += [f"gravcomp of {_counted('link', names)}"] if names else []
        elif word == "servos":
            removed += _without_actuators(spec, [actuator for actuator in spec.actuators if not is_plain_motor(actuator)])
        else:
            actuators = spec.actuators if word == "damping" else ()
            for noun, elements in (("joint", spec.joints), ("tendon", spec.tendons), ("actuator", actuators)):
                names = [element.name for element in elements if _clear(element, word)]
                removed += [f"{word} of {_counted(noun, names)}"] if names else []
    return removed


def _clear(element: Any, word: str) -> bool:
    """Clear a property of a joint or tendon; returns whether it was set."""
    if word == "limits":
        limited = is_limited(element)
        element.limited = mujoco.mjtLimited.mjLIMITED_FALSE
        return limited
    if word == "frictionloss":
        had, element.frictionloss = bool(element.frictionloss), 0.0
        return had
    had = bool(getattr(element, word).any())
    getattr(element, word)[:] = 0.0
    springdamper = getattr(element, "springdamper", None)
    if springdamper is not None and springdamper.any():
        springdamper[:] = 0.0
        had = True
    return had


def _clear_gravcomp(body: Any) -> bool:
    """Clear the gravity compensation of a body; returns whether it was set."""
    had, body.gravcomp = bool(body.gravcomp), 0.0
    return had


def _without_tendons(spec: Any) -> list[str]:
    tendons = list(spec.tendons)
    names = {tendon.name for tendon in tendons}
    removed = _without_sensors_of(spec, mujoco.mjtObj.mjOBJ_TENDON, names)
    pulling = [
        actuator
        for actuator in spec.actuators
        if actuator.trntype == mujoco.mjtTrn.mjTRN_TENDON and actuator.target in names
    ]
    removed += _without_actuators(spec, pulling)
    equalities = [equality for equality in spec.equalities if equality.type == mujoco.mjtEq.mjEQ_TENDON]
    return removed + _deleted(spec, "equality constraint", equalities) + _deleted(spec, "tendon", tendons)


def _without_actuators(spec: Any, actuators: list[Any]) -> list[str]:
    names = {actuator.name for actuator in actuators}
    removed = _without_sensors_of(spec, mujoco.mjtObj.mjOBJ_ACTUATOR, names)
    return removed + _deleted(spec, "actuator", actuators)


def _without_sensors_of(spec: Any, kind: Any, names: set[str]) -> list[str]:
    gone = {(int(kind), name) for name in names}
    needing = [
        candidate
        for candidate in spec.sensors
        if {(int(candidate.objtype), candidate.objname), (int(candidate.reftype), candidate.refname)} & gone
    ]
    return _deleted(spec, "sensor", needing)


def _deleted(spec: Any, noun: str, elements: list[Any]) -> list[str]:
    names = [element.name for element in elements]
    for element in elements:
        spec.delete(element)
    return [_counted(noun, names)] if names else []


def _counted(noun: str, names: list[str]) -> str:
    return f"{plural(len(names), noun)} ({first_few([name or 'unnamed' for name in names])})"


def is_plain_motor(element: Any) -> bool:
    """Whether an actuator of a specification or a model delivers its command, and by no contact force."""
    return (element.gaintype, element.biastype, element.dyntype) == (
        mujoco.mjtGain.mjGAIN_FIXED,
        mujoco.mjtBias.mjBIAS_NONE,
        mujoco.mjtDyn.mjDYN_NONE,
    ) and element.trntype != mujoco.mjtTrn.mjTRN_BODY  # of an <adhesion>


def motors_of(model: str, kinds: Mapping[str, str]) -> tuple[str, ...]:
    """Actuators of a model that a scenario makes motors, by their names in its file; others may be in another model.

    Args:
        model: ``robot`` or the name of an object.
        kinds: Kinds of actuators in the scenario, by their names there.
    """
    return tuple(name.removeprefix(f"{model}/") for name, kind in kinds.items() if kind == "torque")


def make_motors(spec: Any, names: Iterable[str]) -> None:
    """Make ideal motors of some actuators of a specification: with gain 1, without a law, within ``forcerange``.

    ``ctrlrange`` goes: that of a servo is of its setpoint.
    """
    for actuator in spec.actuators:
        if actuator.name in names and not is_plain_motor(actuator):
            actuator.set_to_motor()
            actuator.ctrllimited, actuator.actlimited = mujoco.mjtLimited.mjLIMITED_FALSE, mujoco.mjtLimited.mjLIMITED_FALSE
            actuator.inheritrange, actuator.actdim, actuator.actearly, actuator.ctrlspec = 0.0, -1, False, 0
