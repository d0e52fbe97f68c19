"""Overlay of several runs: tip error, energy and momenta."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from ffsm_mj.analysis.run import Run
from ffsm_mj.report.plots.panels import envelope
from ffsm_mj.report.plots.style import COLOURS, LINE_STYLES, WIDTH_IN, plain
from ffsm_mj.report.plots.thinning import thinned

MOST_RUNS = len(COLOURS)
"""More curves than this cannot be distinguished in one pair of axes."""


def comparison(runs: Sequence[tuple[str, Run]]) -> Figure:
    """Figure of the first ``MOST_RUNS`` of several labelled runs."""
    shown = [(label, thinned(run)) for label, run in runs[:MOST_RUNS]]
    panels = ["kinetic energy, J", "FFSM $|P|$, N s", "object $|P|$, N s"]
    tipped = [(label, run) for label, run in shown if run.summary()["tip"] is not None]
    labels = (["tip error, m"] if tipped else []) + panels
    figure = Figure(figsize=(WIDTH_IN, 0.8 + 1.5 * len(labels)), layout="constrained")
    grid = figure.subplots(len(labels), 1, sharex=True, squeeze=False)[:, 0]
    drawn: dict[str, None] = {}
    for i, (label, run) in enumerate(shown):
        curves = [run["energy.total_J"], *(np.linalg.norm(run.momentum(p)[:, :3], axis=1) for p in ("robot", "objects"))]
        if tipped:
            missing = np.full(len(run.time), np.nan)
            curves.insert(0, run.tip_error() if run.summary()["tip"] is not None else missing)
        for axes, curve in zip(grid, curves, strict=True):
            x, y = envelope(run.time, curve)
            axes.plot(x, y, color=COLOURS[i], linestyle=LINE_STYLES[i], label=plain(label), zorder=3 + len(shown) - i)
        marks = run.log.marks()
        drawn |= dict.fromkeys(plain(kind.plural).replace("_", " ") for kind, *_ in marks)
        for time in sorted({time for _, time, _ in marks}):
            for axes in grid:
                axes.axvline(time, color=COLOURS[i], linewidth=0.8, linestyle=(0, (1, 1.5)), zorder=1)
    for axes, text in zip(grid, labels, strict=True):
        axes.set_ylabel(text)
        axes.margins(x=0.0)
    grid[-1].set_xlabel(f"time, s (dotted: {', '.join(drawn)})" if drawn else "time, s")
    figure.align_ylabels()
    handles, names = grid[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside upper center", ncols=min(4, len(names)))
    return figure
