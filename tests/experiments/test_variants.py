"""Variants with the same samples, compared run by run, in one folder that is resumed."""

from __future__ import annotations

import json
import math
import sqlite3
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ffsm_mj.analysis.run import Run
from ffsm_mj.errors import InputError
from ffsm_mj.experiments.campaign import Campaign
from ffsm_mj.experiments.comparison import compare_variants
from ffsm_mj.experiments.executors import loop
from ffsm_mj.experiments.planning import load_campaign
from tests.experiments.made_up import row, variant_results
from tests.experiments.variant_files import HALF, variants_file
from tests.scenes import two_balls

IMPULSE = "impacts.0.impulse_N_s"


def made(path: Path, out: Path, **more: Any) -> Campaign:
    """A campaign, run in this process."""
    campaign = Campaign.load(path, out, **more)
    campaign.run(loop().open())
    return campaign


def table(campaign: Campaign) -> list[dict[str, Any]]:
    """Rows without the cost of the runs, by variant and run."""
    rows = [{key: value for key, value in each.items() if key not in ("wall_s", "cpu_s")} for each in campaign.table_rows()]
    return sorted(rows, key=lambda each: (each["variant"], each["run"]))


@pytest.mark.long
def test_variants_have_the_same_samples_and_the_differences_of_a_closed_form(tmp_path: Path) -> None:
    """Impulse 1.2 (1 + e) v: at equal speeds e = 0.5 gives 0.6 v less than e = 1; equal variants differ by exactly 0."""
    campaign = made(variants_file(tmp_path, {"elastic": {}, "again": {}, "half": HALF}), tmp_path / "out")
    speeds = [each["initial.rates.robot/x"] for each in campaign.table_rows() if each["variant"] == "elastic"]
    assert all(
        [each["initial.rates.robot/x"] for each in campaign.table_rows() if each["variant"] == name] == speeds
        for name in campaign.variants
    )
    comparison = compare_variants(campaign.variant_results())
    less = comparison.pair("elastic", "half").differences[IMPULSE]
    assert less.mean == pytest.approx(-0.6 * np.mean(speeds), rel=1e-12)
    assert (less.sign, less.n) == (-1, 8)
    same = comparison.pair("elastic", "again").differences[IMPULSE]
    assert (same.mean, same.low, same.high, same.lower, same.higher, same.sign) == (0.0, 0.0, 0.0, 0, 0, 0)
    assert comparison.pair("half", "elastic").differences[IMPULSE].mean == -less.mean


def test_noise_follows_the_number_of_the_run_in_every_variant(tmp_path: Path) -> None:
    """A variant with a scenario of its own has the seed of the first variant, unless it sets one."""
    two_balls(tmp_path, restitution=1.0, duration_s=0.4, seed=5).rename(tmp_path / "other.yaml")
    own = {"scenario": "other.yaml", "overrides": {"seed": 9}}
    plan = load_campaign(variants_file(tmp_path, {"first": {}, "second": {"scenario": "other.yaml"}, "third": own}))
    assert [each.base.scenario.seed for each in plan.variants.values()] == [0, 0, 9]


@pytest.mark.long
def test_the_order_of_variants_and_a_resumed_study_change_nothing(tmp_path: Path) -> None:
    variants: dict[str, Any] = {"elastic": {}, "half": HALF}
    whole = made(variants_file(tmp_path / "a", variants), tmp_path / "a/out")
    turned = made(variants_file(tmp_path / "b", dict(reversed(variants.items()))), tmp_path / "b/out")
    assert [*turned.variants] == ["half", "elastic"]
    assert table(turned) == table(whole)
    one, other = (compare_variants(each.variant_results()).pair("elastic", "half") for each in (whole, turned))
    assert one == other
    before = table(whole)
    for name, first in (("elastic", 5), ("half", 0)):
        with sqlite3.connect(whole.variants[name].folder.table) as db:
            db.execute("DELETE FROM rows WHERE i >= ?", (first,))
    again = Campaign.open(tmp_path / "a/out")
    assert len(again.table_rows()) == 5
    again.run(loop().open())
    assert table(again) == before


@pytest.mark.long
def test_a_changed_study_is_refused_with_what_changed(tmp_path: Path) -> None:
    out = tmp_path / "out"
    made(variants_file(tmp_path, {"elastic": {}, "half": HALF}), out)
    changed = {"overrides": {"contacts.rules.0.restitution": 0.6}}
    with pytest.raises(InputError, match=r"variants/half: .* other settings: .*restitution 0\.5 there, 0\.6 here"):
        Campaign.load(variants_file(tmp_path, {"elastic": {}, "half": changed}), out)
    with pytest.raises(InputError, match="holds the variants half, which the campaign file does not have"):
        Campaign.load(variants_file(tmp_path, {"elastic": {}, "other": HALF}), out)
    other_seed = variants_file(tmp_path, {"elastic": {}, "half": HALF}, samples={"kind": "random", "n": 8, "seed": 2})
    with pytest.raises(InputError, match="seed 1 there, 2 here"):
        Campaign.load(other_seed, out)
    more = made(variants_file(tmp_path, {"third": HALF, "elastic": {}, "half": HALF}), out)
    assert [*more.variants] == ["third", "elastic", "half"]
    assert {name: each.done for name, each in more.status().variants.items()} == {"third": 8, "elastic": 8, "half": 8}


