"""Tendons of a compiled scene: springs and dampers that act on the world or drive, and inertias that do not fit the model.

A tendon between links of one tree is internal: its forces exchange no momentum with anything else. One that is attached to
the world, or has a coefficient on a joint of a base, acts on the world.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.model.coefficients import sign_preserving, tendon_damping_coefficients, tendon_stiffness_coefficients
from ffsm_mj.model.files import ModelFiles
from ffsm_mj.model.joint_limits import IGNORE, LEAST_RANGE
from ffsm_mj.model.places import Places
from ffsm_mj.model.system import ancestors, tendon_bodies

_JOINT = int(mujoco.mjtWrap.mjWRAP_JOINT)
_ON_JOINT = int(mujoco.mjtTrn.mjTRN_JOINT)


def tendon_springs_faults(model: Any) -> Iterator[tuple[str, str]]:
    """Yield (full name of a tendon, what of its spring or damper breaks conservation)."""
    stiffness, damping = tendon_stiffness_coefficients(model), tendon_damping_coefficients(model)
    for t in range(model.ntendon):
        name, present = model.tendon(t).name, {"stiffness": stiffness[t].any(), "damping": damping[t].any()}
        if acts_on_world(model, t):
            yield from ((name, f"{what} that acts on the world") for what, there in present.items() if there)
        elif not sign_preserving(damping[t]):
            yield name, "damping that drives the tendon at some rates"
        if model.tendon_plasticadr[t] >= 0:
            yield name, "springyield, a spring that yields"


def acts_on_world(model: Any, tendon: int) -> bool:
    """Whether a tendon is attached to the world or to a fixed object, or has a coefficient on a joint of a base."""
    path = range(int(model.tendon_adr[tendon]), int(model.tendon_adr[tendon] + model.tendon_num[tendon]))
    joints = [int(model.wrap_objid[i]) for i in path if model.wrap_type[i] == _JOINT]
    on_base = any(model.body_parentid[model.jnt_bodyid[joint]] == 0 for joint in joints)
    return on_base or any(model.body_weldid[body] == 0 for body in tendon_bodies(model, tendon))


def limit_faults(model: Any, scene: Any, files: Mapping[str, ModelFiles]) -> Iterator[str]:
    """Limits of tendons that are no stops between links, each with the file and line of its model.

    Args:
        model: The compiled scene.
        scene: Its specification.
        files: Files of each model by its prefix in the scene.
    """
    places = Places(scene, files)
    for t in np.flatnonzero(model.tendon_limited).tolist():
        what, (low, high) = "", model.tendon_range[t].tolist()
        if acts_on_world(model, t):
            what = "limits of a tendon that acts on the world are not supported, as they would be external forces"
        elif not high - low > LEAST_RANGE:
            what = f"the range {low:g} {high:g} allows a single length"
        if what:
            yield f"{places.of('tendon', model.tendon(t).name)}: {what}; remove its range, {IGNORE}"


def armature_faults(model: Any, scene: Any, files: Mapping[str, ModelFiles]) -> list[str]:
    """Armatures of actuators and tendons that are not an inertia between links of one tree.

    That of a motor on a joint of a base, or of a tendon that acts on the world, is inertia against the world, which the
    momentum of the bodies lacks. MuJoCo's mass matrix has no entries for joints of different branches: it drops the terms of
    a tendon that couples them, and energy is not conserved.

    Args:
        model: The compiled scene.
        scene: Its specification.
        files: Files of each model by its prefix in the scene.
    """
    places, faults = Places(scene, files), []
    for i in np.flatnonzero(model.actuator_armature).tolist():
        joint = int(model.actuator_trnid[i, 0])
        if model.actuator_trntype[i] == _ON_JOINT and model.body_parentid[model.jnt_bodyid[joint]] == 0:
            faults.append(
                f"{places.of('actuator', model.actuator(i).name)} has armature {model.actuator_armature[i]:g} on a joint "
                'of the base, which joins it to the world, which has no part in the dynamics; write armature="0"'
            )
    for t in np.flatnonzero(model.tendon_armature).tolist():
        what = ""
        if acts_on_world(model, t):
            what = "and acts on the world, which has no part in the dynamics"
        elif not _on_one_branch(model, t):
            what = "and couples joints of two branches, whose terms MuJoCo leaves out of the mass matrix"
        if what:
            place = places.of("tendon", model.tendon(t).name)
            faults.append(f'{place} has armature {model.tendon_armature[t]:g}, {what}; write armature="0"')
    return faults


def _on_one_branch(model: Any, tendon: int) -> bool:
    """Whether the bodies that a tendon is attached to are links of one chain, the first of which may be the base."""
    bodies = tendon_bodies(model, tendon)
    chains = [set(ancestors(model, body)) for body in bodies]
    longest = max(chains, key=len)
    return all(body in longest for body in bodies)
