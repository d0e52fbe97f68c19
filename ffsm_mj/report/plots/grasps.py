"""Figure of grasps: the load of the link on the grasped object, and the intervals in which grasps are closed."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ffsm_mj.contact_models.grasp.columns import CLOSED_GRASP, LOADS
from ffsm_mj.report.plots.panels import Curve, Panel, stacked
from ffsm_mj.report.plots.subject import Subject


def grasps(subject: Subject) -> Figure:
    """Components and norms of force and torque (about its site) on the grasped object, and the interval of each grasp."""
    run = subject.run
    loads = [np.where(run[CLOSED_GRASP] > 0.0, run[key], np.nan) for key in LOADS]
    spells: dict[str, list[tuple[float, float]]] = {}
    for capture in run.captures:
        release_s = float(run.time[-1]) if capture.release_s is None else capture.release_s
        spells.setdefault(capture.grasp, []).append((capture.time_s, release_s))
    holds = {name: np.array(spans) for name, spans in spells.items()}
    panels = [
        Panel("force on the\nobject, N", _with_norm(loads[:3], "F")),
        Panel("torque about\nits site, N m", _with_norm(loads[3:], "M")),
        Panel("holds", bars=holds, height=0.25 + 0.12 * len(holds)),
    ]
    return stacked(run, panels, height_in=1.6)


def _with_norm(components: list[np.ndarray], letter: str) -> list[Curve]:
    lines = [Curve(f"${letter}_{axis}$", values) for axis, values in zip("xyz", components, strict=True)]
    return [*lines, Curve(f"$|{letter}|$", np.linalg.norm(components, axis=0))]
