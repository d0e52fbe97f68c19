"""Predictions in orbit: those of estimators are the motion of the run, and actions of environments know the field."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.controller_protocol import predict
from tests.contact_models.grasp.scenes import NEAR, OFF, grasping
from tests.fields.test_laws import ARM
from tests.mutants.scenes import ASTEROID, TURN
from tests.scenes import ball, scene
from tests.sensing.scenes import column
from tests.sensing.test_direct import camera, watching, worst


def test_a_prediction_is_the_motion_of_the_run(tmp_path, rng):
    """An arm that moves and a ball, 6 m from the origin, over 0.5 s: both are RK4 in steps of 0.05 rad and less."""
    start = {
        "joints": {"robot/free": [5.0, 3.0, -1.0, *TURN], "a": 0.4, "b": -0.8, "ball/free": [-4.0, 2.0, 1.0, *TURN]},
        "rates": {"robot/free": [0.1, 0, 0, *rng.uniform(-0.2, 0.2, 3)], "a": 0.3, "c": -0.2},
    }
    path = scene(tmp_path, ARM, {"ball": ball("ball")}, environment=ASTEROID, duration_s=0.5, initial=start)
    made = ffsm_mj.run(path)
    plant = ffsm_mj.Scenario.load(path).prepared.assemble().plant
    model = plant.system.mj
    ends = []
    for field in (plant.fields_in(plant.system), None):
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = made.qpos[0], made.qvel[0]
        for part_s in (0.1, 0.4):  # the second begins at its own time
            predict(model, data, part_s, field)
        assert data.time == pytest.approx(0.5, abs=1e-12)
        ends.append(np.concatenate((data.qpos, data.qvel)))
    # RK4 in steps of 0.05 rad errs by some 1e-9 of a turn; a tide of 0.1 m/s^2 moves by 1e-2 m.
    np.testing.assert_allclose(ends[0], np.concatenate((made.qpos[-1], made.qvel[-1])), rtol=0.0, atol=1e-8)
    assert np.abs(ends[0] - ends[1]).max() > 5e-3


@pytest.mark.parametrize("kind", ["direct", "mekf"])
def test_a_late_camera_finds_a_tumbling_box_in_orbit(tmp_path, kind):
    """As without an orbit (test_direct): 5e-9. Over 0.17 s a tide of 0.03 m/s^2 at 1 m moves things by 4e-4 m."""
    kinds = ("framepos", "framequat", "framelinvel", "frameangvel")
    sensors = camera(*kinds, interval_s=0.05, delay_s=0.12)
    path = watching(tmp_path, sensors, {"kind": kind})
    made = ffsm_mj.run(path, {"environment": ASTEROID})
    assert worst(made, "b_free") < 5e-9


def test_an_estimate_goes_on_through_a_grasp_in_orbit(tmp_path):
    """A filter that begins with the truth and has exact sensors keeps it: before a grasp, in it, and after it."""
    of_base = {kind: {"kind": kind, "of": "robot/base", "interval_s": 0.1} for kind in ("framepos", "framequat")}
    seen = {f"seen_{kind}": base | {"of": "target/target", "relative_to": "grip"} for kind, base in of_base.items()}
    joints = {f"{kind}_{of}": {"kind": kind, "of": of} for kind in ("jointpos", "jointvel") for of in ("shoulder", "elbow")}
    path = grasping(
        tmp_path,
        when=NEAR,
        environment=ASTEROID,
        duration_s=0.5,
        control_period_s=0.01,
        contacts={"rules": []},  # of contact forces a filter knows nothing
        phases=[
            {"name": "meet", "until": "grasp", "arm": ["grasp"], "controller": OFF},
            {"name": "hold", "for_s": 0.25, "controller": OFF},
            {"name": "leave", "until": "end", "release": ["grasp"], "controller": OFF},
        ],
        initial={
            "joints": {"target/free": [1.14, 0.01, 0.0, 1, 0, 0, 0]},
            "rates": {"target/free": [-0.3, 0, 0, 0.4, -0.2, 0.3]},
        },
        sensors=of_base | seen | joints,
        estimator={"kind": "mekf"},
    )
    made = ffsm_mj.run(path)
    assert made.grasps[0].release_s is not None
    errors = [np.abs(column(made, key)).max() for key in made.log.header.layout.keys if key.startswith("estimate.error_")]
    assert max(errors) < 1e-11  # a tide of 0.03 m/s^2 gives 3e-4 m/s in a control period
