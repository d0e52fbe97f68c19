"""Error and cost of the settings, as the JSON has them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

OURS = ("ffsm-mj", "compiled")
Setting = tuple[str, str]
Row = dict[str, Any]


@dataclass(frozen=True)
class Panel:
    """One scene judged by one error; errors at which costs are compared."""

    scene: str
    key: str
    title: str
    targets: tuple[float, ...]


PANELS = (
    Panel("collision, e = 1", "velocity", "collision, e = 1: velocities", (1e-2, 1e-4, 1e-6, 1e-12)),
    Panel("collision, e = 0.5", "velocity", "collision, e = 0.5: velocities", (1e-2, 1e-4, 1e-6, 1e-12)),
    Panel("collision, e = 0.5", "position_m", "collision, e = 0.5: positions, m", (1e-2, 1e-4, 1e-6, 1e-12)),
    Panel("grip", "slip_rate_m_s", "grip: slip, m/s", (1e-4, 1e-5, 1e-6, 1e-12)),
    Panel("flight", "position_m", "free flight: positions, m", (1e-2, 1e-4, 1e-6, 1e-9)),
    Panel("weld", "position_m", "weld: positions, m", (1e-2, 1e-4, 1e-6, 1e-9)),
)


def settings(rows: Iterable[Row], panel: Panel) -> dict[Setting, list[Row]]:
    """Runs of each setting that ended with numbers, in the order of the JSON."""
    found: dict[Setting, list[Row]] = {}
    for row in rows:
        if row["scene"] == panel.scene and panel.key in row["errors"]:
            found.setdefault((row["engine"], row["setting"]), []).append(row)
    return found


def best(runs: list[Row], panel: Panel) -> Row:
    """The run with the smallest error; of equal ones, and those at rounding, the cheapest."""
    return min(runs, key=lambda row: (max(row["errors"][panel.key], 1e-14), row["cost"]))


def cost_at(runs: list[Row], panel: Panel, target: float) -> float | None:
    """CPU s per simulated s of the cheapest run whose error is not greater; None: there is none."""
    return min((row["cost"] for row in runs if row["errors"][panel.key] <= target), default=None)


def cheapest(found: dict[Setting, list[Row]], panel: Panel, target: float) -> list[tuple[float, Setting]]:
    """Settings that reach an error, the cheapest first."""
    costs = ((cost_at(runs, panel, target), setting) for setting, runs in found.items())
    return sorted((cost, setting) for cost, setting in costs if cost is not None)
