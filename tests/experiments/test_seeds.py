"""Noise of the runs of a campaign: its seed follows the index of the run, so that control laws are compared fairly."""

from __future__ import annotations

from ffsm_mj.experiments.campaign import Campaign
from ffsm_mj.experiments.executors import loop
from tests.experiments.files import campaign_file
from tests.sensing.scenes import arm, column, pushing

HELD = [{"name": "hold", "until": "end", "controller": {"kind": "hold", "joints": ["j1", "j2"], "bandwidth_rad_s": 3.0}}]


def test_each_run_has_its_own_noise_and_has_it_again(tmp_path):
    """The noise of run 1 is that of a run with seed 8: 7 of the scenario and 1 of the run."""
    noisy = arm('<jointpos name="e" joint="j1" noise="0.01"/>')
    pushing(tmp_path, robot=noisy, phases=HELD, seed=7, duration_s=0.03)
    path = campaign_file(tmp_path, {"initial.rates.j2": {"choice": [0.1, 0.2, 0.3]}}, {"kind": "grid"})
    campaign = Campaign.load(path, tmp_path / "out")
    campaign.run(loop().open())
    noise = []
    for index in (0, 1):
        again = campaign.rerun(index)
        assert not again.deviations
        noise.append(column(again.run, "sensor.robot_e_rad") - column(again.run, "sensor.robot_e_true_rad"))
        assert f"seed: {7 + index}" in again.run.log.header.scenario_yaml
    assert (noise[0] != noise[1]).all()
