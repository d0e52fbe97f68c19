"""Pinocchio as an oracle of held contacts: rows of its own frames, accelerations and forces of its own solver."""

from __future__ import annotations

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from ffsm_mj._core.contacts import ContactEvaluation
from ffsm_mj._core.row_evaluator import RowEvaluator
from ffsm_mj.contact.features.search import features
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact_models.persistent.contact_points import ContactPoint
from ffsm_mj.contact_models.persistent.friction.modes import SLIDE, FrictionModes
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.dynamics.rigid_body import mass_matrix
from tests.model.test_pinocchio import oracle, to_pinocchio
from tests.scenes import ARM, ball, box, compile_paths

STATES = 500


@pytest.fixture(scope="module")
def system(tmp_path_factory):
    """The arm of two links on a free base; a free ball and a free box."""
    folder = tmp_path_factory.mktemp("held")
    models = {"robot": ARM, "ball": ball("ball", mass=1.5), "box": box("box", mass=2.0, half=(0.2, 0.3, 0.25))}
    for name, text in models.items():
        (folder / f"{name}.xml").write_text(text)
    return compile_paths(folder / "robot.xml", {name: folder / f"{name}.xml" for name in ("ball", "box")})


def held_state(system, data, rng):
    """Everything moves at random; the tip touches the ball's surface and a face of the box at chosen points."""
    model = system.mj
    mujoco.mj_resetData(model, data)
    mujoco.mj_integratePos(model, data.qpos, rng.uniform(-2, 2, model.nv), 1.0)
    data.qvel[:] = rng.uniform(-1, 1, model.nv)
    mujoco.mj_kinematics(model, data)
    tip = data.geom_xpos[system.index("geom", "tip")]
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    at = system.joints["ball/free"].qpos.start
    data.qpos[at : at + 3] = tip + 0.15 * direction
    # On the other side the box, its face x = 0.2 towards the tip at a point inside it.
    at = system.joints["box/free"].qpos.start
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, data.qpos[at + 3 : at + 7])
    centre = np.array((-0.25, *rng.uniform(-0.2, 0.2, 2)))
    data.qpos[at : at + 3] = tip + rotation.reshape(3, 3) @ centre
    mujoco.mj_forward(model, data)
    return tip


@pytest.mark.long
def test_forces_and_accelerations_of_held_contacts(system, rng):
    """Sphere on sphere and sphere on face at once, 500 states: to 1e-10 of the largest acceleration and force.

    Pinocchio gets J from its own frame Jacobians and gamma from its own accelerations at qddot = 0; to them only the turning
    of the normals is added from its own velocities: no number of ours but the normals and points, which are geometry.
    """
    model = system.mj
    reference, of_body = oracle(model)
    reference.gravity.linear = np.zeros(3)
    other, data = reference.createData(), mujoco.MjData(model)
    motion = Motion(model, data)
    for _ in range(STATES):
        tip = held_state(system, data, rng)
        # New ones: a pair remembers the last normal, and states that follow each other in a motion are close.
        pairs = [ContactPair(system, name, "robot/tip", name, 1.0) for name in ("ball/ball", "box/box")]
        found = [features(pair, model, data, pair.proximity(model, data)) for pair in pairs]
        contact_points = [ContactPoint(pair, feature) for pair, (feature,) in zip(pairs, found, strict=True)]
        force = rng.uniform(-5, 5, model.nv)
        here = RowEvaluator(motion, data, contact_points).rows()
        modes, points = FrictionModes(), tuple(contact_points)
        modes.set(points, np.full(2, SLIDE), np.zeros((2, 3)), np.zeros(2), *np.zeros((2, 2), dtype=bool))
        stage, pushes = ContactEvaluation(points, here, force - data.qfrc_bias, modes.of(points)).present_stage()
        held = stage.forces
        ours = np.linalg.solve(mass_matrix(model, data), force - data.qfrc_bias + pushes)

        q, v, X = to_pinocchio(model, data.qpos, data.qvel)
        J, gamma = zip(*(_row(reference, other, of_body, q, v, pair, system, data, tip) for pair in pairs), strict=True)
        J, gamma = np.array(J), np.array(gamma)
        tau = np.linalg.solve(X.T, force)
        theirs = pin.forwardDynamics(reference, other, q, v, tau, J, gamma, 0.0)
        forces = np.array(other.lambda_c)
        # Free joints: v = X qvel, so its rate is X qddot and the turning of the body axes, -omega x v.
        np.testing.assert_allclose(
            _rates(model, X @ ours, data), theirs, rtol=0, atol=1e-10 * max(1.0, np.abs(theirs).max())
        )
        np.testing.assert_allclose(held, forces, rtol=0, atol=1e-10 * max(1.0, np.abs(forces).max()))


