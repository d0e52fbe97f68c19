"""Intervals from closing to release of a grasp, computed from rows and records."""

from __future__ import annotations

import math

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.grasp.records import GRASP, RELEASE, GraspRecord, ReleaseRecord
from ffsm_mj.records.events import Event
from ffsm_mj.records.load_columns import load_columns_of
from ffsm_mj.records.record import Values, declared, record
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.records.signals import Layout


@record
class GraspInterval:
    """Interval in which an object was grasped."""

    grasp: str = declared("Name of the grasp.")
    time_s: float = declared("Time of closing.")
    release_s: float | None = declared(
        "Time of the release, or at which another grasp of the same two sites takes over; None if the grasp is closed at "
        "the end of the log.",
        column="time of the release, or at which another grasp takes over; NaN if closed at the end of the log",
    )
    loss_J: float = declared("Kinetic energy lost at closing.")
    impulse: Values = declared(
        "Impulse on the object at closing, world axes.",
        column="impulse on the object at closing, world frame",
        unit="N s",
        components="xyz",
    )
    peak_force_N: float = declared("Greatest force on the object in the interval, of the samples and right after events.")
    peak_torque_N_m: float = declared(
        "Greatest torque on the object about its site, likewise.",
        column="greatest torque on the object about its site in the interval, likewise",
    )
    peak_s: float = declared("Time of the greatest force.")


class _OpenGrasp:
    """Accumulator for one interval."""

    def __init__(self, begins: GraspRecord, layout: Layout) -> None:
        self.begins, self.end_s = begins, math.inf
        columns = load_columns_of(layout, begins.grasp)
        self._places = (layout.places(columns.loads), layout.places(columns.event_loads)) if columns is not None else None
        self._force, self._torque, self._peak_s = 0.0, 0.0, begins.time_s

    def rows(self, times: FloatArray, block: FloatArray) -> None:
        """Process the rows within the interval; its end, the instant of the release, is excluded."""
        if self._places is None:
            return
        loads, events = (block[:, places] for places in self._places)
        for force, torque, at_s in events[(events[:, 2] >= self.begins.time_s) & (events[:, 2] < self.end_s)].tolist():
            self._higher(force, torque, at_s)
        first, last = np.searchsorted(times, self.begins.time_s), np.searchsorted(times, self.end_s)
        if first >= last:
            return
        force, torque = np.linalg.norm(np.nan_to_num(loads[first:last]).reshape(-1, 2, 3), axis=2).T
        highest = int(np.argmax(force))
        self._higher(float(force[highest]), float(torque.max()), float(times[first + highest]))

    def _higher(self, force: float, torque: float, at_s: float) -> None:
        if force > self._force:
            self._force, self._peak_s = force, at_s
        self._torque = max(self._torque, torque)

    def interval(self) -> GraspInterval:
        """The interval so far."""
        begins, end_s = self.begins, None if self.end_s == math.inf else self.end_s
        peaks = self._force, self._torque, self._peak_s
        return GraspInterval(begins.grasp, begins.time_s, end_s, begins.loss_J, begins.impulse_N_s, *peaks)


class GraspIntervals:
    """Accumulates the grasp intervals of one run from blocks of rows and records."""

    def __init__(self, layout: Layout) -> None:
        """Start without records."""
        self._layout = layout
        self._spells: list[_OpenGrasp] = []
        self._awaited: list[_OpenGrasp] = []

    def event(self, event: Event) -> None:
        """Process the next record; other kinds are ignored."""
        if isinstance(event, GraspRecord):
            self._end(event.replaces, event.time_s)
            self._spells.append(_OpenGrasp(event, self._layout))
            self._awaited.append(self._spells[-1])
        elif isinstance(event, ReleaseRecord):
            self._end(event.grasp, event.time_s)

    def _end(self, grasp: str, time_s: float) -> None:
        """End the interval of a grasp; without one its closing is in a damaged part of the log."""
        spell = next((each for each in self._spells if each.begins.grasp == grasp and each.end_s == math.inf), None)
        if spell is not None:
            spell.end_s = time_s

    def rows(self, block: FloatArray) -> None:
        """Process the next rows."""
        times = block[:, self._layout.time]
        for spell in self._awaited:
            spell.rows(times, block)
        self._awaited = [spell for spell in self._awaited if not spell.end_s < times[-1]]

    def intervals(self) -> tuple[GraspInterval, ...]:
        """All intervals so far, in order."""
        return tuple(spell.interval() for spell in self._spells)


def grasp_records(log: RunLog) -> list[GraspRecord | ReleaseRecord]:
    """Captures and releases in a log, in order."""
    found = [record for kind in (GRASP, RELEASE) for record in log.records.get(kind.plural, ())]
    return sorted(found, key=lambda record: (record.time_s, isinstance(record, GraspRecord)))
