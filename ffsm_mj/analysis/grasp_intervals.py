"""Captures, each from when a grasp takes hold to when it lets go: worked out from what rows and records say of them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.grasp.record import CAPTURE, RELEASE, CaptureRecord, ReleaseRecord
from ffsm_mj.records.events import Event
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.records.signals import CAPTURE_EVENT_LOADS, CAPTURE_LOADS, Layout

COLUMNS = {
    "grasp": ("", "name of the grasp"),
    "time_s": ("s", "when it takes hold"),
    "release_s": ("s", "when it lets go; NaN where it holds to the end of the log"),
    "loss_J": ("J", "kinetic energy lost as it takes hold"),
    "impulse_{xyz}": ("N s", "impulse on the object then, world frame"),
    "peak_force_N": ("N", "greatest force on the object in that time, of the samples and right after events"),
    "peak_torque_N_m": ("N m", "greatest torque on it about its site in that time, likewise"),
    "peak_s": ("s", "when the force is greatest"),
}


@dataclass(frozen=True)
class GraspInterval:
    """An object that was held for a time.

    Attributes:
        grasp: Name of the grasp.
        time_s: When it took hold.
        release_s: When it let go; None where it holds to the end of the log.
        loss_J: Kinetic energy lost as it took hold.
        impulse: On the object then, world axes, N s.
        peak_force_N: Greatest force on the object in that time, of the samples and right after events.
        peak_torque_N_m: Greatest torque on it about its site, likewise.
        peak_s: When the force was greatest.
    """

    grasp: str
    time_s: float
    release_s: float | None
    loss_J: float
    impulse: tuple[float, ...]
    peak_force_N: float
    peak_torque_N_m: float
    peak_s: float


class _OpenGrasp:
    """A capture while it is told of."""

    def __init__(self, begins: CaptureRecord) -> None:
        self.begins, self.end_s = begins, math.inf
        self._force, self._torque, self._peak_s = 0.0, 0.0, begins.time_s

    def rows(self, times: FloatArray, loads: FloatArray, events: FloatArray) -> None:
        """Take those of some rows that fall into it; at the instant of the release nothing is held any more."""
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

    def told(self) -> GraspInterval:
        """What it came to."""
        begins, end_s = self.begins, None if self.end_s == math.inf else self.end_s
        peaks = self._force, self._torque, self._peak_s
        return GraspInterval(begins.grasp, begins.time_s, end_s, begins.loss_J, begins.impulse_N_s, *peaks)


class GraspIntervals:
    """Captures of one run, told in blocks of rows and records."""

    def __init__(self, layout: Layout) -> None:
        """Nothing was told yet."""
        self._time = layout.time
        known = layout.index.keys() >= {*CAPTURE_LOADS, *CAPTURE_EVENT_LOADS}
        self._loads = layout.places(CAPTURE_LOADS) if known else None
        self._events = layout.places(CAPTURE_EVENT_LOADS) if known else None
        self._spells: list[_OpenGrasp] = []
        self._awaited: list[_OpenGrasp] = []

    def event(self, event: Event) -> None:
        """Take the next record; one that tells of no capture says nothing here."""
        if isinstance(event, CaptureRecord):
            self._spells.append(_OpenGrasp(event))
            self._awaited.append(self._spells[-1])
        elif isinstance(event, ReleaseRecord) and self._spells:  # else its capture is lost, with a part of the log
            self._spells[-1].end_s = event.time_s

    def rows(self, block: FloatArray) -> None:
        """Take the next rows."""
        if not self._awaited or self._loads is None or self._events is None:
            return
        times = block[:, self._time]
        for spell in self._awaited:
            spell.rows(times, block[:, self._loads], block[:, self._events])
        self._awaited = [spell for spell in self._awaited if not spell.end_s < times[-1]]

    def told(self) -> tuple[GraspInterval, ...]:
        """All of them so far, in order."""
        return tuple(spell.told() for spell in self._spells)


def grasp_records(log: RunLog) -> list[CaptureRecord | ReleaseRecord]:
    """What a log tells of captures and releases, in order."""
    found = [record for kind in (CAPTURE, RELEASE) for record in log.records.get(kind.plural, ())]
    return sorted(found, key=lambda record: (record.time_s, isinstance(record, CaptureRecord)))
