"""The shipped scenarios with contact that lasts: each tells its story, keeps every law, and is what its log says."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.replay import replay_log

GRAVITY = 9.81


SECONDS = {"tap": 9.0, "push": 10.0, "resting": 5.0, "dock": 10.0}


@cache
def ran(name):
    """A scenario that completed and whose checks pass."""
    run = ffsm_mj.run(name, {"duration_s": SECONDS[name]})
    assert (run.outcome, run.message) == ("completed", "")
    laws = all_checks(run)
    names = {law.name for law in laws}
    assert "no penetration" in names
    assert "contact complementarity" not in names  # it is not known without a replay
    assert all(law.passes for law in laws), [law for law in laws if not law.passes]
    return run


def pairs_of(run, kind):
    """Names of the pairs of some records."""
    return [record.pair for record in run.records[kind]]


@pytest.mark.long
@pytest.mark.parametrize("name", SECONDS)
def test_the_log_is_what_its_states_give(name):
    again = replay_log(ran(name).log)
    assert again.agrees, again.worst
    (forces,) = (check for check in again.checks() if check.name == "contact complementarity")
    assert 0.0 < forces.residual <= forces.tolerance


def test_push():
    """Six bounces; the seventh hit is the entry; the box is pushed for a second and let go."""
    run = ran("push")
    assert [impact.restitution_used for impact in run.impacts] == [0.3] * 6 + [0.0]
    (begins,), (ends,) = run.records["contact_beginnings"], run.records["contact_endings"]
    assert begins.time_s == run.impacts[-1].time_s == pytest.approx(8.71830, abs=1e-5)
    assert 1.0 < ends.time_s - begins.time_s < 1.3
    force = run["contact.gripper_box_force_N"]
    half_a_step = 5e-4
    assert np.all(force[(run.time > begins.time_s) & (run.time < ends.time_s - half_a_step)] > 0.0)
    assert np.all(force[(run.time < begins.time_s) | (run.time > ends.time_s)] == 0.0)


def test_tap():
    """Each of four strokes bounces, carries the ball and throws it at the wall, from which it comes back."""
    run = ran("tap")
    hits = [impact.pair for impact in run.impacts]
    assert hits.count("wall") == 4
    assert pairs_of(run, "contact_beginnings") == pairs_of(run, "contact_endings") == ["paddle"] * 4
    # Between two visits to the wall the paddle hits several times, less hard each time, and the last hit is the entry.
    for stroke in np.split(run.impacts, np.flatnonzero([pair == "wall" for pair in hits]))[:4]:
        bounces = [impact for impact in stroke if impact.pair == "paddle"]
        speeds = [impact.approach_speed_m_s for impact in bounces]
        assert len(bounces) >= 5
        assert speeds == sorted(speeds, reverse=True)
        assert [impact.restitution_used for impact in bounces] == [0.4] * (len(bounces) - 1) + [0.0]


def test_dock():
    """It slides along one face, meets the other, and in the end presses both with all that the thrusters give."""
    run = ran("dock")
    modes = np.array([run[f"contact.probe_port_{side}_mode"] for side in ("upper", "lower")])
    slides = np.flatnonzero(modes[0] == 2.0)[0]
    assert modes[1, slides] == 0.0
    assert modes[:, -1].tolist() == [2.0, 2.0]
    # The base still turns about the probe, slower and slower: on the way to what the thrusters give.
    assert abs(run["state.v_robot_base_yaw_rad_s"][-1]) < 5e-3
    given = sum(run[f"contact.probe_port_{side}_force_x_N"][-1] for side in ("upper", "lower"))
    assert given == pytest.approx(run["actuators.robot_thruster_x_applied_N"][-1], rel=1e-3)


def test_resting():
    """Under each body the weight of all above it, then what the press adds."""
    run = ran("resting")
    assert len(set(pairs_of(run, "contact_beginnings"))) == 4
    pairs = {"slab_crate": 16.0, "crate_block": 6.0, "block_ball": 2.0}
    settled = np.argmin(np.abs(run.time - 2.0))
    press = run["contact.press_ball_force_N"]
    assert press[settled] == 0.0
    assert press[-1] > 20.0
    for pair, carried_kg in pairs.items():
        force = run[f"contact.{pair}_force_N"]
        # Weights are whole kilograms, and the accelerations of the stack are held to zero within 1e-9 m/s^2.
        assert force[settled] == pytest.approx(carried_kg * GRAVITY, rel=1e-9)
        # The press still creeps by its damping.
        assert force[-1] - press[-1] == pytest.approx(carried_kg * GRAVITY, rel=1e-6)
