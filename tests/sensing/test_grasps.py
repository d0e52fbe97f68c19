"""Sensors while an object is grasped: nothing of the plant changes, and what is held loads the wrist."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.log.scenario import compile_log
from ffsm_mj.records.events import ImpactRecord
from ffsm_mj.replay import replay_log
from tests.contact_models.grasp.scenes import FLAT_ARM, FLAT_TARGET, OFF, TOUCH, grasping, stone
from tests.replays import assert_replayed
from tests.scenes import scene

SENSORS = {
    "wrist": {"kind": "force", "of": "grip", "interval_s": 0.0073},
    "load": {"kind": "force", "of": "handle"},
    "camera": {"kind": "framepos", "of": "handle", "relative_to": "robot/base", "interval_s": 0.02, "delay_s": 0.03},
}


def caught(folder, **changes):
    """Caught after 0.1 s; a stone hits what is held at about 0.25 s."""
    pairs = [["hand", "target/target"], ["stone/stone", "target/target"]]
    return grasping(
        folder,
        others={"stone": stone()},
        phases=[
            {"name": "meet", "until": "grasp", "arm": ["grasp"], "controller": OFF},
            {"name": "hold", "until": "end", "controller": {"kind": "pd", "kp": 2.0, "kd": 1.0, "target": [0.5, -0.4]}},
        ],
        initial={
            "joints": {"target/free": [1.08, 0.03, 0.02, 1, 0, 0, 0], "stone/free": [1.6, 0.03, 0.02, 1, 0, 0, 0]},
            "rates": {"target/free": [-0.3, 0, 0, 0.4, -0.2, 0.3], "stone/free": [-1.2, 0, 0, 0, 0, 0]},
        },
        contacts={"rules": [{"between": pair, "restitution": 0.5} for pair in pairs]},
        duration_s=0.35,
        **changes,
    )


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    return ffsm_mj.run(caught(tmp_path_factory.mktemp("measured"), sensors=SENSORS))


def test_bits_of_the_run_are_those_without_sensors(tmp_path, measured):
    """Samples inside steps, while an object is held too, whose motion the logged system follows."""
    without = ffsm_mj.run(caught(tmp_path))
    assert len(without.grasps) == 1
    for key in without.keys:
        assert np.array_equal(without[key], measured[key], equal_nan=True), key
    assert_replayed(measured)


def test_a_log_with_a_gap_while_an_object_is_held_agrees(measured):
    log = replace(measured.log, rows=np.delete(measured.log.rows, range(150, 160), axis=0))
    assert measured["contact.grasp_closed"][150] == 1.0
    assert replay_log(log).agrees


@pytest.mark.parametrize("joint", ["rigid", "ball"])
def test_an_impact_on_what_is_held_passes_through_the_wrist(measured, tmp_path, joint):
    """Momentum of hand and object together: its change, less the impulse of the stone, came through the wrist.

    A latch with a ball joint passes on no moment: the rates of the joint change at the impact.
    """
    if joint != "rigid":
        latch = {"robot_site": "grip", "object_site": "handle", "when": TOUCH, "joint": joint}
        wrist = SENSORS["wrist"] | {"interval_s": 0.002}  # hand and object bounce off each other 3 ms after the stone
        measured = ffsm_mj.run(caught(tmp_path, sensors={"wrist": wrist}, grasps={"grasp": latch}))
    hit = next(e for e in measured.log.events if isinstance(e, ImpactRecord) and "stone/stone" in e.geoms)
    system = compile_log(measured.log)
    model, data = system.mj, mujoco.MjData(system.mj)
    momenta = []
    for rates in (hit.qvel_before, hit.qvel_after):
        data.qpos[:], data.qvel[:] = hit.qpos, np.concatenate([rates[name] for name in system.joints])
        mujoco.mj_forward(model, data)
        mujoco.mj_subtreeVel(model, data)
        held = [model.body(name).id for name in ("robot/hand", "target/target")]
        momenta.append(sum(model.body_mass[body] * data.subtree_linvel[body] for body in held))
    sign = 1.0 if hit.geoms[1] == "target/target" else -1.0
    through = momenta[1] - momenta[0] - sign * hit.impulse_N_s * np.array(hit.normal)
    expected = data.site_xmat[model.site("robot/grip").id].reshape(3, 3).T @ through
    assert np.linalg.norm(expected) > 0.1
    told = np.column_stack([measured[f"sensor.wrist_impulse_{x}_N_s"] for x in "xyz"])
    first = np.flatnonzero(np.abs(told).max(axis=1) * (measured.time > hit.time_s))[0]
    assert np.allclose(told[first], expected, atol=1e-13)  # sums of ten products of this size in rounding


def test_the_load_is_that_of_the_grasp(measured):
    """A sensor at the object's own site; the logged load is that under the efforts of the row, the sample the one before.

    Between ticks of 1 ms the commands of the servo change by a fiftieth of the load at most.
    """
    held = np.flatnonzero(measured["contact.grasp_closed"] == 1.0)
    calm = held[(measured.time[held] > measured.grasps[0].time_s + 0.002) & (measured.time[held] < 0.2)]
    sample = np.column_stack([measured[f"sensor.load_true_{x}_N"] for x in "xyz"])[calm]
    load = np.column_stack([measured[f"contact.grasp_force_{x}_N"] for x in "xyz"])[calm]
    assert np.linalg.norm(load, axis=1).min() > 0.1
    assert np.allclose(np.linalg.norm(sample, axis=1), np.linalg.norm(load, axis=1), rtol=0.02)


def test_a_joint_that_the_grasp_removes_is_not_measured_while_it_is_closed(tmp_path):
    """Slides of the object, by a sensor of the scenario: NaN and not valid from the capture to the release."""
    robot = FLAT_ARM.replace("</mujoco>", '<actuator><motor name="elbow" joint="elbow"/></actuator></mujoco>')
    path = scene(
        tmp_path,
        robot,
        {"target": FLAT_TARGET},
        duration_s=0.3,
        initial={"joints": {"target/x": 1.08}, "rates": {"target/x": -0.3}},
        contacts={"rules": [{"between": ["hand", "target/target"], "restitution": 0.5}]},
        grasps={"grasp": {"robot_site": "grip", "object_site": "handle", "when": TOUCH}},
        sensors={"slide": {"kind": "jointpos", "of": "target/x"}},
        phases=[
            {"name": "meet", "until": "grasp", "arm": ["grasp"], "controller": OFF},
            {"name": "hold", "for_s": 0.05, "controller": OFF},
            {"name": "leave", "until": "end", "release": ["grasp"], "controller": OFF},
        ],
    )
    run = ffsm_mj.run(path)
    (capture,) = run.grasps
    held = (run.time > capture.time_s) & (run.time <= capture.release_s)
    assert 10 < held.sum() < 100
    assert np.array_equal(np.isnan(run["sensor.slide_true_m"]), held)
    assert np.array_equal(run["sensor.slide_valid"] == 0.0, held)
    assert_replayed(run)


SLIDER = """<mujoco><option gravity="0 0 0"/><worldbody><body name="base"><freejoint name="base"/>
  <inertial pos="0 0 0" mass="10" diaginertia="1 1 1"/>
  <body name="slider" pos="0.3 0 0"><joint name="j" type="slide" axis="1 0 0" range="-1 0.05"/>
    <inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/><site name="tip" pos="0.1 0 0"/></body></body></worldbody>
  <actuator><motor name="m" joint="j"/></actuator></mujoco>"""
"""A slider on a spinning base, which a motor presses on its stop."""
LOAD = """<mujoco><option gravity="0 0 0"/><worldbody><body name="load"><freejoint name="free"/>
  <inertial pos="0 0 0" mass="2" diaginertia="0.02 0.02 0.02"/><site name="handle"/></body></worldbody></mujoco>"""


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize("changes", [{}, {"time_step_s": 0.005, "accuracy": 1e-9}], ids=["fixed", "divided"])
def test_a_wrist_feels_what_its_stop_takes_up(tmp_path, changes):
    """At its stop with the load in hand all is one spinning body: 3 kg are held at their distance from the common centre.

    The motor's effort goes into the stop and never reaches the load, in a run and in its replay.
    """
    path = scene(
        tmp_path,
        SLIDER,
        {"load": LOAD},
        **{
            "time_step_s": 0.001,
            "control_period_s": 0.01,
            "initial": {
                "joints": {"load/free": [0.4, 0, 0, 1, 0, 0, 0]},
                "rates": {"robot/base": [0, 0, 0, 0, 0, 0.5]},
            },
            "grasps": {"grasp": {"robot_site": "tip", "object_site": "handle", "when": {"within": {"position_m": 0.01}}}},
            "sensors": {
                "wrist": {"kind": "force", "of": "tip", "interval_s": 0.01},
                "shake": {"kind": "accelerometer", "of": "tip", "interval_s": 0.0037},
            },
            "phases": [
                {
                    "name": "press",
                    "until": "end",
                    "arm": ["grasp"],
                    "controller": {"kind": "pd", "joints": ["j"], "kp": 20, "kd": 2, "target": [0.1]},
                }
            ],
        }
        | changes,
    )
    run = ffsm_mj.run(path)
    (stop,) = run.records["limit_beginnings"]
    at_rest = run.time > stop.time_s
    assert 50 < at_rest.sum() < 90
    centres = np.array((0.0, 0.35, 0.45))
    masses = np.array((10.0, 1.0, 2.0))
    beyond = masses[1:] @ centres[1:] - 3.0 * (masses @ centres) / masses.sum()
    force = -beyond * run["state.v_robot_base_wz_rad_s"][at_rest] ** 2
    # Forces of 1 N that 20 N/m and 13 kg determine to some hundred roundings.
    np.testing.assert_allclose(run["sensor.wrist_true_x_N"][at_rest], force, rtol=0, atol=1e-12)
    again = replay_log(run.log)
    assert again.agrees, again.worst
    assert again.worst["columns"].size < 1e-12
