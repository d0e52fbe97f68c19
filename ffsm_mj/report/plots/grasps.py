"""Figure of grasps: the loads of links on grasped objects, and the intervals in which grasps are closed."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ffsm_mj.arrays import FloatArray
from ffsm_mj.records.load_columns import LoadColumns, logged_load_columns
from ffsm_mj.report.plots.panels import Curve, Panel, stacked
from ffsm_mj.report.plots.subject import Subject


def grasps(subject: Subject) -> Figure:
    """Force and torque (about its site) on the grasped object, and the interval of each grasp.

    One set of loads: components and norms; several: the norms of each grasp.
    """
    run = subject.run
    spells: dict[str, list[tuple[float, float]]] = {}
    for grasp in run.grasps:
        release_s = float(run.time[-1]) if grasp.release_s is None else grasp.release_s
        spells.setdefault(grasp.grasp, []).append((grasp.time_s, release_s))
    holds = {name: np.array(spans) for name, spans in spells.items()}
    sets = logged_load_columns(run.log.header.layout)
    if len(sets) == 1:
        loads = _loads(subject, sets[0])
        force, torque = _with_norm(loads[:3], "F"), _with_norm(loads[3:], "M")
    else:
        both = [(each.grasp, _loads(subject, each)) for each in sets]
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
