"""Figures of the groups of measured impacts."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.report.plots.style import BLACK, BLUE, COLOURS, VERMILION, WIDTH_IN, publication, write

Curves = Mapping[str, FloatArray]


def save_figure(name: str, curves: Curves, folder: Path) -> Path:
    """Draw the figure of a group into ``figures/`` of a folder; returns its path."""
    from matplotlib.figure import Figure

    with publication():
        figure = Figure(figsize=(WIDTH_IN, 3.2), layout="constrained")
        _DRAWN[name](figure.add_subplot(), curves)
        (folder / "figures").mkdir(exist_ok=True)
        (path,) = write(figure, folder / "figures", name, ("png",))
    return path


def _shares(axes: Any, curves: Curves) -> None:
    """Distributions of the errors of impacts."""
    for (name, errors), colour in zip(curves.items(), COLOURS, strict=False):
        axes.semilogx(np.sort(errors), np.linspace(0.0, 1.0, len(errors)), color=colour, linewidth=1.2, label=name)
    axes.set_xlim(1e-3, 1.0)
    axes.set_xlabel("error E")
    axes.set_ylabel("share of impacts")
    axes.legend()


def _times(axes: Any, curves: Curves) -> None:
    """Errors by time, the first curve."""
    (axis, times), *rest = curves.items()
    for (name, errors), colour in zip(rest, COLOURS, strict=False):
        axes.plot(times, errors, color=colour, linewidth=1.2, label=name)
    axes.set_xlabel(f"{axis} after the last frame of free flight")
    axes.set_ylabel("error of position, widths")
    axes.legend()


def _angles(axes: Any, curves: Curves) -> None:
    """Measured ratios of tangential speeds, and those of the laws."""
    axes.plot(curves["fine"], curves["computed"], color=BLUE, linewidth=1.2, label="stronge")
    axes.plot(curves["fine"], curves["compliant"], color=VERMILION, linewidth=1.2, label="compliant")
    axes.plot(curves["angle"], curves["measured"], "o", color=BLACK, markersize=4.0, label="measured")
    axes.set_xlabel("angle of the impact from the normal, deg")
    axes.set_ylabel("ratio of tangential speeds")
    axes.legend()


_DRAWN = {"measured-ellipse": _shares, "measured-cube": _times, "measured-sphere": _angles}
