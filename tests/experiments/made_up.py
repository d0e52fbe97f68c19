"""Results of campaigns that were never run: tables of known content."""

from __future__ import annotations

from typing import Any

from ffsm_mj.experiments.comparison import VariantComparison, compare_variants, refuse_other_samples
from ffsm_mj.experiments.file import CampaignFile
from ffsm_mj.experiments.results import Results, VariantResults, frame_of


def row(run: int, *, outcome: str = "completed", success: bool | None = None, **values: Any) -> dict[str, Any]:
    """A row; one with another outcome failed."""
    failed = values.pop("failed", outcome != "completed")
    head = {"run": run, "outcome": outcome, "failed": failed, "success": success, "message": "", "phase": "coast"}
    return head | values


def results(rows: list[dict[str, Any]], *, kind: str = "random", n: int | None = None, **more: Any) -> Results:
    """Results whose parameters and metrics are columns named ``x...`` and ``y...`` unless told otherwise."""
    names = list(dict.fromkeys(name for each in rows for name in each))
    told = {
        "parameters": tuple(name for name in names if name.startswith("x")),
        "metrics": tuple(name for name in names if name.startswith("y")),
        "runs": len(rows),
    } | more
    return Results(kind=kind, n=n or len(rows), frame=frame_of(rows), **told)


def config_of(**keys: Any) -> CampaignFile:
    """A campaign file with these keys."""
    stated = {
        "campaign": "made-up",
        "scenario": "baseline",
        "samples": {"kind": "random", "n": 8},
        "dispersions": {"duration_s": {"uniform": [1.0, 2.0]}},
    }
    return CampaignFile.model_validate(stated | keys)


def variant_results(
    variants: dict[str, list[dict[str, Any]]], metrics: tuple[str, ...] = ("y",), **config: Any
) -> VariantResults:
    """Results whose variants have these rows, with as many runs as the longest."""
    runs = max(map(len, variants.values()))
    rows = {name: Results("random", runs, runs, ("x",), metrics, frame_of(each)) for name, each in variants.items()}
    return VariantResults(config_of(variants={name: {} for name in variants}, **config), rows)


def compared(one: Results, other: Results, names: tuple[str, str]) -> VariantComparison:
    """Two campaigns run by run."""
    found = VariantResults(config_of(success="y1 < 1"), dict(zip(names, (one, other), strict=True)))
    refuse_other_samples(found)
    return compare_variants(found)
