"""Results of variants that were never run: tables of known content."""

from __future__ import annotations

from typing import Any

from ffsm_mj.experiments.comparison import VariantResults
from ffsm_mj.experiments.file import CampaignFile
from ffsm_mj.experiments.results import Results


def variant_results(
    variants: dict[str, list[dict[str, Any]]], metrics: tuple[str, ...] = ("y",), **config: Any
) -> VariantResults:
    """Results whose variants have these rows, with as many runs as the longest."""
    stated = {
        "campaign": "made-up",
        "scenario": "baseline",
        "samples": {"kind": "random", "n": 8},
        "dispersions": {"duration_s": {"uniform": [1.0, 2.0]}},
        "variants": {name: {} for name in variants},
    }
    runs = max(map(len, variants.values()))
    rows = {name: Results(name, "random", runs, runs, ("x",), metrics, each) for name, each in variants.items()}
    return VariantResults(CampaignFile.model_validate(stated | config), rows, {})
