"""Stacked time plots: curves over shaded and named phases, with marks of events."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.transforms import blended_transform_factory

from ffsm_mj.analysis.run import Run
from ffsm_mj.arrays import BoolArray, FloatArray
from ffsm_mj.report.plots.style import BLACK, BLUE, COLOURS, LINE_STYLES, SKY, VERMILION, WIDTH_IN, plain

_SHADES = ("#F1F1F1", "#FFFFFF")
_BUCKETS = 1200
_FARTHEST = 1e100
_MARGIN = 0.08
"""Margin of the y axis relative to the range of the curves."""
_MOST_LEVELS = 5
"""Greatest number of lines of names of phases above a figure."""
_BANDS = (VERMILION, SKY)
"""Colours of bands over bars, which are blue."""
_AXES_IN = 4.0
"""Approximate width of axes beside a legend."""
_LETTER_IN = 0.075
"""Approximate width of a letter of a label."""
_NAME_IN = 0.17
"""Height of a legend entry."""


@dataclass(frozen=True)
class Curve:
    """A curve: legend entry and values; colour and style follow from its position unless given.

    A limit of other curves does not drive the range of the y axis.
    """

    label: str
    values: FloatArray
    colour: str | None = None
    style: Any = None
    width: float = 1.3
    time: FloatArray | None = None
    is_limit: bool = False


@dataclass(frozen=True)
class Panel:
    """One pair of axes.

    Attributes:
        label: Label of the y axis, with unit.
        lines: Curves.
        log: Logarithmic y axis.
        marks: Annotated points: time, value, text.
        bars: Rows of bars by name in place of curves: start and end, (n, 2).
        bands: Parts of the bars of a state, drawn over them in a colour of its own, by state and name of the row, (n, 2).
        rest: Name of the state of the other parts, for the legend.
        height: Height relative to the other panels.
    """

    label: str
    lines: Sequence[Curve] = ()
    log: bool = False
    marks: Sequence[tuple[float, float, str]] = ()
    bars: Mapping[str, FloatArray] = field(default_factory=dict)
    bands: Mapping[str, Mapping[str, FloatArray]] = field(default_factory=dict)
    rest: str = ""
    height: float = 1.0

    @property
    def is_empty(self) -> bool:
        """Whether no curve shows anything but zero, and there are no bars."""
        shown = (np.nan_to_num(line.values) for line in self.lines if not line.is_limit)
        return not self.bars and not any(map(np.any, shown))


def stacked(run: Run, panels: Sequence[Panel], *, columns: int = 1, height_in: float = 1.75) -> Figure:
    """Panels stacked (or in columns) over a common time axis, each high enough for its legend; empty ones are left out."""
    panels = [panel for panel in panels if not panel.is_empty] or panels[:1]
    rows = -(-len(panels) // columns)
    needed = [max(panel.height * height_in, 0.2 + _NAME_IN * len(_named(panel))) for panel in panels]
    heights = [max(needed[row * columns : (row + 1) * columns]) for row in range(rows)]
    figure = Figure(figsize=(WIDTH_IN, 0.55 + sum(heights)), layout="constrained")
    grid = figure.subplots(rows, columns, sharex=True, squeeze=False, height_ratios=heights)
    for i, axes in enumerate(grid.flat):
        if i >= len(panels):
            axes.set_axis_off()
            continue
        if panels[i].bars:
            _draw_bars(axes, panels[i])
        else:
            _draw(axes, run.time, panels[i])
        axes.yaxis.get_offset_text().set_ha("right")  # above the numbers, not over the names of phases
        axes.set_ylabel(_in_lines(panels[i].label, heights[i // columns]))
        mark_events(axes, run, names=i < columns, wide=columns == 1)
        if i + columns >= len(panels):
            axes.set_xlabel("time, s")
            axes.tick_params(labelbottom=True)
    figure.align_ylabels()
    return figure


def _draw(axes: Axes, time: FloatArray, panel: Panel) -> None:
    for i, line in enumerate(panel.lines):
        x, y = envelope(time if line.time is None else line.time, _within_reach(line.values))
        axes.plot(
            x,
            y,
            label=line.label,
            color=line.colour or COLOURS[i % len(COLOURS)],
            linestyle=_style(i) if line.style is None else line.style,
            linewidth=line.width,
        )
    if panel.log:
        axes.set_yscale("log")
    for x0, y0, text in panel.marks:
        axes.plot([x0], [y0], marker="o", markersize=4, color=BLACK, markerfacecolor="white", zorder=5, linestyle="none")
        halo = {"fc": "white", "ec": "none", "pad": 0.8, "alpha": 0.85}
        axes.annotate(
            text, (x0, y0), (0, 7), textcoords="offset points", ha="center", va="bottom", fontsize=7.5, bbox=halo, zorder=6
        )
    axes.margins(x=0.0, y=_MARGIN)
    if any(line.is_limit for line in panel.lines):
        _leave_limits_aside(axes, panel)
    if len(axes.get_legend_handles_labels()[1]) > 1:
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), borderaxespad=0.3)


def _leave_limits_aside(axes: Axes, panel: Panel) -> None:
    """Set the y range to that of the curves; where all limits are beyond it, say how large they are."""
    curves = np.concatenate([_finite(line.values) for line in panel.lines if not line.is_limit])
    limits = np.concatenate([np.abs(_finite(line.values)) for line in panel.lines if line.is_limit])
    if not curves.size:
        return
    low, high = float(curves.min()), float(curves.max())
    room = _MARGIN * (high - low or abs(high) or 1.0)
    axes.set_ylim(low - room, high + room)
    if limits.size and limits.min() > max(abs(low - room), abs(high + room)):
        name = next((line.label for line in _named(panel) if line.is_limit), "bounds")
        words = f"{name} {limits.min():.3g}" + ("" if np.ptp(limits) == 0.0 else "\nor more")
        axes.annotate(words, (1.0, 0.0), (3.0, 0.0), "axes fraction", "offset points", fontsize=7.0, color="#444444")
        for line, artist in zip(panel.lines, list(axes.get_lines()), strict=False):
            if line.is_limit:
                artist.set_label("_")


def _finite(values: FloatArray) -> FloatArray:
    return values[np.isfinite(values) & (np.abs(values) < _FARTHEST)]


def _within_reach(values: FloatArray) -> FloatArray:
    """Values with NaN for numbers so large that Matplotlib's margins and transforms would overflow."""
    return np.where(np.abs(values) < _FARTHEST, values, np.nan)


