"""Latches as rows on free bodies, which know no joints, against trees of joints, Pinocchio, elimination and closed forms."""

from __future__ import annotations

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from ffsm_mj.dynamics.loops.closed_loops import ClosedLoops
from ffsm_mj.dynamics.loops.latch import LatchedBodies, axes_about, stopped_along_axes
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.dynamics.projection import no_contacts, project
from ffsm_mj.dynamics.rigid_body import kinetic_energy, mass_matrix, momentum_matrix
from tests.contact_models.grasp.two_hands import arm
from tests.model.test_pinocchio import oracle, to_pinocchio

HEAD = '<mujoco><compiler angle="radian"/><option gravity="0 0 0" integrator="RK4"/><worldbody>'
TAIL = "</worldbody></mujoco>"
Z = np.eye(3)


class Chain:
    """A model with latches between its bodies."""

    def __init__(self, xml, time_step_s=1e-3):
        self.model = mujoco.MjModel.from_xml_string(xml)
        self.model.opt.timestep = time_step_s
        self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        self.data = mujoco.MjData(self.model)
        self.latches = ()
        mujoco.mj_forward(self.model, self.data)

    def forward(self):
        mujoco.mj_forward(self.model, self.data)

    def latch(self, first, second, point, kind="rigid", axis=()):
        """Join two bodies where they are, at a point in space, by axes in space."""
        a, b = self.model.body(first).id, self.model.body(second).id
        frames = [self.data.xmat[body].reshape(3, 3) for body in (a, b)]
        turn = np.empty(4)
        mujoco.mju_mat2Quat(turn, (frames[0].T @ frames[1]).ravel())
        made = LatchedBodies.at_pose(
            (a, b),
            frames[1].T @ (np.array(point) - self.data.xpos[b]),
            frames[0].T @ axes_about(axis),
            stopped_along_axes(kind),
            frames[0].T @ (self.data.xpos[b] - self.data.xpos[a]),
            turn,
        )
        self.latches = (*self.latches, made)

    def loops(self, latches=None):
        return ClosedLoops(self.model, self.data, self.latches if latches is None else latches)

    def closing(self, latches=None):
        found = self.loops(latches).plastic()
        self.data.qvel[:] += found.change
        self.forward()
        return found

    def momentum(self):
        return momentum_matrix(self.model, self.data, 0) @ self.data.qvel

    def energy(self):
        return kinetic_energy(mass_matrix(self.model, self.data), self.data.qvel)

    def force(self):
        """All generalised forces less the bias."""
        data = self.data
        return data.qfrc_passive - data.qfrc_bias + data.qfrc_actuator + data.qfrc_applied

    def run(self, duration_s, efforts=None):
        motion = Motion(self.model, self.data)
        loops = motion.loops = self.loops() if self.latches else None

        def push(data):
            mujoco.mj_fwdActuation(self.model, data)
            data.qfrc_applied[:] += loops.generalised(self.force())

        h = self.model.opt.timestep
        motion.push_with([efforts] if efforts else [], [push] if loops else [])
        for _ in range(round(duration_s / h)):
            if loops:
                loops.choose()
            motion.step(h)


def free(name, mass, inertia, centre="0 0 0", pos="0 0 0", extra=""):
    return (
        f'<body name="{name}" pos="{pos}"><freejoint/><inertial pos="{centre}" mass="{mass}" diaginertia="{inertia}"/>'
        f"{extra}</body>"
    )


def test_a_rod_that_moves_across_takes_another_by_a_hinge():
    """B3: impulse 1/7, velocities 6/7 and 1/7, both rates -5/7, loss 1/14, rank 5."""
    rods = free("a", 1, ".05 .1 .1") + free("b", 1, ".05 .1 .1", pos="1 0 0")
    chain = Chain(HEAD + rods + TAIL)
    chain.data.qvel[1] = 1.0
    chain.forward()
    chain.latch("a", "b", (0.5, 0, 0), "hinge")
    found = chain.closing()
    assert found.rank == 5
    assert found.loss_J == pytest.approx(1 / 14, abs=1e-15)
    np.testing.assert_allclose(chain.data.qvel[[1, 5, 7, 11]], [6 / 7, -5 / 7, 1 / 7, -5 / 7], rtol=0, atol=1e-15)
    _, force, torque = chain.loops().wrench(0, found.impulses)
    np.testing.assert_allclose(force, [0, 1 / 7, 0], rtol=0, atol=1e-15)
    assert np.abs(torque).max() < 1e-15


