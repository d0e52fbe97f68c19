"""Shapes of the visible geoms, fixed to their bodies, and poses of the bodies by frame, for any viewer; quaternions wxyz."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from ffsm_mj.arrays import FloatArray
from ffsm_mj.log.drawn_geoms import colour_of, geoms_to_draw
from ffsm_mj.model.system import System
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
_MOST_VERTICES = 2_000_000
"""Greatest number of triangle corners of all drawn meshes; meshes beyond it are drawn as their bounding boxes."""


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
    """Shapes of geoms; a plane is a thin box below it, height fields are left out.

    Args:
        system: Robot and objects.
        geoms: Ids of the geoms; None: those that viewers show.
    """
    model, corners = system.mj, 0
    for geom in geoms_to_draw(model) if geoms is None else geoms:
        kind = _KINDS.get(mujoco.mjtGeom(model.geom_type[geom]))
        if kind is None:
            continue
        size, position = model.geom_size[geom].copy(), model.geom_pos[geom].copy()
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_SPHERE:
            size[:] = size[0]
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE:
            size, position = _slab(size, position, model.geom_quat[geom])
        mesh = int(model.geom_dataid[geom]) if kind == "mesh" else -1
        corners += 3 * int(model.mesh_facenum[mesh]) if mesh >= 0 else 0
        if mesh >= 0 and corners > _MOST_VERTICES:
            kind, mesh = "box", -1  # MuJoCo stores the half sizes of the bounding box as the size of a mesh geom
        vertices, triangles, normals = _mesh(model, mesh)
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


def _slab(size: FloatArray, position: FloatArray, quaternion: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Half sizes and centre of a thin box whose upper face is the plane."""
    normal = np.zeros(3)
    mujoco.mju_rotVecQuat(normal, np.array([0.0, 0.0, 1.0]), quaternion)
    return np.array([size[0] or _PLANE_M, size[1] or _PLANE_M, _THICK_M]), position - _THICK_M * normal


def shapes_by_body(system: System) -> dict[int, list[DrawnShape]]:
    """Drawn shapes by body, for bodies that have any."""
    found: dict[int, list[DrawnShape]] = {}
    for shape in shapes(system):
        found.setdefault(shape.body, []).append(shape)
    return found


def _mesh(model: Any, mesh: int) -> tuple[FloatArray, npt.NDArray[np.int32], FloatArray]:
    """Vertices, triangles and normals at the vertices; a vertex on a sharp edge is repeated for each of its normals."""
    if mesh < 0:
        return np.empty((0, 3)), np.empty((0, 3), dtype=np.int32), np.empty((0, 3))
    vertex, normal, face = (int(each[mesh]) for each in (model.mesh_vertadr, model.mesh_normaladr, model.mesh_faceadr))
    faces = slice(face, face + int(model.mesh_facenum[mesh]))
    corners = np.column_stack((model.mesh_face[faces].ravel(), model.mesh_facenormal[faces].ravel()))
    used, places = np.unique(corners, axis=0, return_inverse=True)
    vertices, normals = model.mesh_vert[vertex + used[:, 0]], model.mesh_normal[normal + used[:, 1]]
    return vertices.astype(np.float64), places.reshape(-1, 3).astype(np.int32), normals.astype(np.float64)


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