def test_two_campaigns_in_one_folder_are_refused(tmp_path: Path) -> None:
    path = variants_file(tmp_path, {"elastic": {}, "half": HALF})
    campaign = Campaign.load(path, tmp_path / "out")
    with campaign.folder.locked(), pytest.raises(InputError, match="another process is running this campaign"):
        Campaign.open(tmp_path / "out").run(loop().open())
    (tmp_path / "out/variants/half").rename(tmp_path / "moved")
    (tmp_path / "out/variants/half").symlink_to(tmp_path / "moved")
    with pytest.raises(InputError, match="half: is a symbolic link"):
        Campaign.open(tmp_path / "out").run(loop().open())
    (tmp_path / "other").mkdir()
    (tmp_path / "other/notes.txt").write_text("mine")
    with pytest.raises(InputError, match=r"holds notes\.txt but no campaign"):
        Campaign.load(path, tmp_path / "other")


@pytest.mark.long
def test_a_law_that_cannot_be_created_is_not_applicable(tmp_path: Path) -> None:
    """Listed with the reason, never compared; a law with an invalid key is bad input."""
    laws = {
        "none": {},
        "pushed": {"controllers": {"coast": {"kind": "task_ct", "position": {"kp_1_s2": 1.0, "kd_1_s": 1.0}}}},
    }
    campaign = made(variants_file(tmp_path, laws | {"half": HALF}), tmp_path / "out")
    assert [*campaign.variants] == ["none", "half"]
    assert "task" in campaign.not_applicable["pushed"]
    assert len(compare_variants(campaign.variant_results()).pairs) == 1
    laws["pushed"]["controllers"]["coast"]["kp"] = 2.0
    with pytest.raises(InputError, match=r"campaign\.yaml:\d+:\d+: variants\.pushed\.controllers\.coast: .*unknown key"):
        Campaign.load(variants_file(tmp_path, laws), tmp_path / "bad")


def raising(run: Run) -> float:
    """Fails where the impulse is large."""
    impulse = float(run.summary()["impacts"][0]["impulse_N_s"])
    return 1.0 if impulse < 2.4 else 1.0 // 0.0


@pytest.mark.long
def test_metrics_of_a_caller_that_fail_are_named_and_stop_nothing(tmp_path: Path) -> None:
    metrics = {"raising": raising, "nowhere": lambda _: math.nan, "nothing": lambda _: None, "speed": lambda _: 2}
    path = variants_file(tmp_path, {"elastic": {}, "half": HALF}, metrics=["speed"])
    campaign = made(path, tmp_path / "out", metrics=metrics)
    results = campaign.variant_results()
    faults = {(metric, variant): runs for metric, variant, runs, _ in results.metric_faults()}
    assert {*faults} == {("raising", "elastic"), ("nowhere", "elastic"), ("nowhere", "half")}
    said = "\n".join(campaign.sentences())
    assert "metric raising has no value in run" in said
    assert "ZeroDivisionError" in said
    assert "metric nowhere has no value in run 0 and 7 more of half: not a finite number: nan" in said
    assert all(each.failed == 0 and each.done == 8 for each in campaign.status().variants.values())
    pair = compare_variants(results).pair("elastic", "half")
    assert pair.differences["raising"].n == 8 - len(faults["raising", "elastic"])
    assert pair.differences["speed"].first == 2.0
    with pytest.raises(InputError, match=r"metrics of a script are needed to run it \(raising, nowhere, nothing, speed\)"):
        Campaign.open(tmp_path / "out").run(loop().open())
    assert len(Campaign.open(tmp_path / "out").table_rows()) == 16


FILE = """
def momentum(run):
    return 2.0 * run.summary()["impacts"][0]["impulse_N_s"]

def _hidden(a, b):
    return a
"""


