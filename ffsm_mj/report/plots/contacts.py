"""Figure of persistent contacts: forces, intervals of contact, accumulated impulses, friction and slip."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ffsm_mj.analysis.run import Run
from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.persistent.rule_columns import SLIDING, mode_key
from ffsm_mj.records.signals import identifier
from ffsm_mj.report.plots.panels import Curve, Panel, stacked
from ffsm_mj.report.plots.style import plain
from ffsm_mj.report.plots.subject import Subject


def contacts(subject: Subject) -> Figure:
    """Contact force of each rule, the intervals in which it was closed, and its impulse; with friction its use and slip."""
    run = subject.run
    spells: dict[str, list[tuple[float, float]]] = {}
    for contact in run.contacts:
        end_s = float(run.time[-1]) if contact.end_s is None else contact.end_s
        spells.setdefault(contact.rule, []).append((contact.start_s, end_s))
    names = [name for name in spells if f"contact.{identifier(name)}_force_N" in run.keys]
    with_friction = [name for name in names if f"contact.{identifier(name)}_friction_use" in run.keys]

    def curves(rules: list[str], what: str) -> list[Curve]:
        return [Curve(plain(name), run[f"contact.{identifier(name)}_{what}"]) for name in rules]

    closed = {name: np.array(spans) for name, spans in spells.items()}
    sliding = {name: _sliding(run, name) for name in with_friction}
    bands = {"sliding": sliding} if with_friction else {}
    panels = [
        Panel("contact force, N", curves(names, "force_N"), height=1.4),
        Panel("closed", bars=closed, bands=bands, rest="not sliding", height=0.25 + 0.12 * len(closed)),
        Panel("impulse, N s", curves(names, "impulse_N_s")),
    ]
    if with_friction:
        panels += [
            Panel("friction use", curves(with_friction, "friction_use")),
            Panel("slip distance, m", curves(with_friction, "slip_m")),
        ]
    return stacked(run, panels, height_in=1.6)


def _sliding(run: Run, rule: str) -> FloatArray:
    """Times between which a rule slides according to the rows, (n, 2)."""
    slides = np.concatenate(([False], run[mode_key(rule)] == SLIDING, [False]))
    starts, stops = (np.flatnonzero(step) for step in (slides[1:] & ~slides[:-1], ~slides[1:] & slides[:-1]))
    time = np.append(run.time, run.time[-1])
    return np.stack((time[starts], time[stops]), axis=1)