def test_a_planar_body_on_a_hinge_in_space():
    """B4: om 1.05, v = (.315, 0), loss .0495; two of five rows are independent, and the load is that of least norm."""
    body = """<body name="post"><freejoint/><inertial pos="0 0 0" mass="1e9" diaginertia="1e9 1e9 1e9"/></body>
      <body name="plate"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint axis="0 0 1"/>
      <inertial pos=".1 0 0" mass="2" diaginertia="1 1 .2"/></body>"""
    chain = Chain(HEAD + body.replace("<freejoint/>", "").replace("1e9", "1") + TAIL)
    chain.data.qvel[:] = 0.4, -0.2, 1.0
    chain.forward()
    chain.latch("post", "plate", (0, 0.3, 0), "hinge")
    found = chain.closing()
    assert found.rank == 2
    np.testing.assert_allclose(chain.data.qvel, [0.315, 0.0, 1.05], rtol=0, atol=1e-15)
    assert found.loss_J == pytest.approx(0.0495, abs=1e-15)
    _, force, torque = chain.loops().wrench(0, found.impulses)
    np.testing.assert_allclose(force, [-0.17, 0.41, 0.0], rtol=0, atol=1e-15)
    assert not torque.any()


ARMS = """<body name="base"><freejoint/><inertial pos="0 0 0" mass="10" diaginertia=".8 .7 .9"/>{left}{right}</body>
<body name="object" pos="{at}"><freejoint/><inertial pos=".03 .02 0" mass="3" diaginertia=".05 .08 .06"/></body>"""


def two_arms(axes, step_s=1e-3):
    xml = HEAD + ARMS.format(left=arm("l", -1, axes), right=arm("r", 1, axes), at="0 0 0") + TAIL
    chain = Chain(xml, step_s)
    chain.data.qpos[7:13] = 0.3, -0.7, 0.2, -0.25, 0.6, -0.3
    chain.forward()
    hands = [chain.data.xpos[chain.model.body(name).id] for name in ("l2", "r2")]
    chain.data.qpos[13:16] = 0.5 * (hands[0] + hands[1]) + (0, 0.15, 0)
    chain.data.qvel[:] = 0.3 * np.random.default_rng(3).normal(size=chain.model.nv)
    chain.forward()
    for name in ("l2", "r2"):
        chain.latch(name, "object", chain.data.xpos[chain.model.body(name).id])
    return chain


@pytest.mark.parametrize(
    ("axes", "rank", "loss_J"),
    [(("0 0 1",) * 3, 9, 0.990770191464), (("0 0 1", "1 0 0", "0 0 1"), 12, 1.356026672503)],
    ids=["planar hinges", "hinges in space"],
)
def test_two_hands_close_on_one_object_at_once(axes, rank, loss_J):
    """B2, against elimination: velocities in the null space of the rows; P and L are kept."""
    chain = two_arms(axes)
    rows, M, before = chain.loops().rows().J, mass_matrix(chain.model, chain.data), chain.data.qvel.copy()
    momentum, energy = chain.momentum(), chain.energy()
    found = chain.closing()
    assert found.rank == rank
    assert found.loss_J == pytest.approx(loss_J, abs=6e-13)
    assert energy - chain.energy() == pytest.approx(found.loss_J, abs=1e-12)
    # Singular values of the rows down to 4e-4 of the largest cost four digits of sixteen.
    space = np.linalg.svd(rows)[2][rank:].T
    expected = space @ np.linalg.solve(space.T @ M @ space, space.T @ M @ before)
    np.testing.assert_allclose(chain.data.qvel, expected, rtol=0, atol=1e-12)
    assert np.abs(rows @ chain.data.qvel).max() < 1e-13
    # Momenta are sums of ten terms of up to 10, impulses known to four digits less.
    assert np.abs(chain.momentum() - momentum).max() < 1e-12


