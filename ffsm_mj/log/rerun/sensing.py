"""Plots of measurements and estimates in a recording."""

from __future__ import annotations

from collections.abc import Sequence

from ffsm_mj.log.palette import AXES, BLUE, GREEN, GREY, ORANGE, PALE, PURPLE, SKY, VERMILION, Colour, mixed
from ffsm_mj.log.rerun.plots import Plot
from ffsm_mj.model.system import System
from ffsm_mj.records.sensing_columns import EstimatedColumns, MeasuredColumns, estimated_columns, measured_columns
from ffsm_mj.records.signals import Layout, identifier

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
    )
