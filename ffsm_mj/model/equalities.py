"""Equality constraints of model files: their places for messages, and those that cannot be rows of the motion."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.model.files import ModelFiles
from ffsm_mj.model.mimic import mimic_place, mimics
from ffsm_mj.model.places import Places

_WRAPS = (mujoco.mjtWrap.mjWRAP_SPHERE, mujoco.mjtWrap.mjWRAP_CYLINDER)
_ALLOWED = "connect, weld, and equality joint or tendon without wrapping geoms are, or use 'strip: [equalities]'"


def followers(model: Any) -> dict[int, int]:
    """Joints that follow another one by an active equality constraint: id of the joint that leads by id of the follower."""
    active = (model.eq_active0 != 0) & (model.eq_type == mujoco.mjtEq.mjEQ_JOINT) & (model.eq_obj2id >= 0)
    pairs = zip(model.eq_obj1id[active].tolist(), model.eq_obj2id[active].tolist(), strict=True)
    return dict(pairs)


def equality_places(model: Any, scene: Any, files: Mapping[str, ModelFiles]) -> dict[int, str]:
    """Text ``file:line: equality`` of each constraint that is active from the start, by its id.

    Args:
        model: The compiled scene.
        scene: Its specification, with all models attached.
        files: Files of each model by its prefix.
    """
    active = np.flatnonzero(model.eq_active0).tolist()
    following = {prefix: mimics(each) for prefix, each in files.items()} if active else {}
    places, found = Places(scene, files), {}
    for e in active:
        mimic = ""
        if model.eq_type[e] == mujoco.mjtEq.mjEQ_JOINT and model.eq_obj2id[e] >= 0:
            prefix, _, follower = model.joint(model.eq_obj1id[e]).name.partition("/")
            mimic = mimic_place(following.get(prefix, ()), follower, model.joint(model.eq_obj2id[e]).name.partition("/")[2])
        found[e] = mimic or places.of("equality", model.equality(e).name)
    return found


def equality_faults(model: Any, places: Mapping[int, str]) -> list[str]:
    """Active constraints that are refused, each with its place and what is allowed.

    Args:
        model: The compiled scene.
        places: See :func:`equality_places`.
    """
    return [f"{place} {what}" for e, place in places.items() for what in _refusals(model, e)]


def _refusals(model: Any, e: int) -> Iterator[str]:
    kind, ends = mujoco.mjtEq(model.eq_type[e]), (int(model.eq_obj1id[e]), int(model.eq_obj2id[e]))
    if kind in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD):
        if model.eq_objtype[e] == mujoco.mjtObj.mjOBJ_SITE:
            ends = int(model.site_bodyid[ends[0]]), int(model.site_bodyid[ends[1]])
        if 0 in ends:
            yield "joins a body to the world, an external force that no part exerts; join it to a fixed object, or remove it"
    elif kind == mujoco.mjtEq.mjEQ_JOINT:
        yield from _base_joints(model, [each for each in ends if each >= 0])
    elif kind == mujoco.mjtEq.mjEQ_TENDON:
        for tendon in ends:
            if tendon >= 0:
                yield from _tendon(model, tendon)
    else:
        yield f"is not supported: {_ALLOWED}"


def _tendon(model: Any, tendon: int) -> Iterator[str]:
    path = slice(int(model.tendon_adr[tendon]), int(model.tendon_adr[tendon] + model.tendon_num[tendon]))
    kinds, ids = model.wrap_type[path], model.wrap_objid[path]
    if np.isin(kinds, _WRAPS).any():
        # Its length is C1 only: where a wrap begins, gamma jumps.
        yield f"couples a tendon with wrapping geoms, which is not supported: {_ALLOWED}"
    if np.any(model.site_bodyid[ids[kinds == mujoco.mjtWrap.mjWRAP_SITE]] == 0):
        yield "couples a tendon that ends at the world, which has no part in the dynamics; end it at a fixed object"
    yield from _base_joints(model, ids[kinds == mujoco.mjtWrap.mjWRAP_JOINT].tolist())


def _base_joints(model: Any, joints: list[int]) -> Iterator[str]:
    for joint in joints:
        if model.body_parentid[model.jnt_bodyid[joint]] == 0:
            name = model.joint(joint).name
            yield f"couples joint {name!r} of a base, which would act on the world; couple joints of links, or remove it"
