"""Actuators of a compiled scene: which are plain motors, and the limits that joints place on their efforts.

A plain motor delivers its command: ``force = gain * ctrl``, along one direction, without a law of its own. Its work enters
the balance by the displacement along that direction. Every other kind is refused by name, with file and line.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.model.files import ModelFiles
from ffsm_mj.model.places import Places
from ffsm_mj.model.system import ancestors

_JOINT, _SITE = mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_SITE
_TENDON = mujoco.mjtTrn.mjTRN_TENDON
_ADHESION = mujoco.mjtTrn.mjTRN_BODY
_FREE, _BALL = mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL
_SERVOS = "use 'strip: [servos]' in the scenario"


def is_plain_motor(element: Any) -> bool:
    """Whether an actuator of a specification or a model delivers its command, and by no contact force."""
    return (element.gaintype, element.biastype, element.dyntype) == (
        mujoco.mjtGain.mjGAIN_FIXED,
        mujoco.mjtBias.mjBIAS_NONE,
        mujoco.mjtDyn.mjDYN_NONE,
    ) and element.trntype != _ADHESION


def actuator_faults(model: Any, scene: Any, files: Mapping[str, ModelFiles]) -> list[str]:
    """Actuators that are not plain motors, each with the file and line of its model.

    Args:
        model: The compiled scene.
        scene: Its specification.
        files: Files of each model by its prefix in the scene.
    """
    places = Places(scene, files)
    elements = {each.name: each for each in scene.actuators}
    names = [model.actuator(i).name for i in range(model.nactuator)]
    return [
        f"{places.of('actuator', name)} {what}"
        for i, name in enumerate(names)
        for what in _faults(model, i, plain=is_plain_motor(elements[name]))
    ]


def _faults(model: Any, i: int, *, plain: bool) -> Iterator[str]:
    """What is wrong with an actuator, as text."""
    kind, target = model.actuator_trntype[i], model.actuator_trnid[i, 0]
    gear = model.actuator_gear[i]
    if kind == _ADHESION:
        yield (
            "is an <adhesion>: it acts by MuJoCo's contact forces, which contact models replace; "
            f"{_SERVOS}, and a grasp ('captures', with 'load_limit') in its place"
        )
        return
    if not plain:
        yield f"is not a plain <motor>: its force would not be the command; write <motor>, or {_SERVOS}"
    if kind == _JOINT and model.jnt_type[target] == _FREE:
        yield (
            "is a motor on a free joint; write <motor site=... gear=...> with a site of that body, "
            "whose force and torque turn with the body"
        )
    elif kind == _JOINT and model.jnt_type[target] == _BALL:
        yield "is a motor on a ball joint, which is not supported; use three hinges, or remove it"
    elif model.actuator_gainprm[i, 0] == 0.0 or not (gear[0] if kind == _JOINT else gear.any()):
        yield "has gear or gain 0: it drives nothing"
    if model.actuator_damping[i] or model.actuator_dampingpoly[i].any():
        yield f"has damping {model.actuator_damping[i]:g}; move it to its joint, or use 'strip: [damping]' in the scenario"


def effort_limits(model: Any, scene: Any, files: Mapping[str, ModelFiles]) -> tuple[FloatArray, list[str]]:
    """Limits of joint efforts in model files as limits of motors, and faults of those that are none.

    ``actuatorfrcrange`` of MJCF and ``<limit effort>`` of URDF limit the sum of what all actuators do to a joint. With one
    motor on the joint and no other actuator that acts on it, that is a limit of the motor, which its command must meet
    before it is applied, logged and entered in the balance.

    Args:
        model: The compiled scene.
        scene: Its specification.
        files: Files of each model by its prefix in the scene.

    Returns:
        Least and greatest effort of each actuator, N or N m, infinite without a limit, (number of actuators, 2); and faults.
    """
    limits = np.tile([-np.inf, np.inf], (model.nactuator, 1))
    places, faults = Places(scene, files), []
    on_joint = model.actuator_trntype == int(_JOINT)
    for j in np.flatnonzero(model.jnt_actfrclimited).tolist():
        motors = np.flatnonzero(on_joint & (model.actuator_trnid[:, 0] == j))
        others = [i for i in np.flatnonzero(~on_joint).tolist() if _acts_on(model, i, int(model.jnt_bodyid[j]))]
        of_base = model.body_parentid[model.jnt_bodyid[j]] == 0
        # MuJoCo applies a limit at a joint of the base to thrusters too, and the balance follows it.
        if len(motors) + len(others) > 1 or (others and not of_base):
            names = ", ".join(model.actuator(i).name for i in (*motors, *others))
            faults.append(
                f"{places.of('joint', model.joint(j).name)} has an effort limit, and on it act {names}: such a limit is "
                "supported for a single motor; remove it, and write a 'forcerange' for each of them"
            )
        limits[motors] = model.jnt_actfrcrange[j]
    # MuJoCo would clamp the sum of the motors of a tendon after their own limits, and the log would state more than acts.
    faults += [
        f"{places.of('tendon', model.tendon(t).name)} has actuatorfrcrange, which is supported for joints only; "
        "remove it, and write a 'forcerange' for each motor of the tendon"
        for t in np.flatnonzero(model.tendon_actfrclimited).tolist()
        if t in model.actuator_trnid[model.actuator_trntype == _TENDON, 0]
    ]
    return limits, faults


def _acts_on(model: Any, actuator: int, body: int) -> bool:
    """Whether an actuator that is no motor of a joint may exert a force on the joints of a body."""
    if model.actuator_trntype[actuator] != _SITE:
        return True
    ends = [int(model.site_bodyid[site]) for site in model.actuator_trnid[actuator] if site >= 0]
    return any(body in ancestors(model, end) for end in ends)
