"""Metrics of an episode so far, under the names that a campaign gives them at the end of a run."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.analysis.intervals import ContactIntervals, GraspIntervals
from ffsm_mj.assembly.assemble import Assembly
from ffsm_mj.controller_protocol import Observation
from ffsm_mj.errors import unknown_name
from ffsm_mj.experiments.metrics import fault_in_list, record_lists, value_at
from ffsm_mj.records.kinds import all_fields, kind_of

_TIP = ("min_error_m", "min_error_time_s", "final_error_m", "final_speed_m_s")
_OF_ROWS = {"contacts": ("impulse_N_s", "slip_m", "sliding_s"), "grasps": ()}
"""Values of intervals, beside those whose names begin with peak, that are known from all rows of a run only."""


class Episode:
    """What has happened in an episode: lists of records and intervals, and the error of the tip at control ticks."""

    def __init__(self, assembly: Assembly) -> None:
        """Begin with nothing."""
        self._assembly, self._task = assembly, assembly.task
        self._contacts, self._grasps = ContactIntervals(assembly.row.layout), GraspIntervals(assembly.row.layout)
        self._records: dict[str, list[dict[str, Any]]] = {}
        self._lists: dict[str, Any] | None = None
        self._time_s, self._twist = 0.0, np.zeros(6)
        self._tip = dict.fromkeys(_TIP, math.inf)

    def add(self, events: Iterable[Any]) -> None:
        """Take records of events, in order."""
        for record in events:
            kind = kind_of(record)
            if kind.plural and kind.summarised:
                self._records.setdefault(kind.plural, []).append(kind.summary(record))
            self._contacts.event(record)
            self._grasps.event(record)
            self._lists = None

    def look(self, observation: Observation) -> None:
        """Take the state at a control tick."""
        self._time_s = observation.time_s
        if self._task is None:
            return
        model, data, axes = self._assembly.system.mj, self._assembly.data, list(self._task.axes)
        site = self._task.tip_site
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_SITE, site, self._twist, 0)
        target, rates = self._task.target_at(observation.time_s, data)
        error = math.dist(data.site_xpos[site][axes], target)
        self._tip["final_error_m"], self._tip["final_speed_m_s"] = error, math.hypot(*(self._twist[3:][axes] - rates))
        if error < self._tip["min_error_m"]:
            self._tip["min_error_m"], self._tip["min_error_time_s"] = error, self._time_s

    def metric(self, name: str) -> Callable[[], Any] | None:
        """Reader of a metric; None if the name is not that of one.

        Raises:
            LookupError: It is one of a finished run only, or of a list that has no such value.
        """
        head, _, rest = name.partition(".")
        if name == "duration_s":
            return lambda: self._time_s
        if head == "tip":
            if self._task is None or rest not in _TIP:
                known = [f"tip.{key}" for key in _TIP] if self._task is not None else []
                raise LookupError(unknown_name("metric", name, known))
            return lambda: self._tip[rest]
        lists = record_lists()
        if head not in lists:
            return None
        if fault := fault_in_list(head, rest, lists[head]):
            raise LookupError(fault)
        field = rest.partition(".")[2]
        if head in _OF_ROWS and (field.startswith("peak") or field in _OF_ROWS[head]):
            raise LookupError(f"{name} is known at the end of a run only")
        return lambda: value_at(self._summary(), name)

    def _summary(self) -> dict[str, Any]:
        if self._lists is None:
            intervals = {"contacts": self._contacts.intervals(), "grasps": self._grasps.intervals()}
            empty: dict[str, Any] = {name: [] for name in record_lists()}
            found = {name: [all_fields(each) for each in some] for name, some in intervals.items()}
            self._lists = empty | self._records | found
        return self._lists
