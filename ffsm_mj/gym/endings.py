"""An episode: its metrics so far, and its ends by success, failure, forbidden contacts, and values beyond their bounds."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_mj.analysis.intervals import ContactIntervals, GraspIntervals
from ffsm_mj.assembly.assemble import Assembly
from ffsm_mj.conditions import Condition, conditions
from ffsm_mj.contact_models.persistent.record import ContactEnds
from ffsm_mj.controller_protocol import Observation
from ffsm_mj.errors import Faults, unknown_name
from ffsm_mj.experiments.metrics import fault_in_list, record_lists, value_at
from ffsm_mj.gym.observations import Values
from ffsm_mj.records.kinds import all_fields, kind_of
from ffsm_mj.scenario.env_config import EnvConfig

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
        self._metrics: dict[str, Any] = {}  # of the records so far, as far as they were asked for
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
            self._metrics.clear()

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
        return lambda: self._metric_of_lists(name)

    def _metric_of_lists(self, name: str) -> Any:
        if name not in self._metrics:
            intervals = {"contacts": self._contacts.intervals(), "grasps": self._grasps.intervals()}
            empty: dict[str, Any] = {of_records: [] for of_records in record_lists()}
            listed = {of_parts: [all_fields(part) for part in some] for of_parts, some in intervals.items()}
            self._metrics[name] = value_at(empty | self._records | listed, name)
        return self._metrics[name]


UNHANDLED = "unhandled"
"""Name for overlaps of geoms that no contact model handles, among the forbidden contacts."""
Overlaps = Callable[[], tuple[tuple[str, ...], ...]]
_Predicate = list[tuple[Condition, Callable[[Observation], Any]]]


class Ending(NamedTuple):
    """The end of an episode.

    Attributes:
        success: Whether it is one with success.
        reason: ``success``, ``failure``, ``forbidden contact PAIR``, ``bound of NAME``, or the outcome of the run.
    """

    success: bool
    reason: str


class Endings:
    """Ends of episodes of one run."""

    def __init__(self, config: EnvConfig, values: Values, episode: Episode, overlaps: Overlaps) -> None:
        """Bind the conditions to a run.

        Args:
            config: Section of the scenario.
            values: Values of the run.
            episode: Its metrics.
            overlaps: Geoms of the overlaps at the last control tick that no contact model handles.

        Raises:
            ScenarioFaults: One fault per unknown name.
        """
        self._values, self._episode = values, episode
        self._overlaps: Overlaps = overlaps if UNHANDLED in config.forbidden_contacts else tuple
        self._success: _Predicate = []
        self._failure: _Predicate = []
        self._bounds: list[tuple[str, float, float, Callable[[Observation], float]]] = []
        self._forbidden: set[str] = set()
        with Faults() as faults:
            for key, text, predicate in (
                ("success", config.success, self._success),
                ("failure", config.failure, self._failure),
            ):
                for condition in conditions(text) if text is not None else ():
                    with faults.below("env", key):
                        predicate.append((condition, self._named(condition.metric)))
            for name, (low, high) in config.bounds.items():
                with faults.below("env", "bounds", name):
                    self._bounds.append((name, low, high, values.scalar(name)))
            for i, name in enumerate(config.forbidden_contacts):
                with faults.below("env", "forbidden_contacts", i):
                    self._forbidden |= values.pairs_of([name]) if name != UNHANDLED else set()

    def _named(self, name: str) -> Callable[[Observation], Any]:
        """Reader of a metric of the episode, or else of a value."""
        metric = self._episode.metric(name)
        return self._values.scalar(name) if metric is None else lambda _: metric()

    def reached(self, observation: Observation, events: Iterable[Any]) -> Ending | None:
        """End at a control tick, with the records since the last one; failure goes before success."""
        for record in events:
            if getattr(record, "pair", None) in self._forbidden and not isinstance(record, ContactEnds):
                return Ending(False, f"forbidden contact {record.pair}")
        for geoms in self._overlaps():
            return Ending(False, f"forbidden contact {' and '.join(geoms)}")
        for name, low, high, read in self._bounds:
            if not low <= read(observation) <= high:
                return Ending(False, f"bound of {name}")
        if _holds(self._failure, observation):
            return Ending(False, "failure")
        return Ending(True, "success") if _holds(self._success, observation) else None


def _holds(predicate: _Predicate, observation: Observation) -> bool:
    return bool(predicate) and all(condition.holds({condition.metric: read(observation)}) for condition, read in predicate)
