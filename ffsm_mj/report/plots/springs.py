"""Figure of flexible joints: their deflections, elastic energy and heat."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ffsm_mj.analysis.run import Run
from ffsm_mj.model.system import Joint, stiffness_coefficients
from ffsm_mj.records.signals import DAMPER_HEAT, ELASTIC, coordinate_names
from ffsm_mj.report.plots.panels import Curve, Panel, stacked
from ffsm_mj.report.plots.style import BLACK, COLOURS, plain
from ffsm_mj.report.plots.subject import Subject

_TOTAL_ELASTIC, _TOTAL_HEAT = f"energy.{ELASTIC.format('total')}", f"balance.{DAMPER_HEAT.format('total')}"
_UNITS = {"hinge": ("deflection, mrad", 1e3), "slide": ("deflection, mm", 1e3)}


def has_springs(run: Run) -> bool:
    """Whether joints of the models have springs."""
    return _TOTAL_ELASTIC in run.keys


def springs(subject: Subject) -> Figure:
    """Deflection of each spring of a hinge or slide from its reference, elastic energy, and heat of dampers."""
    run, model = subject.run, subject.system.mj
    sprung = {model.joint(j).name for j in np.flatnonzero(np.any(stiffness_coefficients(model), axis=1)).tolist()}
    panels = []
    for kind, (label, factor) in _UNITS.items():
        joints = [joint for name, joint in subject.system.joints.items() if joint.kind == kind and name in sprung]
        if joints:
            panels.append(Panel(label, [Curve(_label(joint), factor * _deflection(subject, joint)) for joint in joints]))
    energy = [Curve("elastic energy", run[_TOTAL_ELASTIC], COLOURS[0])]
    if _TOTAL_HEAT in run.keys:
        energy.append(Curve("heat of dampers", run[_TOTAL_HEAT], BLACK, (0, (4.0, 1.5))))
    return stacked(run, [*panels, Panel("energy, J", energy)], height_in=1.8)


def _label(joint: Joint) -> str:
    return plain(joint.name.split("/", 1)[-1].replace("_", " "))


def _deflection(subject: Subject, joint: Joint) -> np.ndarray:
    zero = float(subject.system.mj.qpos_spring[joint.qpos.start])
    return np.asarray(subject.run[f"state.q_{coordinate_names(joint)[0]}"] - zero)
