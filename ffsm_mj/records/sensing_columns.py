"""Columns of measurements and estimates in a log, by sensor and by estimated quantity."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from ffsm_mj.model.system import Tree
from ffsm_mj.records.signals import Layout, coordinate_names, identifier, rate_names, unit_of


@dataclass(frozen=True)
class MeasuredColumns:
    """Columns of a sensor.

    Attributes:
        sensor: Its full name.
        unit: Unit of its value; empty for a plain number.
        components: Name of each component; one empty name for a number.
        measured: Column of each component of the newest sample.
        true: Column of each component of the true value at the time of this sample.
    """

    sensor: str
    unit: str
    components: tuple[str, ...]
    measured: tuple[str, ...]
    true: tuple[str, ...]


@dataclass(frozen=True)
class EstimatedColumns:
    """Columns of an estimated quantity.

    Attributes:
        subsystem: Name of the robot or object.
        quantity: Name of the quantity.
        components: Name of each component of the error.
        unit: Unit of the error.
        true: Columns of the true values.
        estimate: Columns of the estimate.
        errors: Columns of the error.
        sigmas: Columns of the standard deviations of the error; empty if the estimator states none.
    """

    subsystem: str
    quantity: str
    components: tuple[str, ...]
    unit: str
    true: tuple[str, ...]
    estimate: tuple[str, ...]
    errors: tuple[str, ...]
    sigmas: tuple[str, ...]


def measured_columns(layout: Layout, sensors: Iterable[str]) -> list[MeasuredColumns]:
    """Columns of sensors by their full names; those that a log does not have are left out."""
    units, columns = {signal.name: signal.unit for signal in layout.signals if signal.group == "sensor"}, []
    for sensor in sensors:
        prefix = identifier(sensor)
        true = [name for name in units if name == f"{prefix}_true" or name.startswith(f"{prefix}_true_")]
        rests = [rest for name in true if prefix + (rest := name.removeprefix(f"{prefix}_true")) in units]
        if rests:
            first = [rest.split("_")[1] if rest.count("_") else "" for rest in rests]
            columns.append(
                MeasuredColumns(
                    sensor,
                    units[prefix + rests[0]],
                    tuple(part if part in ("w", "x", "y", "z") else "" for part in first),
                    tuple(f"sensor.{prefix}{rest}" for rest in rests),
                    tuple(f"sensor.{prefix}_true{rest}" for rest in rests),
                )
            )
    return columns


def estimated_columns(layout: Layout, trees: Iterable[Tree]) -> list[EstimatedColumns]:
    """Columns of all estimated quantities; empty if a log has no estimate."""
    candidates = [columns for tree in trees for columns in _of_tree(layout, tree)]
    return [columns for columns in candidates if all(key in layout.index for key in (*columns.estimate, *columns.errors))]


def _of_tree(layout: Layout, tree: Tree) -> Iterator[EstimatedColumns]:
    """Position, attitude, velocity and rate of a floating body; coordinates and rates of all hinges and slides."""
    joints = [joint for joint in tree.joints if joint.kind in ("hinge", "slide")]
    for joint in tree.joints:
        if joint.kind == "free":
            coordinates, rates = (
                [f"q_{name}" for name in coordinate_names(joint)],
                [f"v_{name}" for name in rate_names(joint)],
            )
            stem = f"error_q_{identifier(joint.name)}"
            places, turns = [f"{stem}_{axis}_m" for axis in "xyz"], [f"{stem}_turn_{axis}_rad" for axis in "xyz"]
            for quantity, names, errors in (
                ("position", coordinates[:3], places),
                ("attitude", coordinates[3:], turns),
                ("velocity", rates[:3], [f"error_{name}" for name in rates[:3]]),
                ("angular velocity", rates[3:], [f"error_{name}" for name in rates[3:]]),
            ):
                yield _quantity(layout, (tree.name, quantity, tuple("xyz")), names, errors)
    if joints:
        short = tuple(joint.name.split("/", 1)[-1] for joint in joints)
        names = [f"q_{coordinate_names(joint)[0]}" for joint in joints]
        yield _quantity(layout, (tree.name, "joints", short), names, [f"error_{name}" for name in names])
        names = [f"v_{rate_names(joint)[0]}" for joint in joints]
        yield _quantity(layout, (tree.name, "joint rates", short), names, [f"error_{name}" for name in names])


def _quantity(
    layout: Layout, what: tuple[str, str, tuple[str, ...]], names: list[str], errors: list[str]
) -> EstimatedColumns:
    sigmas = tuple(f"estimate.{error.replace('error_', 'sigma_', 1)}" for error in errors)
    return EstimatedColumns(
        *what,
        unit_of(errors[0]),
        tuple(f"state.{name}" for name in names),
        tuple(f"estimate.{name}" for name in names),
        tuple(f"estimate.{error}" for error in errors),
        sigmas if all(key in layout.index for key in sigmas) else (),
    )
