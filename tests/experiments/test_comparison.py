"""Two campaigns with the same samples, run by run."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import t

import ffsm_mj
from ffsm_mj.errors import InputError
from ffsm_mj.experiments.campaign import Campaign
from ffsm_mj.experiments.executors import loop
from ffsm_mj.experiments.statistics import mean_interval
from tests.experiments.files import campaign_file
from tests.experiments.made_up import compared, results, row
from tests.scenes import two_balls

NAMES = ("one", "other")


def two(shift, spread, n=40):
    """Two campaigns whose runs differ by a shift among a spread of the samples that both share."""
    rng = np.random.default_rng(3)
    x, noise = rng.normal(size=n), rng.normal(size=n)
    one = results([row(i, x1=float(x[i]), y1=float(10.0 * x[i])) for i in range(n)])
    other = results([row(i, x1=float(x[i]), y1=float(10.0 * x[i] + shift + spread * noise[i])) for i in range(n)])
    return one, other


def difference(one, other):
    """Difference of the metric, other less one."""
    return compared(one, other, NAMES).pair(*NAMES).differences["y1"]


def test_a_small_shift_is_seen_through_a_large_spread_of_the_samples():
    """0.5 among samples that spread by 10: the interval of 40 differences is 1.96 / sqrt(40) to each side."""
    found = difference(*two(0.5, 1.0))
    assert found.sign == 1
    assert found.low < found.mean < found.high
    assert found.high - found.low == pytest.approx(2.0 * 1.96 / np.sqrt(40.0), rel=0.2)
    assert (found.lower + found.higher, found.n) == (40, 40)
    assert "more in other" in found.sentence(*NAMES)
    back = difference(*reversed(two(0.5, 1.0)))
    assert back.sign == -1


def test_no_campaign_wins_where_the_interval_contains_zero():
    found = difference(*two(0.0, 1.0))
    assert found.sign == 0
    assert found.low < 0.0 < found.high
    assert "no difference is shown" in found.sentence(*NAMES)
    same = difference(*two(0.0, 0.0))
    assert (same.mean, same.low, same.high, same.lower, same.higher) == (0.0, 0.0, 0.0, 0, 0)


@pytest.mark.long
def test_intervals_contain_the_mean_as_often_as_they_say():
    """Of 200 intervals of 16 normal values 190 contain the mean, and of 100 of 30 exponential ones 95.

    Within three deviations; samples as skewed as the latter are some percent short. The widths of the former are those of
    Student's intervals: their ratio is 1 in the mean, deviation 2 % for one interval; without the expansion for few
    values it is 0.89.
    """
    rng = np.random.default_rng(5)
    ratios = []
    for draw, n, number, short in ((rng.normal, 16, 200, 0), (lambda size: rng.exponential(size=size) - 1.0, 30, 100, 3)):
        samples = [draw(size=n) for _ in range(number)]
        intervals = [mean_interval(each) for each in samples]
        inside = sum(low <= 0.0 <= high for low, high in intervals)
        assert abs(inside - 0.95 * number + short) <= 3.0 * np.sqrt(number * 0.95 * 0.05) + short
        student = [2.0 * t.ppf(0.975, n - 1) * each.std(ddof=1) / np.sqrt(n) for each in samples]
        ratios.append(np.mean([(high - low) / each for (low, high), each in zip(intervals, student, strict=True)]))
    assert ratios[0] == pytest.approx(1.0, abs=0.02)
    assert mean_interval(np.array([1.0, 2.0])) == (1.0, 2.0)
    assert all(np.isnan(mean_interval(np.array([1.0]))))


def test_runs_are_counted_and_told_apart():
    """Good in one only, failed without a metric, missing in one: counted, and left out of the means."""
    one = results(
        [
            row(0, success=True, y1=1.0),
            row(1, success=False, y1=2.0),
            row(2, outcome="diverged", success=False),
            row(3, y1=9.0),
        ]
    )
    other = results([row(0, success=False, y1=2.0), row(1, success=True, y1=4.0), row(2, success=True, y1=1.0)])
    found = compared(one, other, NAMES).pair(*NAMES)
    assert (found.common, found.compared) == (3, 2)
    assert found.good == (0, 1, 2, 0)
    assert "good in both 0, in one only 1, in other only 2, in none 0" in found.goodness()
    assert (found.differences["y1"].n, found.differences["y1"].mean) == (2, 1.5)
    assert (found.differences["success"].n, found.differences["success"].mean) == (3, 1.0 / 3.0)
    assert "y2" not in found.differences


def test_other_samples_are_refused():
    one = results([row(0, x1=1.0, y1=1.0)])
    for other, message in (
        (results([row(0, x1=2.0, y1=1.0)]), "run 0: x1 is 1.0 in one and 2.0 in other"),
        (results([row(0, x2=1.0, y1=1.0)]), "do not have the same parameters: x1, x2"),
        (results([row(1, x1=1.0, y1=1.0)]), "no run in common"),
    ):
        with pytest.raises(InputError, match=message):
            compared(one, other, NAMES)


@pytest.mark.long
def test_campaigns_of_folders_are_compared(tmp_path):
    """The impulse of 2 kg on 3 kg is 1.2 (1 + e) v: at the same speeds it is lower by 0.6 v at e = 0.5 than at e = 1."""
    folders = []
    for name, restitution in (("elastic", 1.0), ("half", 0.5)):
        (tmp_path / name).mkdir()
        two_balls(tmp_path / name, restitution=restitution, duration_s=0.4)
        dispersed = {"initial.rates.robot/x": {"uniform": [0.9, 1.1]}}
        samples = {"kind": "random", "n": 8, "seed": 1}
        path = campaign_file(tmp_path / name, dispersed, samples, metrics=["impacts.0.impulse_N_s"])
        campaign = Campaign.load(path, tmp_path / name / "runs")
        campaign.run(loop().open())
        folders.append(campaign)
    found = ffsm_mj.compare_campaigns(folders[0], folders[1].folder.path)
    pair = found.pair("elastic/runs", "half/runs")
    impulse = pair.differences["impacts.0.impulse_N_s"]
    speeds = [speed for (speed,) in folders[0].design.rows]
    assert impulse.mean == pytest.approx(-0.6 * np.mean(speeds), rel=1e-12)
    assert (impulse.sign, impulse.lower, impulse.n) == (-1, 8, 8)
    assert pair.good == (8, 0, 0, 0)
    assert found.lines()[-2].startswith("elastic/runs and half/runs: 8 runs with the same samples, good in both 8")
    assert "less in half/runs" in found.lines()[-1]
