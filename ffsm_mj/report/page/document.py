"""HTML of the page around the scene, with figures as inline SVG; text from the log is always escaped."""

from __future__ import annotations

import html
import json
import re
import zlib
from base64 import b64encode
from functools import cache
from hashlib import sha256
from importlib.resources import files
from io import StringIO
from pathlib import Path
from string import Template
from typing import Any

import k3d
import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from ffsm_mj.analysis.run import Run
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.analysis.summary import card_html
from ffsm_mj.errors import one_line
from ffsm_mj.log import palette
from ffsm_mj.log.markers import arrow_colour, declared_arrows
from ffsm_mj.log.palette import hexadecimal, packed
from ffsm_mj.records.kinds import kind_of
from ffsm_mj.report.check_report import left_to_replay, verdict
from ffsm_mj.report.momentum_report import MOMENTUM_HEAD, momentum_cells, momentum_residual
from ffsm_mj.report.page import scene
from ffsm_mj.report.page.phase_graph import phase_graph
from ffsm_mj.report.page.scene import PageScene, Poses
from ffsm_mj.report.plots import figures as draw_figures
from ffsm_mj.report.plots.style import publication
from ffsm_mj.report.verification_report import stated_sensitivity
from ffsm_mj.verification.check_result import Check

_FIGURES = {
    "orbit": "Path in LVLH: V-bar to the left, R-bar down to the central body",
    "lvlh": "Base in LVLH",
    "tip": "Tip",
    "energies": "Energies",
    "momenta": "Momenta",
    "contacts": "Forces of contacts",
    "torques": "Torques",
    "inputs": "Thrusters and wheels",
    "conservation": "Residuals of the balances",
}
"""Titles of the most important figures, in the order of the page."""
_WITHOUT_TIME = ("orbit",)
"""Figures without an axis of time."""
_THEMED = {"000000": "ink", "ffffff": "paper", "d5d5d5": "grid", "f1f1f1": "shade", "0072b2": "blue", "444444": "faint"}
"""Colours that are replaced by CSS variables of the page."""
_COLOUR = re.compile("#(" + "|".join(_THEMED) + ")", re.IGNORECASE)
_NOISE = re.compile(r'<metadata>.*?</metadata>|<!--.*?-->| id="[a-z0-9]+_\d+"', re.DOTALL)
"""Parts of an SVG to remove: metadata, comments, and ids that are not unique in the page."""


def inline_figures(run: Run) -> dict[str, str]:
    """SVG elements by figure name, for the most important figures that the run has."""
    drawn = draw_figures(run, tuple(_FIGURES), titled=False)
    return {name: _inline(drawn[name], name) for name in _FIGURES if name in drawn}


def _inline(figure: Figure, name: str) -> str:
    buffer = StringIO()
    with publication():
        mpl.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": name})
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    svg = buffer.getvalue()
    svg = _NOISE.sub("", svg[svg.index("<svg") :])
    svg = _COLOUR.sub(lambda match: f"var(--{_THEMED[match[1].lower()]})", svg)
    return svg if name in _WITHOUT_TIME else svg.replace("</svg>", "".join(_cursors(figure)) + "</svg>")


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


_MOST_EVENTS = 200


def document(run: Run, drawn: PageScene, poses: Poses) -> str:
    """HTML page of a run with its scene."""
    script = _part("page.js")
    checks = all_checks(run)
    return Template(_part("page.html")).substitute(
        policy=_policy(script),
        name=_escaped(run.name),
        headline=_escaped(_headline(run)),
        style=_style(),
        events="\n".join(_events(run)),
        note=_escaped(_note(run, drawn, poses)),
        key="".join(_key(run, drawn)),
        card=card_html(run.log, run.digest, checks, "checks"),
        verdict=_escaped(_verdict(run, checks)),
        checks="\n".join(map(_check, checks)),
        momentum=_momentum(run),
        sensitivity=sensitivity_html(run),
        phases=_phases(run),
        figures="\n".join(
            f"<figure><figcaption>{_FIGURES[name]}</figcaption>{svg}</figure>" for name, svg in inline_figures(run).items()
        ),
        data=json.dumps(_script_data(run, drawn, poses)).replace("<", "\\u003c"),
        library=_library(),
        snapshot=b64encode(drawn.snapshot).decode("ascii"),
        script=script,
    )


def _momentum(run: Run) -> str:
    """Table of the angular momentum; empty for a run in which wheels and thrusters took nothing."""
    rows = momentum_cells(run)
    if not rows:
        return ""
    head = "".join(f"<th>{_escaped(name.replace(chr(10), ', '))}</th>" for name in MOMENTUM_HEAD)
    lines = "\n".join(f"<tr>{''.join(f'<td>{_escaped(cell)}</td>' for cell in row)}</tr>" for row in rows)
    return (
        f'<h2>Angular momentum</h2>\n<div class="wide"><table><thead><tr>{head}</tr></thead>\n<tbody>\n{lines}\n'
        '</tbody></table></div>\n<p class="note">About the centre of mass of everything that moves; '
        f"{momentum_residual(run)}.</p>"
    )


def _phases(run: Run) -> str:
    """The graph of the phases where they branch; ways that the run has taken are bold."""
    graph = phase_graph(run)
    caption = "Phases and what ends them; bold: what the run did"
    return f"<h2>Phases</h2><figure><figcaption>{caption}</figcaption>{graph}</figure>" if graph else ""


