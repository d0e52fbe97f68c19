"""The normal where corners nearly meet, found from the state alone, independent of earlier evaluations of the pair."""

from __future__ import annotations

from itertools import product

import mujoco
import numpy as np
import pytest

from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact.shape import Shape
from tests.scenes import HEAD, ball, box, compile_paths

SIGNS = np.array([*product((-1.0, 1.0), repeat=3)])


def tetrahedron(rng):
    """MJCF of a free mesh with four corners."""
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) * 0.08 + rng.uniform(-0.03, 0.03, (4, 3))
    return f"""<mujoco>{HEAD}<asset><mesh name="box" vertex="{" ".join(map(str, corners.ravel()))}"/></asset><worldbody>
      <body name="box"><freejoint name="free"/><inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>
      <geom name="box" type="mesh" mesh="box" mass="0"/></body></worldbody></mujoco>"""


def corners_and_edges(model, data, geom):
    """Corners of a box or a tetrahedron, (n, 3), directions of its edges, and normals of its faces, in the world."""
    rotation, position = data.geom_xmat[geom].reshape(3, 3), data.geom_xpos[geom]
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX:
        return position + (SIGNS * model.geom_size[geom]) @ rotation.T, rotation.T, rotation.T
    first = model.mesh_vertadr[model.geom_dataid[geom]]
    points = position + model.mesh_vert[first : first + 4].astype(float) @ rotation.T
    edges = np.array([points[j] - points[i] for i in range(4) for j in range(i)])
    faces = [
        np.cross(points[b] - points[a], points[c] - points[a]) for a, b, c in ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3))
    ]
    return points, edges, np.array(faces)


def widest(model, data, pair):
    """Separation and direction by the separating axis theorem: over all normals of faces and all pairs of edges."""
    (a, edges_a, faces_a), (b, edges_b, faces_b) = (corners_and_edges(model, data, geom) for geom in pair.ids)
    axes = np.concatenate((faces_a, faces_b, np.cross(edges_a[:, None], edges_b[None]).reshape(-1, 3)))
    lengths = np.linalg.norm(axes, axis=1)
    axes = axes[lengths > 1e-9] / lengths[lengths > 1e-9, None]
    axes = np.concatenate((axes, -axes))
    gaps = (b @ axes.T).min(axis=0) - (a @ axes.T).max(axis=0)
    return gaps.max(), axes[np.argmax(gaps)]


def nearly_meeting(rng, folder, offset_m):
    """Two polytopes at random attitudes in contact, a corner of each within an offset of a corner of the other."""
    bodies = [box("box", half=tuple(rng.uniform(0.05, 0.2, 3))) if rng.random() < 0.6 else tetrahedron(rng) for _ in "ab"]
    paths = []
    for name, text in zip("ab", bodies, strict=True):
        paths.append(folder / f"{name}.xml")
        paths[-1].write_text(text)
    system = compile_paths(paths[0], {"o": paths[1]})
    model, data = system.mj, mujoco.MjData(system.mj)
    pair = ContactPair(system, "pair", "robot/box", "o/box", 1.0)
    for at in (3, 10):
        quaternion = rng.normal(size=4)
        data.qpos[at : at + 4] = quaternion / np.linalg.norm(quaternion)
    mujoco.mj_kinematics(model, data)
    direction, across = rng.normal(size=(2, 3))
    direction /= np.linalg.norm(direction)
    across -= across @ direction * direction
    a, b = (Shape(model, data, geom) for geom in pair.ids)
    data.qpos[7:10] += a.extreme(direction)[0] - b.extreme(-direction)[0] + offset_m * across / np.linalg.norm(across)
    for _ in range(4):
        mujoco.mj_forward(model, data)
        gap, normal = widest(model, data, pair)
        data.qpos[7:10] -= gap * normal
    mujoco.mj_forward(model, data)
    return model, data, pair


@pytest.mark.parametrize("offset_m", [1e-3, 1e-4, 1e-5, 1e-6, 1e-7])
def test_normal_where_corners_nearly_meet(tmp_path, rng, offset_m):
    """The normal has the largest separation of all directions, whatever the normal of the evaluation before."""
    for _ in range(6):
        model, data, pair = nearly_meeting(rng, tmp_path, offset_m)
        gap, normal = widest(model, data, pair)
        cold = pair.proximity(model, data)
        # Corners are sums of numbers of a metre, MuJoCo's meshes among them: 1e-15 each; the normal is that over the offset.
        assert cold.gap == pytest.approx(gap, abs=1e-14)
        assert np.linalg.norm(cold.normal - normal) < 1e-13 + 1e-14 / offset_m


def test_normal_at_the_edge_of_a_fine_mesh(tmp_path, rng):
    """A ball at the side of a face with nine vertices is in contact with the edge, close to the normal of the face."""
    half, radius = 0.25, 0.125  # of powers of two, which are exact in single precision
    grid = " ".join(str(half * x) for corner in product((-1, 0, 1), repeat=3) for x in corner)
    mesh = f"""<mujoco>{HEAD}<asset><mesh name="box" vertex="{grid}"/></asset><worldbody><body name="box">
      <freejoint name="free"/><inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>
      <geom name="box" type="mesh" mesh="box" mass="0"/></body></worldbody></mujoco>"""
    (tmp_path / "a.xml").write_text(mesh)
    (tmp_path / "b.xml").write_text(ball("ball", radius=radius))
    system = compile_paths(tmp_path / "a.xml", {"o": tmp_path / "b.xml"})
    model, data = system.mj, mujoco.MjData(system.mj)
    pair = ContactPair(system, "pair", "robot/box", "o/ball", 1.0)
    for tilt in (1e-7, 1e-6, 2e-5, 9e-5, 1e-3):
        normal, along = np.array([np.sin(tilt), 0.0, np.cos(tilt)]), rng.uniform(-0.2, 0.2)
        rotation, quaternion = np.empty(9), rng.normal(size=4)
        data.qpos[3:7] = quaternion / np.linalg.norm(quaternion)
        mujoco.mju_quat2Mat(rotation, data.qpos[3:7])
        turn = rotation.reshape(3, 3)
        data.qpos[7:10] = turn @ (np.array([half, along, half]) + radius * normal)
        mujoco.mj_forward(model, data)
        near = pair.proximity(model, data)
        # The normal is known to the rounding of places, 1e-16, over the radius.
        assert np.linalg.norm(near.normal - turn @ normal) < 1e-14
