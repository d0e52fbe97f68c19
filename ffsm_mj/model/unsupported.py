"""What model files have that a scene cannot have, by element with its file and line.

Springs, dampers and dry friction of joints and tendons act between links, and enter the balance. What breaks conservation is
refused in a conservative scenario: springs and dampers that act on the world, dampers that drive, springs that yield.
Refused in every scenario are dry friction, limits, armatures and equality constraints that act on the world, since it has no
part in the dynamics. A tendon between links of one tree is internal: its forces exchange no momentum with anything else. One
that is attached to the world, or has a coefficient on a joint of a base, acts on the world.

A conservative scenario is in a vacuum without gravity, whatever its model files say of them. In other scenarios gravity and
its compensation (``gravcomp``) are external forces that enter the balance, and no fault; fluid forces are one.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.model.edits import is_limited
from ffsm_mj.model.files import ModelFiles
from ffsm_mj.model.places import Places
from ffsm_mj.model.properties import MOST_LENGTH, MOST_MASS
from ffsm_mj.model.system import (
    ancestors,
    damping_coefficients,
    stiffness_coefficients,
    tendon_bodies,
    tendon_damping_coefficients,
    tendon_stiffness_coefficients,
)

Finding = tuple[str, str, str]
"""An element and what is wrong with it: its kind, its full name, and the rest of the sentence."""

LEAST_RANGE = 1e-6
"""Least extent of a range in the units of its file: both ends must be further apart than the tolerance of a closed gap."""
FLUID = ("wind", "density", "viscosity")
"""Options of the medium around the bodies."""
_OPTIONS = (
    *("timestep", "impratio", "tolerance", "ls_tolerance", "noslip_tolerance", "ccd_tolerance", "sleep_tolerance"),
    *("gravity", "wind", "magnetic", "density", "viscosity", "o_margin", "o_solref", "o_solimp", "o_friction"),
    *("integrator", "cone", "jacobian", "solver", "iterations", "ls_iterations", "noslip_iterations", "ccd_iterations"),
    *("disableflags", "enableflags", "disableactuator", "sdf_initpoints", "sdf_iterations"),
)
"""Fields of mjOption in its order, which is that of the bits of ``MjSpec.authored.option``."""
_IGNORE = "or write 'limits: ignore' in the scenario"
BELOW_ZERO = "below zero, which would drive"
"""Part of the refusal of a friction that is a mistake, and not a kind that is not modelled."""
_MAY_HAVE_IT = "hinges and slides between links may have it"
_ALLOWED = "connect, weld, and equality joint or tendon without wrapping geoms are, or use 'strip: [equalities]'"
_JOINT, _SITE = int(mujoco.mjtWrap.mjWRAP_JOINT), int(mujoco.mjtWrap.mjWRAP_SITE)
_WRAPS = (mujoco.mjtWrap.mjWRAP_SPHERE, mujoco.mjtWrap.mjWRAP_CYLINDER)
_BALL = mujoco.mjtJoint.mjJNT_BALL
_ONE_AXIS = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
_EQUALITY = mujoco.mjtEq


def authored_options(spec: Any) -> tuple[str, ...]:
    """Names of the fields of ``<option>`` that a model file gives."""
    return tuple(name for bit, name in enumerate(_OPTIONS) if spec.authored.option >> bit & 1)


def is_disabled(spec: Any, flag: str) -> bool:
    """Whether a model file writes ``<flag NAME="disable"/>``."""
    return bool(spec.option.disableflags & int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag.upper()}")))


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


def empty_ranges(spec: Any) -> Iterator[Finding]:
    """Hinges and slides of a model whose range is a single value or empty.

    MuJoCo refuses such a range or, without ``limited``, treats the joint as unlimited.
    """
    for joint in spec.joints:
        if joint.type in _ONE_AXIS and is_limited(joint) and not joint.range[1] - joint.range[0] > LEAST_RANGE:
            low, high = joint.range.tolist()
            what = "is empty: the lower value comes first" if low > high else "allows a single value: use a fixed joint"
            yield "joint", joint.name, f": the range {low:g} {high:g} {what}"


def scene_faults(scene: Any, files: Mapping[str, ModelFiles]) -> Iterator[Finding]:
    """Elements of a scene with all models attached that are refused before it is compiled.

    These are parts of fixed models that move, limits that are no stops of a hinge or slide within a model, and joints of a
    base with armature: inertia against the world, which the momentum of the bodies lacks.
    """
    mocap = [body for body in scene.bodies if body.mocap]
    for kind, elements, does in (
        ("joint", scene.joints, "moves"),
        ("body", mocap, "(mocap) moves"),
        ("actuator", scene.actuators, "drives"),
    ):
        for element in elements:
            name = element.name.partition("/")[0]
            if name in files and files[name].pose is not None:
                yield kind, element.name, f" {does} a fixed object; remove it, or write 'fixed: false'"
    for joint in scene.joints:
        of_base = joint.parent.parent.name == "world"
        if is_limited(joint) and joint.type == _BALL:
            yield "joint", joint.name, f": limits of a ball joint are not supported; remove its range, {_IGNORE}"
        elif is_limited(joint) and joint.type in _ONE_AXIS and of_base:
            what = "limits of a joint to the world are not supported, as they would be external forces; remove its range"
            yield "joint", joint.name, f": {what}, {_IGNORE}"
        if joint.armature and of_base:
            what = f" has armature {joint.armature:g}, and joins the base to the world, which has no part in the dynamics"
            yield "joint", joint.name, f'{what}; write armature="0" (a <freejoint/> has none)'


def number_faults(model: Any) -> Iterator[Finding]:
    """Values of a compiled scene that MuJoCo accepts but a simulation cannot use."""
    for b in range(1, model.nbody):
        worst = max(float(model.body_mass[b]), float(np.max(model.body_inertia[b])))
        if not worst <= MOST_MASS:
            yield "body", model.body(b).name, f" has a mass or inertia of {worst:g}; at most {MOST_MASS:g} kg or kg m^2"
    for kind, count, arrays in (
        ("body", model.nbody, (model.body_pos, model.body_ipos)),
        ("joint", model.njnt, (model.jnt_pos,)),
        ("geom", model.ngeom, (model.geom_pos, model.geom_size)),
        ("site", model.nsite, (model.site_pos,)),
    ):
        if all(np.abs(array).max(initial=0.0) <= MOST_LENGTH for array in arrays):
            continue
        for i in range(count):
            worst = max(float(np.max(np.abs(array[i]))) for array in arrays)
            if not worst <= MOST_LENGTH:
                yield kind, getattr(model, kind)(i).name, f" has a length of {worst:g} m; at most {MOST_LENGTH:g} m"
    for kind, named, colours in (("geom", model.geom, model.geom_rgba), ("material", model.mat, model.mat_rgba)):
        for i in np.flatnonzero(~((colours >= 0.0) & (colours <= 1.0)).all(axis=1)).tolist():
            yield kind, named(i).name, f" has rgba {_vector(colours[i])}; each is from 0 to 1"
    for i in np.flatnonzero(model.pair_geom1 == model.pair_geom2).tolist():
        yield "geom", model.geom(model.pair_geom1[i]).name, " is in a <contact><pair> with itself; remove it"


def conservation_faults(model: Any) -> Iterator[Finding]:
    """Elements of the compiled scene that break the conservation of energy or momentum."""
    advice = "; remove it, or use 'strip' in the scenario"
    for kind, count, springs in (("joint", model.njnt, _joint_spring), ("tendon", model.ntendon, _tendon_spring)):
        for i in range(count):
            yield from ((kind, getattr(model, kind)(i).name, f" has {what}{advice}") for what in springs(model, i))
    # With actgravcomp the compensation is part of the actuator force. Where that is limited, the compensation may be smaller
    # than the weight, and is not the external force that enters the balance.
    limited = model.jnt_bodyid[model.jnt_actgravcomp.astype(bool) & model.jnt_actfrclimited.astype(bool)]
    for b in np.flatnonzero(model.body_gravcomp).tolist() if np.any(model.opt.gravity) else ():
        if any(ancestor in limited for ancestor in ancestors(model, b)):
            yield "body", model.body(b).name, f" has gravcomp{advice}"


def _joint_spring(model: Any, j: int) -> Iterator[str]:
    """What is wrong with the spring and the damper of a joint, as text."""
    stiffness, damping = stiffness_coefficients(model)[j], damping_coefficients(model)[model.jnt_dofadr[j]]
    if _on_base(model, j):  # fixed models have none
        on_world = "on a joint of the base, which acts on the world"
        if np.any(damping):
            yield f"damping {_coefficients(damping)} {on_world}"
        if np.any(stiffness):
            yield f"stiffness {_coefficients(stiffness)} {on_world}"
        return
    if not _preserves_sign(damping):
        yield f"damping {_coefficients(damping)}, which drives the joint at some rates"
    if model.jnt_plasticadr[j] >= 0:
        yield "springyield, a spring that yields"


def _tendon_spring(model: Any, t: int) -> Iterator[str]:
    """What is wrong with the spring and the damper of a tendon, as text."""
    stiffness, damping = tendon_stiffness_coefficients(model)[t], tendon_damping_coefficients(model)[t]
    if acts_on_world(model, t):
        present = {"stiffness": stiffness.any(), "damping": damping.any()}
        yield from (f"{what} that acts on the world" for what, there in present.items() if there)
    elif not _preserves_sign(damping):
        yield "damping that drives the tendon at some rates"
    if model.tendon_plasticadr[t] >= 0:
        yield "springyield, a spring that yields"


def _preserves_sign(damping: FloatArray) -> bool:
    """Whether a damper with coefficients (a, b, c) takes energy at every rate, by MuJoCo's condition."""
    a, b, c = damping.tolist()
    return not (a < 0.0 or c < 0.0 or (b < 0.0 and b * b > 4.0 * a * c))


