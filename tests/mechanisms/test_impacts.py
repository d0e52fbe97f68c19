"""Impacts on mechanisms: their rows respond as the couplings and loops do; limits, contacts that last, grips."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.contact_models.impact.resolution import Contact, contact_jacobian
from ffsm_mj.dynamics.loops.closed_loops import ClosedLoops
from ffsm_mj.dynamics.loops.equalities import equalities_of
from ffsm_mj.dynamics.rigid_body import mass_matrix
from ffsm_mj.errors import InputError
from tests.mechanisms.models import four_bar, geared, mechanism, rock
from tests.mechanisms.test_motions import last
from tests.replays import proved
from tests.scenes import scene


def hit_wheel(folder, e, *, boost=0.0, **scenario):
    """M1: a ball of .4 kg at (0, -1) hits wheel A .15 m from its axis."""
    # The point of contact is at -y of the centre of both spheres, at .15 of the axis along x: put the geom there.
    geom = '<geom name="arm" type="sphere" size=".01" pos=".15 .01 0" mass="0"/>'
    ball = {"rock/free": [0.45, 0.12, 0, 1, 0, 0, 0]}
    rates = {"rock/free": [0, -1 + boost, 0, 0, 0, 0], "robot/base": [0, boost, 0, 0, 0, 0]}
    return mechanism(
        folder,
        geared(geom=geom),
        ball,
        rates,
        objects={"rock": rock(0.4, 0.05)},
        contacts={"rules": [{"between": ["arm", "rock/rock"], "restitution": e}]},
        **{"duration_s": 0.1, "control_period_s": 0.01} | scenario,
    )


@pytest.mark.parametrize(("e", "boost"), [(1.0, 0.0), (1.0, 3.0), (0.5, 0.0)])
def test_a_ball_hits_a_geared_wheel(tmp_path, e, boost):
    """M1: both wheels and the base respond at once, as the elimination says; all changes are those of e = 1, shared."""
    run = ffsm_mj.run(hit_wheel(tmp_path, e, boost=boost))
    proved(run)
    (record,) = run.records["impacts"]
    share = (1.0 + e) / 2.0
    assert record.impulse_N_s == pytest.approx(0.618700163172 * share, abs=1e-11)
    after = record.qvel_after
    base, ball = after["robot/base"], after["rock/free"]
    np.testing.assert_allclose(
        [after["robot/A"][0], after["robot/B"][0], base[0], base[1] - boost, base[5], ball[1] + 1.0 - boost],
        share * np.array([-1.608940611434, 4.826821834303, 0.0, -0.059788799606, -0.338043779440, 1.546750407931]),
        rtol=0,
        atol=1e-11,
    )
    assert e < 1.0 or record.energy_change_J == pytest.approx(0.0, abs=1e-12)


ANGLE = 1.555752341392
"""Of the rocker in M4, whose crank is at pi/3."""
NORMAL = np.array([-math.sin(ANGLE), math.cos(ANGLE), 0.0])
SPOT = np.array([0.4, 0.1, 0.0]) + 0.125 * np.array([math.cos(ANGLE), math.sin(ANGLE), 0.0])
LINKAGE = four_bar('<geom name="spot" type="sphere" size=".01" pos=".125 -.01 0" mass="0"/>')


def hit_rocker(folder, e, *, crank=0.0, turn=None, boost=0.0, mu=0.0, **scenario):
    """M4: a ball of .3 kg hits the rocker of a four-bar linkage at its middle, along its normal, at 1 m/s."""
    turn = Rotation.identity() if turn is None else turn
    quaternion = np.roll(turn.as_quat(), 1).tolist()
    velocity = turn.apply([boost, 0.3 * boost, -0.1 * boost])
    return mechanism(
        folder,
        LINKAGE,
        {
            "crank": math.pi / 3,
            "robot/base": [0, 0, 0, *quaternion],
            "rock/free": [*turn.apply(SPOT - 0.12 * NORMAL), 1, 0, 0, 0],
        },
        {"crank": crank, "robot/base": [*velocity, 0, 0, 0], "rock/free": [*(turn.apply(NORMAL) + velocity), 0, 0, 0]},
        objects={"rock": rock(0.3, 0.05)},
        contacts={"rules": [{"between": ["spot", "rock/rock"], "restitution": e, "mu": mu}]},
        **{"duration_s": 0.1, "control_period_s": 0.01} | scenario,
    )


def test_a_ball_hits_the_rocker_of_a_four_bar_linkage(tmp_path):
    """M4: e .6 at half of the rocker along its normal; the pin and the crank respond."""
    run = ffsm_mj.run(hit_rocker(tmp_path, 0.6))
    proved(run)
    (record,) = run.records["impacts"]
    assert record.impulse_N_s == pytest.approx(0.450747917954, abs=1e-10)
    base = record.qvel_after["robot/base"]
    np.testing.assert_allclose(
        [base[0], base[1], base[5], record.qvel_after["robot/crank"][0]],
        [-0.045420760787, -0.009134763333, 0.084697764666, 0.633674870869],
        rtol=0,
        atol=1e-10,
    )
    # The impulse of the pin is what stops its rows after the same impulse of the ball on the free tree.
    assembly = prepare(hit_rocker(tmp_path, 0.6)).assemble()
    model, data = assembly.system.mj, assembly.data
    bodies = [model.body(name).id for name in ("robot/rocker", "rock/rock")]
    row = contact_jacobian(model, data, Contact(*bodies, SPOT, -NORMAL, 0.6, 0.0))
    data.qvel[:] += np.linalg.solve(mass_matrix(model, data), row) * record.impulse_N_s
    loops = ClosedLoops(model, data, [each.source for each in equalities_of(model)])
    _, pin, torque = loops.wrench(0, loops.plastic().impulses)
    np.testing.assert_allclose(np.abs(pin), [0.191154723843, 0.036378008942, 0.0], rtol=0, atol=1e-10)
    assert np.abs(torque).max() == 0.0


def test_a_linkage_of_an_object_is_hit(tmp_path):
    """M4 with the parts exchanged: the ball is the robot."""
    linkage = LINKAGE.partition("<actuator>")[0] + "</mujoco>"
    path = scene(
        tmp_path,
        rock(0.3, 0.05),
        {"linkage": linkage},
        duration_s=0.1,
        control_period_s=0.01,
        initial={
            "joints": {"crank": math.pi / 3, "robot/free": [*(SPOT - 0.12 * NORMAL), 1, 0, 0, 0]},
            "rates": {"robot/free": [*NORMAL, 0, 0, 0]},
        },
        contacts={"rules": [{"between": ["spot", "rock"], "restitution": 0.6}]},
    )
    run = ffsm_mj.run(path)
    proved(run)
    assert run.records["impacts"][0].impulse_N_s == pytest.approx(0.450747917954, abs=1e-10)


@pytest.mark.parametrize("e", [0.0, 1.0])
def test_an_impact_of_a_linkage_does_not_depend_on_frame_or_step(tmp_path, e):
    """With friction: turned and moving at 2 m/s, at half of the step and at ten times of it."""
    changes = (
        {},
        {"turn": Rotation.from_rotvec([0.3, -0.7, 1.1]), "boost": 2.0},
        {"time_step_s": 5e-4},
        {"time_step_s": 1e-2},
    )
    found = []
    for change in changes:
        run = ffsm_mj.run(hit_rocker(tmp_path, e, crank=1.0, mu=0.2, duration_s=0.5, **change))
        (record,) = run.records["impacts"]
        found.append((record.impulse_N_s, record.time_s, *last(run, "q_robot_crank_rad", "v_robot_crank_rad_s")))
        proved(run)
    for each, tolerance in zip(found[1:], (1e-12, 1e-12, 2e-9), strict=True):  # h^4 of 1 ms is 1e-13 here, of 10 ms 1e-9
        np.testing.assert_allclose(each, found[0], rtol=0, atol=tolerance)


def test_a_coupled_joint_reaches_its_limit(tmp_path):
    """M11: the limit of B takes the momentum of both wheels; e .4."""
    path = mechanism(
        tmp_path,
        geared('range="-3 .6"'),
        {},
        {"A": -0.5},
        joint_limits={"B": {"restitution": 0.4}},
        duration_s=1.0,
        control_period_s=0.01,
    )
    run = ffsm_mj.run(path)
    proved(run)
    (record,) = run.records["limit_impacts"]
    assert record.time_s == pytest.approx(0.4, abs=1e-12)
    assert record.impulse == pytest.approx(0.013046930069, abs=1e-12)
    after = record.qvel_after
    np.testing.assert_allclose(
        [after["robot/A"][0], after["robot/B"][0], *np.array(after["robot/base"])[[1, 5]]],
        [0.2, -0.6, 0.000116861436, -0.007401224263],
        rtol=0,
        atol=2e-12,
    )


@pytest.mark.parametrize(
    ("a", "b", "law", "kept"),
    [
        ("-1 1", "-3 3", "0 -3 0 0 0", {"A lower", "A upper"}),  # a tie goes to the joint that leads
        ("-1 1", "-2 4", "0 -3 0 0 0", {"A lower", "B lower"}),
        ("-1 1", "", "0 -3 0 0 0", {"A lower", "A upper"}),
        ("", "-2 4", "0 2 0 0 0", {"B lower", "B upper"}),
        ("-1 1", "-2 .5", "0 .5 0 .1 0", {"A lower", "B upper"}),
        ("-1 1", "-1 2", "0 .5 1 0 0", {"A lower", "A upper", "B lower", "B upper"}),  # not monotone
        ("-1 1", "-1 1", ".5 0 0 0 0", {"A lower", "A upper", "B lower", "B upper"}),  # does not follow
    ],
)
def test_of_two_limits_that_are_one_stop_the_tighter_one_is_kept(tmp_path, a, b, law, kept):
    text = geared(f'range="{b}"' if b else "").replace('"0 -3 0 0 0"', f'"{law}"')
    text = text.replace('name="A" axis="0 0 1" ', f'name="A" axis="0 0 1" {f"range={chr(34)}{a}{chr(34)}" if a else ""} ')
    limits = prepare(mechanism(tmp_path, text, {}, {})).assemble().limits
    assert {f"{each.joint.removeprefix('robot/')} {each.side}" for each in limits} == kept


def test_a_chain_of_couplings_has_one_limit(tmp_path):
    """C follows B, and B follows A: ends of the same stop."""
    text = geared('range="-3 3"').replace("</body></body></worldbody>", "</body>{}</body></worldbody>")
    wheel = (
        '<body name="C" pos="0 .3 0"><joint name="C" axis="0 0 1" range="-6 2"/>'
        '<inertial pos="0 0 0" mass=".2" diaginertia=".01 .01 .01"/></body>'
    )
    text = text.format(wheel).replace("<equality>", '<equality><joint joint1="C" joint2="B" polycoef="0 2 0 0 0"/>')
    limits = prepare(mechanism(tmp_path, text, {}, {})).assemble().limits
    # C at 2 is B at 1 and A at -1/3; C at -6 is B at -3, a tie.
    assert {(each.joint, each.side) for each in limits} == {("robot/C", "upper"), ("robot/B", "lower")}


def test_a_restitution_of_a_limit_that_is_never_reached_is_refused(tmp_path):
    text = geared('range="-9 9"').replace('name="A" axis="0 0 1"', 'name="A" axis="0 0 1" range="-1 1"')
    with pytest.raises(InputError, match=r"joint_limits\.B: the joint is coupled with others that reach their limits first"):
        prepare(mechanism(tmp_path, text, {}, {}, joint_limits={"B": {"restitution": 0.4}})).assemble()


def test_maps_and_derivatives_of_mechanisms_are_refused(tmp_path):
    """They would be those of the tree; secants are of whole runs."""
    path = hit_wheel(tmp_path, 0.5)
    with pytest.raises(InputError, match=r"robot\.xml:1: equality joint of 'B' and 'A' constrains the joints"):
        ffsm_mj.impact_map(path)
    run = ffsm_mj.run(path)
    rate = {"initial.rates.rock/free.1": 1e-4}
    with pytest.raises(InputError, match="use kind='secant'"):
        ffsm_mj.sensitivity(run, ["impacts.0.impulse_N_s"], rate, kind="exact")
    # The impulse is proportional to the speed of the ball.
    found = ffsm_mj.sensitivity(run, ["impacts.0.impulse_N_s"], rate)
    assert abs(found.derivative[0, 0]) == pytest.approx(0.464025122379, rel=1e-6)


def test_a_limit_inside_a_closed_loop(tmp_path):
    """An ordinary unilateral row: the rocker of a four-bar linkage bounces off its stop, and the crank turns back."""
    text = four_bar().replace('name="rocker" axis="0 0 1"', 'name="rocker" axis="0 0 1" range="1.2 2.2"')
    rates = {"crank": 4.0, "robot/base": [0.01, 0, 0, 0, 0, 0.1]}
    for e in (0.0, 0.5, 1.0):
        path = mechanism(
            tmp_path,
            text,
            {"crank": math.pi / 3},
            rates,
            joint_limits={"rocker": {"restitution": e}},
            duration_s=0.6,
            control_period_s=0.01,
        )
        run = ffsm_mj.run(path)
        proved(run)
        first = run.records["limit_impacts"][0]
        assert first.separation_rate == pytest.approx(e * first.approach_rate, abs=1e-11)
        assert abs(first.energy_change_J) < 1e-11 or e < 1.0  # of 3 J
