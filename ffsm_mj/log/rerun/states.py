"""Lanes of states in a recording: phases with labels that fit, and the switching of thrusters."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import rerun as rr

from ffsm_mj.arrays import FloatArray
from ffsm_mj.log.palette import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION

_LANE_LETTERS = 80
"""Number of letters across the lane in a window of 1200 pixels."""
_COLOURS = (BLUE, VERMILION, GREEN, PURPLE)
"""Dark enough for white letters; successive phases have different ones."""
OFF = "off"
_FIRING = {1: "fires +", 0: OFF, -1: "fires -"}


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


class Switching:
    """Detects when thrusters switch, from all rows of a run: frames would miss short pulses."""

    def __init__(self, time: int, columns: dict[str, int]) -> None:
        """Start with all thrusters off.

        Args:
            time: Column of the simulation time.
            columns: Column of the applied force of each thruster by name.
        """
        self._time, self._columns = time, columns
        self._last = dict.fromkeys(columns, 0)

    def changes(self, rows: FloatArray) -> list[tuple[str, FloatArray, list[str]]]:
        """(Name, times, states) of every thruster that switches in a block of rows."""
        found: list[tuple[str, FloatArray, list[str]]] = []
        for name, column in self._columns.items():
            signs: Any = np.sign(rows[:, column]).astype(int)
            switched = np.flatnonzero(np.diff(signs, prepend=self._last[name]))
            if len(switched):
                found.append((name, rows[switched, self._time], [_FIRING[int(sign)] for sign in signs[switched]]))
                self._last[name] = int(signs[-1])
        return found
