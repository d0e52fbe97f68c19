"""Small campaigns in one function call: all combinations of given values, one table."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from ffsm_mj.campaign.campaign import Campaign
from ffsm_mj.campaign.execution.engines import importable
from ffsm_mj.campaign.plan.loading import make_plan
from ffsm_mj.campaign.script_classes import ScriptClasses
from ffsm_mj.scenario.shipped import scenario_path
from ffsm_mj.scenario.source import source_of
from ffsm_mj.yaml.parser import parse, write_yaml

_DEFAULT = ("impacts.0.time_s", "impacts.0.impulse_N_s", "tip.min_error_m", "tip.final_error_m")


def sweep(
    scenario: str | Path,
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
        scenario: A file, or the name of a shipped scenario.
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
    stated = {
        "campaign": "sweep",
        "scenario": str(scenario_path(scenario).resolve()),
        "overrides": _plain(overrides),
        "samples": {"kind": "grid"},
        "dispersions": {key: {"choice": [_plain(value) for value in each]} for key, each in values.items()},
        "metrics": list(metrics),
        "limits": {"max_failed": 1.0},
    }
    own = ScriptClasses(dict(controllers), dict(estimators))
    name = Path("sweep")  # replaces the file name in messages
    plan = make_plan(source_of(parse(write_yaml(stated), name), name), own)
    with ExitStack() as stack:
        if out is None:
            out = stack.enter_context(tempfile.TemporaryDirectory(prefix="ffsm-sweep-"))
        campaign = Campaign.begin(plan, Path(out), own)
        here = [kind for kind, law in own.every.items() if not importable(law)]
        if here:
            print(
                f"sweep: {', '.join(here)} cannot be imported by other processes: all runs are executed in this one",
                file=sys.stderr,
            )
        campaign.run(workers=workers)
        return campaign.table()


def _plain(value: Any) -> Any:
    """Nested data with NumPy numbers converted to Python numbers."""
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value
