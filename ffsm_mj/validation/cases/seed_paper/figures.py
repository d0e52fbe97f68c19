"""The report's own figures: what the step size changes, and the drift after an impact."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ffsm_mj.report.plots.style import BLUE, GREEN, VERMILION, WIDTH_IN, publication, write
from ffsm_mj.validation.case import Number
from ffsm_mj.validation.cases.seed_paper.drift import DriftExperiment
from ffsm_mj.validation.cases.seed_paper.printed import PRINTED
from ffsm_mj.validation.cases.seed_paper.runs import THRESHOLD, PaperRun, Result, decided_runs

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_GREY = "#666666"
_STEPS = (("1 ms", "o", BLUE), ("0.5 ms", "s", VERMILION), ("0.25 ms", "D", GREEN))


def save_study(results: Mapping[PaperRun, Result], path: Path) -> None:
    """Deviation of every run of the study from every printed number, in units of what the print leaves open."""
    shown = [n for n in PRINTED if not (n.approximate or n.at_most or "misprint" in n.known)]
    with publication():
        figure, axes = _figure(0.155 * len(shown) + 1.2)
        axes.axvspan(-1.0, 1.0, color="#E8E8E8", zorder=0, label="what the print leaves open")
        for i, (label, marker, colour) in enumerate(_STEPS):
            values = [results[decided_runs(n.scenario)[i]].values[n.key] for n in shown]
            _dots(axes, shown, values, marker, colour, f"step and control period {label}")
        declared = [results[THRESHOLD].values.get(n.key, np.nan) if n.scenario == "baseline" else np.nan for n in shown]
        _dots(axes, shown, declared, "x", _GREY, "1 ms, impact declared at the first step within 1 mm")
        axes.set_xscale("symlog", linthresh=2.0, linscale=1.0)
        axes.set_xlim(-30.0, 40.0)
        ticks = (-20, -10, -5, -2, -1, 0, 1, 2, 5, 10, 20)
        axes.set_xticks(ticks, labels=map(str, ticks))
        axes.set_yticks(range(len(shown)), labels=[f"{n.section}  {n.name}" for n in shown], fontsize=7.0)
        axes.set_ylim(len(shown) - 0.4, -0.6)
        axes.set_xlabel("ours minus printed, in half units of the last printed digit")
        figure.legend(loc="outside upper center", ncols=2, fontsize=7.5)
        write(figure, path.parent, path.stem, (path.suffix[1:],))


def save_drift(drifts: Mapping[str, DriftExperiment], path: Path) -> None:
    """Tip error of long runs, and below what it cannot be whatever the arm does."""
    with publication():
        figure, axes = _figure(3.4)
        for (label, drift), colour in zip(drifts.items(), (VERMILION, BLUE, GREEN), strict=True):
            axes.semilogy(drift.time_s, drift.error_m, color=colour, linewidth=1.4, label=label)
            bound = np.where(drift.bound_m > 0.0, drift.bound_m, np.nan)
            axes.semilogy(drift.time_s, bound, color=colour, linewidth=1.1, linestyle=(0, (4, 2)))
        axes.plot([], [], color=_GREY, linewidth=1.1, linestyle=(0, (4, 2)), label="no arm controller can stay below")
        axes.set_xlabel("time, s")
        axes.set_ylabel("distance of the tip from its target, m")
        axes.set_xlim(0.0, 120.0)
        axes.set_ylim(2e-5, 30.0)
        figure.legend(loc="outside upper center", ncols=2)
        write(figure, path.parent, path.stem, (path.suffix[1:],))


def _dots(axes: Any, shown: Sequence[Number], values: Sequence[float], marker: str, colour: str, label: str) -> None:
    away = [(value - number.value) / number.allowed for value, number in zip(values, shown, strict=True)]
    axes.plot(away, range(len(shown)), marker, color=colour, markersize=3.6, markerfacecolor="none", label=label)


def _figure(height_in: float) -> tuple[Figure, Any]:
    from matplotlib.figure import Figure  # not pyplot: nothing global, no display

    figure = Figure(figsize=(WIDTH_IN, height_in))
    return figure, figure.subplots()
