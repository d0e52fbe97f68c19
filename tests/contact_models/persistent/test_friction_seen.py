"""What logs, records and control laws show of friction in persistent contact."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.errors import InputError
from ffsm_mj.report.record_tables import contact_table
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
def rolled(tmp_path_factory):
    phases = [{"name": "watch", "until": "end", "controller": {"kind": "watch"}}]
    path = on_floor(tmp_path_factory.mktemp("rolled"), rates=SLIPS, phases=phases)
    return proved(ffsm_mj.run(path, controllers={"watch": Watch})), list(Watch.told)


def test_columns_of_a_sphere_that_slips_and_then_rolls(rolled):
    run, _ = rolled
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
    (sticks,) = rolled[0].records["contact_sticks"]
    assert sticks.time_s == pytest.approx(T_STOP, abs=1e-8)
    assert sticks.slip_m == pytest.approx(0.5 * U0 * T_STOP, abs=1e-9)  # of the time of the stop, 1e-9 s early
    assert (sticks.friction, sticks.slip_speed_m_s) == ("sticking", 0.0)
    (begins,) = rolled[0].records["contact_beginnings"]
    assert begins.friction == "sliding"


def test_the_interval_of_contact_has_its_slip(rolled):
    (contact,) = rolled[0].contacts
    assert contact.sliding_s == pytest.approx(T_STOP, abs=1e-8)
    assert contact.slip_m == pytest.approx(0.5 * U0 * T_STOP, abs=1e-9)
    assert contact.peak_friction_use == 1.0
    slip = f"{contact.slip_m:.6g}"
    assert slip in contact_table((contact,))
    assert f"{2 * contact.slip_m:.6g}" in contact_table((contact, contact), most=1)


def test_control_laws_see_mode_friction_and_slip(rolled):
    _, told = rolled
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
    ] * 2


def test_shares_of_equal_springs_that_leave_the_cones_are_replaced(tmp_path):
    """Pressed along the axis of the V, the ball needs no friction, though equal springs at its contacts would load it."""
    run = ffsm_mj.run(in_a_v(tmp_path, 0.5, math.radians(30.0), (0.0, -1.0)))
    assert np.abs(run["contact.groove_friction_use"]).max() < 1e-9


def test_rules_without_friction_have_no_columns_of_it(tmp_path):
    run = ffsm_mj.run(on_floor(tmp_path, mu=0.0, duration_s=0.02))
    assert not [key for key in run.keys if "friction_" in key.replace("balance.friction_heat_J", "") or "slip" in key]
    assert set(run["contact.sole_mode"]) == {2.0}


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
    with pytest.raises(InputError, match=rf"contacts.rules.0.{key}: unknown key: .*{says}.*; allowed: between, mu"):
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