def _coefficients(values: Iterable[float]) -> str:
    """Coefficients of a polynomial without trailing zeros."""
    return re.sub("( 0)+$", "", _vector(values))


def _on_base(model: Any, joint: int) -> bool:
    return bool(model.body_parentid[model.jnt_bodyid[joint]] == 0)


def acts_on_world(model: Any, tendon: int) -> bool:
    """Whether a tendon is attached to the world or to a fixed object, or has a coefficient on a joint of a base."""
    path = range(int(model.tendon_adr[tendon]), int(model.tendon_adr[tendon] + model.tendon_num[tendon]))
    on_base = any(model.wrap_type[i] == _JOINT and _on_base(model, int(model.wrap_objid[i])) for i in path)
    return on_base or any(model.body_weldid[body] == 0 for body in tendon_bodies(model, tendon))


def refusals(model: Any) -> Iterator[Finding]:
    """Armatures, dry friction and limits of the compiled scene that no scenario can have."""
    yield from _armatures(model)
    for j in sorted({*model.dof_jntid[model.dof_frictionloss != 0.0].tolist()}):
        loss, where = model.dof_frictionloss[model.jnt_dofadr[j]], ""
        if _on_base(model, j):
            where = f"on a joint of the base, which acts on the world; {_MAY_HAVE_IT}"
        elif model.jnt_type[j] == _BALL:
            where = f"on a ball joint, where limits by axis would depend on the frame; {_MAY_HAVE_IT}"
        elif loss < 0.0:
            where = f"{BELOW_ZERO} the joint; it must be zero or more"
        if where:
            yield "joint", model.joint(j).name, f" has frictionloss {loss:g} {where}"
    for t in range(model.ntendon):
        name, loss, (low, high) = model.tendon(t).name, model.tendon_frictionloss[t], model.tendon_range[t].tolist()
        on_world, limited = acts_on_world(model, t), bool(model.tendon_limited[t])
        if loss and on_world:
            yield "tendon", name, f" has frictionloss {loss:g} and acts on the world; tendons between links may have it"
        elif loss < 0.0:
            yield "tendon", name, f" has frictionloss {loss:g} {BELOW_ZERO} the tendon; it must be zero or more"
        if limited and on_world:
            what = "limits of a tendon that acts on the world are not supported, as they would be external forces"
            yield "tendon", name, f": {what}; remove its range, {_IGNORE}"
        elif limited and not high - low > LEAST_RANGE:
            yield "tendon", name, f": the range {low:g} {high:g} allows a single length; remove its range, {_IGNORE}"


