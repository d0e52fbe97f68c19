"""Campaigns in orbit: rows are single runs, and starts in LVLH are those of each run's own orbit."""

from __future__ import annotations

import json

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.errors import InputError
from ffsm_mj.experiments.campaign import Campaign
from tests.mutants.scenes import TURN
from tests.scenes import ball, box, scene

ELLIPSE = {
    "kind": "elliptic",
    "perigee_altitude_km": 400.0,
    "apogee_altitude_km": 2000.0,
    "true_anomaly_deg": 90.0,
    "argument_of_perigee_deg": 30.0,
    "inclination_deg": 51.6,
    "j2": True,
}
PLACE = (20.0, -3.0, 4.0)
DISPERSIONS = {
    "environment.orbit.perigee_altitude_km": {"uniform": [300.0, 900.0]},
    "environment.orbit.true_anomaly_deg": {"uniform": [0.0, 360.0]},
    "environment.orbit.inclination_deg": {"uniform": [0.0, 90.0]},
    "initial.joints.ball/free.position": {
        "offset": {"vector": {"direction": "random", "magnitude": {"uniform": [0.0, 0.01]}}}
    },
    "initial.joints.box/free": {"rotation": {"axis": [0, 1, 0], "angle": {"uniform": [0.1, 0.5]}}},
    "initial.rates.box/free.3": {"offset": {"normal": {"sd": 1e-3}}},
}


def meeting(folder):
    """A ball drifts to a box that keeps station; the robot is elsewhere. World axes are not those of LVLH."""
    return scene(
        folder,
        ball("probe"),
        {"ball": ball("ball", mass=2.0), "box": box(mass=300.0)},
        environment={"orbit": ELLIPSE, "world_axes": "hill"},
        duration_s=40.0,
        time_step_s=0.5,
        control_period_s=0.5,
        initial={
            "frame": "lvlh",
            "joints": {
                "robot/free": [-9.0, 0, 0, 1, 0, 0, 0],
                "box/free": [21.2, -3.0, 4.0, *TURN],
                "ball/free": [*PLACE, 1, 0, 0, 0],
            },
            "rates": {"ball/free": [0.02, 0, 0, 0, 0, 0.02], "box/free": [0, 0, 0, 0.001, 0, 0]},
        },
        contacts={"rules": [{"between": ["ball", "box"], "restitution": 0.5}]},
    )


def campaign_of(folder, dispersions, **keys):
    """A campaign of four runs."""
    meeting(folder)
    metrics = ["impacts.0.time_s", "impacts.0.impulse_N_s", "duration_s"]
    path = folder / "campaign.yaml"
    samples = {"kind": "random", "n": 4, "seed": 3}
    data = {
        "campaign": "orbits",
        "scenario": "scene.yaml",
        "samples": samples,
        "metrics": metrics,
        "dispersions": dispersions,
    }
    path.write_text(json.dumps(data | keys))
    return path


def test_rows_are_single_runs(tmp_path):
    campaign = Campaign.load(campaign_of(tmp_path, DISPERSIONS), tmp_path / "out")
    campaign.run(workers=1)
    rows = campaign.table_rows()
    assert len({row["impacts.0.time_s"] for row in rows}) == 4
    for number, row in enumerate(rows):
        overrides = campaign.design.overrides(number)
        run = ffsm_mj.run(tmp_path / "scene.yaml", overrides)
        (hit,) = run.impacts
        assert (row["impacts.0.time_s"], row["impacts.0.impulse_N_s"]) == (hit.time_s, hit.impulse_N_s)
        assert row["checks_pass"]
        assert all(check.passes for check in run.checks())
        # The start is what was sampled, in LVLH axes of this run's own orbit.
        stated = overrides["initial.joints.ball/free"]
        start = [run[f"orbit.ball_{axis}_m"][0] for axis in "xyz"]
        np.testing.assert_allclose(start, stated[:3], rtol=0.0, atol=1e-13)
        assert 0.0 < np.linalg.norm(np.subtract(start, PLACE)) < 0.01
        assert run["orbit.ball_vx_m_s"][0] == pytest.approx(0.02, abs=1e-15)
        radius_m = 6378137.0 + 1e3 * overrides["environment.orbit.perigee_altitude_km"]
        assert np.linalg.norm([run[f"orbit.R_{axis}_m"][0] for axis in "xyz"]) >= radius_m * (1.0 - 1e-9)


def test_a_dispersion_below_the_surface_is_refused_before_the_first_run(tmp_path):
    path = campaign_of(tmp_path, {"environment.orbit.perigee_altitude_km": {"uniform": [-200.0, 900.0]}})
    with pytest.raises(InputError, match=r"environment.orbit.perigee_altitude_km.*perigee .* km below the surface"):
        Campaign.load(path, tmp_path / "out")
