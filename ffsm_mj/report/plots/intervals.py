"""Figures of what lasts: persistent contacts with their forces and slip, grasps with their loads."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from matplotlib.figure import Figure

from ffsm_mj.analysis.run import Run
from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.persistent.rule_columns import RuleMode, mode_key
from ffsm_mj.records.load_columns import LoadColumns, logged_load_columns
from ffsm_mj.records.signals import identifier
from ffsm_mj.report.plots.panels import Curve, Panel, spans, stacked
from ffsm_mj.report.plots.style import plain
from ffsm_mj.report.plots.subject import Subject


def _closed(run: Run, intervals: Iterable[tuple[str, float, float | None]]) -> dict[str, FloatArray]:
    """Start and end of each interval by name, (n, 2), s; one without an end lasts to the end of the run."""
    spans: dict[str, list[tuple[float, float]]] = {}
    for name, start_s, end_s in intervals:
        spans.setdefault(name, []).append((start_s, float(run.time[-1]) if end_s is None else end_s))
    return {name: np.array(span) for name, span in spans.items()}


def contacts(subject: Subject) -> Figure:
    """Contact force of each rule, the intervals in which it was closed, and its impulse; with friction its use and slip."""
    run = subject.run
    closed = _closed(run, ((record.rule, record.start_s, record.end_s) for record in run.contacts))
    names = [name for name in closed if f"contact.{identifier(name)}_force_N" in run.keys]
    with_friction = [name for name in names if f"contact.{identifier(name)}_friction_use" in run.keys]

    def curves(rules: list[str], what: str) -> list[Curve]:
        return [Curve(plain(name), run[f"contact.{identifier(name)}_{what}"]) for name in rules]

    sliding = {name: spans(run.time, run[mode_key(name)] == RuleMode.SLIDING) for name in with_friction}
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


def grasps(subject: Subject) -> Figure:
    """Force and torque (about its site) on the grasped object, and the interval of each grasp.

    One set of loads: components and norms; several: the norms of each grasp.
    """
    run = subject.run
    holds = _closed(run, ((record.grasp, record.time_s, record.release_s) for record in run.grasps))
    sets = logged_load_columns(run.log.header.layout)
    if len(sets) == 1:
        loads = _loads(subject, sets[0])
        force, torque = _with_norm(loads[:3], "F"), _with_norm(loads[3:], "M")
    else:
        both = [(load_set.grasp, _loads(subject, load_set)) for load_set in sets]
        force = [Curve(f"$|F|$, {name}", np.linalg.norm(loads[:3], axis=0)) for name, loads in both]
        torque = [Curve(f"$|M|$, {name}", np.linalg.norm(loads[3:], axis=0)) for name, loads in both]
    panels = [
        Panel("force on the\nobject, N", force),
        Panel("torque about\nits site, N m", torque),
        Panel("holds", bars=holds, height=0.25 + 0.12 * len(holds)),
    ]
    return stacked(run, panels, height_in=1.6)


def _loads(subject: Subject, columns: LoadColumns) -> list[FloatArray]:
    """Components of force and torque, NaN where no grasp is closed."""
    run = subject.run
    return [np.where(run[columns.closed] > 0.0, run[key], np.nan) for key in columns.loads]


def _with_norm(components: list[FloatArray], letter: str) -> list[Curve]:
    lines = [Curve(f"${letter}_{axis}$", values) for axis, values in zip("xyz", components, strict=True)]
    return [*lines, Curve(f"$|{letter}|$", np.linalg.norm(components, axis=0))]
