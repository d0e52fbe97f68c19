"""Figures of sensors and estimates: what is measured against what is true, and errors of the estimate."""

from __future__ import annotations

from matplotlib.figure import Figure

from ffsm_mj.model.system import Tree
from ffsm_mj.records.sensing_columns import measured_columns
from ffsm_mj.records.signals import identifier, rate_names
from ffsm_mj.report.plots.panels import Curve, Panel, stacked
from ffsm_mj.report.plots.style import BLACK, COLOURS, plain
from ffsm_mj.report.plots.subject import Subject

_GREY = "#7F7F7F"
_MOST_IN_A_COLUMN = 4


def sensors(subject: Subject) -> Figure:
    """The newest sample of each sensor that has arrived, and the true value at the time of the log (dashed)."""
    panels = []
    for columns in measured_columns(subject.run.log.header.layout, subject.system.sensors):
        lines = [
            Curve(component or "measured", subject.run[key], COLOURS[i % len(COLOURS)], "-")
            for i, (component, key) in enumerate(zip(columns.components, columns.measured, strict=True))
        ]
        for i, key in enumerate(columns.true):
            style = "true then" if i == 0 else "_"
            lines.append(Curve(style, subject.run[key], BLACK, (0, (3.0, 2.0)), 0.6))
        title = plain(columns.sensor.split("/", 1)[-1].replace("_", " "))
        panels.append(Panel(title + (f", {columns.unit}" if columns.unit else ""), lines))
    return _stacked(subject, panels)


def _stacked(subject: Subject, panels: list[Panel]) -> Figure:
    return stacked(subject.run, panels, columns=1 if len(panels) <= _MOST_IN_A_COLUMN else 2, height_in=1.5)


def estimates(subject: Subject) -> Figure:
    """Errors of the estimate, coordinate by coordinate, within three standard deviations where the estimator states them."""
    panels = [panel for tree in subject.system.trees for panel in _of_tree(subject, tree)]
    return _stacked(subject, panels)


def _of_tree(subject: Subject, tree: Tree) -> list[Panel]:
    """Errors of position and attitude of a floating body, and of all joints together."""
    panels, whose = [], plain(tree.name.replace("_", " "))
    joints: list[tuple[str, str]] = []
    for joint in tree.joints:
        names = rate_names(joint)
        if joint.kind == "free":
            stem = identifier(joint.name)
            places = [(axis, f"error_q_{stem}_{axis}_m") for axis in "xyz"]
            turns = [(axis, f"error_q_{stem}_turn_{axis}_rad") for axis in "xyz"]
            panels.append(Panel(f"{whose}: error of position, m", _errors(subject, places)))
            panels.append(Panel(f"{whose}: error of attitude, rad", _errors(subject, turns)))
        elif joint.kind in ("hinge", "slide"):
            joints.append((joint.name.split("/", 1)[-1], f"error_q_{names[0].rsplit('_s', 1)[0]}"))
    if joints:
        panels.append(Panel(f"{whose}: error of joints, rad or m", _errors(subject, joints)))
    return panels


def _errors(subject: Subject, named: list[tuple[str, str]]) -> list[Curve]:
    run, lines = subject.run, []
    for i, (label, name) in enumerate(named):
        if (key := f"estimate.{name}") in run.keys:
            lines.append(Curve(plain(label), run[key], COLOURS[i % len(COLOURS)], "-"))
    for i, (_, name) in enumerate(named):
        if (key := f"estimate.{name.replace('error_', 'sigma_', 1)}") in run.keys:
            for sign in (3.0, -3.0):
                label = r"3$\sigma$" if i == 0 and sign > 0.0 else "_"
                lines.append(Curve(label, sign * run[key], _GREY, (0, (1.0, 1.5)), 0.8, is_limit=True))
    return lines
