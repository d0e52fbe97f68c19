"""Columns of a row that hold the loads on grasped objects, and the arrows that viewers draw from them.

A scenario whose grasps all join the same two sites, so that one at most is closed at a time, has one set of columns,
``contact.grasp_*``. Any other scenario has a set for each grasp, ``contact.grasp_<grasp>_*``.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

from ffsm_mj.model.grasp import Grasp
from ffsm_mj.records.kinds import ArrowColumns
from ffsm_mj.records.signals import Layout, Signal, identifier

_GROUP = "contact"
_LOADS = {**{f"force_{x}_N": "N" for x in "xyz"}, **{f"torque_{x}_N_m": "N m" for x in "xyz"}}
_POINT = tuple(f"centre_{x}_m" for x in "xyz")
_EVENT_LOADS = {"event_force_N": "N", "event_torque_N_m": "N m", "event_s": "s"}
_BETWEEN = "right after an event since the previous sample"
_CLOSED = re.compile(rf"{_GROUP}\.grasp_(?:(.+)_)?closed")


@dataclass(frozen=True)
class LoadColumns:
    """One set of columns.

    Attributes:
        grasp: Name of its grasp, as an identifier; empty: the only set of a scenario.
        closed: Column that says what is closed: of the only set the number of the grasp among those of the scenario, from 1;
            of a set of one grasp its place in the order of closing, from 1. 0: not closed.
        loads: Columns of force and torque on the object.
        point: Columns of their point of application, the object's site; NaN if no grasp is closed.
        event_loads: Columns of the greatest force and torque right after an event since the last sample, and of the time of
            the greatest force.
    """

    grasp: str
    closed: str
    loads: tuple[str, ...]
    point: tuple[str, ...]
    event_loads: tuple[str, ...]

    @classmethod
    @lru_cache
    def of(cls, grasp: str = "") -> LoadColumns:
        """The set of a grasp, or the only one of a scenario."""
        name = identifier(grasp)
        start = f"{_GROUP}.grasp_{name}_" if name else f"{_GROUP}.grasp_"
        closed = f"{start}closed"
        parts = (tuple(f"{start}{end}" for end in ends) for ends in (_LOADS, _POINT, _EVENT_LOADS))
        return cls(name, closed, *parts)

    @property
    def signals(self) -> tuple[Signal, ...]:
        """Their signals, in their order in a row."""
        whose = f" by {self.grasp}" if self.grasp else ""
        closed = (
            f"place of {self.grasp} in the order in which the closed grasps closed, from 1; 0 if it is open"
            if self.grasp
            else "number of the closed grasp among the grasps of the scenario, from 1; 0 if none"
        )
        force, torque = f"force on the grasped object{whose}", f"torque on the grasped object about its site{whose}"
        point = f"site of the grasped object, where the load{whose} acts; NaN if no grasp is closed"
        meanings = (
            f"largest force on the grasped object{whose} {_BETWEEN}, under the efforts set there; 0 if there was no event",
            f"largest torque on the grasped object about its site{whose} {_BETWEEN}; 0 if there was no event",
            f"time of the largest force{whose} {_BETWEEN}; NaN if there was no event",
        )
        at_row = "world axes, under the efforts of this row"
        loads = zip(self.loads, [force] * 3 + [torque] * 3, _LOADS.values(), strict=True)
        return (
            _signal(self.closed, "", closed),
            *(_signal(key, unit, f"{meaning}, {at_row}") for key, meaning, unit in loads),
            *(_signal(key, "m", point) for key in self.point),
            *map(_signal, self.event_loads, _EVENT_LOADS.values(), meanings),
        )


def _signal(key: str, unit: str, meaning: str) -> Signal:
    return Signal(_GROUP, key.partition(".")[2], unit, meaning)


SIGNALS_PER_SET = len(LoadColumns.of().signals)
"""Number of columns of a set."""


def load_columns(grasps: Sequence[Grasp]) -> list[LoadColumns]:
    """The sets of columns of the grasps of a scenario: one, or one per grasp."""
    if all(grasps[0].joins_sites_of(grasp) for grasp in grasps):
        return [LoadColumns.of()]
    return [LoadColumns.of(grasp.name) for grasp in grasps]


def logged_load_columns(layout: Layout) -> list[LoadColumns]:
    """The sets of columns that a row has, in its order."""
    candidates = [LoadColumns.of(match[1] or "") for key in layout.keys if (match := _CLOSED.fullmatch(key))]
    return [
        columns for columns in candidates if {*columns.loads, *columns.point, *columns.event_loads} <= layout.index.keys()
    ]


def load_columns_of(layout: Layout, grasp: str) -> LoadColumns | None:
    """The set of columns of a grasp in a row; None if the row has none."""
    return next((columns for columns in logged_load_columns(layout) if columns.grasp in ("", identifier(grasp))), None)


def load_arrows(layout: Layout) -> list[ArrowColumns]:
    """Force and torque on each grasped object, at its site; none if the run has no grasps."""
    arrows = []
    for columns in logged_load_columns(layout):
        name, whose = (f"grasp_{columns.grasp}", f" by {columns.grasp}") if columns.grasp else ("grasp", "")
        force, torque, point = (layout.places(keys) for keys in (columns.loads[:3], columns.loads[3:], columns.point))
        arrows += [
            ArrowColumns(name, f"force on the grasped object{whose}", force, point),
            ArrowColumns(f"{name}_torque", f"torque on the grasped object{whose}", torque, point, unit="N m"),
        ]
    return arrows
