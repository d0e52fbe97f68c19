"""Points at the limit of friction: what sticks, and how those that hardly exceed it begin to slip."""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from tests.contact_models.persistent.friction.scenes import block, final, load, on_slab, slips
from tests.replays import proved
from tests.scenes import ball

WEIGHT_N, MU, DURATION_S = 10.0, 0.3, 0.04


def pulled_foot(folder, pull_N, step):
    """A foot of 1 kg on three slides, whose limit of friction is 3 N."""
    return on_slab(
        folder,
        ball("foot", mass=1.0, joints="xyz"),
        geom="foot",
        mu=MU,
        weight=WEIGHT_N,
        step=step,
        duration=DURATION_S,
        initial={"joints": {"robot/z": 0.1}},
        loads=[load("robot/foot", force_N=[pull_N])],
    )


def pulled_block(folder, pull_N, step):
    """A block of 1 kg on four corners, pulled at its foot: the corners share the load evenly."""
    pull = load("robot/box", force_N=[pull_N], at_m=[0, 0, -0.05])
    return block(folder, mu=MU, velocity=(0, 0, 0), weight=WEIGHT_N, step=step, duration=DURATION_S, loads=[pull])


def slip_of(run):
    """Velocity in the plane at the end, m/s."""
    if any("v_robot_free" in key for key in run.keys):
        return final(run, "v_robot_free")[:2]
    return np.array([*final(run, "v_robot_x"), *final(run, "v_robot_y")])


@pytest.mark.long
@pytest.mark.parametrize("scene", [pulled_foot, pulled_block])
@pytest.mark.parametrize("step", [2e-3, 1e-3, 2e-2])
@pytest.mark.parametrize("excess", [3e-9, 1e-4])
def test_a_pull_just_beyond_the_limit_slips_along_itself(tmp_path, scene, step, excess):
    """At (pull - mu N) t. Across, friction against a direction that is off by 1e-8 rad pushes ten times as hard as that.

    Both forces are known to 4e-16 of 3 N, and slips to as much times the time.
    """
    along, across = np.array((0.6, 0.8)), np.array((-0.8, 0.6))
    pull = (3.0 + excess) * along
    run = proved(ffsm_mj.run(scene(tmp_path, (*pull, 0.0), step)))
    u = slip_of(run)
    assert [u @ along, u @ across] == pytest.approx([excess * DURATION_S, 0.0], abs=1e-15)


@pytest.mark.long(one_of=3)
@pytest.mark.parametrize("scene", [pulled_foot, pulled_block])
@pytest.mark.parametrize(("excess", "sticks"), [(3e-12, True), (3e-10, True), (3e-9, False)])
def test_an_excess_within_rounding_of_the_accelerations_sticks(tmp_path, scene, excess, sticks):
    """These are known to 1e-10 of the largest term, 10 m/s^2; beyond, it slips, and neither changes its mode again."""
    run = proved(ffsm_mj.run(scene(tmp_path, (3.0 + excess, 0.0, 0.0), 2e-3)))
    assert [*slips(run), *run.records["contact_changes"], *run.records["contact_sticks"]] == []
    assert slip_of(run)[0] == pytest.approx(0.0 if sticks else excess * DURATION_S, abs=1e-15)


def test_a_pull_that_passes_the_limit_slips_there(tmp_path):
    """And not where the excess has grown beyond rounding of the accelerations, 2e-8 s later on this ramp of 0.05 N/s.

    The limit is known to 1e-13 of 10 N.
    """
    pull = load("robot/foot", force_N=[[2.999, 0, 0], [0.05, 0, 0]])
    scene = pulled_foot(tmp_path, (0.0, 0.0, 0.0), 2e-3)
    run = proved(ffsm_mj.run(scene, {"contact_models.0.loads.1": pull}))
    assert slips(run) == [pytest.approx(0.02, abs=2.5e-11)]
