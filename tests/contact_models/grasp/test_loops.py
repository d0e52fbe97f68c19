"""Several grasps at once: the first one as a child body, further ones as latches that are held by rows in every stage."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from ffsm_mj.contact_models.impact.resolution import Contact, contact_jacobian, contact_rows
from ffsm_mj.dynamics.loops.closed_loops import ClosedLoops
from ffsm_mj.dynamics.rigid_body import mass_matrix, tangents
from tests.contact_models.grasp.two_hands import PLANAR, SPATIAL, TwoHands, hand

AMPLITUDES, PLACES = np.array((2.0, -1.5, 0.6, -2.0, 1.2, 0.5)), np.arange(6)


def torques(time_s):
    return AMPLITUDES * np.sin(3.0 * time_s + PLACES)


def relative(bench, other):
    """Largest difference of the states of two scenes."""
    return np.abs(bench.everything() - other.everything()).max()


@pytest.mark.parametrize(("axes", "rank", "loss_J"), [(PLANAR, 9, 0.990770191464), (SPATIAL, 12, 1.356026672503)])
def test_two_closings_at_one_instant_in_either_order(tmp_path, axes, rank, loss_J):
    """The published loss and rank, P and L kept; then the same motion under torques, to truncation of the fourth order."""
    benches = {}
    for step_s in (4e-3, 2e-3):
        for order in ("lr", "rl"):
            bench = benches[order, step_s] = TwoHands(tmp_path, axes, step_s)
            energy, momentum = bench.energy(), bench.momentum()
            found, loss = bench.close(*order)
            assert found == rank
            assert loss == pytest.approx(loss_J, abs=1e-12)
            assert energy - bench.energy() == pytest.approx(loss, abs=1e-13)
            np.testing.assert_allclose(bench.momentum(), momentum, rtol=0, atol=2e-13)
            bench.run(0.2, torques)
            # Torques are internal: this is truncation, at joint rates up to 8 rad/s.
            np.testing.assert_allclose(bench.momentum(), momentum, rtol=0, atol=1e-6 if step_s > 3e-3 else 1e-7)
    coarse, fine = (relative(benches["lr", h], benches["rl", h]) for h in (4e-3, 2e-3))
    assert coarse < 1e-6
    assert coarse / fine > 10.0 or coarse < 1e-12  # slow motions agree to rounding


def test_without_torques_energy_is_constant_and_loops_stay_closed(tmp_path):
    """2 s: the energy drifts by truncation alone, as P and L do; errors of the rows are projected beyond 1e-11 m."""
    bench = TwoHands(tmp_path, SPATIAL)
    bench.close()
    energy, momentum = bench.energy(), bench.momentum()
    bench.run(2.0)
    assert bench.energy() == pytest.approx(energy, abs=1e-11)
    np.testing.assert_allclose(bench.momentum(), momentum, rtol=0, atol=1e-11)
    assert np.abs(bench.integrator.motion.loops.errors()).max() < 2e-11


@pytest.mark.parametrize("kind", ["ball", "hinge", "slide", "cylindrical"])
def test_a_further_grasp_with_freedom_moves_as_a_first_one(tmp_path, kind):
    """Rigid first and free second, by rows, against free first, by joints, and rigid second: one motion."""
    one, other = (TwoHands(tmp_path, SPATIAL, joints=("rigid", kind)) for _ in range(2))
    ranks = one.close("l", "r"), other.close("r", "l")
    assert ranks[0][0] == ranks[1][0]
    assert ranks[0][1] == pytest.approx(ranks[1][1], abs=1e-12)
    for each in (one, other):
        each.run(0.1, torques)
    assert relative(one, other) < 1e-9


BALL = '<geom name="ball" type="sphere" size=".05" mass="0"/>'
PLATE = '<geom name="plate" type="box" size=".02 .5 .5" pos="{} {} {}" mass="0"/>'
CHAINS = {"tree": (SPATIAL, "other"), "loop": (PLANAR, "target")}


def pressing(time_s):
    return np.array((-1.5, 0.0, 0.1, -2.0, 0.6 + 0.3 * np.sin(5.0 * time_s), 0.05))


def pressed(folder, chain, mu, restitution, order="lr", step_s=2e-3):
    """Arms press a ball that they hold against a plate of the base, 2 mm away at the start."""
    axes, name = CHAINS[chain]
    place = hand(axes, "r") if name == "other" else 0.5 * (hand(axes, "r") + hand(axes, "l"))
    place = place + np.array((0.072, 0.15, 0.0))
    pairs = [("pair", "robot/plate", f"{name}/ball", restitution, mu)]
    bench = TwoHands(folder, axes, step_s, objects=("target", name), geoms=(PLATE.format(*place), BALL), pairs=pairs)
    bench.data.qvel[:] = 0.0
    mujoco.mj_forward(bench.system.mj, bench.data)
    bench.close(*order)
    return bench


@pytest.mark.long
@pytest.mark.parametrize(
    ("chain", "mu", "restitution"), [("tree", 0.0, 0.5), ("tree", 0.05, 0.0), ("loop", 0.05, 0.5), ("loop", 0.6, 0.0)]
)
def test_the_order_of_two_grasps_does_not_matter_in_contact(tmp_path, chain, mu, restitution):
    """Impacts, their accumulation, and contact that lasts: one motion, to truncation; P and L are kept.

    In the tree, what one scene holds by rows the other one has as a child body.
    """
    one, other = (pressed(tmp_path, chain, mu, restitution, order) for order in ("lr", "rl"))
    momentum = one.momentum()
    for bench in (one, other):
        bench.run(0.1, pressing)
        assert bench.persistent.active
    np.testing.assert_allclose(one.everything(), other.everything(), rtol=0, atol=2e-9)
    np.testing.assert_allclose(one.momentum(), momentum, rtol=0, atol=2e-9)
    kinds = [[type(record).__name__ for record in bench.records] for bench in (one, other)]
    assert kinds[0] == kinds[1]
    assert len([kind for kind in kinds[0] if kind == "ImpactRecord"]) >= (1 if restitution == 0.0 else 4)


def all_rows(bench):
    """Rows of both grasps in the logged system, and their rates."""
    latches = [bench.latch(side) for side in "lr"]
    return ClosedLoops(bench.system.mj, bench.data, latches).rows()


@pytest.mark.parametrize("mu", [0.0, 0.05, 0.6])
def test_impulses_on_a_closed_loop(tmp_path, mu):
    """M times the change of velocity is what impulses of the record and of the 12 rows explain; the rows stay at rest."""
    bench = pressed(tmp_path, "loop", mu, 0.5)
    bench.run(0.1, pressing)
    for record in [each for each in bench.records if hasattr(each, "impulse_N_s")][:3]:
        model, data = bench.system.mj, mujoco.MjData(bench.system.mj)
        before, after = (
            np.concatenate([v[j] for j in bench.system.joints]) for v in (record.qvel_before, record.qvel_after)
        )
        data.qpos[:], data.qvel[:] = record.qpos, after
        mujoco.mj_forward(model, data)
        B = ClosedLoops(model, data, [bench.loops.motion.loops.sources[0]]).rows().J
        first = bench.latch("l")
        B = np.vstack((B, ClosedLoops(model, data, [first]).rows().J))
        pair = bench.pairs[0]
        contact = Contact(pair.body_a, pair.body_b, np.array(record.point_m), np.array(record.normal), 0.5, mu)
        along = record.impulse_N_s * np.array(record.normal) + np.array(record.tangential_impulse_N_s)
        rows = contact_rows(model, data, contact, np.eye(3)[:2])
        J = np.vstack((rows[1:], contact_rows(model, data, contact, np.eye(3)[1:])[2:]))
        left = mass_matrix(model, data) @ (after - before) - along @ J
        explained = B.T @ np.linalg.lstsq(B.T, left, rcond=1e-12)[0]
        np.testing.assert_allclose(left, explained, rtol=0, atol=1e-12)
        assert np.abs(B @ after).max() < 1e-9  # drift of the rates until the next projection
        assert record.separation_speed_m_s == pytest.approx(record.restitution_used * record.approach_speed_m_s, abs=1e-9)
        assert float(contact_jacobian(model, data, contact) @ after) == pytest.approx(record.separation_speed_m_s, abs=1e-11)
        assert np.linalg.norm(record.tangential_impulse_N_s) <= mu * record.impulse_N_s * (1.0 + 1e-9)


@pytest.mark.parametrize("mu", [0.0, 0.05])
def test_forces_of_contact_on_a_closed_loop(tmp_path, mu):
    """In the logged system, M qddot + c = efforts + B^T lambda + J^T (n - mu s) N, and B qddot = -gamma."""
    bench = pressed(tmp_path, "loop", mu, 0.0)
    bench.run(0.1, pressing)
    bench.integrator.motion.refresh_forces()
    bench.integrator.motion.path.on_event_located()
    (contact,) = bench.persistent.active_contacts()
    model, data = bench.system.mj, bench.data
    pair, normal = bench.pairs[0], contact.normal
    at = Contact(pair.body_a, pair.body_b, contact.point_m, normal, 0.0, mu)
    J = contact_rows(model, data, at, tangents(normal))
    axes = np.vstack((normal, tangents(normal)))
    given = (axes @ contact.force_N) @ J
    rows = all_rows(bench)
    needed = mass_matrix(model, data) @ data.qacc + data.qfrc_bias - data.qfrc_actuator - given
    explained = rows.J.T @ np.linalg.lstsq(rows.J.T, needed, rcond=1e-12)[0]
    np.testing.assert_allclose(needed, explained, rtol=0, atol=1e-9)
    np.testing.assert_allclose(rows.J @ data.qacc, -rows.gamma, rtol=0, atol=1e-9)
    size = float(contact.force_N @ normal)
    assert size > 0.1
    slip = J[1:] @ data.qvel
    np.testing.assert_allclose(axes[1:] @ contact.force_N, -mu * size * slip / np.linalg.norm(slip), rtol=0, atol=1e-9)
    assert abs(J[0] @ data.qvel) < 1e-9


def test_pairs_on_rigidly_latched_bodies_are_not_in_contact(tmp_path):
    """While both hands hold the object, all three are one rigid body; by a hinge, they are not."""
    for kind, names in (
        ("rigid", ("robot/palm_l", "robot/palm_r", "target/ball")),
        ("hinge", ("robot/palm_l", "target/ball")),
    ):
        bench = TwoHands(tmp_path, SPATIAL, joints=("rigid", kind), geoms=("", BALL))
        bench.close()
        ids = [bench.system.index("geom", name) for name in names]
        motion = bench.integrator.motion
        assert motion.disabled == {frozenset((a, b)) for a in ids for b in ids if a < b}
        bench.loops.open("r")
        bench.integrator.bind(motion)
        assert motion.disabled == {frozenset((ids[0], ids[-1]))}
