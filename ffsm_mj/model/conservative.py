"""Detection of elements that break the conservation of energy or momentum, each with its name, file and line.

Springs, dampers and dry friction of joints and tendons act between links, and enter the balance. Refused are those of the
base's joints, which act on the world, dampers that drive, springs that yield, and, whether the scenario is conservative or
not, dry friction of ball joints, of those of the base, and of tendons that act on the world.

A conservative scenario is in a vacuum without gravity, whatever its model files say of them. In other scenarios gravity and
its compensation (``gravcomp``) are external forces that enter the balance, and no fault; fluid forces are one.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.model.coefficients import damping_coefficients, sign_preserving, stiffness_coefficients
from ffsm_mj.model.files import ModelFiles
from ffsm_mj.model.places import Places
from ffsm_mj.model.system import ancestors
from ffsm_mj.model.tendons import acts_on_world, tendon_springs_faults

_OPTIONS = (
    *("timestep", "impratio", "tolerance", "ls_tolerance", "noslip_tolerance", "ccd_tolerance", "sleep_tolerance"),
    *("gravity", "wind", "magnetic", "density", "viscosity", "o_margin", "o_solref", "o_solimp", "o_friction"),
    *("integrator", "cone", "jacobian", "solver", "iterations", "ls_iterations", "noslip_iterations", "ccd_iterations"),
    *("disableflags", "enableflags", "disableactuator", "sdf_initpoints", "sdf_iterations"),
)
"""Fields of mjOption in its order, which is that of the bits of ``MjSpec.authored.option``."""
_MAY_HAVE_IT = "hinges and slides between links may have it"
FLUID = ("wind", "density", "viscosity")
"""Options of the medium around the bodies."""


def authored_options(spec: Any) -> tuple[str, ...]:
    """Names of the fields of ``<option>`` that a model file gives."""
    return tuple(name for bit, name in enumerate(_OPTIONS) if spec.authored.option >> bit & 1)


def fluid_faults(spec: Any, files: ModelFiles) -> list[str]:
    """Options of one model file by which MuJoCo adds fluid forces; a scene adopts them unless it must be conservative."""
    return [
        f"{files.place}: <option {name}={_vector(np.atleast_1d(getattr(spec.option, name)))}> adds fluid forces; remove it"
        for name in FLUID
        if np.any(getattr(spec.option, name))
    ]


def gravity_of(spec: Any, files: ModelFiles) -> tuple[float, ...]:
    """Gravity of a model, (3,), m/s^2; without one in the file, MuJoCo's default (MJCF) or zero (URDF); zero if disabled."""
    silent = is_disabled(spec, "gravity") or (files.urdf and "gravity" not in authored_options(spec))
    return (0.0, 0.0, 0.0) if silent else tuple(map(float, spec.option.gravity))


def magnetic_of(spec: Any, name: str) -> dict[str, tuple[float, ...]]:
    """Magnetic field of a model by its name, (3,), in the units of its magnetometers; empty if its file has none."""
    return {name: tuple(map(float, spec.option.magnetic))} if "magnetic" in authored_options(spec) else {}


def is_disabled(spec: Any, flag: str) -> bool:
    """Whether a model file writes ``<flag NAME="disable"/>``."""
    return bool(spec.option.disableflags & int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag.upper()}")))


def shared_vector_faults(what: str, asked: Mapping[str, tuple[float, ...]], files: Mapping[str, ModelFiles]) -> list[str]:
    """Faults of models with different gravity or magnetic fields: a scene has one, and models without it take it over.

    Args:
        what: Name of the vector in messages.
        asked: The vector of each model that has one, by name.
        files: Files of each model by name.
    """
    first = next(iter(asked), "")
    return [
        f"{files[name].place}: {what} is {_vector(vector)}, and {_vector(asked[first])} in "
        f"{files[first].place}; all models of a scene have one {what}"
        for name, vector in asked.items()
        if vector != asked[first]
    ]


def _vector(values: Iterable[float]) -> str:
    return " ".join(f"{value:g}" for value in values)


