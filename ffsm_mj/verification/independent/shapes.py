"""Two geoms that touch, as MuJoCo's distances take them: convex geoms as they are, of others the pieces at a point.

A geom that is not convex has pieces outside MuJoCo, which knows its hull only. Here each piece at the point is a mesh of its
own in a small model, in single precision, which is enough for angles between bodies that are moved apart.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_mj.verification.independent.finding import Array
from ffsm_mj.verification.independent.scene import LoggedScene

_AT_M = 1e-6
"""Pieces closer to a contact point than this touch there: weld and gap of a contact are 1e-9 m, single precision 1e-7."""
_MOST = 32
"""Pieces at one point: more are the facets around an apex, whose normals are alike."""
_MESH = int(mujoco.mjtGeom.mjGEOM_MESH)


class Shapes(NamedTuple):
    """Two convex geoms.

    Attributes:
        model: A MuJoCo model with them.
        data: Its data: places of geoms are current.
        first: Id of the first geom.
        second: Id of the second one.
    """

    model: Any
    data: Any
    first: int
    second: int


def touching(scene: LoggedScene, geoms: tuple[int, int], point: Array) -> Iterator[Shapes]:
    """Pairs of shapes of two geoms that may touch at a point: the geoms themselves, or each two of their pieces.

    Args:
        scene: Models of the log, at the state.
        geoms: Ids of the geoms.
        point: Place in the world, m.
    """
    if not any(geom in scene.system.pieces for geom in geoms):
        yield Shapes(scene.model, scene.data, *geoms)
        return
    first, second = ([*_corners(scene, geom, point)] for geom in geoms)
    for one in first:
        for other in second:
            yield _compiled(scene, geoms, (one, other))


def _corners(scene: LoggedScene, geom: int, point: Array) -> Iterator[Array | None]:
    """Corners of the pieces of a geom at a point, in the axes of the geom, (n, 3) each; None for a geom without pieces."""
    pieces = scene.system.pieces.get(geom)
    if pieces is None:
        yield None
        return
    local = (point - scene.data.geom_xpos[geom]) @ scene.data.geom_xmat[geom].reshape(3, 3)
    heights = np.array([(piece.normals @ local - piece.offsets).max() for piece in pieces])
    at = np.flatnonzero(heights <= max(_AT_M, float(heights.min())))
    yield from (pieces[k].vertices for k in at[:_MOST].tolist())


def _mesh_corners(model: Any, geom: int) -> Array:
    """Vertices of the mesh of a geom, in the axes of the geom, (n, 3)."""
    mesh = int(model.geom_dataid[geom])
    start = int(model.mesh_vertadr[mesh])
    return np.asarray(model.mesh_vert[start : start + int(model.mesh_vertnum[mesh])], dtype=np.float64)


def _compiled(scene: LoggedScene, geoms: tuple[int, int], corners: tuple[Array | None, Array | None]) -> Shapes:
    """A model of two geoms where they are in the scene."""
    spec = mujoco.MjSpec()
    spec.option.ccd_tolerance, spec.option.ccd_iterations = scene.model.opt.ccd_tolerance, scene.model.opt.ccd_iterations
    for side, (geom, of_piece) in enumerate(zip(geoms, corners, strict=True)):
        kind = int(scene.model.geom_type[geom])
        added = spec.worldbody.add_geom(name=str(side), type=kind, size=scene.model.geom_size[geom])
        points = _mesh_corners(scene.model, geom) if of_piece is None and kind == _MESH else of_piece
        if points is not None:
            added.type, added.meshname = mujoco.mjtGeom.mjGEOM_MESH, str(side)
            spec.add_mesh(name=str(side), uservert=np.asarray(points).reshape(-1).tolist())
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for side, geom in enumerate(geoms):
        # Meshes are moved to their centres and turned to their principal axes: the pose of the geom in the model says how.
        rotation = scene.data.geom_xmat[geom].reshape(3, 3)
        data.geom_xpos[side] = scene.data.geom_xpos[geom] + rotation @ data.geom_xpos[side]
        data.geom_xmat[side] = (rotation @ data.geom_xmat[side].reshape(3, 3)).reshape(-1)
    return Shapes(model, data, 0, 1)