@pytest.mark.long
def test_a_file_of_metrics_is_named_by_the_study_and_copied(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(FILE)
    path = variants_file(tmp_path, {"elastic": {}, "half": HALF}, metrics={"file": "mine.py", "names": [IMPULSE]})
    campaign = made(path, tmp_path / "out")
    for each in campaign.table_rows():
        assert each["momentum"] == 2.0 * each[IMPULSE]
    (tmp_path / "mine.py").write_text(FILE.replace("2.0 *", "3.0 *"))
    with pytest.raises(InputError, match=r"metrics of mine\.py are needed to run it \(momentum\)"):
        Campaign.open(tmp_path / "out").run(loop().open())
    with pytest.raises(InputError, match=r"metric functions\.momentum\.2 "):
        Campaign.open(tmp_path / "out", metrics=tmp_path / "mine.py").run(loop().open())
    (tmp_path / "mine.py").write_text(FILE)
    again = Campaign.open(tmp_path / "out", metrics=tmp_path / "mine.py").rerun(3, "half")
    assert again.verdict == "run 3 agrees with its row bit for bit"
    (tmp_path / "mine.py").write_text(FILE.replace("2.0 *", "3.0 *"))
    with pytest.raises(InputError, match=r"metric functions\.momentum\.2 .*2\.0 \*.* there, .*3\.0 \*"):
        Campaign.load(path, tmp_path / "out")
    for text, message in (
        ("def f(:", r"mine\.py:1:7: is not Python"),
        ("def f(a, b): return 1", r"mine\.py:1:1: f is no metric"),
        ("x = 1", "defines no metric"),
        ("def drift(run): return 1", "drift is a built-in metric"),
        ("1 / 0\ndef f(run): return 1", r"mine\.py: cannot be executed \(ZeroDivisionError.*mine\.py:1"),
    ):
        (tmp_path / "mine.py").write_text(text)
        with pytest.raises(InputError, match=message):
            Campaign.load(path, tmp_path / "fresh")


def test_faults_of_a_study_file_name_the_place(tmp_path: Path) -> None:
    def fault(**changed: Any) -> str:
        with pytest.raises(InputError) as raised:
            Campaign.load(variants_file(tmp_path, **{"variants": {"a": {}, "b": HALF}} | changed), tmp_path / "out")
        return str(raised.value)

    assert "campaign.yaml:" in fault(variants={"a": {}})
    assert "needs at least 2" in fault(variants={"a": {}})
    assert "variants.b.overides: unknown key" in fault(variants={"a": {}, "b": {"overides": {}}})
    assert "objectives" in fault(objectives={IMPULSE: "least"})
    assert "'minimize' or 'maximize'" in fault(objectives={IMPULSE: "least"})
    assert "reference: unknown variant 'c'; allowed: a, b" in fault(reference="c")
    assert "metrics: should be a list of names, or a mapping" in fault(metrics=5)
    axes = {"error": IMPULSE, "effort": "steps"}
    assert "pareto.effort: less of steps is better" in fault(pareto=axes, objectives={"steps": "maximize"})
    assert "unknown metric" in fault(objectives={"impulse": "minimize"})
    assert "metrics.0: unknown metric" in fault(metrics=["impulse"])
    assert "variants.b.overrides" in fault(variants={"a": {}, "b": {"overrides": {"duration": 3}}})
    assert not (tmp_path / "out/record.json").exists()


def test_success_and_violated_checks_are_counted_apart() -> None:
    """A run that meets the condition with a violated check is no success, and is not compared."""
    rows = [
        row(0, success=True, y=1.0),
        row(1, success=False, y=1.0, failed=True),
        row(2, success=False, y=9.0),
        row(3, success=False, outcome="diverged"),
    ]
    results = variant_results({"a": rows, "b": [row(i, success=True, y=0.0) for i in range(4)]}, success="y < 5")
    assert results.met("a").tolist() == [True, True, False, False]
    (left_out,) = [line for line in compare_variants(results).sentences() if line.startswith("a: ")]
    assert left_out.startswith("a: of 4 runs 1 ended with diverged and 1 violates a check;")
    pair = compare_variants(results).pair("a", "b")
    assert (pair.common, pair.compared) == (4, 2)
    assert (pair.differences["y"].n, pair.differences["y"].mean) == (2, -5.0)
    assert (pair.differences["success"].n, pair.differences["success"].mean) == (4, 0.75)


@pytest.mark.long
@pytest.mark.parametrize("shift", [0.0, 1.0])
def test_a_winner_is_shown_as_often_as_the_level_says(shift: float) -> None:
    """60 campaigns of 3 variants with 20 runs each: without a shift a winner by chance, with one in most of them.

    Without a shift a winner must win two correlated comparisons, each by chance in 2.5 %: in fewer than 3 x 2.5 % of the
    campaigns, plus three deviations of 3.4 %. A shift of 1 among differences of deviation sqrt(2) is 3.2 of those of a mean
    of 20: seen in 86 % of the comparisons, in both in more than 75 %, less three deviations of 5 %.
    """
    rng = np.random.default_rng(7)
    winners = []
    for _ in range(60):
        values = {name: rng.normal(size=20) - (shift if name == "b" else 0.0) for name in "abc"}
        results = variant_results({name: [row(i, y=float(y)) for i, y in enumerate(each)] for name, each in values.items()})
        ranking = compare_variants(results).ranking("y", "minimize")
        assert ranking is not None
        winners.append(ranking.best)
    if shift:
        assert winners.count("b") >= 36
    else:
        assert len(winners) - winners.count("") <= 10


def test_the_record_of_a_folder_is_validated(tmp_path: Path) -> None:
    campaign = Campaign.load(variants_file(tmp_path, {"a": {}, "b": HALF}), tmp_path / "out")
    wrong = {"format": 1, "not_applicable": {"a": 1}, "metrics": [], "metrics_file": ""}
    for content in ("{", "[]", json.dumps({"format": 9}), json.dumps(wrong)):
        (campaign.folder.path / "record.json").write_text(content)
        with pytest.raises(InputError, match=r"record\.json: is not the record of a campaign"):
            Campaign.open(tmp_path / "out")
    with pytest.raises(InputError, match="no such campaign folder"):
        Campaign.open(tmp_path / "nothing")