def _rates(model, moved, data):
    """Rates of Pinocchio's velocities: the linear ones of free joints are in turning axes."""
    for j in np.flatnonzero(model.jnt_type == int(mujoco.mjtJoint.mjJNT_FREE)):
        d, a = int(model.jnt_dofadr[j]), int(model.jnt_qposadr[j])
        rotation = np.empty(9)
        mujoco.mju_quat2Mat(rotation, data.qpos[a + 3 : a + 7])
        linear = rotation.reshape(3, 3).T @ data.qvel[d : d + 3]
        moved[d : d + 3] -= np.cross(data.qvel[d + 3 : d + 6], linear)
    return moved


def _row(reference, other, of_body, q, v, pair, system, data, tip):
    """J and gamma of one gap by Pinocchio: between two centres, or from a face to a centre.

    gap = |c_b - c_a| - r_a - r_b has gap'' = n . (a_b - a_a) + |v_t|^2 / d with the tangential part of the centres' relative
    velocity and their distance d. gap = n . (c - p) - r with n turning with the face at w has, for the material point p of
    the face under c and the relative velocity r' = v_c - v_p: gap'' = n . (a_c - a_p) + 2 (w x n) . (v_c - v_p), for n'' and
    the lever's own terms are in a_p, which is that of a point of the body.
    """
    pin.forwardKinematics(reference, other, q, v, np.zeros(reference.nv))
    pin.computeJointJacobians(reference, other, q)
    a, b = of_body[pair.body_a], of_body[pair.body_b]
    J_a, v_a, a_a, _ = _point(reference, other, a, tip)
    if pair.geom_b == "ball/ball":
        centre = np.array(data.geom_xpos[system.index("geom", "ball/ball")])
        J_b, v_b, a_b, _ = _point(reference, other, b, centre)
        distance = np.linalg.norm(centre - tip)
        n = (centre - tip) / distance
        relative = v_b - v_a
        tangential = relative - n * (n @ relative)
        return n @ (J_b - J_a), n @ (a_b - a_a) + tangential @ tangential / distance
    outward = data.geom_xmat[system.index("geom", "box/box")].reshape(3, 3)[:, 0]
    J_b, v_b, a_b, w = _point(reference, other, b, tip)
    return outward @ (J_a - J_b), outward @ (a_a - a_b) + 2.0 * np.cross(w, outward) @ (v_a - v_b)


def _point(reference, other, joint, point):
    """Jacobian, velocity, acceleration at qddot = 0 of a body-fixed point, and the body's angular velocity; world axes."""
    world = pin.ReferenceFrame.WORLD
    J = pin.getJointJacobian(reference, other, joint, world)
    velocity = pin.getVelocity(reference, other, joint, world)
    spatial = pin.getAcceleration(reference, other, joint, world)
    w, at = velocity.angular, velocity.linear + np.cross(velocity.angular, point)
    acceleration = spatial.linear + np.cross(spatial.angular, point) + np.cross(w, at)
    return J[:3] - pin.skew(point) @ J[3:], at, acceleration, w