def _armatures(model: Any) -> Iterator[Finding]:
    """Armatures of actuators and tendons that are not an inertia between links of one tree.

    That of a motor on a joint of a base, or of a tendon that acts on the world, is inertia against the world, which the
    momentum of the bodies lacks. MuJoCo's mass matrix has no entries for joints of different branches: it drops the terms of
    a tendon that couples them, and energy is not conserved. An actuator on a tendon gives its armature to the tendon.
    """
    for i in np.flatnonzero(model.actuator_armature).tolist():
        target, what = int(model.actuator_trnid[i, 0]), ""
        if model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_TENDON:
            why = _armature_of_tendon(model, target)
            what = f"on tendon {model.tendon(target).name.partition('/')[2]!r}, which {why}" if why else ""
        elif _on_base(model, target):
            what = "on a joint of the base, which joins it to the world, which has no part in the dynamics"
        if what:
            has = f" has armature {model.actuator_armature[i]:g} {what}"
            yield "actuator", model.actuator(i).name, f'{has}; write armature="0"'
    for t in np.flatnonzero(model.tendon_armature).tolist():
        if what := _armature_of_tendon(model, t):
            has = f" has armature {model.tendon_armature[t]:g}, and {what}"
            yield "tendon", model.tendon(t).name, f'{has}; write armature="0"'


def _armature_of_tendon(model: Any, tendon: int) -> str:
    """Why a tendon cannot have inertia; empty if it can."""
    chains = [{*ancestors(model, body)} for body in tendon_bodies(model, tendon)]
    if acts_on_world(model, tendon):
        return "acts on the world, which has no part in the dynamics"
    if set.union(*chains) != max(chains, key=len):
        return "couples joints of two branches, whose terms MuJoCo leaves out of the mass matrix"
    return ""


