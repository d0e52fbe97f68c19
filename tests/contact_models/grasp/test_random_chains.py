"""Seeded random scenes of grasps, contacts and springs: every check passes, and the log replays."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.replay import explain, replay_log
from ffsm_mj.replay.truncation import AnalysisLimits
from tests.contact_models.grasp.scenes import OFF
from tests.contact_models.grasp.two_arms import CLAMP, LEFT, RIGHT, holding, plate
from tests.replays import assert_replayed
from tests.scenes import ball

AXES = ("1 0 0", "0 1 0", "0 0 1")
LATCHES = ("rigid", "rigid", "ball", "hinge", "slide", "cylindrical")


def latch(rng, grasp):
    """A grasp with some freedom, about or along any axis."""
    kind = str(rng.choice(LATCHES))
    axis = {} if kind in ("rigid", "ball") else {"axis": rng.normal(size=3).tolist()}
    return grasp | {"joint": kind, **axis}


def drawn(seed, folder):
    """Two or three grasps that close one after the other or together, a ball that hits, sprung joints, a random release."""
    rng = np.random.default_rng([33, seed])
    axes = tuple(rng.choice(AXES, size=int(rng.integers(2, 5))))
    names = [f"{side}_{k}" for side in ("left", "right") for k in range(len(axes))]
    two = rng.random() < 0.3
    of_right = {"object_site": "box/b_right"} if two else {}
    grasps = {"left": latch(rng, LEFT), "right": latch(rng, RIGHT | of_right), "clamp": latch(rng, CLAMP)}
    order = [str(name) for name in rng.permutation(list(grasps))[: int(rng.integers(2, 4))]]
    grasps = {name: grasps[name] for name in order}
    joints = {name: float(angle) for name, angle in zip(names, rng.normal(size=len(names)) * 0.6, strict=True)}
    turn = rng.normal(size=4)
    joints |= {"plate/free": [2.2, *(0.05 * rng.normal(size=2)), *(turn / np.linalg.norm(turn))]}
    joints |= {"stone/free": [2.9, 0.0, 0.0, 1, 0, 0, 0]}
    rates = {name: float(rate) for name, rate in zip(names, rng.normal(size=len(names)) * 0.3, strict=True)}
    rates |= {f"{body}/free": (rng.normal(size=6) * 0.1).tolist() for body in ("robot", "plate")}
    rates |= {"stone/free": [-5.0, *(0.1 * rng.normal(size=2)), *rng.normal(size=3)]}
    objects = {"stone": ball("stone", mass=0.4)}
    if two:
        objects["box"] = plate("box").replace("to_", "b_")
        joints["box/free"] = [1.2, -2.0, 0.3, 1, 0, 0, 0]
    rule = {"between": ["stone/stone", "plate/plate"], "restitution": float(rng.choice([0.0, 0.5, 1.0]))}
    rule |= {"mu": 0.4} if rng.random() < 0.5 else {}
    together = rng.random() < 0.5
    phases = [{"name": "first", "for_s": 0.04, "arm": order if together else order[:1], "controller": OFF}]
    phases += [] if together else [{"name": "others", "for_s": 0.04, "arm": order[1:], "controller": OFF}]
    phases += [{"name": "leave", "until": "end", "release": [str(rng.choice(order))], "controller": OFF}]
    spring = (float(rng.uniform(0.5, 5.0)), float(rng.uniform(0.0, 0.2))) if rng.random() < 0.4 else None
    scenario = {"initial": {"joints": joints, "rates": rates}, "grasps": grasps, "phases": phases}
    changes = {"contacts": {"rules": [rule]}, "objects": objects, "conservative": spring is None}
    timing = {"duration_s": 0.12, "time_step_s": 1e-3}
    return holding(folder, axes=axes, spring=spring, **scenario, **changes, **timing)


@pytest.mark.long(one_of=25)
@pytest.mark.parametrize("seed", range(200))
def test_a_random_scene(tmp_path, seed):
    """A check may fail by the truncation of the step alone, of order four: fast hits and light links are drawn too."""
    run = ffsm_mj.run(drawn(seed, tmp_path))
    assert run.outcome == "completed", run.message
    assert [
        check for check in explain(run, limits=AnalysisLimits()).checks if not (check.passes or check.fails_by_truncation)
    ] == []
    assert len(run.grasps) >= 2
    if seed % 3 == 0:  # a replay takes as long as its run
        assert_replayed(run)


def rough(seed, folder, mu, step_s):
    """The scene of a seed with another coefficient of friction and another step."""
    path = drawn(seed, folder)
    scenario = json.loads(path.read_text())
    scenario["contacts"]["rules"][0]["mu"], scenario["time_step_s"] = mu, step_s
    path.write_text(json.dumps(scenario))
    return ffsm_mj.run(path).log


@pytest.fixture(scope="module")
def turned(tmp_path_factory):
    """A stone slides on a grasped plate, turns by a right angle at 4e-6 m/s within a step, and stops."""
    return rough(175, tmp_path_factory.mktemp("turned"), 0.6, 2e-3)


@pytest.mark.parametrize(("error", "agrees"), [(0.0, True), (1e-8, False)])
def test_what_a_stop_leaves_open_is_the_force_before_it_alone(turned, error, agrees):
    """Slip ends at 2.5e-12 m/s, its rounding: the replay finds another direction, and 2e-5 N more before the stop.

    The load right after it is that of a point that sticks, and known to rounding.
    """
    (stick,) = turned.records["contact_sticks"]
    assert stick.force_before_N > 0.1
    rows = np.array(turned.rows)
    rows[-1, turned.header.layout.index["contact.grasp_clamp_event_force_N"]] += error
    again = replay_log(replace(turned, rows=rows))
    assert again.agrees == agrees, again.worst


@pytest.mark.long
@pytest.mark.parametrize("seed", [175, 56])
def test_forces_at_a_slow_slip_are_compared_to_what_its_state_determines(tmp_path, seed):
    """Rows at 1.5e-5 and 9e-7 m/s: the transfer of a grasped object's state turns the slip by 2e-9 and 4e-9 rad."""
    again = replay_log(rough(seed, tmp_path, 0.6, 5e-4))
    assert again.agrees, again.worst
