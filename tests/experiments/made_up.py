"""Results of campaigns that were never run: tables of known content."""

from __future__ import annotations

from typing import Any

from ffsm_mj.experiments.results import Results


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
    return Results(name="made-up", kind=kind, n=n or len(rows), rows=rows, **told)
