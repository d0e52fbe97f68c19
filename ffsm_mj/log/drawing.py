"""What every viewer draws of a scene: shapes of geoms, poses by frame, the size of markers, the view; quaternions wxyz."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, NamedTuple

import mujoco
import numpy as np
import numpy.typing as npt

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.reach import Reach
from ffsm_mj.dynamics.rigid_body import rotation_matrix
from ffsm_mj.log import limits
from ffsm_mj.log.palette import GREY, ROBOT, WHITE, Colour, mixed, object_colour, shares
from ffsm_mj.model.system import System
from ffsm_mj.polytope import Polytope
from ffsm_mj.records.signals import Layout, coordinate_keys

_KINDS = {
    mujoco.mjtGeom.mjGEOM_BOX: "box",
    mujoco.mjtGeom.mjGEOM_SPHERE: "ellipsoid",
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: "ellipsoid",
    mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder",
    mujoco.mjtGeom.mjGEOM_CAPSULE: "capsule",
    mujoco.mjtGeom.mjGEOM_MESH: "mesh",
    mujoco.mjtGeom.mjGEOM_PLANE: "box",
}
_PLANE_M, _THICK_M = 10.0, 1e-3
"""Drawn half width of an infinite plane, and half thickness of any plane."""


@dataclass(frozen=True)
class DrawnShape:
    """The shape of a drawn geom.

    Attributes:
        geom: Id of the geom.
        name: The geom's name without its prefix.
        body: Id of its body; 0 is the world.
        kind: ``box``, ``ellipsoid``, ``cylinder``, ``capsule`` or ``mesh``.
        size: Half sizes (box, ellipsoid), or radius and half length (cylinder, capsule; the latter without its caps), m.
        position: Centre in the frame of the body, (3,), m.
        quaternion: Orientation in the frame of the body, (4,).
        rgba: Red, green, blue and opacity, each from 0 to 1.
        vertices: Vertices of a mesh in the frame of the geom, (n, 3), m.
        triangles: Vertex indices of the triangles of a mesh, (m, 3).
        normals: Unit normals at the vertices of a mesh, for shading, (n, 3).
    """

    geom: int
    name: str
    body: int
    kind: str
    size: FloatArray
    position: FloatArray
    quaternion: FloatArray
    rgba: tuple[float, ...]
    vertices: FloatArray
    triangles: npt.NDArray[np.int32]
    normals: FloatArray


@dataclass(frozen=True)
class Frames:
    """Some rows of a log and the poses of all bodies in them.

    Attributes:
        times: Time of each frame, (n,), s.
        rows: The chosen rows, (n, number of signals).
        positions: World positions of all bodies, (n, nbody, 3), m.
        quaternions: World orientations of all bodies, (n, nbody, 4).
    """

    times: FloatArray
    rows: FloatArray
    positions: FloatArray
    quaternions: FloatArray

    @classmethod
    def joined(cls, parts: Sequence[Frames]) -> Frames:
        """Frames one after another."""
        fields = ((part.times, part.rows, part.positions, part.quaternions) for part in parts)
        return cls(*map(np.concatenate, zip(*fields, strict=True)))


def posed_bodies(system: System) -> list[int]:
    """Ids of the bodies whose poses are sent: all but the world, including fixed ones."""
    return list(range(1, system.mj.nbody))


def shapes(system: System, geoms: Iterable[int] | None = None) -> Iterator[DrawnShape]:
    """Shapes of geoms; a plane is a thin box below it, a fixed height field its surface; those that move are left out.

    Args:
        system: Robot and objects.
        geoms: Ids of the geoms; None: those that viewers show.
    """
    model, corners = system.mj, 0
    for geom in geoms_to_draw(model) if geoms is None else geoms:
        kind = _KINDS.get(mujoco.mjtGeom(model.geom_type[geom]))
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_HFIELD and geom in system.pieces:
            surface = _surface(system.pieces[geom])
            corners += 3 * len(surface[1])
            kind = "mesh" if corners <= limits.MESH_CORNERS else None
        if kind is None:
            continue
        size, position = model.geom_size[geom].copy(), model.geom_pos[geom].copy()
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_SPHERE:
            size[:] = size[0]
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE:
            size, position = _slab(size, position, model.geom_quat[geom])
        mesh = int(model.geom_dataid[geom]) if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH else -1
        corners += 3 * int(model.mesh_facenum[mesh]) if mesh >= 0 else 0
        if mesh >= 0 and corners > limits.MESH_CORNERS:
            kind, mesh = "box", -1  # MuJoCo stores the half sizes of the bounding box as the size of a mesh geom
        vertices, triangles, normals = _mesh(model, mesh) if kind != "mesh" or mesh >= 0 else surface
        yield DrawnShape(
            geom=geom,
            name=(model.geom(geom).name or f"geom_{geom}").rsplit("/", 1)[-1],
            body=int(model.geom_bodyid[geom]),
            kind=kind,
            size=size,
            position=position,
            quaternion=model.geom_quat[geom].copy(),
            rgba=colour_of(system, geom),
            vertices=vertices,
            triangles=triangles,
            normals=normals,
        )


def rotated(vector: FloatArray, quaternion: FloatArray) -> FloatArray:
    """A vector rotated by a quaternion, (3,)."""
    out = np.zeros(3)
    mujoco.mju_rotVecQuat(out, vector, quaternion)
    return out


def _slab(size: FloatArray, position: FloatArray, quaternion: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Half sizes and centre of a thin box whose upper face is the plane."""
    normal = rotated(np.array([0.0, 0.0, 1.0]), quaternion)
    return np.array([size[0] or _PLANE_M, size[1] or _PLANE_M, _THICK_M]), position - _THICK_M * normal


