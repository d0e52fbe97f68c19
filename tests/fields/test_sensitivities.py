"""Derivatives in orbit against central differences of runs."""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from tests.contact_models.grasp.scenes import OFF, grasping
from tests.mutants.scenes import ASTEROID, TURN
from tests.scenes import ball, box, scene

IMPACT = ("impacts.0.time_s", "impacts.0.impulse_N_s")
GRASP = ("grasps.0.time_s", "grasps.0.loss_J")
_PLACE, _TURN = "initial.joints.target/free.0", "initial.rates.target/free.4"


def meeting(folder):
    """A ball hits a box that tumbles, 6 m from the origin, after 2 s; states are relative to LVLH axes."""
    return scene(
        folder,
        ball(mass=2.0),
        {"target": box("target", mass=3.0, half=(0.3, 0.5, 0.4))},
        environment=ASTEROID,
        duration_s=4.0,
        time_step_s=0.01,
        control_period_s=0.02,
        initial={
            "frame": "lvlh",
            "joints": {"robot/free": [5.0, 3.0, -1.0, 1, 0, 0, 0], "target/free": [6.2, 3.05, -1.1, *TURN]},
            "rates": {"robot/free": [0.4, 0.03, -0.02, 0, 0, 0], "target/free": [0, 0, 0, 0.1, -0.2, 0.3]},
        },
        contacts={"rules": [{"between": ["robot", "target"], "restitution": 0.5}]},
    )


def closing(folder, **bounds):
    """A tumbling ball comes along the R-bar to the hand of an arm, where a bound begins to hold; the tide slows it down."""
    across = np.sqrt(0.5)  # the arm, along x of its base, along -z
    return grasping(
        folder,
        when={"within": bounds},
        environment=ASTEROID,
        duration_s=0.8,
        contacts={"rules": []},
        phases=[{"name": "meet", "until": "end", "arm": ["grasp"], "controller": OFF}],
        initial={
            "joints": {
                "robot/free": [0, 0, 0, across, 0, across, 0],
                "target/free": [0.01, 0.0, -1.12, across, 0, across, 0],
            },
            "rates": {"robot/free": [0, 0, 0, 0.02, -0.03, 0.05], "target/free": [0, 0, 0.1, 0.1, -0.02, 0.03]},
        },
    )


def differences(path, names, key, step):
    """Central differences of two steps, to which the error of the second order is extrapolated."""
    slopes = []
    for h in (step, 0.5 * step):
        ends = []
        for sign in (1.0, -1.0):
            value = _stated(path, key) + sign * h
            ends.append(_numbers(ffsm_mj.run(path, {key: value}), names))
        slopes.append(np.subtract(*ends) / (2.0 * h))
    return (4.0 * slopes[1] - slopes[0]) / 3.0


def _stated(path, key):
    joint, index = key.rsplit(".", 1)
    part, name = joint.removeprefix("initial.").split(".")
    initial = ffsm_mj.Scenario.load(path).prepared.scenario.initial
    return float(getattr(initial, part)[name][int(index)])


def _numbers(run, names):
    found = ffsm_mj.summary(run)
    return np.array([_at(found, name) for name in names])


def _at(found, name):
    for part in name.split("."):
        found = found[int(part) if part.isdigit() else part]
    return float(found)


@pytest.mark.parametrize(
    ("make", "names"),
    [
        (meeting, IMPACT),
        (lambda folder: closing(folder, position_m=0.04), GRASP),
        (lambda folder: closing(folder, position_m=0.2, speed_m_s=0.1), GRASP),
    ],
    ids=["impact", "place", "speed"],
)
@pytest.mark.parametrize("key", [_PLACE, _TURN])
def test_derivatives_are_those_of_runs(tmp_path, make, names, key):
    path = make(tmp_path)
    run = ffsm_mj.run(path)
    found = ffsm_mj.sensitivity(run, list(names), {key: 1e-3}, kind="exact")
    np.testing.assert_allclose(found.derivative[:, 0], differences(path, names, key, 1e-3), rtol=1e-6, atol=1e-8)
