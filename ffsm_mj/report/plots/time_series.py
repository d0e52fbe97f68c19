"""Figures over time: base, joints, springs, tip, torques, inputs, momenta, energies, and residuals of the balances."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
from matplotlib.figure import Figure

from ffsm_mj.analysis.run import Run
from ffsm_mj.arrays import FloatArray
from ffsm_mj.model.system import Joint, Tree, stiffness_coefficients
from ffsm_mj.records.metadata import free_components, logged_task
from ffsm_mj.records.signals import (
    COMPONENTS,
    DAMPER_HEAT,
    ELASTIC,
    OBJECTS_WORK,
    SUBSYSTEMS,
    coordinate_names,
    identifier,
    rate_names,
)
from ffsm_mj.report.plots.panels import Curve, Panel, running_maximum, spans, stacked
from ffsm_mj.report.plots.style import BLACK, BLUE, COLOURS, ORANGE, VERMILION, plain
from ffsm_mj.report.plots.subject import Subject
from ffsm_mj.verification.checks import DEFAULT_TOLERANCE
from ffsm_mj.verification.residuals import BalanceColumns, drift_window_s, norms, without_loss

_GREY = "#7F7F7F"
CONSERVED = {"energy": "J", "linear momentum": "N s", "angular momentum": "N m s"}
"""Conserved quantities with their units."""
SUBSYSTEM_NAMES = {"total": "whole system", "robot": "robot", "objects": "object"}


def short(name: str) -> str:
    """Short form of a model's name for a legend: without prefix, with spaces."""
    return plain(name.split("/", 1)[-1].replace("_", " "))


def base(subject: Subject) -> Figure:
    """Position and attitude of the base (paper, Fig. 5a)."""
    run, robot = subject.run, subject.system.robot
    time, path = run.time[subject.chosen], subject.roots[robot.name]
    axes = [i for i in range(3) if np.ptp(path[:, i]) > 1e-9] or [0, 1]
    places = [Curve("xyz"[i], path[:, i], COLOURS[i], time=time) for i in axes]
    return stacked(run, [Panel("base position, m", places), _attitude(subject, robot)])


def _attitude(subject: Subject, tree: Tree) -> Panel:
    """Angles of a base's hinges, or the rotation vector of its attitude relative to the start."""
    run = subject.run
    hinges = [joint for joint in tree.joints if joint.body == tree.root and joint.kind == "hinge"]
    if hinges:
        return Panel("base angle, rad", [Curve(short(joint.name), _coordinate(subject, joint)) for joint in hinges])
    quaternions = np.empty((len(subject.chosen), 4))
    for i, qpos in enumerate(run.qpos[subject.chosen]):
        quaternions[i] = subject.silhouette.place(qpos).xquat[tree.root]
    turns, difference = np.empty((len(quaternions), 3)), np.empty(4)
    inverse = quaternions[0] * (1.0, -1.0, -1.0, -1.0)
    for i, quaternion in enumerate(quaternions):
        mujoco.mju_mulQuat(difference, quaternion, inverse)
        mujoco.mju_quat2Vel(turns[i], difference, 1.0)
    lines = [Curve(axis, turns[:, i], COLOURS[i], time=run.time[subject.chosen]) for i, axis in enumerate("xyz")]
    return Panel("base rotation, rad", lines)


def _coordinate(subject: Subject, joint: Joint) -> FloatArray:
    return subject.run[f"state.q_{coordinate_names(joint)[0]}"]


def _rate(subject: Subject, joint: Joint) -> FloatArray:
    return subject.run[f"state.v_{rate_names(joint)[0]}"]


_MIXED = ("coordinate", "rad or m")


def _per_second(unit: str) -> str:
    return " or ".join(f"{part}/s" for part in unit.split(" or "))


