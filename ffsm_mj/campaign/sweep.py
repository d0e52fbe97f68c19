"""A small campaign in one call: every combination of some values, one table."""

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
from ffsm_mj.campaign.plan.loading import planned
from ffsm_mj.scenario.shipped import scenario_path
from ffsm_mj.scenario.source import source_of, write_yaml
from ffsm_mj.yaml.parser import parse

_DEFAULT = ("impacts.0.time_s", "impacts.0.impulse_N_s", "tip.min_error_m", "tip.final_error_m")


def sweep(
    scenario: str | Path,
    values: Mapping[str, Sequence[Any]],
    *,
    metrics: Sequence[str] = _DEFAULT,
    overrides: Mapping[str, Any] = MappingProxyType({}),
    controllers: Mapping[str, Any] = MappingProxyType({}),
    workers: int | None = None,
    out: str | Path | None = None,
) -> Any:
    """Run a scenario with every combination of some values.

    Works in a script without a main guard, from standard input and in a notebook.

    Args:
        scenario: A file, or the name of a shipped scenario.
        values: Values to take by dotted key of the scenario.
        metrics: What is kept of each run; see docs/campaigns.md.
        overrides: Values that all runs take, by dotted key.
        controllers: Control laws of the caller's own, classes by kind.
        workers: Processes; None: as many as there are processors.
        out: Folder of the campaign; one that holds the same is gone on with. None keeps only the table.

    Returns:
        A ``pyarrow.Table`` with a row per run; ``to_pandas()`` makes it a data frame.

    Raises:
        InputError: A key, a value or a metric is wrong.
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
    name = Path("sweep")  # stands for the file in what is said of faults
    plan = planned(source_of(parse(write_yaml(stated), name), name), controllers)
    with ExitStack() as stack:
        if out is None:
            out = stack.enter_context(tempfile.TemporaryDirectory(prefix="ffsm-sweep-"))
        campaign = Campaign.begin(plan, Path(out), controllers)
        here = [kind for kind, law in controllers.items() if not importable(law)]
        if here:
            print(
                f"sweep: {', '.join(here)} cannot be imported by other processes, so all runs are made in this one",
                file=sys.stderr,
            )
        campaign.run(workers=workers)
        return campaign.table()


def _plain(value: Any) -> Any:
    """Numbers of numpy as those of Python, at any depth."""
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value
