"""The task model: digits of the case study, and Pinocchio, finite differences and the reduced model as oracles."""

from __future__ import annotations

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.controller_protocol import ControllerContext, ScenarioFaults, Task, mass_matrix, reduced_model
from ffsm_mj.model.grasp import Grasp
from ffsm_mj.task_model import TaskModel
from tests.conftest import MJCF
from tests.model.test_pinocchio import oracle, to_pinocchio
from tests.scenes import compile_paths

TARGET_M = np.array([3.0, 0.0])


@pytest.fixture(scope="module")
def planar():
    """The case study at its start, and what its laws are made for."""
    system = prepare("baseline").system
    data = mujoco.MjData(system.mj)
    for name, value in {"base_x": 5.0, "base_y": -1.75, "base_yaw": 0.1, "object/x": 3.5, "object/y": -0.5}.items():
        data.qpos[system.joint(name).qpos] = value
    for name, value in {"joint_1": 1.035066011, "joint_2": 1.123473903, "joint_3": -2.158539914}.items():
        data.qpos[system.joint(name).qpos] = value
    return system, data.qpos.copy(), ControllerContext(system, Task(system.index("site", "tip"), (0, 1), TARGET_M), 0.001)


@pytest.fixture(scope="module")
def spatial():
    """Servicer and satellite, without a task."""
    system = compile_paths(MJCF / "spacecraft_7dof.xml", {"satellite": MJCF / "satellite_defunct.xml"})
    return system, ControllerContext(system, None, 0.01)


def at(model, qpos, qvel=None):
    """Data at a state, everything derived current."""
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    if qvel is not None:
        data.qvel[:] = qvel
    mujoco.mj_forward(model, data)
    return data


def drawn(model, rng):
    """A state that nothing singles out."""
    data = mujoco.MjData(model)
    mujoco.mj_integratePos(model, data.qpos, rng.normal(size=model.nv), 1.0)
    return data.qpos.copy(), rng.normal(size=model.nv)


JOINTS = ("yaw", "shoulder", "upper_roll", "elbow", "fore_roll", "wrist", "hand_roll")


def arm(context):
    """The seven joints and the tip's position and attitude."""
    return TaskModel(context, JOINTS, site="tip", attitude=True)


def test_the_generalised_jacobian_of_the_case_study(planar):
    """T0: to the eight digits that are known of it."""
    system, qpos, context = planar
    model = TaskModel(context, base_axes=(2,))
    model.update(at(system.mj, qpos))
    expected = [[-0.37371418, -0.44140439, 0.17790255], [-0.18805183, 0.19095911, 1.37524489]]
    np.testing.assert_allclose(model.alpha, expected, rtol=0, atol=5.1e-9)
    np.testing.assert_allclose(model.W, [[-0.87577562, -0.38243214, -0.17434295]], rtol=0, atol=5.1e-9)
    np.testing.assert_array_equal(model.target_m, TARGET_M)
    np.testing.assert_array_equal(model.e, model.y - TARGET_M)


def free_of_momentum(system, data, qd, joints):
    """Rates of the robot's dofs with the driven ones given and no momentum, by the rows of M."""
    M = mass_matrix(system.mj, data)
    base = [d for d in range(system.robot.dofs.start, system.robot.dofs.stop) if d not in joints]
    qvel = np.zeros(system.mj.nv)
    qvel[joints] = qd
    qvel[base] = -np.linalg.solve(M[np.ix_(base, base)], M[np.ix_(base, joints)] @ qd)
    return qvel


@pytest.fixture(scope="module")
def holding():
    """The same with the satellite held by the hand."""
    grasp = Grasp("grasp", "robot/tip", "satellite/grapple", "robot/hand_roll", "satellite", "satellite/satellite")
    files = {"satellite": MJCF / "satellite_grapple.xml"}
    system = compile_paths(MJCF / "spacecraft_7dof.xml", files, grasp=grasp)
    return system, ControllerContext(system, None, 0.01)