def joints(subject: Subject) -> Figure:
    """Angles and rates of the arm (paper, Fig. 5b)."""
    arm = subject.arm_joints
    kinds = {joint.kind for joint in arm}
    what, unit = {"hinge": ("angle", "rad"), "slide": ("position", "m")}[kinds.pop()] if len(kinds) == 1 else _MIXED
    angles = [Curve(short(joint.name), _coordinate(subject, joint)) for joint in arm]
    rates = [Curve(short(joint.name), _rate(subject, joint)) for joint in arm]
    return stacked(
        subject.run,
        [Panel(f"joint {what}, {unit}", angles), Panel(f"joint rate, {_per_second(unit)}", rates)],
        height_in=2.0,
    )


def tip(subject: Subject) -> Figure:
    """Error of the tip along the task's axes, and its velocity (paper, Fig. 6)."""
    run, task = subject.run, logged_task(subject.run.log.header.metadata)
    assert task is not None, "a figure for runs with a task"
    error, best = run.tip_error(), run.summary()["tip"]
    lines = [Curve("norm", error, BLACK, "-", 1.6)]
    lines += [Curve("xyz"[a], run.tip[:, a] - task.point_m[a], COLOURS[a], _STYLES[a]) for a in task.axes]
    marks = []
    if best is not None and best["min_error_time_s"] < 0.98 * run.time[-1]:
        marks = [(best["min_error_time_s"], best["min_error_m"], f"{best['min_error_m']:.3g} m")]
    velocity = [Curve("xyz"[a], run.tip_velocity[:, a], COLOURS[a], _STYLES[a]) for a in task.axes]
    panels = [Panel("tip error, m", lines, marks=marks), Panel("tip velocity, m/s", velocity)]
    return stacked(run, panels, height_in=2.0)


_STYLES = ("-", (0, (5.0, 1.5)), (0, (6.0, 1.5, 1.2, 1.5)))


def torques(subject: Subject) -> Figure:
    """Effort of every motor with its bounds (paper, Figs 7 and 8)."""
    motors = subject.named("motor")
    columns, height = (1, 1.45 if len(motors) <= 4 else 1.05) if len(motors) <= 8 else (2, 1.05)
    panels = []
    for i, name in enumerate(motors):
        low, high = (_effort(subject, name, side)[0] for side in ("lower", "upper"))
        applied, unit = _effort(subject, name, "applied")
        bounds = [
            Curve("bounds" if values is low else "_", values, _GREY, (0, (4.0, 1.5)), 0.9, is_limit=True)
            for values in (low, high)
            if np.all(np.isfinite(values))
        ]
        label = "torque" if unit == "N m" else "force"
        lines = [*bounds, Curve(label, applied, BLUE, "-")]
        shown = lines if columns == 1 and i == 0 else [replace(line, label="_") for line in lines]
        panels.append(Panel(f"{short(name)}, {unit}", shown))
    return stacked(subject.run, panels, columns=columns, height_in=height)


def _effort(subject: Subject, name: str, what: str) -> tuple[FloatArray, str]:
    """Values of a motor in the log and their unit; of a servo its force, of which the log has no limits."""
    run, stem = subject.run, f"actuators.{identifier(name)}"
    unit = next(unit for unit in ("N", "N_m") if f"{stem}_force_{unit}" in run.keys or f"{stem}_applied_{unit}" in run.keys)
    if f"{stem}_force_{unit}" not in run.keys:
        values = run[f"{stem}_{what}_{unit}"]
    else:
        values = run[f"{stem}_force_{unit}"] if what == "applied" else np.full(len(run.time), np.nan)
    return values, unit.replace("_", " ")


