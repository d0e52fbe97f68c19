"""What logs, records and control laws show of friction in persistent contact."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import ClassVar

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run import Run
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.errors import InputError
from ffsm_mj.replay import replay_log
from ffsm_mj.report.record_tables import contact_table
from tests.changed_logs import with_records
from tests.replays import proved
from tests.scenes import scene

FLOOR = '<mujoco>{gravity}<worldbody><geom name="plane" type="box" size="20 20 1"/></worldbody></mujoco>'
BODY = """<mujoco>{gravity}<worldbody><body name="body"><inertial pos="0 0 0" mass="1" diaginertia=".4 .4 .4"/>
  <freejoint name="free"/><geom name="body" {geom} mass="0"/></body></worldbody></mujoco>"""
BALL = 'type="sphere" size="1"'
U0 = math.hypot(0.13, 0.05)
T_STOP = 2.0 * U0 / (7.0 * 0.2)
"""A sphere with slip u0 at the contact point rolls after 2 u0 / (7 mu g): its slip falls with 7/2 mu g."""


def on_floor(folder, *, geom=BALL, height=1.0, gravity=(0.0, 0.0, -1.0), rates=(0.0,) * 6, mu=0.2, **more):
    """A body of 1 kg on a fixed floor."""
    option = f'<option gravity="{" ".join(map(str, gravity))}"/>'
    fixed = {"floor": {"position_m": [0.0, 0.0, -1.0]}}
    more = {"duration_s": 0.24, "time_step_s": 2e-3, "control_period_s": 4e-3} | more
    return scene(
        folder,
        BODY.format(gravity=option, geom=geom),
        {"floor": FLOOR.format(gravity=option)},
        fixed=fixed,
        conservative=False,
        initial={"joints": {"free": [0.0, 0.0, height, 1.0, 0.0, 0.0, 0.0]}, "rates": {"free": list(rates)}},
        contacts={"rules": [{"name": "sole", "between": ["robot", "floor"], "restitution": 0.0, "mu": mu}]},
        **more,
    )


SLIPS = (0.07, -0.04, 0.0, 0.09, -0.06, 2.0)


class Watch:
    """Drives nothing; keeps what it is shown."""

    telemetry_signals: ClassVar = ()
    told: ClassVar[list] = []

    def __init__(self, config, context):
        Watch.told = []

    def start(self, observation): ...

    def control(self, observation, command):
        self.told += [(observation.time_s, one) for one in observation.contacts]

    def telemetry(self):
        return ()


@pytest.fixture(scope="module")
def watched(tmp_path_factory):
    """A sphere that slips, pressed with 1 N at mu = 0.2, and then rolls; and what a control law sees of it."""
    phases = [{"name": "watch", "until": "end", "controller": {"kind": "watch"}}]
    path = on_floor(tmp_path_factory.mktemp("rolled"), rates=SLIPS, phases=phases)
    return proved(ffsm_mj.run(path, controllers={"watch": Watch})), list(Watch.told)


@pytest.fixture(scope="module")
def rolled(watched):
    return watched[0]


def test_columns_of_a_sphere_that_slips_and_then_rolls(rolled):
    run = rolled
    slips = run.time < T_STOP
    np.testing.assert_array_equal(run["contact.sole_mode"], np.where(slips, 4.0, 3.0))
    # The stages err by about 1e-10 of the slip near the stop.
    slip = np.where(slips, U0 - 0.7 * run.time, 0.0)
    np.testing.assert_allclose(run["contact.sole_slip_m_s"], slip, atol=1e-9)
    way = np.where(slips, U0 * run.time - 0.35 * run.time**2, 0.5 * U0 * T_STOP)
    np.testing.assert_allclose(run["contact.sole_slip_m"], way, atol=1e-10)
    np.testing.assert_allclose(run["contact.sole_friction_N"], 0.2 * slips, atol=1e-12)
    np.testing.assert_allclose(run["contact.sole_friction_use"], 1.0 * slips, atol=1e-12)
    # The floor is the second side: friction pushes it along the slip of the sphere.
    first = [run[f"contact.sole_friction_{axis}_N"][0] for axis in "xyz"]
    np.testing.assert_allclose(first, [0.2 * 0.13 / U0, 0.2 * 0.05 / U0, 0.0], atol=1e-12)


def test_the_record_of_the_stop(rolled):
    (sticks,) = rolled.records["contact_sticks"]
    assert sticks.time_s == pytest.approx(T_STOP, abs=1e-8)
    assert sticks.slip_m == pytest.approx(0.5 * U0 * T_STOP, abs=1e-9)  # of the time of the stop, 1e-9 s early
    assert (sticks.friction, sticks.slip_speed_m_s) == ("sticking", 0.0)
    (begins,) = rolled.records["contact_beginnings"]
    assert begins.friction == "sliding"


def test_the_interval_of_contact_has_its_slip(rolled):
    (contact,) = rolled.contacts
    assert contact.sliding_s == pytest.approx(T_STOP, abs=1e-8)
    assert contact.slip_m == pytest.approx(0.5 * U0 * T_STOP, abs=1e-9)
    assert contact.peak_friction_use == 1.0
    slip = f"{contact.slip_m:.6g}"
    assert slip in contact_table((contact,))
    assert f"{2 * contact.slip_m:.6g}" in contact_table((contact, contact), most=1)


def test_control_laws_see_mode_friction_and_slip(watched):
    _, told = watched
    sliding = [(time, one) for time, one in told if one.mode == "sliding"]
    assert len(sliding) == np.count_nonzero(np.arange(0.0, 0.24, 4e-3) < T_STOP)
    for time, one in sliding:
        # The floor moves backwards under the sphere, and is pushed forwards.
        along = np.array([0.13, 0.05, 0.0]) / U0
        # Across the slip, rates err by up to 3e-8 m/s in steps of 2 ms, most shortly before the stop.
        np.testing.assert_allclose(one.slip_m_s, -along * (U0 - 0.7 * time), atol=1e-7)
        np.testing.assert_allclose(one.friction_N, 0.2 * along, atol=1e-4)
        assert one.friction_use == 1.0
    assert {one.mode for time, one in told if time > T_STOP} == {"sticking"}
    assert not any(np.any(one.slip_m_s) for time, one in told if time > T_STOP)


def test_the_share_of_the_limit_that_is_used_is_the_share_of_mu_that_holds(tmp_path):
    """A box on a floor under a load of 0.2 along it, 1 across: 0.2 of friction per normal force at the least."""
    box = {"geom": 'type="box" size=".5 .4 .1"', "height": 0.1, "gravity": (-0.2, 0.0, -1.0), "duration_s": 0.02}
    run = proved(ffsm_mj.run(on_floor(tmp_path, mu=0.5, **box)))
    use = run["contact.sole_friction_use"]
    assert np.ptp(use) < 1e-9
    assert 0.2 <= 0.5 * use[0] < 0.3
    held = ffsm_mj.run(on_floor(tmp_path, mu=0.5 * use[0], **box))
    assert set(held["contact.sole_mode"]) == {3.0}
    slid = ffsm_mj.run(on_floor(tmp_path, mu=0.199, **box))
    assert set(slid["contact.sole_mode"]) == {4.0}


def in_a_v(folder, mu, angle_rad, load):
    """A ball of 1 kg in a V whose faces stand at this angle to its axis, z, under a load in N."""
    walls = ""
    for name, side in (("left", 1.0), ("right", -1.0)):
        normal = np.array([side * math.cos(angle_rad), 0.0, math.sin(angle_rad)])
        x, _, z = -1.5 * normal
        tilt = math.atan2(normal[0], normal[2])
        walls += f'<geom name="{name}" type="box" size="3 3 .5" pos="{x} 0 {z}" euler="0 {tilt} 0"/>'
    option = f'<compiler angle="radian"/><option gravity="{load[0]} 0 {load[1]}"/>'
    return scene(
        folder,
        BODY.format(gravity=option, geom=BALL),
        {"groove": f"<mujoco>{option}<worldbody>{walls}</worldbody></mujoco>"},
        fixed={"groove": {"position_m": [0.0, 0.0, 0.0]}},
        conservative=False,
        duration_s=0.004,
        time_step_s=1e-3,
        control_period_s=1e-3,
        contacts={"rules": [{"name": "groove", "between": ["robot", "groove"], "restitution": 0.0, "mu": mu}]},
    )


@pytest.mark.parametrize(("mu", "wedged"), [(0.5, False), (0.57, False), (0.585, True), (0.8, True)])
def test_a_ball_in_a_v_wedges_if_the_cones_contain_the_line_between_its_contacts(tmp_path, mu, wedged):
    """The tangent of 30 degrees is 0.577."""
    run = ffsm_mj.run(in_a_v(tmp_path, mu, math.radians(30.0), (0.0, -1.0)))
    assert [record.friction for record in run.records["contact_beginnings"]] == [
        "sticking, wedged" if wedged else "sticking"
    ]


def test_shares_of_equal_springs_that_leave_the_cones_are_replaced(tmp_path):
    """Pressed along the axis of the V, the ball needs no friction, though equal springs at its contacts would load it."""
    run = ffsm_mj.run(in_a_v(tmp_path, 0.5, math.radians(30.0), (0.0, -1.0)))
    assert np.abs(run["contact.groove_friction_use"]).max() < 1e-9


def test_a_phase_ends_where_a_contact_sticks(tmp_path):
    law = {"controller": {"kind": "off"}}
    phases = [{"name": "slide", "until": "contact_sticks", **law}, {"name": "roll", "until": "end", **law}]
    run = ffsm_mj.run(on_floor(tmp_path, rates=SLIPS, phases=phases))
    assert run.phases[1].reason == "contact_sticks"
    assert 0.0 <= run.phases[1].start_s - T_STOP <= 4e-3  # at the next tick


def test_a_phase_cannot_wait_for_slip_where_nothing_has_friction(tmp_path):
    phases = [{"name": "hold", "until": "contact_slips", "controller": {"kind": "off"}}]
    with pytest.raises(InputError, match=r"phases.0.until: nothing slips or sticks: no contact rule has friction"):
        ffsm_mj.run(on_floor(tmp_path, mu=0.0, phases=phases))


@pytest.mark.parametrize(
    ("key", "says"),
    [
        ("mu_static", "mu is the coefficient of friction of points that stick and of points that slide"),
        ("torsional_friction", "has no torsional friction; a face resists torsion by its points"),
        ("rolling_friction", "has no rolling friction; the coefficient of friction is mu"),
        ("friction", "the coefficient of friction is mu"),
    ],
)
def test_other_coefficients_of_friction_are_refused_by_name(tmp_path, key, says):
    rule = {"between": ["robot", "floor"], "restitution": 0.0, key: 0.3}
    path = on_floor(tmp_path)
    with pytest.raises(InputError, match=rf"contacts.rules.0.{key}: unknown key: .*{says}.*; allowed: between, elastic, mu"):
        ffsm_mj.run(path, {"contacts.rules": [rule]})


def test_the_slip_of_a_face_is_that_of_its_fastest_point(tmp_path):
    """A box turns about a vertical axis through its middle and moves along x: the corner at -y is the fastest."""
    box = {"geom": 'type="box" size=".5 .4 .1"', "height": 0.1, "duration_s": 0.02}
    run = proved(ffsm_mj.run(on_floor(tmp_path, mu=0.1, rates=(0.3, 0.0, 0.0, 0.0, 0.0, 2.0), **box)))
    speed = np.hypot(0.3 + 2.0 * 0.4, 2.0 * 0.5)
    assert run["contact.sole_slip_m_s"][0] == pytest.approx(speed, abs=1e-12)
    # It slows down by some 0.1 m/s^2, and turns by 0.04 rad: the slip distance is between those of both ends.
    way = run["contact.sole_slip_m"]
    assert run["contact.sole_slip_m_s"].min() * 0.02 < way[-1] < run["contact.sole_slip_m_s"].max() * 0.02
    assert np.all(np.diff(way) > 0.0)


def test_the_three_coefficients_of_a_geom_of_mujoco_are_refused(tmp_path):
    rule = {"between": ["robot", "floor"], "restitution": 0.0, "mu": [0.5, 0.005, 0.0001]}
    with pytest.raises(InputError, match=r"contacts.rules.0.mu: should be one number: contact points have no torsional"):
        ffsm_mj.run(on_floor(tmp_path), {"contacts.rules": [rule]})


HEAT, TOTAL, WORK = "contact.sole_heat_J", "balance.friction_heat_J", "balance.contact_work_J"


def failures(checks):
    """Names and components of those that fail."""
    return {(check.name, check.component) for check in checks if not check.passes}


def test_heat_is_friction_times_way_until_the_slip_stops(rolled):
    time = np.minimum(rolled.time, T_STOP)
    np.testing.assert_allclose(rolled[HEAT], 0.2 * (U0 * time - 0.35 * time**2), atol=2e-11)
    assert np.diff(rolled[HEAT]).min() >= 0.0
    np.testing.assert_allclose(rolled[TOTAL], rolled[HEAT], atol=1e-17)  # sums in another order
    energy = rolled["energy.total_J"]
    # In one step energy errs by rounding; there is no other force that does work.
    np.testing.assert_allclose(energy[0] - energy, rolled[HEAT], atol=1e-14)
    np.testing.assert_allclose(rolled[WORK], -rolled[HEAT], atol=1e-14)


def test_heat_of_impacts_and_of_sliding_add_up(tmp_path):
    """A sphere that falls at 0.5 m/s with e = 0: a plastic impact, which rubs, and then sliding."""
    run = proved(ffsm_mj.run(on_floor(tmp_path, rates=(0.9, 0.0, -0.5, 0.0, 0.0, 0.0), duration_s=0.048)))
    (hit,) = run.impacts
    assert hit.friction_work_J < 0.0
    assert run[HEAT][-1] > 0.001
    np.testing.assert_allclose(run[TOTAL], run[HEAT] - hit.friction_work_J * (run.time > 0.0), atol=1e-14)


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize("factor", [1.0 + 1e-5, -1.0])
def test_heat_that_is_not_the_energy_lost_fails_the_check(rolled, factor):
    log = rolled.log
    rows = np.array(log.rows)
    rows[:, log.header.layout.index[HEAT]] *= factor
    falsified = replace(log, rows=rows)
    assert "heat of sliding" in {name for name, _ in failures(Run(falsified).checks())}
    again = replay_log(falsified)
    assert not again.agrees
    assert {name for name, _ in failures(again.checks())} == {
        "heat of friction"
    }  # the states are right, this looks at the log


def test_heat_that_falls_fails_the_check(rolled):
    log = rolled.log
    rows = np.array(log.rows)
    heat, work = (log.header.layout.index[key] for key in (HEAT, WORK))
    rows[30:, heat] -= 1e-4
    rows[30:, work] += 1e-4
    assert failures(Run(replace(log, rows=rows)).checks()) >= {("heat of sliding", "fall")}


def test_sticking_gives_no_heat(tmp_path):
    """A box on a slope of 1 in 5, mu = 0.5."""
    slope = {"geom": 'type="box" size=".5 .4 .1"', "height": 0.1, "gravity": (-0.2, 0.0, -1.0), "duration_s": 0.048}
    run = proved(ffsm_mj.run(on_floor(tmp_path, mu=0.5, **slope)))
    assert not run[HEAT].any()


def test_without_friction_there_is_no_heat_and_no_check(tmp_path):
    run = ffsm_mj.run(on_floor(tmp_path, mu=0.0, rates=SLIPS, duration_s=0.02))
    assert not [key for key in run.keys if "heat" in key or key == WORK]
    assert "heat of sliding" not in {check.name for check in all_checks(run)}


ROW = 30
"""A row while the sphere slips."""
SHORT = {"duration_s": 0.208, "time_step_s": 4e-3}
"""It stops at 0.199 s; nearly every test below takes the whole log again."""


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    return proved(ffsm_mj.run(on_floor(tmp_path_factory.mktemp("short"), rates=SLIPS, **SHORT))).log


def falsified(log, column, error, row=ROW):
    rows = np.array(log.rows)
    rows[row, log.header.layout.index[column]] += error
    return replace(log, rows=rows)


@pytest.mark.long
@pytest.mark.parametrize(
    ("column", "error"),
    [
        ("contact.sole_force_x_N", 1e-6),
        ("contact.sole_force_z_N", 1e-6),
        ("state.v_robot_free_vx_m_s", 1e-6),
        ("state.v_robot_free_wx_rad_s", 1e-6),
    ],
)
def test_forces_and_states_that_do_not_belong_together(short, column, error):
    """Efforts and states determine the forces: friction is opposite to the slip, to 1e-6 of its direction."""
    again = replay_log(falsified(short, column, error))
    assert not again.agrees
    assert "contact complementarity" in {check.name for check in again.checks() if not check.passes}


@pytest.mark.long
@pytest.mark.parametrize(
    ("column", "error"),
    [
        ("contact.sole_mode", -1.0),
        ("contact.sole_friction_x_N", 1e-6),
        ("contact.sole_friction_use", -1e-3),
        ("contact.sole_slip_m_s", 1e-6),
        ("contact.sole_slip_m", 1e-6),
        ("contact.sole_heat_J", 1e-6),
        ("balance.friction_heat_J", 1e-6),
    ],
)
def test_columns_that_do_not_follow_from_the_states(short, column, error):
    assert not replay_log(falsified(short, column, error)).agrees


@pytest.mark.long
@pytest.mark.parametrize(
    "change",
    [{"slip_m": 0.01}, {"friction": "sliding"}, {"time_s": T_STOP - 1e-4}, {"force_after_N": 1.1}],
    ids=lambda change: next(iter(change)),
)
def test_records_that_do_not_follow_from_the_states(short, change):
    (sticks,) = short.records["contact_sticks"]
    records = {**short.records, "contact_sticks": (replace(sticks, **change),)}
    assert not replay_log(with_records(short, records)).agrees


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize("kind", ["contact_beginnings", "contact_sticks"])
def test_records_that_are_missing(short, kind):
    """The pair begins at the state of a row, and stops within a step."""
    again = replay_log(with_records(short, {kind: ()}))
    assert "missing" in again.worst["impacts"].what


def test_a_force_before_a_stop_is_compared_to_what_its_state_determines(short):
    """It keeps the direction of a slip of 1e-6 of the largest, 0.14 m/s: velocities within 1e-12 m/s turn 0.2 N by 1e-5."""
    (sticks,) = short.records["contact_sticks"]
    for error, agrees in ((1e-8, True), (1e-4, False)):
        changed = replace(sticks, force_before_N=sticks.force_before_N + error)
        assert replay_log(with_records(short, {"contact_sticks": (changed,)})).agrees == agrees


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize(("more_m_s", "agrees"), [(3e-13, True), (3e-12, False)])
def test_a_logged_stop_is_one_to_the_rounding_of_its_slip(short, more_m_s, agrees):
    """The run locates it where the slip is the rounding of the speeds, 1e-12 (1 m/s + their terms, which are below 1 m/s).

    It is some 1e-13 m/s below: a replay of other rounding, as with a grasped object, may find the point above. Twice the
    rounding of at most 2e-12 m/s is the largest that two evaluations of one state can find; 3e-12 more is slip.
    """
    (sticks,) = short.records["contact_sticks"]
    rates, spin = np.array(sticks.qvel_before["robot/free"]), np.empty(3)
    mujoco.mju_rotVecQuat(spin, rates[3:], np.array(sticks.qpos[3:7]))
    slip = rates[:3] + np.cross(spin, (0.0, 0.0, -1.0))
    rates[:2] += more_m_s * slip[:2] / np.hypot(*slip[:2])
    qvel = {**sticks.qvel_before, "robot/free": rates.tolist()}
    changed = replace(sticks, qvel_before=qvel, qvel_after=qvel)
    again = replay_log(with_records(short, {"contact_sticks": (changed,)}))
    assert again.agrees == agrees, again.worst
