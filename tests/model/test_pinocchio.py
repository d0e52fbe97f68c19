"""Pinocchio as an independent oracle: mass matrix, momenta, energy, impact, on 500 random states of each robot.

A plain run has 50 of them. The Pinocchio model is built joint by joint from the numbers of the MuJoCo model; none of its own
loaders is trusted with two floating trees. Free joints: Pinocchio's linear velocity is in body axes, MuJoCo's in world axes.
"""

from __future__ import annotations

import re

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from ffsm_mj.dynamics.rigid_body import base_jacobian, base_wrench, free_components, mass_matrix
from ffsm_mj.impact import Contact, resolve
from tests.conftest import MJCF
from tests.scenes import compile_paths, of_subtree

STATES = 50


def oracle(model):
    """Pinocchio's model of all bodies, and its joint by MuJoCo body."""
    out = pin.Model()
    of_body = {0: 0}
    for body in range(1, model.nbody):
        rotation = np.empty(9)
        mujoco.mju_quat2Mat(rotation, model.body_quat[body])
        placement = pin.SE3(rotation.reshape(3, 3), model.body_pos[body].copy())
        parent = of_body[int(model.body_parentid[body])]
        inertia_rotation = np.empty(9)
        mujoco.mju_quat2Mat(inertia_rotation, model.body_iquat[body])
        R = inertia_rotation.reshape(3, 3)
        inertia = pin.Inertia(
            float(model.body_mass[body]), model.body_ipos[body].copy(), R @ np.diag(model.body_inertia[body]) @ R.T
        )
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        if count == 0:
            # Welded to its parent: its inertia joins that of the parent's joint; poses of welded bodies are not needed.
            out.appendBodyToJoint(parent, inertia, placement)
            of_body[body] = parent
            continue
        for j in range(first, first + count):
            axis = model.jnt_axis[j]
            kind = {
                int(mujoco.mjtJoint.mjJNT_FREE): pin.JointModelFreeFlyer,
                int(mujoco.mjtJoint.mjJNT_SLIDE): lambda axis=axis: pin.JointModelPrismaticUnaligned(*axis),
                int(mujoco.mjtJoint.mjJNT_HINGE): lambda axis=axis: pin.JointModelRevoluteUnaligned(*axis),
            }[int(model.jnt_type[j])]()
            # A free joint's position is absolute in MuJoCo.
            where = pin.SE3.Identity() if model.jnt_type[j] == int(mujoco.mjtJoint.mjJNT_FREE) else placement
            parent = out.addJoint(parent, kind, where, f"joint_{j}")
            placement = pin.SE3.Identity()
        out.appendBodyToJoint(parent, inertia, pin.SE3.Identity())
        of_body[body] = parent
    out.armature = model.dof_armature.copy()
    return out, of_body


def to_pinocchio(model, qpos, qvel):
    """(q, v, X) with v = X qvel."""
    q, X = qpos.copy(), np.eye(model.nv)
    for j in range(model.njnt):
        if model.jnt_type[j] == int(mujoco.mjtJoint.mjJNT_FREE):
            a, d = int(model.jnt_qposadr[j]), int(model.jnt_dofadr[j])
            rotation = np.empty(9)
            mujoco.mju_quat2Mat(rotation, qpos[a + 3 : a + 7])
            q[a + 3 : a + 7] = np.roll(qpos[a + 3 : a + 7], -1)
            X[d : d + 3, d : d + 3] = rotation.reshape(3, 3).T
    return q, X @ qvel, X


def without_wheels(text):
    """MJCF of a robot without its wheels and their motors."""
    text = re.sub(r"\s*<body name=\"wheel[^>]*>.*?</body>", "", text, flags=re.DOTALL)
    return re.sub(r"\s*<motor name=\"wheel[^>]*/>", "", text)


@pytest.fixture(
    scope="module",
    params=[
        ("ffsm_3dof", "box_1m", False),
        ("ffsm_3dof_hardware", "box_1m", False),
        ("spacecraft_7dof", "satellite_defunct", False),
        ("spacecraft_7dof", "satellite_defunct", True),
    ],
    ids=["planar", "planar with wheel", "spatial with wheels", "spatial without wheels"],
)
def system(request, tmp_path_factory):
    robot, target, strip = request.param
    folder = MJCF
    if strip:
        folder = tmp_path_factory.mktemp("stripped")
        for path in MJCF.glob("*.xml"):
            text = path.read_text()
            (folder / path.name).write_text(without_wheels(text) if path.stem == robot else text)
    compiled = compile_paths(folder / f"{robot}.xml", {"object": folder / f"{target}.xml"})
    assert any("wheel" in name for name in compiled.names("joint")) == (not strip and robot != "ffsm_3dof")
    return compiled


def close(found, expected, scale=None):
    """Equal to 1e-12 of the largest entry."""
    scale = np.abs(expected).max() if scale is None else scale
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * scale)