def inputs(subject: Subject) -> Figure:
    """Thrusters, wheels and magnetorquers (paper, Fig. 16): a few thrusters as forces, many as bars."""
    thrusters, wheels = subject.named("thruster"), subject.named("wheel")
    panels = []
    if len(thrusters) <= 3:
        for name in thrusters:
            panels.append(
                Panel(f"{short(name)}, N", [Curve("force", _effort(subject, name, "applied")[0], BLUE, width=0.8)])
            )
    else:
        bars = {short(name): spans(subject.run.time, _effort(subject, name, "applied")[0] != 0.0) for name in thrusters}
        if any(map(len, bars.values())):
            panels.append(Panel("thruster on", bars=bars, height=0.36 + 0.093 * len(bars)))
    spent = [key for n in thrusters if (key := f"actuators.{identifier(n)}_impulse_N_s") in subject.run.keys]
    if spent:
        total = np.sum([subject.run[key] for key in spent], axis=0)
        panels.append(Panel("impulse spent, N s", [Curve("impulse", total, VERMILION)]))
    if wheels:
        lines = [Curve(short(n), _effort(subject, n, "applied")[0], width=0.9) for n in wheels]
        panels.append(Panel("wheel torque, N m", lines))
    if coils := subject.named("magnetorquer"):
        dipoles = [subject.run[f"actuators.{identifier(name)}_applied_A_m2"] for name in coils]
        lines = [Curve(short(name), values, width=0.9) for name, values in zip(coils, dipoles, strict=True)]
        panels.append(Panel("dipole, A m$^2$", lines))
    if subject.wheel_joints:
        panels.append(Panel("wheel speed, rad/s", [Curve(short(j.name), _rate(subject, j)) for j in subject.wheel_joints]))
    return stacked(subject.run, panels, height_in=1.4)


def _named(subject: Subject, subsystem: str) -> str:
    """Name of a subsystem in a legend or axis label."""
    return SUBSYSTEM_NAMES[subsystem] + ("s" if subsystem == "objects" and len(subject.system.objects) > 1 else "")


def _moving(subject: Subject) -> tuple[str, ...]:
    """Subsystems with momentum and energy: the FFSM, and the objects if any of them floats."""
    return ("robot", "objects") if subject.system.objects else ("robot",)


def momenta(subject: Subject) -> Figure:
    """P and L about the origin: of the FFSM computed in two ways, and of the objects (paper, Fig. 9)."""
    panels = [
        Panel(f"{_named(subject, subsystem)} ${letter}$, {unit}", _momentum_lines(subject, subsystem, first, letter))
        for subsystem in _moving(subject)
        for first, letter, unit in ((0, "P", "N s"), (3, "L", "N m s"))
    ]
    return stacked(subject.run, panels, height_in=1.35)


def _momentum_lines(subject: Subject, subsystem: str, first: int, letter: str) -> list[Curve]:
    free = free_components(subject.run.log.header.metadata, subsystem) > 0
    values = subject.run.momentum(subsystem)
    lines: list[Curve] = []
    again: list[Curve] = []
    for axis in range(3):
        i = first + axis
        if free[i] or np.any(np.abs(values[:, i]) > 1e-9):
            lines.append(Curve(f"${letter}_{'xyz'[axis]}$", values[:, i], COLOURS[axis], _STYLES[axis]))
        if subsystem == "robot" and free[i]:
            by_matrix = subject.run[f"momentum.robot_by_mass_matrix_{COMPONENTS[i]}"]
            again.append(Curve("_" if again else "from $M\\dot q$", by_matrix, BLACK, (0, (1.0, 2.5)), 0.9))
    return lines + again


_KEPT = ("energy.total_J", f"energy.{ELASTIC.format('total')}", f"balance.{DAMPER_HEAT.format('total')}")


def energies(subject: Subject) -> Figure:
    """Kinetic energy of the FFSM and the objects, and the work of the actuators (paper, Fig. 10).

    With springs and dampers of joints, the change of energy contains elastic energy and heat.
    """
    run = subject.run
    kept = [key for key in _KEPT if key in run.keys]
    energy = np.sum([run[key] for key in kept], axis=0)
    kinetic = [
        Curve(_named(subject, p), run[f"energy.{p}_J"], c, s)
        for p, c, s in zip(_moving(subject), (BLUE, VERMILION), _STYLES, strict=False)
    ]
    # A run that goes on from another one brings its work and its losses along.
    keys = [key for key in ("balance.work_J", f"balance.{OBJECTS_WORK}") if key in run.keys]
    work = np.sum([run[key] - run[key][0] for key in keys], axis=0)
    impacts = run["balance.total_impact_energy_J"] - run["balance.total_impact_energy_J"][0]
    account = [
        Curve("energy change", energy - energy[0], BLUE, "-"),
        Curve("work + impacts", work + impacts, BLACK, (0, (1.0, 2.5)), 1.1),
        Curve("lost in impacts", -impacts, ORANGE, (0, (6.0, 1.5, 1.2, 1.5))),
    ]
    panels = [Panel("kinetic energy, J", kinetic), Panel("balance of the\nwhole system, J", account)]
    return stacked(run, panels, height_in=1.9)


