"""Flexible joints that a scenario gives to a robot: the inertia of the motor behind a spring (Spong, 1987).

The joint of the file becomes the motor side, after the gear: its coordinate is what an encoder on the motor reads, and its
actuators, limits and damping act there. A joint ``<name>_flex`` about the same axis follows, with the spring and the damper:
the angle of the link is the sum of both. The rotor is an ``armature`` of gear^2 times its inertia: kinetic energy of its own
spin. It has no mass, and its spin no angular momentum, so momenta are those of the links, and are conserved exactly.

M. W. Spong, Modeling and control of elastic joint robots, J. Dyn. Sys. Meas. Control 109(4), 310-318.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
from pydantic import NonNegativeFloat, PositiveFloat

from ffsm_mj.config import StrictModel
from ffsm_mj.errors import Fault, ScenarioFaults, unknown_name

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
    faults = []
    for name, given in flex.items():
        joint = spec.joint(name)
        fault = _fault(spec, name, joint)
        if fault:
            faults.append(Fault(fault, ("robot", "joint_flex", name)))
        else:
            _make_flexible(joint, given)
    if faults:
        raise ScenarioFaults(faults)
    if flex:
        for key in list(spec.keys):  # keyframes have a value per coordinate; they are not used in a scene
            spec.delete(key)


def _fault(spec: Any, name: str, joint: Any) -> str:
    """Why a joint cannot be made flexible; empty if it can."""
    if joint is None:
        return unknown_name("joint", name, [each.name for each in spec.joints])
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
