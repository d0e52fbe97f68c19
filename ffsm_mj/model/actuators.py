"""Actuators of a compiled scene: plain motors and servos, and the limits that joints place on efforts.

A plain motor delivers its command: ``force = gain * ctrl``, along one direction, without a law of its own. A servo has one:
it is commanded by a setpoint, and its force follows from the state in every stage of a step. What cannot be modelled is
refused by name, with file and line.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import BoolArray, FloatArray, IntArray
from ffsm_mj.model.inputs import NO_VOLTAGE, further_inputs
from ffsm_mj.model.magnetorquers import magnetorquer_mask
from ffsm_mj.model.system import ancestors, driven_bodies, is_fixed_tendon

_JOINT, _SITE = mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_SITE
_TENDON, _IN_PARENT = mujoco.mjtTrn.mjTRN_TENDON, mujoco.mjtTrn.mjTRN_JOINTINPARENT
_ADHESION = mujoco.mjtTrn.mjTRN_BODY
_FREE, _BALL = mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL
_GAIN, _BIAS, _DYN = mujoco.mjtGain, mujoco.mjtBias, mujoco.mjtDyn
_UNKNOWN = (int(_GAIN.mjGAIN_USER), int(_GAIN.mjGAIN_SO3))
_UNKNOWN_BIAS = (int(_BIAS.mjBIAS_USER), int(_BIAS.mjBIAS_SO3))
SLEW_RATE, INTEGRAL_LIMIT = 8, 9
"""Places in the gain parameters of a controller, free in MuJoCo's, of what :func:`smooth_controllers` moves there."""
_NO_SLEW = 1e-300
_SERVOS = "use 'strip: [servos]' in the scenario"
_INSTEAD = f"make a motor of it by 'kind: torque' under 'actuators' in the scenario, or {_SERVOS}"
_OF_ORIENTATION = (
    "is an <orientation> servo, with three forces of one actuator, where commands, limits and logs have one; write three "
    "<position> servos with the gears '1 0 0', '0 1 0' and '0 0 1', which turn alike while they are close to their "
    f"setpoints, or {_SERVOS}"
)
_OF_ADHESION = (
    "is an <adhesion>: it acts by MuJoCo's contact forces, which contact models replace; "
    f"{_SERVOS}, and a grasp ('grasps', with 'load_limit') in its place"
)


def servo_mask(model: Any) -> BoolArray:
    """Actuators of a compiled model that have a law of their own, (nactuator,)."""
    plain = (
        (model.actuator_gaintype == int(mujoco.mjtGain.mjGAIN_FIXED))
        & (model.actuator_biastype == int(mujoco.mjtBias.mjBIAS_NONE))
        & (model.actuator_dyntype == int(mujoco.mjtDyn.mjDYN_NONE))
    )
    return np.asarray(~plain)


def is_servo(model: Any, actuator: int) -> bool:
    """Whether an actuator of a compiled model has a law of its own."""
    return bool(servo_mask(model)[actuator])


def has_servos(model: Any) -> bool:
    """Whether an actuator of a compiled model has a law of its own."""
    return bool(servo_mask(model).any())


def thruster_ids(model: Any) -> IntArray:
    """Plain motors that exert a force at a site without reference site: an external force on its body, (n,)."""
    at_site = (model.actuator_trntype == int(_SITE)) & (model.actuator_trnid[:, 1] < 0)
    return np.flatnonzero(at_site & ~servo_mask(model) & ~magnetorquer_mask(model))


def external_servos(model: Any) -> IntArray:
    """Servos that act from outside, at a site without reference site or on a free joint, (n,)."""
    target, kind = model.actuator_trnid[:, 0], model.actuator_trntype
    on_free = (kind == int(_JOINT)) & (model.jnt_type[np.where(kind == int(_JOINT), target, 0)] == int(_FREE))
    at_site = (kind == int(_SITE)) & (model.actuator_trnid[:, 1] < 0)
    return np.flatnonzero((at_site | on_free) & servo_mask(model))


def without_servos(model: Any) -> Any:
    """A copy of a model whose servos exert no force; the model itself if it has none."""
    servos = servo_mask(model)
    if not servos.any():
        return model
    other = copy.copy(model)
    other.actuator_gaintype[servos], other.actuator_gainprm[servos] = int(mujoco.mjtGain.mjGAIN_FIXED), 0.0
    other.actuator_biastype[servos] = int(mujoco.mjtBias.mjBIAS_NONE)
    return other


def without_force_limits(model: Any) -> Any:
    """A copy of a model whose actuators, joints and tendons have no limits on forces."""
    other = without_joint_limits(model)
    other.actuator_forcelimited[:] = 0
    return other


