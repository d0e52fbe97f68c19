"""Phases in a recording: a lane of states whose labels fit."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import rerun as rr

from ffsm_mj.log.rerun.plots import BLUE, GREEN, PURPLE, VERMILION

_LANE_LETTERS = 80
"""Letters across the lane in a window of 1200 pixels."""
_COLOURS = (BLUE, VERMILION, GREEN, PURPLE)
"""Dark enough for white letters; no two phases that follow each other have the same."""


def short_name(name: str, room: int) -> str:
    """A phase's name in at most so many letters: whole, else its last word, else a blank."""
    words = name.replace("_", " ")
    return next((text for text in (words, words.rpartition(" ")[2]) if len(text) <= room), " ")


def phase_looks(begins: Sequence[tuple[float, str]], end_s: float) -> rr.StateConfiguration:
    """Labels and colours of phases.

    Args:
        begins: When each begins in s, and its name, in order.
        end_s: End of the run, s.
    """
    room: dict[str, int] = {}
    for (start_s, name), (stop_s, _) in pairwise([*begins, (end_s, "")]):
        letters = int(_LANE_LETTERS * (stop_s - start_s) / end_s) - 1 if end_s > 0.0 else 0
        room[name] = min(letters, room.get(name, letters))
    labels = [short_name(name, letters) for name, letters in room.items()]
    colours = [_COLOURS[i % len(_COLOURS)] for i in range(len(room))]
    return rr.StateConfiguration(values=list(room), labels=labels, colors=colours)
