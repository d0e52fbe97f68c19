"""Lanes of states in a recording: phases with labels that fit, the switching of thrusters, and the modes of contacts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import rerun as rr

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.persistent.rule_columns import MODE_NAMES
from ffsm_mj.log.palette import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION
from ffsm_mj.records.signals import Layout

_LANE_LETTERS = 80
"""Number of letters across the lane in a window of 1200 pixels."""
_COLOURS = (BLUE, VERMILION, GREEN, PURPLE)
"""Dark enough for white letters; successive phases have different ones."""
OFF = "off"
FIRING = {1: "fires +", 0: OFF, -1: "fires -"}
"""States of a thruster by the sign of its force."""


def short_name(name: str, room: int) -> str:
    """Name of a phase in at most ``room`` letters: the whole name, else its last word, else a blank."""
    words = name.replace("_", " ")
    return next((text for text in (words, words.rpartition(" ")[2]) if len(text) <= room), " ")


def phase_looks(begins: Sequence[tuple[float, str]], end_s: float) -> rr.StateConfiguration:
    """Labels and colours of phases.

    Args:
        begins: Start time in s and name of each phase, in order.
        end_s: End of the run, s.
    """
    room: dict[str, int] = {}
    for (start_s, name), (stop_s, _) in pairwise([*begins, (end_s, "")]):
        letters = int(_LANE_LETTERS * (stop_s - start_s) / end_s) - 1 if end_s > 0.0 else 0
        room[name] = min(letters, room.get(name, letters))
    labels = [short_name(name, letters) for name, letters in room.items()]
    colours = [_COLOURS[i % len(_COLOURS)] for i in range(len(room))]
    return rr.StateConfiguration(values=list(room), labels=labels, colors=colours)


def thruster_looks() -> rr.StateConfiguration:
    """Labels and colours of the states of a thruster."""
    return rr.StateConfiguration(
        values=[OFF, "fires +", "fires -"], labels=[" ", "+", "-"], colors=[(60, 60, 60), ORANGE, SKY]
    )


def contact_looks() -> rr.StateConfiguration:
    """Labels and colours of the modes of a contact."""
    colours = [(60, 60, 60), (100, 100, 100), BLUE, BLUE, VERMILION]
    return rr.StateConfiguration(
        values=list(MODE_NAMES.values()), labels=[" ", " ", "force", "sticks", "slides"], colors=colours
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
        found: list[tuple[str, FloatArray, list[str]]] = []
        for name, column in self._columns.items():
            values: Any = rows[:, column]
            values = np.clip(np.where(values < 0.0, np.floor(values), np.ceil(values)), min(self._states), max(self._states))
            values = np.nan_to_num(values).astype(int)
            switched = np.flatnonzero(np.diff(values, prepend=self._last[name]))
            if len(switched):
                found.append((name, rows[switched, self._time], [self._states[int(value)] for value in values[switched]]))
                self._last[name] = int(values[-1])
        return found


class Lanes:
    """Sends the states of thrusters or contacts; a lane is created when its state first changes.

    Attributes:
        begun: Names of the lanes.
    """

    def __init__(
        self,
        recording: rr.RecordingStream,
        parent: str,
        timeline: str,
        switching: Switching,
        looks: rr.StateConfiguration,
    ) -> None:
        """Start without lanes.

        Args:
            recording: Destination.
            parent: Parent entity of the lanes.
            timeline: Name of the timeline.
            switching: Detects the changes.
            looks: Labels and colours.
        """
        self._recording, self._parent, self._timeline = recording, parent, timeline
        self._switching, self._looks = switching, looks
        self.begun: set[str] = set()

    def send(self, rows: FloatArray) -> list[str]:
        """Send the changes in a block of rows; names of the lanes that begin."""
        new = []
        for name, times, states in self._switching.changes(rows):
            if name not in self.begun:
                self.begun.add(name)
                new.append(name)
                self._changes(name, [0.0], [self._switching.rest])
                self._recording.log(f"{self._parent}/{name}", self._looks, static=True)
            self._changes(name, times, states)
        return new

    def _changes(self, name: str, times: Any, states: list[str]) -> None:
        index = [rr.TimeColumn(self._timeline, duration=times)]
        columns = rr.StateChange.columns(state=states)
        rr.send_columns(f"{self._parent}/{name}", indexes=index, columns=columns, recording=self._recording)