def _named(panel: Panel) -> list[Curve]:
    """Curves with a legend entry."""
    return [line for line in panel.lines if not line.label.startswith("_")]


def _style(i: int) -> Any:
    """Style of a panel's i-th curve: line styles do not repeat with the colours, so that no two curves look alike."""
    return LINE_STYLES[(i + i // len(COLOURS)) % len(LINE_STYLES)]


def _in_lines(label: str, height_in: float) -> str:
    """Wrap a y-axis label to the height of its panel; the unit is not broken."""
    name, comma, unit = label.rpartition(", ")
    whole = name + comma + unit.replace(" ", "\N{NO-BREAK SPACE}")
    lines = (fill(line, max(12, int(height_in / _LETTER_IN))) for line in whole.split("\n"))
    return "\n".join(lines).replace("\N{NO-BREAK SPACE}", " ")


def _draw_bars(axes: Axes, panel: Panel) -> None:
    _draw_spans(axes, panel, panel.bars, BLUE, panel.rest if panel.bands else "")
    for colour, (state, bands) in zip(_BANDS, panel.bands.items(), strict=False):
        _draw_spans(axes, panel, bands, colour, state)
    if panel.bands:
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), borderaxespad=0.3)
    axes.set_yticks(range(len(panel.bars)), list(map(plain, panel.bars)), fontsize=6.5)
    axes.set_ylim(len(panel.bars) - 0.4, -0.6)
    axes.margins(x=0.0)


def _draw_spans(axes: Axes, panel: Panel, spans: Mapping[str, FloatArray], colour: str, label: str) -> None:
    """Draw bars of one colour in the rows of their names, with one entry in the legend."""
    for name, intervals in spans.items():
        widths = [(start, stop - start) for start, stop in intervals]
        row = list(panel.bars).index(name)
        axes.broken_barh(widths, (row - 0.38, 0.76), facecolors=colour, edgecolors=colour, linewidth=0.3)
    if label:
        axes.broken_barh([], (0.0, 0.0), facecolors=colour, label=label)


