"""Outlines of all drawn geoms, projected onto a plane of the world, as polygons."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_mj._core.polygons import hull
from ffsm_mj.arrays import FloatArray
from ffsm_mj.log.drawing import colour_of, geoms_to_draw
from ffsm_mj.model.system import System

_TURN = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
_CIRCLE = np.stack((np.cos(_TURN), np.sin(_TURN)))
_MOST_VERTICES = 2000
"""A mesh with more vertices is reduced to its extreme ones."""
WORLD = "world"
"""Tree name of the outlines of fixed geoms."""
_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)


@dataclass(frozen=True)
class Plane:
    """A plane spanned by two world axes, viewed so that they point right and up."""

    right: int
    up: int

    @property
    def axes(self) -> list[int]:
        """Indices of the two axes."""
        return [self.right, self.up]

    @property
    def names(self) -> tuple[str, str]:
        """Names of the two axes."""
        return "xyz"[self.right], "xyz"[self.up]

    @property
    def towards(self) -> FloatArray:
        """Unit vector towards the viewer, (3,)."""
        return np.asarray(np.cross(np.eye(3)[self.right], np.eye(3)[self.up]))


@dataclass(frozen=True)
class ProjectedOutline:
    """Polygon of one geom, (n, 2) in m, its tree (``WORLD`` if it is fixed) and its lightness from 0 to 1."""

    points: FloatArray
    tree: str
    lightness: float


class Silhouette:
    """Drawn geoms of a system, for projection at many configurations."""

    def __init__(self, system: System) -> None:
        """Find the geoms to draw."""
        model = system.mj
        self._system, self._data = system, mujoco.MjData(model)
        shown = geoms_to_draw(model)
        self._geoms = [(g, system.tree_of_body(int(model.geom_bodyid[g]))) for g in shown]
        meshes = {int(model.geom_dataid[g]) for g in shown if model.geom_type[g] == mujoco.mjtGeom.mjGEOM_MESH}
        self._corners = {mesh: _corners(model, mesh) for mesh in meshes}

    def place(self, qpos: FloatArray) -> Any:
        """MuJoCo data with all poses at a configuration, (nq,)."""
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._system.mj, self._data)
        return self._data

    def outlines(self, qpos: FloatArray, plane: Plane) -> list[ProjectedOutline]:
        """Polygons at a configuration, sorted from back to front."""
        data = self.place(qpos)
        shapes = []
        for geom, tree in self._geoms:
            centre, rotation = data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3)
            flat = self._outline(geom, rotation[plane.axes])
            if flat is not None:
                depth = float(centre @ plane.towards)
                lightness = _lightness(colour_of(self._system, geom))
                shape = ProjectedOutline(flat + centre[plane.axes], tree.name if tree else WORLD, lightness)
                shapes.append((depth, shape))
        return [shape for _, shape in sorted(shapes, key=lambda pair: pair[0])]

    def _outline(self, geom: int, view: FloatArray) -> FloatArray | None:
        """Convex outline of a geom about its centre, seen through two rows of its rotation, (2, 3); None for a plane."""
        model = self._system.mj
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
            return hull(self._corners[int(model.geom_dataid[geom])] @ view.T)
        return _outline(model.geom_size[geom], mujoco.mjtGeom(model.geom_type[geom]), view)


def _corners(model: Any, mesh: int) -> FloatArray:
    """Vertices of a mesh for its outline, (n, 3), m; of many vertices the extreme ones in many directions."""
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    vertices: FloatArray = model.mesh_vert[first : first + count].astype(np.float64)
    if count <= _MOST_VERTICES:
        return vertices
    turn = np.arange(_MOST_VERTICES) * np.pi * (1.0 + np.sqrt(5.0))  # golden-angle spiral: even over the sphere
    z = 1.0 - (2.0 * np.arange(_MOST_VERTICES) + 1.0) / _MOST_VERTICES
    flat = np.sqrt(1.0 - z**2)
    directions = np.column_stack((flat * np.cos(turn), flat * np.sin(turn), z))
    outermost = np.unique([int(np.argmax(vertices @ direction)) for direction in directions])
    return np.asarray(vertices[outermost])


def _outline(size: FloatArray, kind: Any, view: FloatArray) -> FloatArray | None:
    """Convex outline of a geom other than a mesh."""
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return hull((_CORNERS * size) @ view.T)
    if kind in (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_ELLIPSOID):
        radii = size if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID else np.full(3, size[0])
        U, S, _ = np.linalg.svd(view * radii)
        return np.asarray((U * S @ _CIRCLE).T)
    end = size[1] * view[:, 2]
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        disc = size[0] * _CIRCLE.T
    elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        disc = size[0] * (view[:, :2] @ _CIRCLE).T
    else:
        return None
    return hull(np.vstack((disc + end, disc - end)))


def _lightness(rgba: tuple[float, ...]) -> float:
    return float(np.array(rgba[:3]) @ (0.2126, 0.7152, 0.0722))
