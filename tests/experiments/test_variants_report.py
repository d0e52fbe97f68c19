"""The report of a campaign: tables, sentences and figures of known content."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ffsm_mj.cli.main import main
from ffsm_mj.experiments.comparison import compare_variants
from ffsm_mj.experiments.figures import pareto_front, save_variant_figures
from ffsm_mj.experiments.page import report_page
from tests.experiments.made_up import row, variant_results
from tests.experiments.variant_files import HALF, variants_file


def shifted(shift: dict[str, float], n: int = 16, **config: Any) -> Any:
    """Variants whose metric y is that of a common sample, shifted, with a small own part."""
    rng = np.random.default_rng(2)
    common = rng.normal(size=n)
    variants = {
        name: [row(i, success=bool(y < 3.0), x=float(common[i]), y=float(y), z=5.0 - float(y)) for i, y in enumerate(values)]
        for name, each in shift.items()
        for values in [common + each + 0.1 * rng.normal(size=n)]
    }
    return variant_results(variants, metrics=("y", "z"), **config)


def said(results: Any) -> list[str]:
    return compare_variants(results).sentences()


def test_the_sentences_follow_from_the_intervals() -> None:
    goals = {"objectives": {"y": "minimize"}}
    assert said(shifted({"a": 0.0, "b": -1.0, "c": 1.0}, **goals)) == ["y (minimize): b has less than every other variant."]
    assert said(shifted({"a": 0.0, "b": 0.0}, **goals)) == ["y (minimize): no difference is shown between a and b."]
    tied = "no variant has the least: none is shown to be better than a and b; c is shown to be worse than another."
    assert said(shifted({"a": 0.0, "b": 0.0, "c": 1.0}, **goals)) == [f"y (minimize): {tied}"]
    assert said(shifted({"a": 0.0, "b": -1.0}, objectives={"y": "maximize"})) == [
        "y (maximize): a has more than every other variant."
    ]
    against = "y (minimize): better than b: c; worse than b: a."
    assert said(shifted({"a": 1.0, "b": 0.0, "c": -1.0}, reference="b", **goals)) == [against]
    few = "y (minimize): nothing is shown by 5 runs; 6 or more are needed."
    assert said(shifted({"a": 0.0, "b": -1.0}, n=5, **goals)) == [few]


def test_runs_that_fail_are_named_and_left_out() -> None:
    good = [row(i, y=1.0) for i in range(8)]
    bad = [row(i, y=0.0, outcome="diverged" if i < 2 else "completed", failed=i < 3) for i in range(7)]
    results = variant_results({"good": good, "bad": bad}, objectives={"y": "minimize"})
    assert said(results) == [
        "y (minimize): nothing is shown by 4 runs; 6 or more are needed.",
        "bad: of 8 runs 1 has no result yet, 2 ended with diverged and 1 violates a check; metrics are compared over runs "
        "that completed and pass their checks in both variants.",
    ]


def test_the_front_has_what_nothing_beats_in_both() -> None:
    points = {"a": (1.0, 3.0), "b": (2.0, 2.0), "c": (3.0, 1.0), "worse": (2.0, 2.5), "same": (2.0, 2.0)}
    assert pareto_front(points) == ["a", "b", "c", "same"]


@pytest.mark.long
def test_figures_and_page(tmp_path: Path) -> None:
    results = shifted(
        {"a": 0.0, "b": -1.0, "c": 1.0}, success="y < 3", pareto={"error": "y", "effort": "z"}, description="<i>|"
    )
    comparison = compare_variants(results)
    made = save_variant_figures(comparison, tmp_path)
    assert [name for _, name in made] == ["pareto.png", "differences.png"]
    before = {name: (tmp_path / name).read_bytes() for _, name in made}
    save_variant_figures(comparison, tmp_path)
    assert {name: (tmp_path / name).read_bytes() for _, name in made} == before
    assert "<i>" not in report_page(results, comparison, made)


@pytest.mark.long
def test_the_report_of_a_study(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "mine.py").write_text("def twice(run):\n    return 2 * run.summary()['impacts'][0]['impulse_N_s']\n")
    goals = {"objectives": {"twice": "minimize"}, "metrics": {"file": "mine.py"}, "success": "twice < 5"}
    path = variants_file(tmp_path, {"elastic": {}, "half": HALF}, **goals)
    out = str(tmp_path / "out")
    assert main(["campaign", "run", str(path), "--out", out, "--workers", "1"]) == 0
    ran = capsys.readouterr().out.splitlines()
    assert "twice (minimize): half has less than every other variant." in ran
    assert main(["campaign", "report", out]) == 0
    assert capsys.readouterr().out.splitlines()[:-1] == ran[:-2]
    whole, text = (tmp_path / "out/report.html").read_text(), (tmp_path / "out/report.md").read_text()
    assert whole.count("data:image/png;base64,") == text.count("![") == 1
    assert not re.search(r'(src|href)="(?!data:)', whole)
    assert "- twice (minimize): half has less than every other variant." in text
    assert (tmp_path / "out/results.csv").read_text().startswith('"variant","run"')
    assert main(["campaign", "resume", out]) == 2
    assert "metrics of mine.py are needed to run it (twice); give --metrics" in capsys.readouterr().err
    assert main(["campaign", "resume", out, "--metrics", str(tmp_path / "mine.py")]) == 0