def envelope(time: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Decimate a curve without visible change: first, least, greatest and last value of each of many slices."""
    count = len(time)
    if count <= 4 * _BUCKETS:
        return time, values
    edges = np.linspace(0, count, _BUCKETS + 1).astype(np.intp)
    kept = [0, count - 1]
    for start, stop in pairwise(edges):
        part = values[start:stop]
        finite = np.nan_to_num(part, nan=0.0)
        kept += [start, start + int(np.argmin(finite)), start + int(np.argmax(finite)), stop - 1]
    chosen = np.unique(kept)
    return time[chosen], values[chosen]


def spans(time: FloatArray, on: BoolArray) -> FloatArray:
    """Start and end of each interval in which a mask of rows is set, (n, 2), s."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], on, [False])).astype(int)))
    return time[np.minimum(edges, len(time) - 1)].reshape(-1, 2)


def mark_events(axes: Axes, run: Run, *, names: bool, wide: bool = True) -> None:
    """Shade the phases, optionally name them above the axes, and mark the times of events."""
    begin_s = float(run.time[0])  # of a run that goes on from another one, within a phase
    phases = [entry | {"start_s": max(begin_s, entry["start_s"])} for entry in run.summary()["phases"]]
    for i, phase in enumerate(phases):
        axes.axvspan(phase["start_s"], phase["end_s"], color=_SHADES[i % 2], zorder=-2, linewidth=0)
    across = blended_transform_factory(axes.transData, axes.transAxes)
    marks = run.log.marks()
    times = sorted({time for _, time, _ in marks})
    for time in times:
        axes.axvline(time, color=BLACK, linewidth=0.7, linestyle=(0, (1, 1.5)), zorder=1)
    if names and len(phases) > 1:
        _name_phases(axes, phases, (float(run.time[-1]) - begin_s) * (0.0125 if wide else 0.034))
    if names and times:
        _make_room_at_the_top(axes)
        axes.plot(times, [1.0] * len(times), "v", transform=across, color=BLACK, markersize=4.5, clip_on=False, zorder=6)
        words = dict.fromkeys(kind.name if len(times) == 1 else kind.plural for kind, *_ in marks)
        text = plain(", ".join(words)).replace("_", " ")
        _label_marks(axes, text, times[-1])


def _label_marks(axes: Axes, text: str, time: float) -> None:
    """Label marks to the right of a time if there is room, else right-aligned at the end of the axes."""
    across = blended_transform_factory(axes.transData, axes.transAxes)
    look: dict[str, Any] = {"xycoords": across, "textcoords": "offset points", "va": "top", "fontsize": 7.5}
    start, end = axes.get_xlim()
    if (end - time) * _AXES_IN < (end - start) * _LETTER_IN * len(text):
        axes.annotate(
            text, (end, 0.97), (0, 0), ha="right", bbox={"fc": "white", "ec": "none", "pad": 1.0, "alpha": 0.8}, **look
        )
    else:
        axes.annotate(text, (time, 0.97), (4, 0), **look)


def _make_room_at_the_top(axes: Axes) -> None:
    """Extend the y range so that no curve crosses a label; in axes coordinates, as y may be logarithmic or inverted."""
    _, top = axes.transData.inverted().transform(axes.transAxes.transform((0.0, 1.1)))
    axes.set_ylim(top=top)


def _name_phases(axes: Axes, phases: Sequence[dict[str, Any]], letter_s: float) -> None:
    """Centre names above their phases, on further lines if they would overlap; letter_s is the width of a letter."""
    across = blended_transform_factory(axes.transData, axes.transAxes)
    ends = [float("-inf")] * _MOST_LEVELS
    for phase in phases:
        text = plain(phase["name"]).replace("_", " ")
        half = 0.5 * len(text) * letter_s
        middle = max(0.5 * (phase["start_s"] + phase["end_s"]), phases[0]["start_s"] + half)
        free = [level for level in range(_MOST_LEVELS) if middle - half > ends[level]]
        if free:
            ends[free[0]] = middle + half
            axes.annotate(
                text,
                (middle, 1.0),
                (0, 5 + 9 * free[0]),
                xycoords=across,
                textcoords="offset points",
                ha="center",
                fontsize=7.5,
                color="#444444",
            )


def running_maximum(time: FloatArray, values: FloatArray, count: int = 400) -> tuple[FloatArray, FloatArray]:
    """Greatest value in each of ``count`` slices of a run, and the middle of each slice."""
    edges = np.unique(np.linspace(0, len(time), min(count, len(time)) + 1).astype(np.intp))
    return 0.5 * (time[edges[:-1]] + time[edges[1:] - 1]), np.maximum.reduceat(values, edges[:-1])