def sensitivity_html(run: Run) -> str:
    """The sentences as a section of the page; empty where there are none."""
    sentences = stated_sensitivity(run)
    if not sentences:
        return ""
    lines = "\n".join(f"<li>{_escaped(sentence)}</li>" for sentence in sentences)
    note = '<p class="note">From runs at both sides of each standard deviation.</p>'
    return f"<h2>Uncertainties</h2>\n<ul>\n{lines}\n</ul>\n{note}"


def _part(name: str) -> str:
    return files("ffsm_mj.report.page").joinpath(name).read_text(encoding="utf-8")


def _style() -> str:
    """Style sheet, with the colours of the palette."""
    colours = {"robot": palette.ROBOT, "event": palette.MARK, "cursor": palette.VERMILION}
    return Template(_part("page.css")).substitute({name: hexadecimal(colour) for name, colour in colours.items()})


@cache
def _library() -> str:
    """K3D's viewer, compressed; only with its embedded fonts, since others would be fetched from the network."""
    viewer = (Path(k3d.__file__).parent / "static" / "standalone.js").read_bytes()
    viewer = re.sub(rb',url\(fonts/[^)]*\) format\("(?:woff|truetype)"\)', b"", viewer)
    return b64encode(zlib.compress(viewer, 9)).decode("ascii")


def _policy(script: str) -> str:
    """Content security policy: the page may run its own script and what that loads, without network access."""
    digest = b64encode(sha256(script.encode()).digest()).decode("ascii")
    return (
        f"default-src 'none'; script-src 'sha256-{digest}' 'strict-dynamic' 'wasm-unsafe-eval'; style-src 'unsafe-inline'; "
        "img-src data: blob:; font-src data:; worker-src blob:; connect-src data: blob:; base-uri 'none'; form-action 'none'"
    )


def _escaped(text: str) -> str:
    return html.escape(one_line(text))


def _headline(run: Run) -> str:
    parts = [f"{run.outcome} after {run.digest.end_s:g} s", run.message, run.missing]
    return "; ".join(part for part in parts if part)


def _events(run: Run) -> list[str]:
    """A button per event that moves the slider to its time."""
    events = run.log.events
    lines = []
    for record in events[:_MOST_EVENTS]:
        kind = kind_of(record)
        marked = ' class="marked"' if kind.marks is not None else ""
        time, text = kind.time(record), _escaped(kind.sentence(record))
        lines.append(f'<li{marked}><button type="button" data-time="{time!r}"><b>{time:.6f} s</b> {text}</button></li>')
    if len(events) > _MOST_EVENTS:
        lines.append(f"<li>and {len(events) - _MOST_EVENTS} more, see ffsm analyze</li>")
    return lines


def _note(run: Run, drawn: PageScene, poses: Poses) -> str:
    more = f"; {drawn.undrawn} marks beyond the first {scene.MOST_MARKS} are not drawn" if drawn.undrawn else ""
    return f"{poses.description}, of {len(run.log.rows)} samples in the log{more}."


def _key(run: Run, drawn: PageScene) -> list[str]:
    """Legend of the colours that occur in the scene."""
    path = "path of the tip" if "state.tip_x_m" in run.keys else "path of the base"
    words = {
        scene.BEFORE: f"{path} before the first event" if scene.AFTER in drawn.colours else path,
        scene.AFTER: "after the first event",
        scene.MARK: "events",
        **_meanings(run),
        scene.PLUME: "firing thruster",
        scene.TARGET: "target",
        **{colour: name for name, colour in scene.LVLH.items()},
    }
    return [
        f'<span class="key"><i style="background:#{colour:06x}"></i>{_escaped(word)}</span>'
        for colour, word in words.items()
        if colour in drawn.colours
    ]


def _meanings(run: Run) -> dict[int, str]:
    """What the arrows of each colour stand for."""
    by_column: dict[int, dict[str, None]] = {}
    for arrow in declared_arrows(run.log.header):
        by_column.setdefault(packed(arrow_colour(arrow)), {})[arrow.meaning] = None
    return {colour: ", ".join(meanings) for colour, meanings in by_column.items()}


def _verdict(run: Run, checks: tuple[Check, ...]) -> str:
    parts = [verdict(run, checks) if checks else "no checks", *filter(None, [left_to_replay(run)])]
    if not run.conservative:
        parts.append(f"energy and momenta are not checked, the run is not conservative: {run.why_not_conservative}")
    return "; ".join(parts)


def _check(check: Check) -> str:
    state = "passes" if check.passes else "fails"
    texts = (
        check.name,
        check.subsystem,
        f"{check.residual:.1e}",
        f"{check.tolerance:.1e}",
        check.unit,
        check.component,
        f"{check.time_s:.3f}",
    )
    cells = "".join(f"<td>{_escaped(text)}</td>" for text in texts)
    return f'<tr class="{state}"><td>{state}</td>{cells}</tr>'


def _script_data(run: Run, drawn: PageScene, poses: Poses) -> dict[str, Any]:
    """Data for the script."""
    times = sorted({time for _, time, _ in run.log.marks() if np.isfinite(time)})
    return {
        "start": times[0] if times else 0.0,
        "end": float(poses.times[-1]),
        "ticks_per_s": scene.TICKS_PER_S,
        "marks": times[: scene.MOST_MARKS],
        "phases": [[phase.start_s, phase.name.replace("_", " ")] for phase in run.phases],
        "centre": drawn.centre.tolist(),
        "to_eye": drawn.to_eye.tolist(),
        "path": [] if drawn.path is None else np.column_stack((poses.times, drawn.path)).round(6).tolist(),
    }
