"""Discs that fall flat: the tilt of the rim sets the scale of time, and at a rise of FLAT_M the whole rim is in contact."""

from __future__ import annotations

import math

import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from tests.replays import assert_replayed, proved
from tests.scenes import HEAD, scene

ENERGY_J = 5.9
"""Kinetic energy at the end of the scene."""


@pytest.fixture(scope="module")
def scenario(tmp_path_factory):
    """A slider of 1 kg on a bus of 50 kg presses its face on the cap of a cylinder of 7 kg, tilted by 3.8e-6 rad.

    The first touch at the rim turns the cap flat within 1 us, under a force that rises from 4 to 2000 N; at 0.953 s the cap,
    tilted by 5e-3 rad, rolls half round its rim within 0.5 ms.
    """
    bus = f"""<mujoco>{HEAD}<worldbody><body name="bus"><freejoint name="bus"/>
      <inertial pos="0 0 0" mass="50" diaginertia="5 5 5"/>
      <body name="f" pos=".4 0 0"><joint name="s" type="slide" axis="1 0 0"/>
        <inertial pos="0 0 0" mass="1" diaginertia=".01 .01 .01"/>
        <geom name="f" type="box" size=".05 .1 .1" mass="0"/></body></body></worldbody>
      <actuator><motor name="s" joint="s"/></actuator></mujoco>"""
    disc = f"""<mujoco>{HEAD}<compiler angle="radian"/><worldbody><body name="b"><freejoint name="b"/>
      <inertial pos="0 0 0" mass="6.947909317578816" diaginertia="0.05 0.05 0.05"/>
      <geom name="b" type="cylinder" size="0.09257097334161968 0.06769606747227627" euler="0 1.5707963267948966 0" mass="0"/>
      </body></worldbody></mujoco>"""
    place = (0.8, -0.010443524000513335, 0.015960062588753956)
    turn = (0.9999999999979863, -1.557703353588703e-06, 1.0679904020538678e-06, -6.784723593844176e-07)
    return scene(
        tmp_path_factory.mktemp("disc"),
        bus,
        {"b": disc},
        duration_s=1.0,
        time_step_s=2e-3,
        control_period_s=2e-3,
        initial={"joints": {"b": [*place, *turn]}},
        contacts={"rules": [{"between": ["f", "b/b"], "restitution": 0.0}]},
        phases=[
            {
                "name": "press",
                "until": "end",
                "controller": {"kind": "pd", "joints": ["s"], "kp": 0.5, "kd": 0.0, "target": [10.0]},
            }
        ],
    )


@pytest.mark.long
@pytest.mark.parametrize("duration_s", [0.45, 1.0])
def test_with_an_accuracy_every_check_passes(scenario, duration_s):
    """The steps shrink with the tilt of the rim, and the log gives the same forces, which grow as its inverse.

    The first pass is over within 1 us; the second takes most of the steps.
    """
    run = ffsm_mj.run(scenario, ["accuracy=1e-9", f"duration_s={duration_s}"])
    assert max(run["contact.f_b_b_force_N"]) > 0.0
    assert [check for check in all_checks(run) if not check.passes] == []
    assert_replayed(run)


@pytest.mark.long
def test_at_a_fixed_step_only_truncation_is_left(scenario):
    """At 2 ms the second pass is 9e-8 J off; half the step leaves a twentieth of that."""
    run = ffsm_mj.run(scenario)
    failing = [check for check in all_checks(run) if not check.passes]
    assert all(check.name == "energy" for check in failing)
    assert all(check.residual < 3e-8 * ENERGY_J for check in failing)


SPEED_M_S, MASS_KG, RADIUS_M, HALF_HEIGHT_M = 0.2, 2.0, 0.1, 0.02


def falling(folder, tilt_rad, azimuth_rad, inertia_kg_m2, *, spin_rad_s=0.0, mu=0.0, **scenario):
    """A disc falls on a slab without load, tilted about a horizontal axis, and turns about its first point of contact."""
    disc = f"""<mujoco>{HEAD}<worldbody><body name="disc"><freejoint name="free"/>
      <inertial pos="0 0 0" mass="{MASS_KG}" diaginertia="{inertia_kg_m2} {inertia_kg_m2} {inertia_kg_m2}"/>
      <geom name="disc" type="cylinder" size="{RADIUS_M} {HALF_HEIGHT_M}" mass="0"/></body></worldbody></mujoco>"""
    slab = f"""<mujoco>{HEAD}<worldbody><geom name="slab" type="box" pos="0 0 -0.5" size="1 1 0.5"/></worldbody></mujoco>"""
    turned = math.sin(0.5 * tilt_rad)
    turn = (math.cos(0.5 * tilt_rad), turned * math.cos(azimuth_rad), turned * math.sin(azimuth_rad), 0.0)
    rule = {"between": ["disc", "slab/slab"], "restitution": 0.0} | ({"mu": mu} if mu else {})
    return ffsm_mj.run(
        scene(
            folder,
            disc,
            {"slab": slab},
            fixed={"slab": {}},
            initial={
                "joints": {"free": [0.0, 0.0, 0.0215, *turn]},
                "rates": {"free": [0.0, 0.0, -SPEED_M_S, 0.0, 0.0, spin_rad_s]},
            },
            contacts={"rules": [rule]},
            **{"duration_s": 0.02, "time_step_s": 2e-3, "control_period_s": 2e-3} | scenario,
        )
    )


