"""Results of studies that were never run: tables of known content."""

from __future__ import annotations

from typing import Any

from ffsm_mj.campaign.evaluation.results import Results
from ffsm_mj.studies.config import StudyFile
from ffsm_mj.studies.results import StudyResults


def study_results(
    variants: dict[str, list[dict[str, Any]]], metrics: tuple[str, ...] = ("y",), **config: Any
) -> StudyResults:
    """Results whose variants have these rows, with as many runs as the longest."""
    stated = {
        "study": "made-up",
        "scenario": "baseline",
        "samples": {"kind": "random", "n": 8},
        "dispersions": {"duration_s": {"uniform": [1.0, 2.0]}},
        "variants": {name: {} for name in variants},
    }
    runs = max(map(len, variants.values()))
    rows = {name: Results(name, "random", runs, runs, ("x",), metrics, each) for name, each in variants.items()}
    return StudyResults(StudyFile.model_validate(stated | config), rows, {})