def test_the_order_of_closing_does_not_matter():
    """One latch first, then both: the same velocities and the same total loss as both at once (nested projections)."""
    together, after, other = (two_arms(("0 0 1", "1 0 0", "0 0 1")) for _ in range(3))
    loss = together.closing().loss_J
    for chain, first in ((after, 0), (other, 1)):
        found = chain.closing((chain.latches[first],)).loss_J + chain.closing().loss_J
        assert found == pytest.approx(loss, abs=1e-13)
        np.testing.assert_allclose(chain.data.qvel, together.data.qvel, rtol=0, atol=1e-12)


def test_the_rows_of_a_held_latch_left_out_would_tear_it():
    """The second latch alone moves the hand of the first: the check above sees it."""
    chain = two_arms(("0 0 1", "1 0 0", "0 0 1"))
    chain.closing((chain.latches[0],))
    chain.closing((chain.latches[1],))
    assert np.abs(chain.loops().rows().J @ chain.data.qvel).max() > 1e-2


def test_a_weld_that_is_stated_twice_is_shared():
    """B5: rank 6 of 12, velocities as with one, and each takes half: the load of least norm."""
    once, twice = (two_arms(("0 0 1", "1 0 0", "0 0 1")) for _ in range(2))
    latch = once.latches[0]
    alone, shared = once.closing((latch,)), twice.closing((latch, latch))
    assert shared.rank == alone.rank == 6
    np.testing.assert_allclose(shared.change, alone.change, rtol=0, atol=1e-13)
    np.testing.assert_allclose(shared.impulses, np.tile(0.5 * alone.impulses, 2), rtol=0, atol=1e-13)


def waves():
    """Torques of B2 on the six hinges."""
    amplitudes, place = np.array((2.0, -1.5, 0.6, -2.0, 1.2, 0.5)), np.arange(6)

    def efforts(data):
        data.qfrc_applied[6:12] += amplitudes * np.sin(3.0 * data.time + place)

    return efforts


def test_a_closed_chain_moves_with_order_four():
    """B2 in motion, .4 s under torques, without projection: errors of the rows fall sixteenfold from step to step."""
    found = []
    for step_s in (4e-3, 2e-3):
        chain = two_arms(("0 0 1",) * 3, step_s)
        chain.closing()
        momentum = chain.momentum()
        chain.run(0.4, waves())
        found.append((np.abs(chain.loops().errors()).max(), np.abs(chain.momentum() - momentum).max()))
    coarse, fine = np.array(found)
    np.testing.assert_array_less(coarse, (3e-8, 2e-7))
    assert np.all(coarse / fine > 12.0), coarse / fine


BASE = free("base", 5, ".5 .6 .4")
ONE = '<inertial pos="0 0 -.4" mass="1" diaginertia=".06 .05 .01"/>'
TWO = '<inertial pos="0 .02 -.3" mass=".7" diaginertia=".03 .025 .006"/>'
PLACED = (("one", ".2 0 -.3", ONE), ("two", ".2 0 -1.1", TWO))
KINDS = {
    "ball and ball": (("ball", ()), ("ball", ())),
    "hinge and slide": (("hinge", (1.0, 2.0, 2.0)), ("slide", (2.0, -1.0, 2.0))),
    "cylindrical and ball": (("cylindrical", (1.0, 2.0, 2.0)), ("ball", ())),
}


def tree_of(kinds, step_s):
    """The two links as children, by MuJoCo's own joints."""
    joints = []
    for kind, axis in kinds:
        parts = {"cylindrical": ("slide", "hinge")}.get(kind, (kind,))
        along = f' axis="{" ".join(map(str, axis))}"' if axis else ""
        joints.append("".join(f'<joint type="{part}"{along}/>' for part in parts))
    text = (
        '<body name="base"><freejoint/><inertial pos="0 0 0" mass="5" diaginertia=".5 .6 .4"/>'
        f'<body name="one" pos=".2 0 -.3">{joints[0]}{ONE}<body name="two" pos="0 0 -.8">{joints[1]}{TWO}</body></body>'
        "</body>"
    )
    return Chain(HEAD + text + TAIL, step_s)