@pytest.mark.parametrize(("scene", "seed"), [("spatial", 0), ("spatial", 1), ("holding", 2)])
def test_the_reduced_model_is_the_elimination(request, scene, seed):
    """M_c, c_c, alpha and drift against the elimination of (22) with dense matrices, with any momentum."""
    system, context = request.getfixturevalue(scene)
    model, data = arm(context), at(system.mj, *drawn(system.mj, np.random.default_rng(seed)))
    model.update(data)
    robot = range(system.robot.dofs.start, system.robot.dofs.stop)
    a = model.joints.dofs
    b = np.array([d for d in robot if d not in a])
    jacobian, rate = np.empty((6, system.mj.nv)), np.empty((6, system.mj.nv))
    site = system.index("site", "tip")
    mujoco.mj_jacSite(system.mj, data, jacobian[:3], jacobian[3:], site)
    mujoco.mj_jacDot(system.mj, data, rate[:3], rate[3:], data.site_xpos[site], system.mj.site_bodyid[site])
    M = mass_matrix(system.mj, data)
    expected = reduced_model(M, data.qfrc_bias, jacobian, rate @ data.qvel, a, b)
    for name in ("M_c", "c_c", "alpha", "drift"):
        value = getattr(expected, name)
        # Condition of M is some 1e5 here: 1e-16 of that, and room.
        np.testing.assert_allclose(getattr(model, name), value, rtol=0, atol=1e-10 * np.abs(value).max(), err_msg=name)
    np.testing.assert_allclose(model.B, expected.alpha @ np.linalg.inv(expected.M_c), rtol=0, atol=1e-10)
    momentum = M[np.ix_(b, b)] @ data.qvel[b] + M[np.ix_(b, a)] @ data.qvel[a]
    np.testing.assert_allclose(model.v_h, jacobian[:, b] @ np.linalg.solve(M[np.ix_(b, b)], momentum), rtol=0, atol=1e-10)
    assert np.abs(model.v_h).max() > 0.1
    without = free_of_momentum(system, data, data.qvel[a], a)
    model.update(at(system.mj, data.qpos, without))
    assert np.abs(model.v_h).max() < 1e-12
    np.testing.assert_allclose(at(system.mj, data.qpos, without).cvel[system.robot.root, :3], model.W @ model.qd, atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_pinocchio_has_the_same_accelerations(spatial, seed):
    """The tip's acceleration with efforts, from Pinocchio's forward dynamics, is drift + B u."""
    system, context = spatial
    rng = np.random.default_rng(seed)
    model, data = arm(context), at(system.mj, *drawn(system.mj, rng))
    model.update(data)
    u = rng.normal(size=7)
    twin, of_body = oracle(system.mj)
    twin.gravity.setZero()
    body = int(system.mj.site_bodyid[system.index("site", "tip")])
    place = pin.SE3(np.eye(3), system.mj.site_pos[system.index("site", "tip")])
    frame = twin.addFrame(pin.Frame("tip", of_body[body], 0, place, pin.FrameType.OP_FRAME))
    q, v, X = to_pinocchio(system.mj, data.qpos, data.qvel)
    efforts = np.zeros(system.mj.nv)
    efforts[model.joints.dofs] = u  # hinges: X is the identity there
    work = twin.createData()
    pin.forwardKinematics(twin, work, q, v, pin.aba(twin, work, q, v, efforts))
    axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    rates = pin.getFrameVelocity(twin, work, frame, axes)
    acceleration = pin.getFrameClassicalAcceleration(twin, work, frame, axes)
    np.testing.assert_allclose(model.yd, rates.vector, rtol=0, atol=1e-12 * 10.0)
    # Accelerations of some 100 m/s^2 by way of M, whose condition is some 1e5.
    np.testing.assert_allclose(model.drift + model.B @ u, acceleration.vector, rtol=0, atol=1e-9)
    np.testing.assert_allclose(X[model.joints.dofs], np.eye(system.mj.nv)[model.joints.dofs], atol=0)


def test_the_attitude_error_is_in_world_axes(spatial):
    """Turned by a small angle about a world axis from the target: that rotation vector."""
    system, context = spatial
    model, data = arm(context), at(system.mj, *drawn(system.mj, np.random.default_rng(3)))
    model.update(data)
    turn = np.array([0.3, -0.2, 0.25])
    model.target_frame = pin.exp3(-turn) @ model.site.frame
    model.update(data)
    np.testing.assert_allclose(model.e[3:], turn, atol=1e-14)
    assert np.abs(model.site.frame.T @ turn - turn).max() > 0.1  # in the site's own axes it is another


def test_what_other_actuators_push_is_added(spatial):
    """A torque of a wheel moves the tip; the response is B's column for a driven joint."""
    system, context = spatial
    model, data = arm(context), at(system.mj, *drawn(system.mj, np.random.default_rng(4)))
    model.update(data)
    force = np.zeros(system.mj.nv)
    force[model.joints.dofs[2]] = 2.0
    np.testing.assert_allclose(model.response(data, force), 2.0 * model.B[:, 2], atol=1e-14)


def test_what_there_is_not_is_refused_with_its_place(spatial):
    _, context = spatial
    for changes, path, what in (
        ({"joints": ("yaw", "elbo")}, ("joints", 1), "elbow"),
        ({"site": "top"}, ("site",), "unknown site 'top'"),
    ):
        with pytest.raises(ScenarioFaults) as faults:
            TaskModel(context, **({"site": "tip"} | changes))
        (fault,) = faults.value.faults
        assert fault.path == path
        assert what in fault.message
    with pytest.raises(ScenarioFaults, match="a 'task' with tip"):
        TaskModel(context)