def base_armatures(scene: Any, files: Mapping[str, ModelFiles]) -> Iterator[str]:
    """Faults of joints of a base with armature: inertia against the world, which the momentum of the bodies lacks.

    Args:
        scene: Specification with all models attached.
        files: Files of each model by its prefix.
    """
    places = Places(scene, files)
    for joint in scene.joints:
        if joint.armature and joint.parent.parent.name == "world":
            yield (
                f"{places.of('joint', joint.name)} has armature {joint.armature:g}, and joins the base to the world, which "
                'has no part in the dynamics; write armature="0" (a <freejoint/> has none)'
            )


def model_faults(model: Any, scene: Any, files: Mapping[str, ModelFiles]) -> list[str]:
    """Elements of the compiled scene that break conservation, each with the file and line of its model."""
    places = Places(scene, files)
    return [
        f"{places.of(kind, name)} has {what}; remove it, or use 'strip' in the scenario"
        for kind, name, what in _elements(model)
    ]


def friction_faults(model: Any, scene: Any, files: Mapping[str, ModelFiles]) -> Iterator[str]:
    """Dry friction that is not that of a hinge, slide or tendon between links, each with the file and line of its model."""
    places = Places(scene, files)
    for j in sorted({*model.dof_jntid[model.dof_frictionloss != 0.0].tolist()}):
        name, loss = model.joint(j).name, model.dof_frictionloss[model.jnt_dofadr[j]]
        if model.body_parentid[model.jnt_bodyid[j]] == 0:
            where = f"on a joint of the base, which acts on the world; {_MAY_HAVE_IT}"
        elif model.jnt_type[j] == mujoco.mjtJoint.mjJNT_BALL:
            where = f"on a ball joint, where limits by axis would depend on the frame; {_MAY_HAVE_IT}"
        elif loss < 0.0:
            where = "below zero, which would drive the joint"
        else:
            continue
        yield f"{places.of('joint', name)} has frictionloss {loss:g} {where}"
    for t in np.flatnonzero(model.tendon_frictionloss).tolist():
        place, loss = places.of("tendon", model.tendon(t).name), model.tendon_frictionloss[t]
        if acts_on_world(model, t):
            yield f"{place} has frictionloss {loss:g} and acts on the world; tendons between links may have it"
        elif loss < 0.0:
            yield f"{place} has frictionloss {loss:g} below zero, which would drive the tendon"


def _has_limited_gravcomp(model: Any, body: int) -> bool:
    """Whether the gravity compensation of a body acts through actuators at a joint that limits their force."""
    # With actgravcomp the compensation is part of the actuator force. Where that is limited, the compensation may be smaller
    # than the weight, and is not the external force that enters the balance.
    limited = model.jnt_actgravcomp.astype(bool) & model.jnt_actfrclimited.astype(bool)
    return any(limited[model.jnt_bodyid == each].any() for each in ancestors(model, body))


def _coefficients(values: Iterable[float]) -> str:
    """Coefficients of a polynomial without trailing zeros."""
    return re.sub("( 0)+$", "", _vector(values))


def _spring_faults(model: Any, j: int, dof: int) -> Iterator[str]:
    """What is wrong with the spring and the damper of a joint, as text."""
    stiffness, damping = stiffness_coefficients(model)[j], damping_coefficients(model)[dof]
    if model.body_parentid[model.jnt_bodyid[j]] == 0:  # a joint of a base; fixed models have none
        on_world = "on a joint of the base, which acts on the world"
        if np.any(damping):
            yield f"damping {_coefficients(damping)} {on_world}"
        if np.any(stiffness):
            yield f"stiffness {_coefficients(stiffness)} {on_world}"
        return
    if not sign_preserving(damping):
        yield f"damping {_coefficients(damping)}, which drives the joint at some rates"
    if model.jnt_plasticadr[j] >= 0:
        yield "springyield, a spring that yields"


def _elements(model: Any) -> Iterator[tuple[str, str, str]]:
    """Yield (kind, full name, property that breaks conservation)."""
    for j in range(model.njnt):
        joint = model.joint(j)
        yield from (("joint", joint.name, what) for what in _spring_faults(model, j, joint.dofadr[0]))
    yield from (("tendon", name, what) for name, what in tendon_springs_faults(model))
    for b in np.flatnonzero(model.body_gravcomp).tolist() if np.any(model.opt.gravity) else ():
        if _has_limited_gravcomp(model, b):
            yield "body", model.body(b).name, "gravcomp"
