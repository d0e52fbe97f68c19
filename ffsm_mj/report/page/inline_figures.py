"""Figures of a run as inline SVG: in the page's light or dark colours, with a cursor at the displayed time."""

from __future__ import annotations

import re
from io import StringIO

import matplotlib as mpl
from matplotlib.figure import Figure

from ffsm_mj.analysis.run import Run
from ffsm_mj.report.plots import figures
from ffsm_mj.report.plots.style import publication

_SHOWN = ("tip", "energies", "momenta", "contacts", "torques", "inputs", "conservation")
_THEMED = {"000000": "ink", "ffffff": "paper", "d5d5d5": "grid", "f1f1f1": "shade", "0072b2": "blue", "444444": "faint"}
"""Colours that are replaced by CSS variables of the page."""
_COLOUR = re.compile("#(" + "|".join(_THEMED) + ")", re.IGNORECASE)
_NOISE = re.compile(r'<metadata>.*?</metadata>|<!--.*?-->| id="[a-z0-9]+_\d+"', re.DOTALL)
"""Parts of an SVG to remove: metadata, comments, and ids that are not unique in the page."""


def inline_figures(run: Run) -> dict[str, str]:
    """SVG elements by figure name, for the most important figures that the run has."""
    drawn = figures(run, _SHOWN)
    return {name: _inline(drawn[name], name) for name in _SHOWN if name in drawn}


def _inline(figure: Figure, name: str) -> str:
    buffer = StringIO()
    with publication():
        mpl.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": name})
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    svg = buffer.getvalue()
    svg = _NOISE.sub("", svg[svg.index("<svg") :])
    svg = _COLOUR.sub(lambda found: f"var(--{_THEMED[found[1].lower()]})", svg)
    return svg.replace("</svg>", "".join(_cursors(figure)) + "</svg>")


def _cursors(figure: Figure) -> list[str]:
    """A time cursor for each axes, moved by the script of the page."""
    width, height = (72.0 * inches for inches in figure.get_size_inches())
    lines = []
    for axes in figure.axes:
        place, (start, end) = axes.get_position(), map(float, axes.get_xlim())
        if axes.axison:
            across = f'data-left="{place.x0 * width:.2f}" data-right="{place.x1 * width:.2f}"'
            span = f'data-start="{start!r}" data-end="{end!r}"'
            along = f'y1="{(1.0 - place.y1) * height:.2f}" y2="{(1.0 - place.y0) * height:.2f}"'
            lines.append(f'<line class="cursor" {across} {span} {along}/>')
    return lines
