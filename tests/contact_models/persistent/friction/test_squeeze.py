"""The shipped scenario ``squeeze``: held by friction at half its limit, lost above it."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from ruamel.yaml import YAML

import ffsm_mj
from ffsm_mj.scenario.shipped import scenarios_dir
from tests.contact_models.persistent.friction.reading import good, slips
from tests.contact_models.persistent.friction.scenes import load, loaded
from tests.scenes import ball

MU, GRIP_N, CUBE_KG = 0.3, 15.0, 5.0
GRIP_X_M = 0.45 + 2 * 0.5 * math.cos(0.4) + 0.27
MASS_CENTRES = {
    "bus": (50.0, (0, 0, 0)),
    "upper_arm": (3.0, (0.25, 0, 0)),
    "fore_arm": (2.0, (0.25, 0, 0)),
    "hand": (1.4, (0.06, 0, 0)),
    "left_finger": (0.3, (-0.05, 0, 0)),
    "right_finger": (0.3, (-0.05, 0, 0)),
}
"""Mass in kg and place in m of each body of the robot."""


def pulled_away(folder, rate):
    """Outside forces give robot and gripper the acceleration ``rate`` t and carry what friction asks of the pads."""
    scenario = YAML(typ="safe").load(scenarios_dir() / "squeeze.yaml")
    mjcf = scenarios_dir().parent / "mjcf"
    scenario["robot"]["mjcf"] = str(mjcf / "servicer_gripper.xml")
    (folder / "anchor.xml").write_text(ball("anchor").replace('<freejoint name="free"/>', ""))
    anchor = {"mjcf": "anchor.xml", "fixed": True, "pose": {"position_m": [9, 9, 9]}}
    scenario["objects"] = {"cube": {"mjcf": str(mjcf / "cube_5kg.xml")}, "anchor": anchor}
    scenario["initial"] = {
        "joints": scenario["initial"]["joints"] | {"left": 0.025, "right": 0.025, "cube/free": [GRIP_X_M, 0, 0, 1, 0, 0, 0]}
    }
    grip = next(phase for phase in scenario["phases"] if phase["name"] == "grip")
    scenario["phases"] = [{"name": "grip", "until": "end", "controllers": grip["controllers"]}]
    growing = [
        load(f"robot/{body}", "anchor/anchor", force_N=[[0, 0, 0], [mass * rate, 0, 0]], at_m=place)
        for body, (mass, place) in MASS_CENTRES.items()
    ] + [
        load(f"robot/{side}_finger", "anchor/anchor", force_N=[[0, 0, 0], [CUBE_KG * rate / 2, 0, 0]], at_m=[0, y, 0])
        for side, y in (("left", -0.025), ("right", 0.025))
    ]
    path = folder / "scene.yaml"
    path.write_text(json.dumps(scenario | {"contact_models": loaded(*growing), "duration_s": 0.056}))
    return path


def test_the_grip_slips_where_the_load_exceeds_the_friction_of_both_pads(tmp_path):
    """Without rotation the cube of 5 kg needs 5 kg times 35 t m/s^2 of 2 mu N = 9 N: until 9 / 175 s, inside a step."""
    run = good(ffsm_mj.run(pulled_away(tmp_path, 35.0)), records=False)
    assert slips(run) == [pytest.approx(2 * MU * GRIP_N / (CUBE_KG * 35.0), rel=1e-6)] * 2


@pytest.mark.long
@pytest.mark.slow
def test_squeeze():
    """The cube comes to rest in the pads, is moved at half of what friction can, slides, and is let go."""
    run = ffsm_mj.run("squeeze")
    assert run.outcome == "completed", run.message
    assert [check for check in run.checks() if not check.passes] == []
    phases = {record.name: record.start_s for record in run.records["phases"]}
    (begins,) = {record.time_s for record in run.records["contact_sticks"]}
    assert phases["grip"] < begins < phases["retract"]
    assert len(slips(run)) == 2
    assert all(phases["snatch"] < at_s < phases["release"] for at_s in slips(run))
    force = sum(np.stack([run[f"contact.{side}_friction_{axis}_N"] for axis in "xyz"], axis=1) for side in ("left", "right"))
    # The force that the pads need over 2 mu N, the limit of translation: half of it while the arm retracts.
    used = np.linalg.norm(force, axis=1) / (2 * MU * GRIP_N)
    retracts = (run.time > phases["retract"]) & (run.time < phases["extend"])
    assert used[retracts].max() == pytest.approx(0.5, abs=0.03)
    slides = (run.time > slips(run)[0] + 0.008) & (run.time < phases["release"] - 0.008)
    # Newton-Euler of the logged cube: central differences over 8 ms, of an acceleration that turns at some 10 rad/s.
    velocity = np.stack([run[f"state.v_cube_free_v{axis}_m_s"] for axis in "xyz"], axis=1)
    needed = CUBE_KG * np.gradient(velocity, run.time, axis=0)
    np.testing.assert_allclose(force[slides], needed[slides], atol=0.02 * 2 * MU * GRIP_N)
    for side in ("left", "right"):
        np.testing.assert_allclose(run[f"contact.{side}_friction_use"][slides], 1.0, rtol=1e-9)