@pytest.mark.long(one_of=25)
@pytest.mark.parametrize(
    ("tilt_rad", "azimuth_rad", "mu"),
    [(1e-5, 0.0, 0.0), (1e-5, 0.4, 0.0), (1e-5, 0.4, 0.3), (3e-7, 0.4, 0.0)]
    + [pytest.param(tilt, 0.7, mu, marks=pytest.mark.long) for tilt in (3e-8, 3e-6, 3e-5, 1e-4) for mu in (0.0, 0.3)],
)
@pytest.mark.parametrize("inertia_kg_m2", [0.01, 0.05])
def test_a_disc_that_falls_straight_to_flat_has_one_impact_all_round_its_rim(
    tmp_path, tilt_rad, azimuth_rad, mu, inertia_kg_m2
):
    """Rest if I < m R^2; else the disc rocks on over the opposite point, as Housner's block, at (I - m R^2) / (I + m R^2).

    With friction its rim sticks, and its angular momentum about the rim includes that of the motion along the slab.
    """
    run = proved(falling(tmp_path, tilt_rad, azimuth_rad, inertia_kg_m2, mu=mu))
    along, across = MASS_KG * HALF_HEIGHT_M**2 * (mu > 0.0), MASS_KG * RADIUS_M**2
    turning = SPEED_M_S * MASS_KG * RADIUS_M / (inertia_kg_m2 + along + across)
    rocks = max(inertia_kg_m2 + along - across, 0.0) / (inertia_kg_m2 + along + across) * turning
    rates = [run[f"state.v_robot_free_{axis}_rad_s"][-1] for axis in ("wx", "wy", "wz")]
    assert math.hypot(*rates) == pytest.approx(rocks, rel=1e-3, abs=1e-9)
    assert len({impact.event for impact in run.impacts}) == 2
    assert len(run.records["contact_changes"]) < 60


@pytest.mark.parametrize(("tilt_rad", "spin_rad_s"), [(1e-4, 3.0), pytest.param(1e-4, 20.0, marks=pytest.mark.long)])
def test_a_disc_that_spins_rolls_on_its_rim_as_it_falls_flat(tmp_path, tilt_rad, spin_rad_s):
    """The tilt turns on its way to zero, and the contact point travels round the rim."""
    run = proved(falling(tmp_path, tilt_rad, 1.1, 0.01, spin_rad_s=spin_rad_s, duration_s=0.03))
    assert 0 < len(run.records["contact_changes"]) < 60


PUSHED = {"controller": {"kind": "pd", "joints": ["s"], "kp": 0.5, "kd": 0.0, "target": [10.0]}}


@pytest.mark.long(one_of=20)
@pytest.mark.parametrize(
    ("tilt_rad", "azimuth_rad", "mu", "step_s"),
    [(1e-5, 0.7, 0.0, 4e-3), (1e-5, 0.0, 0.3, 2e-3)]
    + [
        pytest.param(tilt, 0.7, mu, step, marks=pytest.mark.long)
        for tilt in (3e-6, 3e-5, 1e-4)
        for mu in (0.0, 0.3)
        for step in (5e-4, 4e-3)
    ],
)
def test_a_disc_under_load_falls_flat_in_few_steps(tmp_path, tilt_rad, azimuth_rad, mu, step_s):
    """A slider pushes it; steps that shrank without end, or 1e-8 m of penetration, stood for this."""
    run = proved(ffsm_mj.run(pushed(tmp_path, tilt_rad, azimuth_rad, mu, step_s)))
    assert len({impact.event for impact in run.impacts}) == 2
    assert len(run.records["contact_changes"]) < 60


def pushed(folder, tilt_rad, azimuth_rad, mu, step_s):
    """A slider on a bus pushes the cap of a disc of 7 kg, at 0.2 m/s."""
    bus = f"""<mujoco>{HEAD}<worldbody><body name="bus"><freejoint name="bus"/>
      <inertial pos="0 0 0" mass="50" diaginertia="5 5 5"/>
      <body name="f" pos=".4 0 0"><joint name="s" type="slide" axis="1 0 0"/>
        <inertial pos="0 0 0" mass="1" diaginertia=".01 .01 .01"/>
        <geom name="f" type="box" size=".05 .15 .15" mass="0"/></body></body></worldbody>
      <actuator><motor name="s" joint="s"/></actuator></mujoco>"""
    disc = f"""<mujoco>{HEAD}<compiler angle="radian"/><worldbody><body name="b"><freejoint name="b"/>
      <inertial pos="0 0 0" mass="7" diaginertia="0.05 0.05 0.05"/>
      <geom name="b" type="cylinder" size="0.09 0.06" euler="0 {0.5 * math.pi} 0" mass="0"/></body></worldbody></mujoco>"""
    turned = math.sin(0.5 * tilt_rad)
    turn = (math.cos(0.5 * tilt_rad), 0.0, turned * math.cos(azimuth_rad), turned * math.sin(azimuth_rad))
    return scene(
        folder,
        bus,
        {"b": disc},
        duration_s=0.06,
        time_step_s=step_s,
        control_period_s=step_s,
        initial={"joints": {"b": [0.515, 0.0, 0.0, *turn]}},
        contacts={"rules": [{"between": ["f", "b/b"], "restitution": 0.0} | ({"mu": mu} if mu else {})]},
        phases=[{"name": "push", "until": "end", **PUSHED}],
    )