def equality_places(model: Any, places: Places) -> dict[int, str]:
    """Text ``file:line: equality`` of each constraint that is active from the start, by its id."""
    active = np.flatnonzero(model.eq_active0).tolist()
    following = {prefix: mimics(file) for prefix, file in places.files.items()} if active else {}
    equalities = {}
    for e in active:
        mimic = ""
        if model.eq_type[e] == _EQUALITY.mjEQ_JOINT and model.eq_obj2id[e] >= 0:
            prefix, _, follower = model.joint(model.eq_obj1id[e]).name.partition("/")
            mimic = _mimic_place(following.get(prefix, ()), follower, model.joint(model.eq_obj2id[e]).name.partition("/")[2])
        equalities[e] = mimic or places.of("equality", model.equality(e).name)
    return equalities


def equality_refusals(model: Any, e: int) -> Iterator[str]:
    """Why an active equality constraint cannot be rows of the motion, as text."""
    kind, ends = _EQUALITY(model.eq_type[e]), (int(model.eq_obj1id[e]), int(model.eq_obj2id[e]))
    if kind in (_EQUALITY.mjEQ_CONNECT, _EQUALITY.mjEQ_WELD):
        if model.eq_objtype[e] == mujoco.mjtObj.mjOBJ_SITE:
            ends = int(model.site_bodyid[ends[0]]), int(model.site_bodyid[ends[1]])
        if 0 in ends:
            yield "joins a body to the world, an external force that no part exerts; join it to a fixed object, or remove it"
    elif kind == _EQUALITY.mjEQ_JOINT:
        yield from _couples_base(model, [end for end in ends if end >= 0])
    elif kind == _EQUALITY.mjEQ_TENDON:
        for tendon in (end for end in ends if end >= 0):
            path = slice(int(model.tendon_adr[tendon]), int(model.tendon_adr[tendon] + model.tendon_num[tendon]))
            kinds, ids = model.wrap_type[path], model.wrap_objid[path]
            if np.isin(kinds, _WRAPS).any():
                # Its length is C1 only: where a wrap begins, gamma jumps.
                yield f"couples a tendon with wrapping geoms, which is not supported: {_ALLOWED}"
            if np.any(model.site_bodyid[ids[kinds == _SITE]] == 0):
                yield "couples a tendon that ends at the world, which has no part in the dynamics; end it at a fixed object"
            yield from _couples_base(model, ids[kinds == _JOINT].tolist())
    else:
        yield f"is not supported: {_ALLOWED}"


def _couples_base(model: Any, joints: Iterable[int]) -> Iterator[str]:
    for joint in joints:
        if _on_base(model, joint):
            name = model.joint(joint).name
            yield f"couples joint {name!r} of a base, which would act on the world; couple joints of links, or remove it"


class Mimic(NamedTuple):
    """A ``<mimic>`` of a URDF, which MuJoCo compiles to an unnamed equality constraint.

    Attributes:
        joint: The joint that follows.
        leader: The joint that it follows.
        place: ``file:line``.
    """

    joint: str
    leader: str
    place: str


def mimics(files: ModelFiles) -> list[Mimic]:
    """All ``<mimic>`` elements of a model and its attached URDFs; longest names first, as names may share an ending."""
    read, joint = list[Mimic](), ""
    for element in files.elements("mimic"):
        if element.tag == "joint":
            joint = element.attributes.get("name", "")
        elif element.tag == "mimic" and element.parents[0] == "robot" and element.parents[-1] == "joint":
            read.append(Mimic(joint, element.attributes.get("joint", ""), element.place))
    return sorted(read, key=lambda mimic: -len(mimic.joint))


def _mimic_place(written: Iterable[Mimic], follower: str, leader: str) -> str:
    """Text ``file:line: joint 'a' mimics joint 'b'`` of a constraint that comes from a ``<mimic>``; empty if it does not.

    Names in the model are those in the URDF after the prefixes of attachments. If several URDFs of a model have joints of
    these names, all their places are given.

    Args:
        written: All ``<mimic>`` elements of the model, longest names first.
        follower: Name of the joint that follows, in the model.
        leader: Name of the joint that it follows.
    """

    def is_source(source: Mimic) -> bool:
        before = follower.removesuffix(source.joint)
        return (before + source.joint, before + source.leader) == (follower, leader)

    matching = [source for source in written if is_source(source)]
    if not matching:
        return ""
    place = " or ".join(dict.fromkeys(source.place for source in matching if source.joint == matching[0].joint))
    return f"{place}: <mimic> of joint {follower!r} by joint {leader!r}"