@pytest.mark.parametrize("draw", [0, *(pytest.param(draw, marks=pytest.mark.long) for draw in range(1, 10))])
def test_pinocchio_agrees(system, draw):
    model, rng = system.mj, np.random.default_rng([20240601, draw])
    reference, of_body = oracle(model)
    other = reference.createData()
    data = mujoco.MjData(model)
    tip = int(model.site_bodyid[system.index("site", "tip")])
    target = system.objects[0].root
    for _ in range(STATES):
        mujoco.mj_resetData(model, data)
        mujoco.mj_integratePos(model, data.qpos, rng.uniform(-2, 2, model.nv), 1.0)
        data.qvel[:] = rng.uniform(-1, 1, model.nv)
        mujoco.mj_forward(model, data)
        mujoco.mj_subtreeVel(model, data)
        q, v, X = to_pinocchio(model, data.qpos, data.qvel)

        M = pin.crba(reference, other, q)
        M = np.triu(M) + np.triu(M, 1).T
        close(mass_matrix(model, data), X.T @ M @ X)
        T = 0.5 * v @ M @ v
        assert 0.5 * data.qvel @ (mass_matrix(model, data) @ data.qvel) == pytest.approx(T, rel=1e-12)

        momentum = pin.computeCentroidalMomentum(reference, other, q, v)
        total = np.concatenate((momentum.linear, momentum.angular + np.cross(other.com[0], momentum.linear)))
        parts = [of_subtree(model, data, tree.root) for tree in system.trees]
        close(sum(parts), total, scale=max(np.abs(part).max() for part in parts))
        # The robot alone: what its base rows of M qdot say, on the components that are free.
        robot = system.robot
        rows = base_wrench(base_jacobian(model, data, robot), (X.T @ M @ v)[robot.base_dofs])
        free = free_components(system, robot)
        close(rows[free], parts[0][free], scale=np.abs(parts[0]).max())

        point, normal = rng.uniform(-1, 1, 3), rng.normal(size=3)
        if not free.all():
            point[2] = normal[2] = 0.0  # planar
        normal /= np.linalg.norm(normal)
        pin.computeJointJacobians(reference, other, q)
        row = normal @ (
            point_jacobian(reference, other, of_body[target], point) - point_jacobian(reference, other, of_body[tip], point)
        )
        if row @ v > 0.0:
            row, normal = -row, -normal
        after = pin.impulseDynamics(reference, other, q, v, row[None], 1.0)
        impact = resolve(model, data, [Contact(tip, target, point, normal)])
        close(X @ impact.after.qvel, after)
        assert impact.impulses[0] == pytest.approx(float(other.impulse_c[0]), rel=1e-11)


@pytest.mark.parametrize(
    ("robot", "target"),
    [("ffsm_3dof", "box_1m"), ("spacecraft_7dof", "satellite_defunct")],
)
def test_pinocchio_agrees_on_any_two_bodies(robot, target, rng):
    """Object on object, the robot on itself and on an object, an object on the robot; elastic and not."""
    system = compile_paths(MJCF / f"{robot}.xml", dict.fromkeys(("object", "other"), MJCF / f"{target}.xml"))
    model = system.mj
    reference, of_body = oracle(model)
    other, data = reference.createData(), mujoco.MjData(model)
    tip = int(model.site_bodyid[system.index("site", "tip")])
    one, two = (tree.root for tree in system.objects)
    planar = not free_components(system, system.robot).all()
    for a, b in ((one, two), (system.robot.root, tip), (tip, system.robot.root), (tip, one), (two, tip)) * 20:
        mujoco.mj_resetData(model, data)
        mujoco.mj_integratePos(model, data.qpos, rng.uniform(-2, 2, model.nv), 1.0)
        data.qvel[:] = rng.uniform(-1, 1, model.nv)
        mujoco.mj_forward(model, data)
        q, v, X = to_pinocchio(model, data.qpos, data.qvel)
        point, normal, e = rng.uniform(-1, 1, 3), rng.normal(size=3), rng.uniform()
        if planar:
            point[2] = normal[2] = 0.0
        normal /= np.linalg.norm(normal)
        pin.computeJointJacobians(reference, other, q)
        row = normal @ (
            point_jacobian(reference, other, of_body[b], point) - point_jacobian(reference, other, of_body[a], point)
        )
        if row @ v > 0.0:
            row, normal = -row, -normal
        after = pin.impulseDynamics(reference, other, q, v, row[None], e)
        impact = resolve(model, data, [Contact(a, b, point, normal, e)])
        close(X @ impact.after.qvel, after)
        assert impact.impulses[0] == pytest.approx(float(other.impulse_c[0]), rel=1e-11)
        # Within one subsystem the impulses cancel, on whom they act is in its joints alone.
        moved = [of_subtree_change(model, data, impact, tree.root) for tree in system.trees]
        scale = np.abs(impact.before.momentum).max()
        np.testing.assert_allclose(sum(moved), 0.0, atol=1e-13 * (1.0 + scale))
        if a in system.robot.bodies and b in system.robot.bodies:
            np.testing.assert_allclose(moved, 0.0, atol=1e-13 * (1.0 + scale))


def of_subtree_change(model, data, impact, root):
    """Change of the momentum of a subtree at an impact."""
    found = []
    for state in (impact.before, impact.after):
        data.qvel[:] = state.qvel
        mujoco.mj_fwdVelocity(model, data)
        found.append(of_subtree(model, data, root))
    return found[1] - found[0]


def point_jacobian(reference, other, joint, point):
    """Velocity of a body-fixed point in world axes per joint velocity, (3, nv)."""
    J = pin.getJointJacobian(reference, other, joint, pin.ReferenceFrame.WORLD)
    return J[:3] - pin.skew(point) @ J[3:]
