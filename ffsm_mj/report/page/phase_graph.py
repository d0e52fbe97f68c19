"""Drawing of the phases of a scenario that branch, with what the run has made of them, as SVG."""

from __future__ import annotations

import html
from collections import Counter
from itertools import pairwise

from ffsm_mj.analysis.run import Run
from ffsm_mj.errors import one_line
from ffsm_mj.records.metadata import logged_phase_graph

_BOX, _HEIGHT, _GAP = 210, 30, 44
_LEFT, _TOP, _LANE = 12, 12, 26
_LETTER = 6.2  # width of one at 11 px
_LONGEST = 40
_HEAD = (
    '<defs><marker id="phase-arrow" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="9" markerHeight="9" '
    'markerUnits="userSpaceOnUse" orient="auto"><path d="M0 0L8 4L0 8z"/></marker></defs>'
)


def phase_graph(run: Run) -> str:
    """SVG of the graph: a box for each phase with how often the run was in it, an arrow for each end; empty for none."""
    names, edges = logged_phase_graph(run.log.header.metadata)
    if not edges:
        return ""
    times = Counter(phase.name for phase in run.phases)
    transitions = {(one.name, other.name) for one, other in pairwise(run.phases)}
    arrows, labels, lane, right = [], [], 0, 0.0
    beside: Counter[int] = Counter()
    for start, trigger, to in edges:
        if to == start + 1:
            path, x, y = _down(start, beside[start])
            beside[start] += 1
        else:
            path, x, y = _round(start, to, lane)
            lane += 1
        arrows.append(_arrow(path, (names[start], names[to]) in transitions))
        labels.append(_label(x, y, trigger))
        right = max(right, x + _LETTER * len(_shown(trigger)))
    width, height = max(right, _LEFT + _BOX) + _LEFT, 2 * _TOP + len(names) * (_HEIGHT + _GAP) - _GAP
    style = f'style="max-width:{width:.0f}px;font:11px sans-serif"'
    parts = "".join([_HEAD, *(_box(i, name, times[name]) for i, name in enumerate(names)), *arrows, *labels])
    return f'<svg viewBox="0 0 {width:.0f} {height}" role="img" aria-label="Phases" {style}>{parts}</svg>'


def _shown(text: str) -> str:
    line = one_line(text)
    return line if len(line) <= _LONGEST else f"{line[: _LONGEST - 1]}…"


def _y(i: int) -> int:
    return _TOP + i * (_HEIGHT + _GAP)


def _box(i: int, name: str, times: int) -> str:
    reached = f" ({times} times)" if times > 1 else "" if times else " (not reached)"
    opacity = 1.0 if times else 0.45
    rectangle = f'<rect x="{_LEFT}" y="{_y(i)}" width="{_BOX}" height="{_HEIGHT}" rx="5" fill="none" stroke="currentColor"/>'
    text = f'<text x="{_LEFT + _BOX / 2}" y="{_y(i) + 19}" text-anchor="middle">{html.escape(_shown(name))}{reached}</text>'
    return f'<g opacity="{opacity}">{rectangle}{text}</g>'


def _down(start: int, above: int) -> tuple[str, float, float]:
    """Way to the next phase, and where its label begins: below those of other ends that lead there."""
    x, y = _LEFT + _BOX / 2, _y(start) + _HEIGHT
    return f"M{x} {y}V{y + _GAP}", x + 8, y + 14 + 13 * above


def _round(start: int, to: int, lane: int) -> tuple[str, float, float]:
    """Way round the right of the boxes in a lane of its own, and where its label begins."""
    x, out = _LEFT + _BOX, _LEFT + _BOX + _LANE * (lane + 1)
    up, down = _y(start) + _HEIGHT * 0.7, _y(to) + _HEIGHT * 0.3
    return f"M{x} {up:.1f}H{out}V{down:.1f}H{x}", out + 5, (up + down) / 2 + 13 * (lane % 3) - 9


def _label(x: float, y: float, text: str) -> str:
    """Text over the lines that it crosses."""
    halo = 'style="paint-order:stroke;stroke:var(--paper);stroke-width:4px"'
    return f'<text x="{x}" y="{y:.1f}" {halo}>{html.escape(_shown(text))}</text>'


def _arrow(path: str, bold: bool) -> str:
    width = 2.2 if bold else 1.0
    return f'<path d="{path}" fill="none" stroke="currentColor" stroke-width="{width}" marker-end="url(#phase-arrow)"/>'
