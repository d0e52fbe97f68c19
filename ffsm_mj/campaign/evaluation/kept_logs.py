"""Choice of the runs whose logs are kept: failures, and the runs with the largest values of metrics."""

from __future__ import annotations

from collections.abc import Sequence

from ffsm_mj.campaign.plan.config import KeepConfig
from ffsm_mj.campaign.storage.outcomes import RETRIED
from ffsm_mj.campaign.storage.store import RunRow


def runs_to_keep(rows: Sequence[RunRow], keep: KeepConfig) -> list[int]:
    """Indices of the runs whose logs the campaign file asks for; runs without a result have no log.

    Args:
        rows: All rows, in the order of their indices.
        keep: Entry ``keep`` of the campaign file.
    """
    ended = [row for row in rows if row.outcome not in RETRIED]
    wanted = [row.index for row in ended if row.failed][: keep.failures]
    for metric, count in keep.worst.items():
        known = [row for row in ended if isinstance(row.metrics.get(metric), int | float)]
        wanted += [row.index for row in sorted(known, key=lambda row: -row.metrics[metric])[:count]]
    return list(dict.fromkeys(wanted))