def shapes_by_body(system: System) -> dict[int, list[DrawnShape]]:
    """Drawn shapes by body, for bodies that have any."""
    by_body: dict[int, list[DrawnShape]] = {}
    for shape in shapes(system):
        by_body.setdefault(shape.body, []).append(shape)
    return by_body


def _mesh(model: Any, mesh: int) -> tuple[FloatArray, npt.NDArray[np.int32], FloatArray]:
    """Vertices, triangles and normals at the vertices; a vertex on a sharp edge is repeated for each of its normals."""
    if mesh < 0:
        return np.empty((0, 3)), np.empty((0, 3), dtype=np.int32), np.empty((0, 3))
    vertex, normal, face = (int(starts[mesh]) for starts in (model.mesh_vertadr, model.mesh_normaladr, model.mesh_faceadr))
    faces = slice(face, face + int(model.mesh_facenum[mesh]))
    corners = np.column_stack((model.mesh_face[faces].ravel(), model.mesh_facenormal[faces].ravel()))
    used, places = np.unique(corners, axis=0, return_inverse=True)
    vertices, normals = model.mesh_vert[vertex + used[:, 0]], model.mesh_normal[normal + used[:, 1]]
    return vertices.astype(np.float64), places.reshape(-1, 3).astype(np.int32), normals.astype(np.float64)


def _surface(prisms: Sequence[Polytope]) -> tuple[FloatArray, npt.NDArray[np.int32], FloatArray]:
    """Vertices, triangles and normals at the vertices of the tops of prisms, each a flat fan."""
    vertices, triangles, normals, count = [], [], [], 0
    for prism in prisms:
        top = prism.vertices[list(prism.faces[0])]
        vertices.append(top)
        normals.append(np.tile(prism.normals[0], (len(top), 1)))
        triangles += [(count, count + k, count + k + 1) for k in range(1, len(top) - 1)]
        count += len(top)
    return np.concatenate(vertices), np.array(triangles, dtype=np.int32), np.concatenate(normals)


