"""Timing and errors of the sensors of a log, from its models and its scenario, and their columns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ffsm_mj.model.sensors import ModelSensor
from ffsm_mj.records.metadata import logged_start_s
from ffsm_mj.records.sensing_columns import measured_columns
from ffsm_mj.records.signals import identifier
from ffsm_mj.verification.independent.finding import Array
from ffsm_mj.verification.independent.scene import LoggedScene


@dataclass(frozen=True)
class SensorSettings:
    """A sensor of a log.

    Attributes:
        model: The sensor of its model.
        given: What the scenario sets of it.
        measured: Columns of its measured value.
        true: Columns of its true value.
        sampled: Column of the time of the sample.
        seed: Seed of the run.
        start_s: Start of the run, s.
        interval_s: Time between samples, s.
        first_s: Time of the first sample, s.
        delay_s: Least time from a sample to its arrival, s.
    """

    model: ModelSensor
    given: Mapping[str, Any]
    measured: tuple[int, ...]
    true: tuple[int, ...]
    sampled: int
    seed: int
    start_s: float
    interval_s: float
    first_s: float
    delay_s: float

    @property
    def name(self) -> str:
        """Full name."""
        return self.model.name

    def value(self, key: str, default: Any) -> Any:
        """What the scenario sets under a key, or a default."""
        found = self.given.get(key)
        return default if found is None else found

    def numbers(self, block: Array) -> Array:
        """Numbers of the samples that some rows show, (n,); NaN before the first arrival."""
        return np.asarray(np.round((block[:, self.sampled] - self.first_s) / self.interval_s))


def sensor_settings(scene: LoggedScene) -> list[SensorSettings]:
    """The sensors of a log whose columns it has.

    Raises:
        LookupError: The scenario names a sensor that the models do not have, or a column is missing.
    """
    layout, system, scenario, metadata = scene.layout, scene.system, scene.scenario, scene.log.header.metadata
    period_s = float(metadata.get("control_period_s", "nan"))
    given = {system.resolve("sensor", key): dict(part) for key, part in (scenario.get("sensors") or {}).items()}
    found = []
    for columns in measured_columns(layout, system.sensors):
        model, own = system.sensors[columns.sensor], given.get(columns.sensor, {})
        timing = {
            name: own[name] if own.get(name) is not None else getattr(model, name)
            for name in ("interval_s", "first_s", "delay_s")
        }
        timing["interval_s"] = timing["interval_s"] or period_s
        found.append(
            SensorSettings(
                model,
                own,
                tuple(layout.index[key] for key in columns.measured),
                tuple(layout.index[key] for key in columns.true),
                layout.index[f"sensor.{identifier(columns.sensor)}_sampled_s"],
                int(scenario.get("seed") or 0),
                logged_start_s(metadata),
                **timing,
            )
        )
    return found
