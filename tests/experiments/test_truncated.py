"""Runs of a campaign whose checks fail by the truncation of the step alone count, or fail, as the campaign says."""

from __future__ import annotations

import pytest

from ffsm_mj.cli.main import main
from ffsm_mj.experiments.campaign import Campaign
from ffsm_mj.experiments.executors import Loop
from tests.experiments.files import campaign_file
from tests.simulation.test_accuracy import whirling


@pytest.mark.long
@pytest.mark.parametrize(("truncated", "failed"), [({}, 0), ({"truncated": "fail"}, 3)], ids=["count", "fail"])
def test_as_the_campaign_says(tmp_path, capsys, truncated, failed):
    whirling(tmp_path, duration_s=0.1)
    path = campaign_file(
        tmp_path,
        {"initial.rates.elbow": {"uniform": [-8.0, -6.0]}},
        {"kind": "random", "n": 3, "seed": 1},
        success="impacts.count == 0",
        limits={"max_failed": 1.0, "workers": 1},
        metrics=["fails_by_truncation", "passes"],
        **truncated,
    )
    assert main(["campaign", "run", str(path), "--out", str(tmp_path / "out")]) == 0
    assert (f"{failed} failed" in capsys.readouterr().out) == (failed > 0)
    assert main(["campaign", "report", str(tmp_path / "out")]) == 0
    page = (tmp_path / "out" / "report.md").read_text()
    assert f"| success | {3 - failed} of 3 |" in page
    assert "a check fails by the truncation of the step alone (remedy: accuracy in the scenario) | 3 of 3" in page
    # Drift of all runs: 1e-6 of energy and momenta, a thousand times what is allowed, whether they count or not.
    drift = float(page.partition("over (1 + scale): at most ")[2].split()[0].rstrip("."))
    assert drift > 1e-8
    assert main(["campaign", "rerun", str(tmp_path / "out"), "0"]) == 0


def told(campaign):
    """What of the rows must be the same wherever they are made."""
    return [(row.index, row.outcome, dict(row.metrics)) for row in campaign.rows()]


def fast_runs(folder):
    """Three runs at up to 10 rad/s and steps of 5 to 50 ms: the first have a verdict after 7 steps each, the last none."""
    whirling(folder, duration_s=0.1, control_period_s=0.1)
    steps = {"time_step_s": {"values": [0.005, 0.01, 0.05]}}
    metrics = ["fails_by_truncation", "passes"]
    return campaign_file(folder, steps, {"kind": "grid"}, limits={"max_failed": 1.0}, metrics=metrics)


@pytest.mark.long
def test_rows_and_reruns_do_not_depend_on_where_they_are_made(tmp_path):
    """The budget is counted in steps: a loop, a pool and a rerun have one verdict; one without a verdict fails."""
    found = []
    for name, how in (("loop", {"executor": Loop()}), ("pool", {"workers": 2})):
        campaign = Campaign.load(fast_runs(tmp_path), tmp_path / name)
        campaign.run(**how)
        found.append(told(campaign))
    loop, pool = found
    assert loop == pool
    assert [row[2]["fails_by_truncation"] for row in loop] == [True, True, None]
    assert [row[2]["passes"] for row in loop] == [True, True, False]
    again = Campaign.load(fast_runs(tmp_path), tmp_path / "loop")
    assert [again.rerun(index).deviations for index in range(3)] == [(), (), ()]
    (message,) = again.status().messages
    assert message.startswith("run 2: checks fail: ")
    assert message.endswith("; truncation: not analysed")
