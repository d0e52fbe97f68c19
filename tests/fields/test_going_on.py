"""Runs in orbit go on bit for bit: from bytes of states, from instants of logs, in a grasp and in persistent contact."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.errors import InputError
from ffsm_mj.fields.orbit import Orbit
from ffsm_mj.replay import replay_log
from tests.mutants import scenes
from tests.scenes import ball, box, scene
from tests.simulation.restored import goes_on, is_rest_of

OBLATE = {
    "body": {"mu_km3_s2": 10.0, "radius_km": 5.0, "j2": 0.05},
    "kind": "elliptic",
    "semi_major_axis_km": 9.0,
    "eccentricity": 0.2,
    "argument_of_perigee_deg": 40.0,
    "inclination_deg": 60.0,
    "j2": True,
}
"""About the same body as that of ``scenes.ASTEROID``: the reference is integrated in pieces of 1 s."""


def pressed(folder):
    """A ball and a box along the V-bar, which the tide presses together; the box spins under the ball, with friction."""
    return scene(
        folder,
        ball(mass=2.0),
        {"box": box("box", mass=3.0, half=(0.3, 0.4, 0.5))},
        environment={"orbit": OBLATE},
        duration_s=2.0,
        time_step_s=0.01,
        control_period_s=0.02,
        initial={
            "joints": {"robot/free": [0.02, 0.0, 0.05, 1, 0, 0, 0], "box/free": [0.0, 0.5001, 0.0, 1, 0, 0, 0]},
            "rates": {"robot/free": [0, 0.001, 0, 0, 0, 0], "box/free": [0, 0, 0, 0, 0.1, 0]},
        },
        contacts={"rules": [{"between": ["robot", "box"], "restitution": 0.0, "mu": 0.3, "name": "on"}]},
    )


def held(folder):
    """The scene of the mutants: an arm grasps a box."""
    return scenes.orbits(folder)


SCENES = {"held": (held, 0.2, "contact.grasp_closed"), "pressed": (pressed, 1.1, "contact.on_mode")}


@pytest.mark.parametrize("name", [*SCENES])
def test_from_bytes_of_a_state(tmp_path, name):
    make, at_s, key = SCENES[name]
    whole, rest = goes_on(make(tmp_path), at_s)
    assert is_rest_of(whole, rest)
    assert len(rest["rows"]) > 10
    run = ffsm_mj.run(tmp_path / "scene.yaml")
    assert run[key][int(np.searchsorted(run.time, at_s))] > 0.0  # it is held, or the contact is closed, there
    assert all(check.passes for check in run.checks())


@pytest.mark.parametrize("name", [*SCENES])
def test_from_an_instant_of_a_log(tmp_path, name):
    make, at_s, _ = SCENES[name]
    path, out = make(tmp_path), tmp_path / "run"
    whole = ffsm_mj.run(path, out=out, rerun=False)
    again = replay_log(ffsm_mj.load_run(out).log)
    assert again.agrees
    assert not [check for check in again.checks() if not check.passes]
    Orbit.of.cache_clear()  # as in another process
    rest = ffsm_mj.resume(out, at_s, out=tmp_path / "rest", rerun=False)
    assert np.array_equal(whole.log.rows[-len(rest.log.rows) :], rest.log.rows, equal_nan=True)
    assert all(check.passes for check in all_checks(rest))
    again = replay_log(ffsm_mj.load_run(tmp_path / "rest").log)
    assert again.agrees
    scenario = json.loads(path.read_text())
    scenario["initial"] = {"from": "run", "at_s": at_s}
    path.write_text(json.dumps(scenario))
    assert np.array_equal(ffsm_mj.run(path).log.rows, rest.log.rows, equal_nan=True)


def test_branches_begin_at_the_time_of_their_state(tmp_path):
    with ffsm_mj.Simulator(pressed(tmp_path)) as simulator:
        simulator.reset()
        while simulator.time_s < 1.1:
            simulator.step()
        state, ends = simulator.get_state(), []
        for _ in range(2):
            simulator.set_state(state)
            while not simulator.ended:
                step = simulator.step()
            ends.append(step.observation.data.qpos.copy())
    assert np.array_equal(*ends)


def test_another_orbit_or_frame_cannot_begin_in_the_midst(tmp_path):
    ffsm_mj.run(pressed(tmp_path), out=tmp_path / "run", rerun=False)
    for key, value in (("environment.orbit.eccentricity", 0.1), ("environment.world_axes", "lvlh")):
        with pytest.raises(InputError, match=rf"{key}: cannot change where a run goes on"):
            ffsm_mj.resume(tmp_path / "run", 1.1, {key: value})
    begin = {"initial": {"from": str(tmp_path / "run"), "at_s": 1.1, "frame": "lvlh"}}
    with pytest.raises(InputError, match=r"initial.frame: cannot change where a run goes on"):
        ffsm_mj.run(tmp_path / "scene.yaml", begin)


@pytest.mark.parametrize("name", [*SCENES])
def test_a_replay_begins_anew_behind_a_gap(tmp_path, name):
    """Forces behind the gap are those of its time: without it the motion would be off by 4e-5 m/s after a step."""
    log = ffsm_mj.run(SCENES[name][0](tmp_path)).log
    again = replay_log(replace(log, rows=np.delete(log.rows, slice(20, 40), axis=0)))
    assert again.agrees


@pytest.mark.parametrize("time_step_s", [0.005, 0.01, 0.02])
def test_a_contact_that_opens_as_its_force_vanishes_slowly(tmp_path, time_step_s):
    # The force falls by 0.01 N/s, and the field is known to 5e-15 N: at the time that the log tells, to a bit, the gap may
    # open by rounding less than where the run found it to.
    path, settings = pressed(tmp_path), {"duration_s": 4.0, "time_step_s": time_step_s, "contacts.rules.0.mu": 0.0}
    for place in range(4):
        run = ffsm_mj.run(
            path, settings | {"initial.rates.box/free.4": 0.05 * place}, out=tmp_path / f"run{place}", rerun=False
        )
        assert len(run.records["contact_endings"]) == 1
        again = replay_log(ffsm_mj.load_run(tmp_path / f"run{place}").log)
        assert again.agrees
        assert not [check for check in again.checks() if not check.passes]