class Poser:
    """Computes poses of all bodies of a model from its coordinates."""

    def __init__(self, model: Any) -> None:
        """Make room for one state."""
        self._model, self._data = model, mujoco.MjData(model)

    def poses(self, coordinates: FloatArray) -> tuple[FloatArray, FloatArray]:
        """World positions in m, (n, nbody, 3), and orientations, (n, nbody, 4), for coordinates, (n, nq)."""
        positions = np.empty((len(coordinates), self._model.nbody, 3))
        quaternions = np.empty((len(coordinates), self._model.nbody, 4))
        for i, qpos in enumerate(coordinates):
            self._data.qpos[:] = qpos
            mujoco.mj_kinematics(self._model, self._data)
            positions[i], quaternions[i] = self._data.xpos, self._data.xquat
        return positions, quaternions


class FramePicker:
    """Selects frames from blocks of rows, the first row in each view period, and computes their poses."""

    def __init__(self, system: System, layout: Layout, view_rate_hz: float) -> None:
        """Start before the first row of a run with these columns."""
        self._poser = Poser(system.mj)
        self._time, self._coordinates = layout.time, layout.places(coordinate_keys(system.joints.values()))
        self._period, self._last = 1.0 / view_rate_hz, -1.0

    def pick(self, block: FloatArray) -> Frames | None:
        """Frames in the next block; None if there are none."""
        # The margin keeps a row at a multiple of the period in its own period despite rounding of its time.
        number = np.floor(block[:, self._time] / self._period + 1e-6)
        rows = block[np.diff(number, prepend=self._last) > 0.0]
        if not len(rows):
            return None
        self._last = number[-1]
        return Frames(rows[:, self._time], rows, *self._poser.poses(rows[:, self._coordinates]))


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
    colour, material = tuple(map(float, model.geom_rgba[geom])), int(model.geom_matid[geom])
    if colour != _NO_COLOUR:
        return colour
    if material >= 0:
        return _material_colour(model, material)
    body = int(model.geom_bodyid[geom])
    return shares(mixed(_hue(system, body), WHITE, _TINTS[_depth(model, body) % len(_TINTS)])) if body else colour


def _root(model: Any, geom: int) -> int:
    return int(model.body_rootid[model.geom_bodyid[geom]])


def _covered(model: Any, geom: int, visual: list[int]) -> bool:
    """Whether the bounding boxes of visual geoms of one body cover that of a geom of the same body."""
    around = model.geom_aabb[geom]
    points = (around[:3] + _GRID * around[3:]) @ rotation_matrix(model.geom_quat[geom]).T + model.geom_pos[geom]
    inside = np.zeros(len(points), dtype=bool)
    for other in visual:
        box = model.geom_aabb[other]
        local = (points - model.geom_pos[other]) @ rotation_matrix(model.geom_quat[other]) - box[:3]
        inside |= (np.abs(local) <= (1.0 + _MARGIN) * box[3:] + _MARGIN * around[3:].max()).all(axis=1)
    return bool(inside.mean() >= _COVERED)


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


_SIGNS = np.array(list(product((-1.0, 1.0), repeat=3)))


def box_points(
    model: Any, geoms: Iterable[int], positions: FloatArray, quaternions: FloatArray, shares: FloatArray = _SIGNS
) -> FloatArray:
    """Points of the bounding boxes of some geoms in world axes, their corners if not stated, (n * number of geoms, 3), m.

    Args:
        model: MuJoCo model.
        geoms: Ids of the geoms.
        positions: World positions of all bodies, (nbody, 3), m.
        quaternions: World orientations of all bodies, wxyz, (nbody, 4).
        shares: The points in each box, relative to its half sizes, (n, 3).
    """
    points = [np.empty((0, 3))]
    for geom in geoms:
        body, around = int(model.geom_bodyid[geom]), model.geom_aabb[geom]
        local = (around[:3] + shares * around[3:]) @ rotation_matrix(model.geom_quat[geom]).T + model.geom_pos[geom]
        points.append(local @ rotation_matrix(quaternions[body]).T + positions[body])
    return np.vstack(points)


