"""Metrics of other packages may be anything, and fail in any way: that is a row, or a null, and the table is made."""

from __future__ import annotations

import sys
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from ffsm_mj.errors import InputError
from ffsm_mj.experiments import metrics
from ffsm_mj.experiments.campaign import Campaign
from ffsm_mj.experiments.executors import loop
from tests.experiments.files import rock_hits

_TWO = {"kind": "random", "n": 2, "seed": 1}
Made = Callable[..., Campaign]


@pytest.fixture
def made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Made:
    """Runs two runs whose metric ``odd`` is what a function says."""

    def of(odd: Callable[[Any], Any], **more: Any) -> Campaign:
        monkeypatch.setattr(metrics, "plugin_metrics", lambda: {"odd": odd})
        path = rock_hits(tmp_path, **{"samples": _TWO, "metrics": ["odd"], "limits": {"max_failed": 1.0}, **more})
        campaign = Campaign.load(path, tmp_path / "out")
        campaign.run(loop().open())
        return campaign

    return of


def in_turn(*values: Any) -> Callable[[Any], Any]:
    """One of the values after the other."""
    calls = count()
    return lambda _: values[next(calls) % len(values)]


@pytest.mark.long
@pytest.mark.parametrize(
    ("values", "column"),
    [
        ((10**400, 1.0), [None, 1.0]),
        ((2**70, 1), [2.0**70, 1.0]),
        ((2**60 + 1, 1.5), [float(2**60), 1.5]),
        ((True, 1.5), [1.0, 1.5]),
        (("a", 1.5), ["a", "1.5"]),
        (("a\ud800", None), ["a\\ud800", None]),
    ],
)
def test_a_table_is_made_of_whatever_metrics_are(made: Made, values: tuple[Any, Any], column: list[Any]) -> None:
    campaign = made(in_turn(*values))
    assert campaign.status().outcomes == {"completed": 2}
    assert campaign.table().column("odd").to_pylist() == column


def test_a_text_fulfils_no_condition(made: Made) -> None:
    campaign = made(in_turn("a", 1), success="odd < 2")
    assert campaign.table().column("success").to_pylist() == [False, True]


def test_a_metric_that_leaves_is_an_error(made: Made) -> None:
    campaign = made(lambda _: sys.exit(3))
    assert campaign.status().outcomes == {"error": 2}
    assert campaign.rows()[0].message.startswith("SystemExit: 3 (test_odd_metrics.py:")


def test_a_run_whose_metric_fails_can_be_looked_at(made: Made) -> None:
    campaign = made(lambda _: 1 / 0)
    again = campaign.rerun(0)
    assert again.deviations == ()
    assert again.run.outcome == "completed"


def test_a_metric_that_no_run_has_is_no_quantile(made: Made) -> None:
    with pytest.raises(InputError, match="odd: no run that did not fail has a number for it"):
        made(lambda _: None).quantile("odd", 0.5)
