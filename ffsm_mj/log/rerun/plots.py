"""Plots of a recording, and lanes of states: phases, the switching of thrusters, the modes of contacts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.persistent.rule_columns import RuleMode
from ffsm_mj.dynamics.rigid_body import external_actuators
from ffsm_mj.log.palette import (
    AXES,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PALE,
    PURPLE,
    ROBOT_ON_DARK,
    SKY,
    VERMILION,
    Colour,
    mixed,
    object_colour,
)
from ffsm_mj.model.magnetorquers import magnetorquer_mask
from ffsm_mj.model.system import System
from ffsm_mj.records.metadata import free_components
from ffsm_mj.records.sensing_columns import EstimatedColumns, MeasuredColumns, estimated_columns, measured_columns
from ffsm_mj.records.signals import COMPONENTS, SUBSYSTEMS, Layout, effort_key, identifier

TIMELINE = "sim_time"
_COLOURS = {
    "total": (PALE, PALE, PALE),
    "robot": (ROBOT_ON_DARK, BLUE, GREEN),
    "objects": (object_colour(0), ORANGE, PURPLE),
}
_USE_COLOURS = (ORANGE, SKY, GREEN, PURPLE, VERMILION, BLUE)
JOINTS, BASE = "plots/joints", "plots/base"
"""Parent entities of the efforts of joint motors, and of thrusters and ideal base torques."""
_MARGIN = 0.08
"""Margin of the y axis relative to the range of the curves."""
_LEAST = 1e-18
"""Least value on a logarithmic axis, far below rounding."""
FORCES = "plots/contact_forces"
"""Parent entity of the magnitudes of forces."""
TORQUES = "plots/interface_torque"
"""Parent entity of the magnitudes of torques."""
FRICTION_USE = "plots/friction_use"
"""Entity of the shares of the friction limit that contacts use."""


class Recording:
    """A stream of the Rerun SDK whose values are on one timeline, that of the simulation time.

    Attributes:
        stream: The stream.
    """

    def __init__(self, stream: rr.RecordingStream) -> None:
        """Wrap a stream."""
        self.stream = stream

    def constant(self, entity: str, value: Any) -> None:
        """Send what does not change."""
        self.stream.log(entity, value, static=True)

    @staticmethod
    def index(times: FloatArray | Sequence[float]) -> list[rr.TimeColumn]:
        """Times in s, (n,), at which columns have values."""
        return [rr.TimeColumn(TIMELINE, duration=times)]

    def send(self, entity: str, index: list[rr.TimeColumn], columns: Any) -> None:
        """Send columns of values. They go without ``log``, which would add a timeline of wall time."""
        rr.send_columns(entity, indexes=index, columns=columns, recording=self.stream)


@dataclass(frozen=True)
class Plot:
    """Curves of one entity.

    Attributes:
        entity: Path of the entity.
        columns: Column of a row for each curve.
        names: Name of each curve.
        colours: Colour of each curve, with its opacity from 0 to 255 if it is not opaque.
        unit: Common unit of the curves; empty if there is none.
        logarithmic: Whether the decimal logarithms of the magnitudes are shown.
        title: Title without the unit; empty if the layout gives one.
        widths: Width of each curve in points; none: the usual one.
        factors: Factor of each column; none: 1.
        limits: Places of the curves that are limits of the others; they do not drive the range of the y axis.
    """

    entity: str
    columns: list[int]
    names: list[str]
    colours: Sequence[Colour | tuple[int, int, int, int]]
    unit: str = ""
    logarithmic: bool = False
    title: str = ""
    widths: Sequence[float] = ()
    factors: Sequence[float] = ()
    limits: Sequence[int] = ()

    def values(self, rows: FloatArray) -> FloatArray:
        """Values to show for some rows, (n, number of curves)."""
        values = rows[:, self.columns]
        if self.factors:
            values = values * np.array(self.factors)
        return np.log10(np.maximum(np.abs(values), _LEAST)) if self.logarithmic else values


@dataclass
class Extent:
    """Range of the curves of a plot, limits aside.

    Attributes:
        low: Least value.
        high: Greatest value.
        limit: Least magnitude of the limits; infinite without any.
        is_empty: Whether no curve has shown anything but zero.
    """

    low: float = math.inf
    high: float = -math.inf
    limit: float = math.inf
    is_empty: bool = True

    def add(self, plot: Plot, values: FloatArray) -> None:
        """Take the next values of a plot, (n, number of curves)."""
        is_limit = np.isin(np.arange(values.shape[1]), plot.limits)
        curves = values[:, ~is_limit]
        curves = curves[np.isfinite(curves)]
        if curves.size:
            self.low, self.high = min(self.low, float(curves.min())), max(self.high, float(curves.max()))
        zero = math.log10(_LEAST) if plot.logarithmic else 0.0
        self.is_empty = self.is_empty and not np.any(curves != zero)
        self.limit = min(self.limit, float(np.nanmin(np.abs(values[:, is_limit]), initial=math.inf)))

    @property
    def y_range(self) -> tuple[float, float]:
        """Range of a y axis with a margin."""
        span = self.high - self.low or abs(self.high) or 1.0
        return self.low - _MARGIN * span, self.high + _MARGIN * span


def plots(layout: Layout, system: System, metadata: Mapping[str, str]) -> list[Plot]:
    """All plots of a run except the tip error, which is not a column."""
    index = layout.index
    subsystems = [subsystem for subsystem in SUBSYSTEMS if subsystem != "objects" or system.objects]
    energy = [index[f"energy.{subsystem}_J"] for subsystem in subsystems]
    return [
        Plot("plots/energy", energy, subsystems, [_COLOURS[subsystem][0] for subsystem in subsystems]),
        *_momenta(index, metadata, subsystems[1:]),
        _residuals(index, metadata),
        *_friction_use(layout),
        *_efforts(layout, system),
    ]


def _friction_use(layout: Layout) -> list[Plot]:
    rules = friction_modes(layout)
    columns = [layout.index[f"contact.{name}_friction_use"] for name in rules]
    colours = [_USE_COLOURS[i % len(_USE_COLOURS)] for i in range(len(rules))]
    return [Plot(FRICTION_USE, columns, list(rules), colours)] if rules else []


def _free(metadata: Mapping[str, str], subsystem: str) -> list[str]:
    """Components of momentum that the joints of a subsystem leave free; the others are not conserved."""
    flags = free_components(metadata, subsystem)
    return [component for component, flag in zip(COMPONENTS, flags, strict=True) if flag]


def _momenta(index: Mapping[str, int], metadata: Mapping[str, str], subsystems: Sequence[str]) -> list[Plot]:
    groups = []
    for subsystem in subsystems:
        for kind, letter in (("linear", "P"), ("angular", "L")):
            components = [c for c in _free(metadata, subsystem) if c.startswith(letter)]
            colours = [_COLOURS[subsystem]["xyz".index(c[2])] for c in components]
            columns = [index[f"momentum.{subsystem}_{c}"] for c in components]
            names = [f"{subsystem} {c[2]}" for c in components]
            if components:
                groups.append(Plot(f"plots/{kind}_momentum/{subsystem}", columns, names, colours))
    return groups


def _residuals(index: Mapping[str, int], metadata: Mapping[str, str]) -> Plot:
    colours = dict(zip(COMPONENTS, (ORANGE, VERMILION, PURPLE, SKY, BLUE, GREEN), strict=True))
    components = _free(metadata, "total")
    columns = [index["balance.total_energy_residual_J"], *(index[f"balance.total_residual_{c}"] for c in components)]
    names = ["energy", *(c[:3] for c in components)]
    return Plot("plots/balance", columns, names, [PALE, *(colours[c] for c in components)], logarithmic=True)


def _efforts(layout: Layout, system: System) -> list[Plot]:
    groups = []
    external = external_actuators(system) | magnetorquer_mask(system.mj)
    for i, name in enumerate(system.names("actuator")):
        columns = [layout.index[effort_key(layout, name, what)] for what in ("lower", "upper", "applied")]
        entity = f"{BASE if external[i] else JOINTS}/{identifier(name)}"
        names, unit = ["lower bound", "upper bound", name.rsplit("/", 1)[-1]], layout.signals[columns[-1]].unit
        groups.append(Plot(entity, columns, names, [GREY, GREY, ORANGE], unit, limits=(0, 1)))
    return groups


_SENSORS, _ESTIMATES = "plots/sensors", "plots/estimates"
_AXES = {"": ORANGE, "w": PALE, **dict(zip("xyz", AXES, strict=True))}
_JOINTS = (ORANGE, SKY, GREEN, PURPLE, VERMILION, BLUE, PALE)
_THIN, _USUAL, _THICK, _TRANSLUCENT = 1.0, 1.5, 4.0, 90
_ON_A_PAGE = 8
"""Greatest number of plots of sensors in one tab."""


def sensing_tabs(layout: Layout, system: System) -> dict[str, list[Plot]]:
    """Plots by the name of their tab: sensors in pages, then the estimate of the robot and of each object."""
    sensors = [_sensor(columns, layout) for columns in measured_columns(layout, system.sensors)]
    pages = [sensors[first : first + _ON_A_PAGE] for first in range(0, len(sensors), _ON_A_PAGE)]
    tabs = {"Sensors" if i == 0 else f"Sensors {i + 1}": page for i, page in enumerate(pages)}
    for columns in estimated_columns(layout, system.trees):
        tabs.setdefault(f"Estimate of {columns.subsystem}", []).extend(_estimate(columns, layout))
    return tabs


def _sensor(columns: MeasuredColumns, layout: Layout) -> Plot:
    """Newest sample of a sensor, over its true value at the time of this sample."""
    colours = [_AXES[component] for component in columns.components]
    names = [component or "measured" for component in columns.components]
    title = columns.sensor.split("/", 1)[-1].replace("_", " ")
    entity = f"{_SENSORS}/{identifier(columns.sensor)}"
    return _over_truth(entity, title, columns.unit, layout, columns.true, columns.measured, names, colours)


def _estimate(columns: EstimatedColumns, layout: Layout) -> list[Plot]:
    """An estimated quantity over its true value, and its error within three standard deviations."""
    stem = f"{_ESTIMATES}/{identifier(columns.subsystem)}/{identifier(columns.quantity)}"
    error = _error(f"{stem}_error", columns, layout)
    if not columns.quantity.startswith("joint"):
        names = ["w", "x", "y", "z"][-len(columns.estimate) :]
        colours = [_AXES[name] for name in names]
        unit = "quaternion" if len(names) == 4 else columns.unit
        title = f"{columns.quantity.capitalize()}, estimate"
        return [_over_truth(stem, title, unit, layout, columns.true, columns.estimate, names, colours), error]
    return [error]  # the curves of all joints in one plot would cover each other


def _over_truth(
    entity: str,
    title: str,
    unit: str,
    layout: Layout,
    true: Sequence[str],
    shown: Sequence[str],
    names: Sequence[str],
    colours: Sequence[Colour],
) -> Plot:
    """Thin curves, and thick translucent ones of the truth; legends list as many as have room, in this order."""
    return Plot(
        entity,
        layout.places((*shown, *true)).tolist(),
        [*names, *("true" if name == "measured" else f"true {name}" for name in names)],
        [*colours, *((*colour, _TRANSLUCENT) for colour in colours)],
        unit,
        title=title,
        widths=[_USUAL] * len(shown) + [_THICK] * len(true),
    )


def _error(entity: str, columns: EstimatedColumns, layout: Layout) -> Plot:
    """Errors of a quantity, and the bounds of three standard deviations as thin paler curves."""
    count = len(columns.errors)
    colours = list(AXES) if columns.components == tuple("xyz") else [_JOINTS[i % len(_JOINTS)] for i in range(count)]
    bounds = 2 * list(columns.sigmas)
    return Plot(
        entity,
        layout.places((*columns.errors, *bounds)).tolist(),
        [*columns.components, *(f"3 sigma {component}" for component in columns.components * (len(bounds) // count))],
        [*colours, *(mixed(colour, GREY, 0.5) for colour in colours * (len(bounds) // count))],
        columns.unit,
        title=f"Error of {columns.quantity}{', 3 sigma' if bounds else ''}",
        widths=[_USUAL] * count + [_THIN] * len(bounds),
        factors=[1.0] * count + [3.0] * len(columns.sigmas) + [-3.0] * len(columns.sigmas),
        limits=range(count, count + len(bounds)),
    )


_PHASE_COLOURS = (BLUE, VERMILION, GREEN, PURPLE)
"""Dark enough for white letters; successive phases have different ones."""
OFF = "off"
FIRING = {1: "fires +", 0: OFF, -1: "fires -"}
"""States of a thruster by the sign of its force."""


def phase_looks(names: Sequence[str]) -> rr.StateConfiguration:
    """Labels and colours of phases by their names, in order."""
    known = list(dict.fromkeys(names))
    labels = [name.replace("_", " ") for name in known]
    colours = [_PHASE_COLOURS[i % len(_PHASE_COLOURS)] for i in range(len(known))]
    return rr.StateConfiguration(values=known, labels=labels, colors=colours)


def thruster_looks() -> rr.StateConfiguration:
    """Labels and colours of the states of a thruster."""
    return rr.StateConfiguration(
        values=[OFF, "fires +", "fires -"], labels=[" ", "+", "-"], colors=[(60, 60, 60), ORANGE, SKY]
    )


def contact_looks() -> rr.StateConfiguration:
    """Labels and colours of the modes of a contact."""
    colours = [(60, 60, 60), (100, 100, 100), BLUE, BLUE, VERMILION]
    return rr.StateConfiguration(
        values=[mode.word for mode in RuleMode], labels=[" ", " ", "force", "sticks", "slides"], colors=colours
    )


def friction_modes(layout: Layout) -> dict[str, int]:
    """Columns of the contact modes of the rules with friction, by the name of the rule in columns."""
    names = (key.removeprefix("contact.").removesuffix("_friction_use") for key in layout.keys if _of_use(key))
    return {name: layout.index[f"contact.{name}_mode"] for name in names if f"contact.{name}_mode" in layout.index}


def _of_use(key: str) -> bool:
    return key.startswith("contact.") and key.endswith("_friction_use")


class Switching:
    """Detects when thrusters or contacts change their state, from all rows of a run: frames would miss short pulses.

    Attributes:
        rest: The state at the start.
    """

    def __init__(self, time: int, columns: dict[str, int], states: Mapping[Any, str]) -> None:
        """Start with all values at zero.

        Args:
            time: Column of the simulation time.
            columns: Column of each value by name; rounded away from zero, and within those of the states, it is the state.
            states: Names of the states.
        """
        self._time, self._columns, self._states, self.rest = time, columns, states, states[0]
        self._last = dict.fromkeys(columns, 0)

    def changes(self, rows: FloatArray) -> list[tuple[str, FloatArray, list[str]]]:
        """(Name, times, states) of everything that changes its state in a block of rows."""
        changed: list[tuple[str, FloatArray, list[str]]] = []
        for name, column in self._columns.items():
            values: Any = rows[:, column]
            values = np.clip(np.where(values < 0.0, np.floor(values), np.ceil(values)), min(self._states), max(self._states))
            values = np.nan_to_num(values).astype(int)
            switched = np.flatnonzero(np.diff(values, prepend=self._last[name]))
            if len(switched):
                changed.append((name, rows[switched, self._time], [self._states[int(value)] for value in values[switched]]))
                self._last[name] = int(values[-1])
        return changed


class Lanes:
    """Sends the states of thrusters or contacts; a lane is created when its state first changes.

    Attributes:
        begun: Names of the lanes.
    """

    def __init__(self, recording: Recording, parent: str, switching: Switching, looks: rr.StateConfiguration) -> None:
        """Start without lanes.

        Args:
            recording: Destination.
            parent: Parent entity of the lanes.
            switching: Detects the changes.
            looks: Labels and colours.
        """
        self._recording, self._parent, self._switching, self._looks = recording, parent, switching, looks
        self.begun: set[str] = set()

    def send(self, rows: FloatArray) -> list[str]:
        """Send the changes in a block of rows; names of the lanes that begin."""
        new, recording = [], self._recording
        for name, times, states in self._switching.changes(rows):
            lane = f"{self._parent}/{name}"
            if name not in self.begun:
                self.begun.add(name)
                new.append(name)
                recording.send(lane, recording.index([0.0]), rr.StateChange.columns(state=[self._switching.rest]))
                recording.constant(lane, self._looks)
            recording.send(lane, recording.index(times), rr.StateChange.columns(state=states))
        return new