NOMINAL_M = 10.0
"""Size of a robot whose markers have their nominal size, m."""


def marker_scale(system: System) -> float:
    """Factor of the lengths of markers: the size of the robot over ``NOMINAL_M``.

    The size is the diagonal of the box around the robot's drawn geoms at the zero position of its model.
    """
    model = system.mj
    data = mujoco.MjData(model)
    data.qpos[:] = model.qpos0
    mujoco.mj_kinematics(model, data)
    geoms = [geom for geom in geoms_to_draw(model) if int(model.geom_bodyid[geom]) in system.robot.bodies]
    if not geoms:
        return float(model.stat.extent) / NOMINAL_M
    corners = box_points(model, geoms, data.xpos, data.xquat)
    return float(np.linalg.norm(np.ptp(corners, axis=0))) / NOMINAL_M


View = tuple[FloatArray, FloatArray]
"""Lower and upper corner of the box that a view frames, (3,) each, m."""


def robot_boxes(system: System, positions: FloatArray) -> FloatArray:
    """Lower, then upper corners of the boxes around the frames of the robot's bodies in world axes, (n, 6), m.

    Args:
        system: Robot and objects.
        positions: World positions of all bodies, (n, nbody, 3), m.
    """
    robot = positions[:, list(system.robot.bodies)]
    return np.hstack((robot.min(axis=1), robot.max(axis=1)))


def camera_path(times: FloatArray, boxes: FloatArray, first_s: float, view: View) -> FloatArray | None:
    """Displacements of a camera, (n, 3), m; None if the robot stays in view.

    They are those of the middle of the robot since the first event. They are zero before it: the camera stands still until
    then, wherever the viewer begins.

    Args:
        times: Times, (n,), s.
        boxes: Boxes around the robot at these times, (n, 6), m.
        first_s: Time of the first event, at which the view frames everything; zero without events.
        view: What the view frames.
    """
    low, high = view
    first = min(int(np.searchsorted(times, first_s)), len(times) - 1)
    if (boxes[first:, :3] >= low).all() and (boxes[first:, 3:] <= high).all():
        return None
    middles = 0.5 * (boxes[:, :3] + boxes[:, 3:])
    middles[:first] = middles[first]
    return np.asarray(middles - middles[first])


class NamedPoint(NamedTuple):
    """A point in world axes, (3,), m, and what it is."""

    name: str
    point_m: FloatArray


class CheckedPair(NamedTuple):
    """A pair of geoms whose contacts are resolved.

    Attributes:
        name: Its name.
        geoms: Geom ids.
        restitution: Coefficient of restitution.
        mu: Coefficient of friction.
        nearest: Signed distance in m and nearest points in the world, (2, 3), m; None: those of both convex geoms.
    """

    name: str
    geoms: tuple[int, int]
    restitution: float
    mu: float
    nearest: tuple[float, FloatArray] | None = None


@dataclass(frozen=True, kw_only=True)
class InitialScene:
    """A scene at t = 0.

    Attributes:
        name: Name of the scenario.
        system: Robot and objects.
        data: MuJoCo data at t = 0, all derived quantities current.
        targets: Targets of the tip and of phases.
        centres: Centres of mass.
        reaches: Reach of each tip.
        pairs: Pairs of geoms whose contacts are resolved.
        ignored: Geom ids of ignored pairs.
        lines: Text shown beside the scene.
        view: Direction towards the camera; None: the one that shows most.
    """

    name: str
    system: System
    data: Any
    targets: Sequence[NamedPoint]
    centres: Sequence[NamedPoint]
    reaches: Sequence[Reach]
    pairs: Sequence[CheckedPair]
    ignored: frozenset[frozenset[int]]
    lines: Sequence[str]
    view: Sequence[float] | None = None
