"""Geoms to draw, as the author of a model wants it seen: visual geoms instead of the collision geoms that they cover."""

from __future__ import annotations

from itertools import product
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.log.palette import GREY, ROBOT, WHITE, Colour, mixed, object_colour, shares
from ffsm_mj.model.system import System

# MuJoCo's viewer draws groups 0 to 2; geoms that are only for contact often have higher groups.
_DRAWN_GROUPS = 3
_COVERED, _MARGIN = 0.5, 0.05
"""Part of the box of a collision geom that the boxes of visual geoms cover if they replace it, and by which these grow."""
_GRID = np.array(list(product(np.linspace(-0.8, 0.8, 5), repeat=3)))
_NO_COLOUR = (0.5, 0.5, 0.5, 1.0)
"""MuJoCo's default colour of a geom."""
_TINTS = (0.25, 0.45)
"""Parts of white in the colours of bodies without colours; successive ones differ."""


def geoms_to_draw(model: Any) -> list[int]:
    """Ids of the geoms that viewers show.

    These are the geoms of the drawn groups. Where a body has visual geoms (contype and conaffinity zero) that cover a
    collision geom, only the visual ones are shown: both on top of each other flicker. A model with no geom in the drawn
    groups shows all of its geoms.
    """
    drawn = [geom for geom in range(model.ngeom) if model.geom_group[geom] < _DRAWN_GROUPS]
    seen = {_root(model, geom) for geom in drawn}
    drawn += [geom for geom in range(model.ngeom) if _root(model, geom) not in seen]
    visual: dict[int, list[int]] = {}
    for geom in drawn:
        if is_visual(model, geom):
            visual.setdefault(int(model.geom_bodyid[geom]), []).append(geom)
    solid = [geom for geom in drawn if not is_visual(model, geom)]
    covered = {geom for geom in solid if _covered(model, geom, visual.get(int(model.geom_bodyid[geom]), []))}
    return sorted(set(drawn) - covered)


def is_visual(model: Any, geom: int) -> bool:
    """Whether a geom collides with nothing by MuJoCo's rules."""
    return not (model.geom_contype[geom] or model.geom_conaffinity[geom])


def colour_of(system: System, geom: int) -> tuple[float, ...]:
    """Colour of a geom: red, green, blue and opacity, each from 0 to 1.

    The geom's own colour wins over its material, as in MuJoCo; a texture counts with its mean colour. A body without colours
    gets a tint of the colour of its model.
    """
    model = system.mj
    own, material = tuple(map(float, model.geom_rgba[geom])), int(model.geom_matid[geom])
    if own != _NO_COLOUR:
        return own
    if material >= 0:
        return _material_colour(model, material)
    body = int(model.geom_bodyid[geom])
    return shares(mixed(_hue(system, body), WHITE, _TINTS[_depth(model, body) % len(_TINTS)])) if body else own


def _root(model: Any, geom: int) -> int:
    return int(model.body_rootid[model.geom_bodyid[geom]])


def _covered(model: Any, geom: int, visual: list[int]) -> bool:
    """Whether the bounding boxes of visual geoms of one body cover that of a geom of the same body."""
    around = model.geom_aabb[geom]
    points = (around[:3] + _GRID * around[3:]) @ _rotation(model, geom).T + model.geom_pos[geom]
    inside = np.zeros(len(points), dtype=bool)
    for other in visual:
        box = model.geom_aabb[other]
        local = (points - model.geom_pos[other]) @ _rotation(model, other) - box[:3]
        inside |= (np.abs(local) <= (1.0 + _MARGIN) * box[3:] + _MARGIN * around[3:].max()).all(axis=1)
    return bool(inside.mean() >= _COVERED)


def _rotation(model: Any, geom: int) -> FloatArray:
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
    return rotation.reshape(3, 3)


def _material_colour(model: Any, material: int) -> tuple[float, ...]:
    colour = model.mat_rgba[material].astype(np.float64)
    texture = int(model.mat_texid[material, mujoco.mjtTextureRole.mjTEXROLE_RGB])
    if texture >= 0:
        channels, first = int(model.tex_nchannel[texture]), int(model.tex_adr[texture])
        count = int(model.tex_height[texture]) * int(model.tex_width[texture]) * channels
        texels = model.tex_data[first : first + count].reshape(-1, channels)
        colour[:3] *= texels.mean(axis=0)[[0, 1, 2] if channels >= 3 else [0, 0, 0]] / 255.0
    return tuple(map(float, colour))


def _hue(system: System, body: int) -> Colour:
    """Colour of the model to which a body belongs."""
    if body in system.robot.bodies:
        return ROBOT
    return next((object_colour(i) for i, tree in enumerate(system.objects) if body in tree.bodies), GREY)


def _depth(model: Any, body: int) -> int:
    """Number of bodies between a body and the world."""
    depth, body = 0, int(model.body_parentid[body])
    while body:
        body, depth = int(model.body_parentid[body]), depth + 1
    return depth
