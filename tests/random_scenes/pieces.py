"""Bodies of several convex pieces in random scenes, and fixed ones that are no convex shape: terrain and cones."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from tests.random_scenes.dice import Dice, numbers

Array = np.ndarray
SHAPES = ("cut", "cut", "corner", "slot", "cross", "rod", "wedges", "decomposed")
WELD_M = 1e-7
"""Of scenes with pieces: vertices of meshes are in single precision, 2e-8 m off in a body of 0.3 m."""
MOUTH_M = 2.5
"""Radius of the mouth of a cone: all that is placed is inside."""
PLATES = 16
"""Of a pyramid inside a cone, by which its distance is known to be no less."""


@dataclass
class Drawn:
    """Elements of a shape.

    Attributes:
        geoms: Its geoms.
        assets: Their meshes and height fields.
        keys: Further keys of its model in the scenario.
        side: What contact rules name.
        apart: Geoms that are nowhere farther from anything, by which it is placed.
    """

    geoms: str
    assets: str = ""
    keys: dict[str, Any] = field(default_factory=dict)
    side: str = ""
    apart: str = ""


def pieces(dice: Dice, name: str, half: Array, at: Array, turn: Array) -> Drawn:
    """A shape of several pieces ``name_0``, ``name_1`` and so on; a mesh that is decomposed is one geom, ``name``.

    Args:
        dice: Random numbers.
        name: Name of the geom that it replaces.
        half: Half lengths along its axes, m.
        at: Its position, m.
        turn: Its quaternion.
    """
    shape = dice.pick(SHAPES)
    if shape == "decomposed":
        points, faces = _corner_mesh(half)
        asset = f'<mesh name="{name}" vertex="{numbers(points.ravel())}" face="{" ".join(map(str, faces.ravel()))}"/>'
        geom = f'<geom name="{name}" pos="{numbers(at)}" quat="{numbers(turn)}" mass="0" type="mesh" mesh="{name}"/>'
        return Drawn(geom, asset, {"decompose": {"mesh": name}})
    if shape == "wedges":
        return _wedges(dice, name, half, at, turn)
    frame = Rotation.from_quat(turn, scalar_first=True)
    kind, places, sizes = "box", [], []
    if shape == "rod":
        # Two cylinders of one radius end to end.
        cut, kind = dice.between(-0.6, 0.6) * half[1], "cylinder"
        for low, high in ((-half[1], cut), (cut, half[1])):
            places.append([0.0, 0.0, 0.5 * (low + high)])
            sizes.append([half[0], 0.5 * (high - low)])
    else:
        boxes = _cut(dice, half) if shape == "cut" else np.array(_BOXES[shape]) * half
        places, sizes = list(boxes.mean(axis=1)), list(0.5 * (boxes[:, 1] - boxes[:, 0]))
    text = ""
    for k, (place, size) in enumerate(zip(places, sizes, strict=True)):
        where = f'pos="{numbers(at + frame.apply(place))}" quat="{numbers(turn)}"'
        text += f'<geom name="{name}_{k}" {where} mass="0" type="{kind}" size="{numbers(size)}"/>'
    return Drawn(text)


_BOXES = {
    "corner": [[(-1, -1, -1), (1, 1, -0.3)], [(-1, -1, -0.3), (-0.2, 1, 1)]],
    "slot": [
        [(-1, -1, -1), (1, 1, -0.5)],
        [(-1, -1, -0.5), (-0.6, 1, 0.4)],
        [(0.6, -1, -0.5), (1, 1, 0.4)],
        [(-1, -1, 0.4), (-0.3, 1, 1)],
        [(0.3, -1, 0.4), (1, 1, 1)],
    ],
    # Its bars overlap.
    "cross": [[(-1, -0.4, -0.5), (1, 0.4, 0.5)], [(-0.3, -1, -0.5), (0.3, 1, 0.5)]],
}
"""Lower and upper corners in half lengths."""


def _cut(dice: Dice, half: Array) -> Array:
    """(n, 2, 3) A box in two to four: lower and upper corners."""
    boxes = [np.array([-half, half])]
    for _ in range(dice.integer(1, 3)):
        box = boxes.pop(dice.integer(0, len(boxes) - 1))
        axis, share = dice.integer(0, 2), dice.between(0.25, 0.75)
        low, high = box.copy(), box.copy()
        low[1, axis] = high[0, axis] = box[0, axis] + share * (box[1, axis] - box[0, axis])
        boxes += [low, high]
    return np.array(boxes)


def _wedges(dice: Dice, name: str, half: Array, at: Array, turn: Array) -> Drawn:
    """A box cut by an oblique plane into two meshes."""
    geoms, assets, seam = "", "", half[0] * np.array([dice.between(-0.6, 0.6), dice.between(-0.6, 0.6)])
    for k, end in enumerate((-half[0], half[0])):
        section = ((end, -half[2]), (seam[0], -half[2]), (end, half[2]), (seam[1], half[2]))
        points = np.array([(x, y, z) for y in (-half[1], half[1]) for x, z in section])
        assets += f'<mesh name="{name}_{k}" vertex="{numbers(points.ravel())}"/>'
        where = f'pos="{numbers(at)}" quat="{numbers(turn)}" mass="0"'
        geoms += f'<geom name="{name}_{k}" {where} type="mesh" mesh="{name}_{k}"/>'
    return Drawn(geoms, assets)


def _corner_mesh(half: Array) -> tuple[Array, Array]:
    """Vertices and triangles of an L with its edges along y."""
    outline = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, -0.3), (-0.2, -0.3), (-0.2, 1.0), (-1.0, 1.0)])
    n = len(outline)
    points = np.array([(x, y, z) for y in (-1.0, 1.0) for x, z in outline]) * half
    caps = [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)]
    sides = [(i, i + n, (i + 1) % n) for i in range(n)] + [((i + 1) % n, i + n, (i + 1) % n + n) for i in range(n)]
    return points, np.array([*caps, *((a + n, c + n, b + n) for a, b, c in caps), *sides])


def wall(dice: Dice, name: str) -> Drawn | None:
    """A fixed body before x = 0, instead of a box: pieces, terrain or the inside of a cone; None: the box."""
    kind = dice.pick(["box", "box", "pieces", "pieces", "terrain", "cone"])
    if kind == "box":
        return None
    if kind == "terrain":
        return _terrain(dice, name)
    if kind == "cone":
        return _cone(dice, name)
    boxes = _cut(dice, np.array([0.1, 0.8, 0.8]))
    sizes = zip(boxes.mean(axis=1), 0.5 * (boxes[:, 1] - boxes[:, 0]), strict=True)
    # Cuts along x are inside; seams of its face are along y and z.
    text = [
        f'<geom name="{name}_{k}" pos="{numbers(at)}" type="box" size="{numbers(size)}" mass="0"/>'
        for k, (at, size) in enumerate(sizes)
    ]
    return Drawn("".join(text), side=name, apart="".join(text))


def _terrain(dice: Dice, name: str) -> Drawn:
    """A height field that looks along -x, of four levels, some cells of it level."""
    top, wide, base = dice.log_between(1e-3, 2e-2), 0.8, 0.1
    rows = dice.rng.integers(0, 4, (5, 4))
    rows[0, 0], rows[-1, -1] = 0, 3
    shape = f'nrow="5" ncol="4" size="{numbers([wide, wide, top, base])}" elevation="{" ".join(map(str, rows.ravel()))}"'
    quat = [math.sqrt(0.5), 0.0, -math.sqrt(0.5), 0.0]
    geom = f'<geom name="{name}" type="hfield" hfield="{name}" quat="{numbers(quat)}" mass="0"/>'
    size = numbers([0.5 * (top + base), wide, wide])
    apart = f'<geom name="{name}" type="box" pos="{numbers([0.5 * (base - top), 0.0, 0.0])}" size="{size}" mass="0"/>'
    return Drawn(geom, f'<hfield name="{name}" {shape}/>', side=f"{name}/{name}", apart=apart)


def _cone(dice: Dice, name: str) -> Drawn:
    """A cone that opens along -x, before a small box that nothing can reach."""
    angle = math.radians(dice.between(50.0, 80.0))
    stop = f'<geom name="{name}" type="box" pos="0.2 0 0" size="0.1 0.1 0.1" mass="0"/>'
    cone = {"body": "world", "axis": [-1.0, 0.0, 0.0], "half_angle_deg": math.degrees(angle), "name": "cone"}
    slope, text = math.atan(math.tan(angle) * math.cos(math.pi / PLATES)), stop
    for k in range(PLATES):
        about = 2.0 * math.pi * k / PLATES
        round_ = np.array([0.0, math.cos(about), math.sin(about)])
        along = math.sin(slope) * round_ - [math.cos(slope), 0.0, 0.0]
        inward = -math.cos(slope) * round_ - [math.sin(slope), 0.0, 0.0]
        axes = np.array([along, np.cross(inward, along), inward]).T
        half = [MOUTH_M, MOUTH_M, 0.05]
        where = f'pos="{numbers(MOUTH_M * along - 0.05 * inward)}" quat="{numbers(_quaternion(axes))}"'
        text += f'<geom name="{name}plate{k}" {where} type="box" size="{numbers(half)}" mass="0"/>'
    cone |= {"length_m": MOUTH_M / math.tan(angle)}
    return Drawn(stop, keys={"cones": [cone]}, side=f"{name}/cone", apart=text)


def _quaternion(axes: Array) -> Array:
    return Rotation.from_matrix(axes).as_quat(scalar_first=True)
