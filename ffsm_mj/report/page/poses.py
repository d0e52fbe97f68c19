"""Keyframes of a page: poses of the bodies at evenly spaced times and at the exact time of each event."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ffsm_mj.analysis.run import Run
from ffsm_mj.arrays import FloatArray
from ffsm_mj.log.drawing import Frames
from ffsm_mj.records.kinds import kind_of
from ffsm_mj.report.plots.subject import Subject

_MOST, _PER_SECOND = 600, 50.0
"""Greatest and, for a short run, least number of poses besides events; a browser interpolates between them."""


@dataclass(frozen=True)
class Poses(Frames):
    """Poses of all bodies at increasing times of a run, each from the first row at or after the time.

    Attributes:
        events: Number of the times that are events.
    """

    events: int

    @property
    def description(self) -> str:
        """One line with the number of poses."""
        at = f", {self.events} of them at events" if self.events else ""
        return f"{len(self.times)} poses over {self.times[-1]:g} s{at}"

    def nearest(self, time: float) -> int:
        """Index of the pose nearest to a time."""
        return int(np.argmin(np.abs(self.times - time)))


def picked_times(run: Run) -> FloatArray:
    """Evenly spaced times over a run, s."""
    end = run.digest.end_s
    return np.linspace(0.0, end, max(2, min(_MOST, 1 + math.ceil(end * _PER_SECOND))))


def poses(subject: Subject) -> Poses:
    """Poses at evenly spaced times, and at each event from its record."""
    run = subject.run
    rows = np.unique(np.clip(np.searchsorted(run.time, picked_times(run) - 1e-9), 0, len(run.time) - 1))
    found = dict(zip(run.time[rows].tolist(), run.qpos[rows], strict=True))
    # A log may hold any numbers: use a record only if its number of coordinates is that of the models.
    records = [record for record in run.log.events() if hasattr(record, "qpos")]
    at_events = {
        kind_of(record).time(record): np.array(record.qpos)
        for record in records
        if len(record.qpos) == subject.system.mj.nq and np.isfinite(record.qpos).all()
    }
    found |= at_events
    times = np.array(sorted(found))
    bodies = subject.system.mj.nbody
    positions, quaternions = np.empty((len(times), bodies, 3)), np.empty((len(times), bodies, 4))
    for i, time in enumerate(times.tolist()):
        data = subject.silhouette.place(found[time])
        positions[i], quaternions[i] = data.xpos, data.xquat
    after = np.clip(np.searchsorted(run.time, times - 1e-9), 0, len(run.time) - 1)
    return Poses(times, np.asarray(run.log.rows[after]), positions, quaternions, len(at_events))
