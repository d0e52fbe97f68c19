"""The shipped campaign: its first rows, made again, are those that its page was written from."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import pytest

from ffsm_mj.experiments.campaign import Campaign
from ffsm_mj.experiments.worker import TOLERANCE

ROWS = Path(__file__).parents[2] / "docs" / "campaign-rows.csv"
WORDS = ("outcome", "message", "phase", "failed", "success", "checks_pass", "fails_by_truncation", "passes")
ROUNDING = ("checks.", "drift", "deepest_overlap_m", "wall_s", "cpu")
"""Residuals and what a row cost differ from machine to machine."""


@pytest.mark.long
@pytest.mark.parametrize("rows", [1, 8])
def test_the_first_rows_of_the_page_are_made_again(tmp_path: Path, rows: int) -> None:
    """On another machine, or with another compiler, numbers differ by rounding; runs are short of chaos."""
    page = list(csv.DictReader(ROWS.read_text().splitlines()))
    kept = page[:rows]
    campaign = Campaign.load("baseline-dispersed", tmp_path, overrides=[f"samples.n={rows}"])
    campaign.run(workers=min(rows, 2))
    made = campaign.table_rows()
    assert len(page) == 8
    assert len(made) == len(kept) == rows
    for before, now in zip(kept, made, strict=True):
        for name, text in before.items():
            value: Any = now[name]
            if name in WORDS:
                assert str(value).lower() == text.lower(), name
            elif not name.startswith(ROUNDING):
                assert value == pytest.approx(float(text), rel=TOLERANCE, abs=TOLERANCE), name
