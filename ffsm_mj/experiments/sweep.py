"""Small campaigns in one function call: all combinations of given values, one table."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ffsm_mj.assembly.prepare import Scenario
from ffsm_mj.experiments.campaign import Campaign
from ffsm_mj.scenario.shipped import scenario_path

_DEFAULT = ("impacts.0.time_s", "impacts.0.impulse_N_s", "tip.min_error_m", "tip.final_error_m")


def sweep(
    scenario: Scenario | Mapping[str, Any] | str | Path,
    values: Mapping[str, Sequence[Any]],
    *,
    metrics: Sequence[str] = _DEFAULT,
    overrides: Mapping[str, Any] = MappingProxyType({}),
    controllers: Mapping[str, Any] = MappingProxyType({}),
    estimators: Mapping[str, Any] = MappingProxyType({}),
    workers: int | None = None,
    out: str | Path | None = None,
) -> Any:
    """Run a scenario with every combination of given values.

    Works in a script without a main guard, from standard input and in a notebook.

    Args:
        scenario: See :func:`ffsm_mj.run`.
        values: Values by dotted key of the scenario.
        metrics: Metrics of each run; see docs/campaigns.md.
        overrides: Overrides of the scenario for all runs, by dotted key.
        controllers: Control laws of the caller, classes by kind.
        estimators: Estimators of the caller, likewise.
        workers: Number of processes; None: one per processor.
        out: Folder of the campaign, continued if it holds the same campaign; None: only the table is kept.

    Returns:
        A ``pyarrow.Table`` with a row per run; its method ``to_pandas`` gives a data frame.

    Raises:
        InputError: A key, a value or a metric is invalid.
    """
    keys = {
        "campaign": "sweep",
        "scenario": str(scenario_path(scenario).resolve()) if isinstance(scenario, str | Path) else scenario,
        "overrides": overrides,
        "samples": {"kind": "grid"},
        "dispersions": {key: {"choice": each} for key, each in values.items()},
        "metrics": list(metrics),
        "limits": {"max_failed": 1.0},
    }
    with tempfile.TemporaryDirectory(prefix="ffsm-sweep-") as temporary:
        campaign = Campaign.load(keys, out or temporary, controllers=controllers, estimators=estimators)
        campaign.run(workers=workers)
        return campaign.table()