@pytest.mark.parametrize("kinds", KINDS.values(), ids=KINDS)
def test_free_bodies_with_latches_move_as_the_tree(kinds):
    """B1: .2 s from random rates, against MuJoCo's joints at a quarter of the step; order four in the last body's pose."""
    errors = []
    for step_s in (4e-3, 2e-3):
        tree = tree_of(kinds, 0.25 * step_s)
        tree.data.qvel[:] = np.random.default_rng(1).normal(size=tree.model.nv)
        tree.forward()
        bodies = "".join(f'<body name="{n}" pos="{at}"><freejoint/>{mass}</body>' for n, at, mass in PLACED)
        chain = Chain(HEAD + BASE + bodies + TAIL, step_s)
        chain.data.qvel[:6] = tree.data.qvel[:6]
        twist = np.empty(6)
        for k, name in enumerate(("one", "two"), start=1):
            body = tree.model.body(name).id
            mujoco.mj_objectVelocity(tree.model, tree.data, mujoco.mjtObj.mjOBJ_XBODY, body, twist, 0)
            chain.data.qvel[6 * k : 6 * k + 3], chain.data.qvel[6 * k + 3 : 6 * k + 6] = twist[3:], twist[:3]
        chain.forward()
        for pair, point, (kind, axis) in zip(
            (("base", "one"), ("one", "two")), ((0.2, 0, -0.3), (0.2, 0, -1.1)), kinds, strict=True
        ):
            chain.latch(*pair, point, kind, axis)
        assert np.abs(chain.loops().rows().J @ chain.data.qvel).max() < 1e-14
        chain.run(0.2)
        tree.run(0.2)
        place = [each.data.xpos[each.model.body("two").id] for each in (chain, tree)]
        turn = [each.data.xmat[each.model.body("two").id] for each in (chain, tree)]
        errors.append(max(np.abs(place[0] - place[1]).max(), np.abs(turn[0] - turn[1]).max()))
    assert errors[0] < 1e-8
    assert errors[0] / errors[1] > 10.0, errors


def test_projection_removes_the_drift_and_keeps_momenta():
    """Errors of 1e-6 go to rounding by Newton's method; then velocities satisfy the rows, with P and L as before."""
    chain = two_arms(("0 0 1", "1 0 0", "0 0 1"))
    chain.closing()
    rng = np.random.default_rng(2)
    mujoco.mj_integratePos(chain.model, chain.data.qpos, 1e-6 * rng.normal(size=chain.model.nv), 1.0)
    chain.data.qvel[:] += 1e-6 * rng.normal(size=chain.model.nv)
    chain.forward()
    momentum = chain.momentum()
    assert np.abs(chain.loops().errors()).max() > 1e-7
    motion = Motion(chain.model, chain.data)
    motion.loops = chain.loops()
    project(motion, lambda: no_contacts(chain.model.nv), np.ones(6, dtype=bool), np.empty((0, 6)))
    assert np.abs(chain.loops().errors()).max() < 1e-14
    assert np.abs(chain.loops().rows().J @ chain.data.qvel).max() < 1e-13
    assert np.abs(chain.momentum() - momentum).max() < 1e-13


def test_an_impact_on_projected_rows_keeps_the_loop():
    """J less what the latches hold, with the same M, is an impact with Mc^-1: J Mc^-1 J^T, and no row of a latch moves."""
    chain = two_arms(("0 0 1", "1 0 0", "0 0 1"))
    chain.closing()
    rows, M = chain.loops().rows().J, mass_matrix(chain.model, chain.data)
    J = np.random.default_rng(4).normal(size=(1, chain.model.nv))
    projected, response = chain.loops().projected(J), chain.loops().response(J)
    inverse = np.linalg.inv(M)
    Mc = inverse - inverse @ rows.T @ np.linalg.pinv(rows @ inverse @ rows.T, rcond=1e-20**0.5) @ rows @ inverse
    np.testing.assert_allclose(projected @ inverse @ projected.T, J @ Mc @ J.T, rtol=1e-8)
    np.testing.assert_allclose(response, J @ Mc, rtol=0, atol=1e-9 * np.abs(J @ inverse).max())
    np.testing.assert_allclose(projected @ chain.data.qvel, J @ chain.data.qvel, rtol=0, atol=1e-12)
    assert np.abs(rows @ inverse @ projected.T).max() < 1e-10 * np.abs(inverse @ J.T).max()