def without_joint_limits(model: Any) -> Any:
    """A copy of a model whose joints and tendons have no limits on the forces of actuators; these keep their own."""
    other = copy.copy(model)
    other.jnt_actfrclimited[:], other.tendon_actfrclimited[:] = 0, 0
    return other


def controllers_of(model: Any, kind: Any) -> tuple[IntArray, IntArray, IntArray]:
    """Actuators of a compiled model that are controllers of a kind, ``mjGAIN_PID`` or ``mjGAIN_DCMOTOR``.

    Returns:
        Their ids, and the addresses of effective setpoints and of integrals in the activations; -1 without, (n,) each.
    """
    ids = np.flatnonzero(model.actuator_gaintype == int(kind))
    slew, gain = (1, 0) if kind == _GAIN.mjGAIN_PID else (7, 5)
    slews, integrates = model.actuator_dynprm[ids, slew] > 0.0, model.actuator_gainprm[ids, gain] > 0.0
    first = model.actuator_actadr[ids]
    return ids, np.where(slews, first, -1), np.where(integrates, first + slews, -1)


def smooth_controllers(model: Any) -> None:
    """Take the limits of setpoint rates and integrals out of the laws of a compiled model's controllers.

    Both would act at the ends of MuJoCo's time steps. The effective setpoint becomes the activation itself, and the integral
    that of the error; the stages of the steps apply the limits, which move to free places of the gain parameters.
    """
    for kind, slew, limit in ((_GAIN.mjGAIN_PID, 1, 0), (_GAIN.mjGAIN_DCMOTOR, 7, 8)):
        ids, slews, _ = controllers_of(model, kind)
        model.actuator_gainprm[ids, SLEW_RATE] = model.actuator_dynprm[ids, slew]
        model.actuator_gainprm[ids, INTEGRAL_LIMIT] = model.actuator_dynprm[ids, limit]
        # The least positive rate keeps the activation, and moves the setpoint by nothing.
        model.actuator_dynprm[ids, slew] = np.where(slews >= 0, _NO_SLEW, 0.0)
        model.actuator_dynprm[ids, limit] = 0.0
    model.actuator_ctrlrange[model.actuator_ctrlrange[:, 1] == NO_VOLTAGE] = 0.0


def dampers_to_targets(model: Any) -> None:
    """Add the dampers of a compiled model's actuators to those of their joints and tendons, where MuJoCo has them act.

    It adds all coefficients times the square of the gear to the force there, outside the limits of actuators.
    """
    damped = (model.actuator_damping != 0.0) | model.actuator_dampingpoly.any(axis=1)
    for i in np.flatnonzero(damped).tolist():
        target, factor = int(model.actuator_trnid[i, 0]), float(model.actuator_gear[i, 0]) ** 2
        if model.actuator_trntype[i] == _TENDON:
            of_target, poly, at = model.tendon_damping, model.tendon_dampingpoly, np.array([target])
        else:
            of_target, poly = model.dof_damping, model.dof_dampingpoly.reshape(model.nv, -1)
            at = np.flatnonzero(model.dof_jntid == target)
        of_target[at] += factor * model.actuator_damping[i]
        poly[at] += factor * model.actuator_dampingpoly[i]
    model.actuator_damping[:], model.actuator_dampingpoly[:] = 0.0, 0.0


def actuator_faults(model: Any) -> Iterator[tuple[str, str, str]]:
    """Actuators of a compiled scene that cannot be modelled: kind, full name, and the rest of the sentence."""
    servos = servo_mask(model)
    # One force each: the arrays of controls, actuators and forces then have the same indices.
    several = np.flatnonzero(model.actuator_outnum != 1)
    for i in (several if len(several) else np.flatnonzero(~further_inputs(model))).tolist():
        if len(several):
            faults = iter([_OF_ORIENTATION])
        else:
            faults = _servo_faults(model, i) if servos[i] else _motor_faults(model, i)
        yield from (("actuator", model.actuator(i).name, f" {what}") for what in faults)


def _motor_faults(model: Any, i: int) -> Iterator[str]:
    """What is wrong with a plain motor, as text."""
    kind, target = model.actuator_trntype[i], model.actuator_trnid[i, 0]
    gear = model.actuator_gear[i]
    if kind == _ADHESION:
        yield _OF_ADHESION
        return
    if kind == _JOINT and model.jnt_type[target] == _FREE:
        yield (
            "is a motor on a free joint; write <motor site=... gear=...> with a site of that body, "
            "whose force and torque turn with the body"
        )
    elif kind == _JOINT and model.jnt_type[target] == _BALL:
        yield "is a motor on a ball joint, which is not supported; use three hinges, or remove it"
    elif model.actuator_gainprm[i, 0] == 0.0 or not (gear[0] if kind == _JOINT else gear.any()):
        yield "has gear or gain 0: it drives nothing"


