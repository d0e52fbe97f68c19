"""Figure of persistent contacts: forces, intervals of contact and accumulated impulses."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ffsm_mj.records.signals import identifier
from ffsm_mj.report.plots.panels import Curve, Panel, stacked
from ffsm_mj.report.plots.style import plain
from ffsm_mj.report.plots.subject import Subject


def contacts(subject: Subject) -> Figure:
    """Contact force of each rule, the intervals in which it was closed, and its impulse since t = 0."""
    run = subject.run
    spells: dict[str, list[tuple[float, float]]] = {}
    for contact in run.contacts:
        end_s = float(run.time[-1]) if contact.end_s is None else contact.end_s
        spells.setdefault(contact.rule, []).append((contact.start_s, end_s))
    names = [name for name in spells if f"contact.{identifier(name)}_force_N" in run.keys]
    forces, impulses = (
        [Curve(plain(name), run[f"contact.{identifier(name)}_{what}"]) for name in names]
        for what in ("force_N", "impulse_N_s")
    )
    closed = {name: np.array(spans) for name, spans in spells.items()}
    panels = [
        Panel("contact force, N", forces, height=1.4),
        Panel("closed", bars=closed, height=0.25 + 0.12 * len(closed)),
        Panel("impulse, N s", impulses),
    ]
    return stacked(run, panels, height_in=1.6)