def test_pinocchio_agrees_on_the_closed_chain(rng, request):
    """Constrained accelerations of two hands on one object at 500 random states (50 in the normal run).

    Expected: by Pinocchio's own M, drift and rows.

    Its accelerations of a free joint are in body axes, those of MuJoCo at the origin in world axes.
    """
    for _ in range(500 if request.config.getoption("--long") else 50):
        chain = two_arms(("0 0 1", "1 0 0", "0 0 1"))
        chain.data.qpos[7:13] += 0.3 * rng.normal(size=6)
        mujoco.mj_integratePos(chain.model, chain.data.qpos, np.append(rng.normal(size=6), np.zeros(12)), 1.0)
        chain.forward()
        chain.latches = ()
        for name in ("l2", "r2"):
            chain.latch(name, "object", chain.data.xpos[chain.model.body(name).id])
        chain.data.qvel[:] = rng.normal(size=chain.model.nv)
        chain.forward()
        ratio = chain.closing().least_ratio
        torques = np.append(np.zeros(6), np.append(rng.normal(size=6), np.zeros(6)))
        chain.data.qfrc_applied[:] = torques
        expected, M = by_pinocchio(chain, torques), mass_matrix(chain.model, chain.data)
        found = np.linalg.solve(M, chain.force() + chain.loops().generalised(chain.force()))
        scale = 1.0 + np.abs(M).max() * np.abs(expected).max()
        # Both solve normal equations of the rows: nearly singular states cost the square of the ratio.
        scale *= max(1.0, (1e-3 / ratio) ** 2)
        np.testing.assert_allclose(M @ found, M @ expected, rtol=0, atol=1e-10 * scale)


def by_pinocchio(chain, torques):
    """Accelerations with both welds, in MuJoCo's coordinates."""
    model, data = chain.model, chain.data
    other, of_body = oracle(model)
    other.gravity.setZero()
    q, v, X = to_pinocchio(model, data.qpos.copy(), data.qvel.copy())
    around = other.createData()
    pin.computeAllTerms(other, around, q, v)
    pin.forwardKinematics(other, around, q, v, np.zeros(model.nv))
    J, drift = [], []
    for latch in chain.latches:
        place, rows, bias = data.xpos[latch.second] + 0.0, [], []
        place = data.xmat[latch.second].reshape(3, 3) @ latch.point_in_second + place
        for body in (latch.first, latch.second):
            joint = of_body[body]
            arm = place - around.oMi[joint].translation
            spatial = pin.getJointJacobian(other, around, joint, pin.LOCAL_WORLD_ALIGNED)
            shift = np.block([[np.eye(3), -pin.skew(arm)], [np.zeros((3, 3)), np.eye(3)]])
            rows.append(shift @ spatial)
            spin = pin.getVelocity(other, around, joint, pin.LOCAL_WORLD_ALIGNED).angular
            a = pin.getClassicalAcceleration(other, around, joint, pin.LOCAL_WORLD_ALIGNED)
            linear = a.linear + np.cross(a.angular, arm) + np.cross(spin, np.cross(spin, arm))
            bias.append(np.concatenate((linear, a.angular)))
        J.append(rows[1] - rows[0])
        drift.append(bias[1] - bias[0])
    rows, M = np.vstack(J), pin.crba(other, around, q)
    saddle = np.block([[M, rows.T], [rows, np.zeros((len(rows), len(rows)))]])
    tau = np.linalg.solve(X.T, torques)
    right = np.concatenate((tau - pin.nonLinearEffects(other, around, q, v), -np.concatenate(drift)))
    a = np.linalg.lstsq(saddle, right, rcond=None)[0][: model.nv]
    for start in (0, 12):  # of the origin, in world axes
        turn = X[start : start + 3, start : start + 3]
        a[start : start + 3] = turn.T @ (a[start : start + 3] + np.cross(v[start + 3 : start + 6], v[start : start + 3]))
    return a
