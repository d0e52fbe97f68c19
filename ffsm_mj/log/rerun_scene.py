"""What a recording shows in 3-D: every drawn geom as a shape that hangs on its body."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import rerun as rr

from ffsm_mj.model import FloatArray, System
from ffsm_mj.signals import identifier

# MuJoCo's own viewer draws groups 0 to 2; contact-only geoms live in higher ones.
_DRAWN_GROUPS = 3


def body_path(system: System, body: int) -> str:
    """Entity of a body: ``world/robot/base``. Bodies are not nested, their poses are in the world frame."""
    tree, _, name = system.mj.body(body).name.partition("/")
    return f"world/{identifier(tree)}/{identifier(name)}"


def moving_bodies(system: System) -> list[int]:
    """Ids of all bodies that get a pose."""
    return [body for tree in system.trees for body in tree.bodies]


def log_shapes(recording: rr.RecordingStream, system: System) -> None:
    """Log every drawn geom once, in the frame of its body."""
    model = system.mj
    for geom in range(model.ngeom):
        if model.geom_group[geom] >= _DRAWN_GROUPS:
            continue
        shape = _shape(model, geom)
        body = int(model.geom_bodyid[geom])
        if shape is not None:
            name = (model.geom(geom).name or f"geom_{geom}").rsplit("/", 1)[-1]
            parent = body_path(system, body) if body else "world/static"
            recording.log(f"{parent}/{identifier(name)}", shape, static=True)


def poses(system: System, scratch: Any, qpos_rows: FloatArray) -> tuple[FloatArray, FloatArray]:
    """World positions (n, nbody, 3) and quaternions wxyz (n, nbody, 4) of all bodies at some configurations."""
    model = system.mj
    positions, quaternions = np.empty((len(qpos_rows), model.nbody, 3)), np.empty((len(qpos_rows), model.nbody, 4))
    for i, qpos in enumerate(qpos_rows):
        scratch.qpos[:] = qpos
        mujoco.mj_kinematics(model, scratch)
        positions[i], quaternions[i] = scratch.xpos, scratch.xquat
    return positions, quaternions


def _shape(model: Any, geom: int) -> Any:
    size, kind = model.geom_size[geom], mujoco.mjtGeom(model.geom_type[geom])
    centre, quaternion = model.geom_pos[geom], _xyzw(model.geom_quat[geom])
    look: dict[str, Any] = {"colors": [_colour(model, geom)], "fill_mode": "solid"}
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return rr.Boxes3D(half_sizes=[size], centers=[centre], quaternions=[quaternion], **look)
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return rr.Ellipsoids3D(half_sizes=[[size[0]] * 3], centers=[centre], **look)
    if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        return rr.Ellipsoids3D(half_sizes=[size], centers=[centre], quaternions=[quaternion], **look)
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return rr.Cylinders3D(lengths=[2 * size[1]], radii=[size[0]], centers=[centre], quaternions=[quaternion], **look)
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        # A capsule of Rerun starts at its origin and runs along +z; MuJoCo's is centred.
        axis = np.zeros(3)
        mujoco.mju_rotVecQuat(axis, np.array([0.0, 0.0, size[1]]), model.geom_quat[geom])
        return rr.Capsules3D(
            lengths=[2 * size[1]], radii=[size[0]], translations=[centre - axis], quaternions=[quaternion], **look
        )
    return _mesh(model, geom) if kind == mujoco.mjtGeom.mjGEOM_MESH else None


def _mesh(model: Any, geom: int) -> rr.Mesh3D:
    mesh = int(model.geom_dataid[geom])
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    face, faces = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
    vertices = model.mesh_vert[first : first + count] @ rotation.reshape(3, 3).T + model.geom_pos[geom]
    triangles = model.mesh_face[face : face + faces]
    return rr.Mesh3D(vertex_positions=vertices, triangle_indices=triangles, albedo_factor=_colour(model, geom))


def _colour(model: Any, geom: int) -> list[int]:
    material = int(model.geom_matid[geom])
    rgba = model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]
    return [round(255 * float(c)) for c in rgba]


def _xyzw(wxyz: FloatArray) -> FloatArray:
    return np.roll(wxyz, -1, axis=-1)