def _servo_faults(model: Any, i: int) -> Iterator[str]:
    """What is not supported of a servo, as text."""
    if model.actuator_trntype[i] == _ADHESION:
        yield _OF_ADHESION
        return
    if model.actuator_plugin[i] >= 0:
        yield f"is a plugin: its law is in no model file; write a servo of MuJoCo, or {_SERVOS}"
    elif (
        model.actuator_gaintype[i] in _UNKNOWN
        or model.actuator_biastype[i] in _UNKNOWN_BIAS
        or model.actuator_dyntype[i] == _DYN.mjDYN_USER
    ):
        yield f"has a law of a user, which is in no model file; {_INSTEAD}"
    if not (_acts_within(model, i) or _acts_on_free_tree(model, i)):
        yield (
            "is a servo that acts from outside other than on a tree with a free joint, at a site or on this joint, which is "
            f"not supported; {_INSTEAD}"
        )


def _acts_within(model: Any, i: int) -> bool:
    """Whether an actuator acts between links of one tree: it exchanges no momentum with anything else."""
    kind, bodies = int(model.actuator_trntype[i]), driven_bodies(model, i)
    if kind == _SITE and model.actuator_trnid[i, 1] < 0:
        return False
    of_joints = kind in (int(_JOINT), int(_IN_PARENT)) or (
        kind == _TENDON and is_fixed_tendon(model, int(model.actuator_trnid[i, 0]))
    )
    if of_joints:
        return bool((model.body_parentid[bodies] != 0).all())
    roots = np.unique(model.body_rootid[bodies])
    return len(roots) == 1 and bool(model.body_dofnum[roots[0]])


def _acts_on_free_tree(model: Any, i: int) -> bool:
    """Whether a servo acts from outside on a tree whose momentum nothing else holds."""
    if i not in external_servos(model):
        return False
    root = model.body_rootid[driven_bodies(model, i)[0]]
    return bool(model.body_jntnum[root] == 1 and model.jnt_type[model.body_jntadr[root]] == _FREE)


def effort_limits(model: Any) -> tuple[FloatArray, list[tuple[str, str, str]]]:
    """Limits of joint efforts in model files as limits of motors, and faults of those that are none; servos keep theirs.

    ``actuatorfrcrange`` of MJCF and ``<limit effort>`` of URDF limit the sum of what all actuators do to a joint. With one
    motor on the joint and no other actuator that acts on it, that is a limit of the motor, which its command must meet
    before it is applied, logged and entered in the balance.

    Returns:
        Least and greatest effort of each actuator, N or N m, infinite without a limit, (number of actuators, 2); and faults.
    """
    limits, faults = np.tile([-np.inf, np.inf], (model.nactuator, 1)), list[tuple[str, str, str]]()
    on_joint, servos = model.actuator_trntype == int(_JOINT), servo_mask(model)
    for j in np.flatnonzero(model.jnt_actfrclimited).tolist():
        motors = np.flatnonzero(on_joint & (model.actuator_trnid[:, 0] == j))
        others = [i for i in np.flatnonzero(~on_joint).tolist() if _acts_on(model, i, int(model.jnt_bodyid[j]))]
        if servos[[*motors, *others]].all():
            continue  # MuJoCo applies the limit in every stage, and so does the balance
        of_base = model.body_parentid[model.jnt_bodyid[j]] == 0
        # MuJoCo applies a limit at a joint of the base to thrusters too, and the balance follows it.
        if len(motors) + len(others) > 1 or (others and not of_base):
            names = ", ".join(model.actuator(i).name for i in (*motors, *others))
            what = f" has an effort limit, and on it act {names}: such a limit is supported for a single motor; remove it"
            faults.append(("joint", model.joint(j).name, f"{what}, and write a 'forcerange' for each of them"))
        limits[motors] = model.jnt_actfrcrange[j]
    # MuJoCo would clamp the sum of the motors of a tendon after their own limits, and the log would state more than acts.
    what = " has actuatorfrcrange, which is supported for joints only; remove it"
    pulled = model.actuator_trnid[(model.actuator_trntype == _TENDON) & ~servos, 0]
    faults += [
        ("tendon", model.tendon(t).name, f"{what}, and write a 'forcerange' for each motor of the tendon")
        for t in np.flatnonzero(model.tendon_actfrclimited).tolist()
        if t in pulled
    ]
    return limits, faults


def _acts_on(model: Any, actuator: int, body: int) -> bool:
    """Whether an actuator that is no motor of a joint may exert a force on the joints of a body."""
    if model.actuator_trntype[actuator] != _SITE:
        return True
    ends = [int(model.site_bodyid[site]) for site in model.actuator_trnid[actuator] if site >= 0]
    return any(body in ancestors(model, end) for end in ends)