def conservation(subject: Subject) -> Figure:
    """Residuals of energy and momenta, the largest in each time slice, and their tolerances."""
    run, header = subject.run, subject.run.log.header
    sizes = {}
    for subsystem in SUBSYSTEMS:
        accounts, rows = BalanceColumns(header.layout, header.metadata, subsystem), np.asarray(run.log.rows)
        energy, momentum = accounts.energy(rows), accounts.momentum(rows)
        energy, momentum, loss = energy - energy[0], momentum - momentum[0], accounts.truncation(rows)
        if loss is not None:
            energy = without_loss(energy, loss - loss[0])
        sizes[subsystem] = np.abs(energy), norms(momentum[:, :3]), norms(momentum[:, 3:])
    windows = np.maximum(np.ceil(run.time / drift_window_s(header.metadata) - 1e-9), 1.0)
    panels, checks = [], run.checks(DEFAULT_TOLERANCE)
    for i, (check, unit) in enumerate(CONSERVED.items()):
        allowed = {
            x.subsystem: x.tolerance for x in checks if x.name == check and x.subsystem in ("total", *_moving(subject))
        }
        lines = []
        for subsystem, colour, style in zip(SUBSYSTEMS, (BLACK, BLUE, VERMILION), _STYLES, strict=True):
            if subsystem not in allowed:
                continue
            time, worst = running_maximum(run.time, sizes[subsystem][i])
            label = _named(subject, subsystem) if np.any(worst) else f"{_named(subject, subsystem)}: 0"
            # A logarithmic axis cannot show zero: residuals that are exactly zero are left out.
            lines.append(Curve(label, np.where(worst > 0.0, worst, np.nan), colour, style, 1.1, time))
        if allowed:  # a run that is not conservative has no such check
            lines.append(Curve("allowed", min(allowed.values()) * windows, _GREY, (0, (4.0, 1.5)), 0.9))
            panels.append(Panel(f"{check.replace(' ', chr(10))}\nresidual, {unit}", lines, log=True))
    return stacked(run, panels, height_in=1.6)


_TOTAL_ELASTIC, _TOTAL_HEAT = f"energy.{ELASTIC.format('total')}", f"balance.{DAMPER_HEAT.format('total')}"
_UNITS = {"hinge": ("deflection, mrad", 1e3), "slide": ("deflection, mm", 1e3)}


def has_springs(run: Run) -> bool:
    """Whether joints of the models have springs."""
    return _TOTAL_ELASTIC in run.keys


def springs(subject: Subject) -> Figure:
    """Deflection of each spring of a hinge or slide from its reference, elastic energy, and heat of dampers."""
    run, model = subject.run, subject.system.mj
    sprung = {model.joint(j).name for j in np.flatnonzero(np.any(stiffness_coefficients(model), axis=1)).tolist()}

    def zero(joint: Joint) -> float:
        return float(model.qpos_spring[joint.qpos.start])

    panels = []
    for kind, (label, factor) in _UNITS.items():
        joints = [joint for name, joint in subject.system.joints.items() if joint.kind == kind and name in sprung]
        if joints:
            panels.append(
                Panel(
                    label,
                    [Curve(short(joint.name), factor * (_coordinate(subject, joint) - zero(joint))) for joint in joints],
                )
            )
    energy = [Curve("elastic energy", run[_TOTAL_ELASTIC], COLOURS[0])]
    if _TOTAL_HEAT in run.keys:
        energy.append(Curve("heat of dampers", run[_TOTAL_HEAT], BLACK, (0, (4.0, 1.5))))
    return stacked(run, [*panels, Panel("energy, J", energy)], height_in=1.8)
