"""Marks of event records in a recording: arrows and dots that are shown for a while, with a text beside them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import rerun as rr

from ffsm_mj.log.marks import SHOWN_S, DrawnMark, MarkSequence
from ffsm_mj.log.palette import MARK
from ffsm_mj.log.rerun.opening import Opening
from ffsm_mj.records.events import Event
from ffsm_mj.records.signals import identifier

_APART_M = 0.6
"""Texts at a smaller distance would overlap at scale 1."""

Send = Callable[[float, str, Any], None]
"""Sends one value to an entity at a time in s."""


class _LabelledMark(NamedTuple):
    """A mark whose text is shown, and its entity."""

    entity: str
    drawn: DrawnMark


class Marks:
    """Draws the marks of events as they come, and removes them after some time."""

    def __init__(self, send: Send, opening: Opening, scale: float) -> None:
        """Start without marks, at a scale of markers."""
        self._send, self._opening, self._scale = send, opening, scale
        self._sequence = MarkSequence(scale)
        self._shown: list[tuple[float, str]] = []
        self._labelled: list[_LabelledMark] = []

    def event(self, event: Event) -> None:
        """Draw the marks of an event."""
        for drawn in self._sequence.add(event):
            entity = f"world/{drawn.kind.plural}/{drawn.instant}/{identifier(drawn.mark.name)}_{drawn.number + 1}"
            labelled = self._makes_room(_LabelledMark(entity, drawn))
            self._send(drawn.time_s, entity, _shape(drawn, self._scale, labelled=labelled))
            self._shown.append((drawn.end_s, entity))
            self._opening.add_mark(drawn.time_s, drawn.mark.point_m)

    def clear(self, now_s: float) -> None:
        """Remove marks whose time is over; never ahead of the motion, or a viewer would jump there."""
        for end_s, entity in [mark for mark in self._shown if mark[0] <= now_s]:
            self._shown.remove((end_s, entity))
            self._send(end_s, entity, rr.Clear.columns(is_recursive=[False]))

    def _makes_room(self, new: _LabelledMark) -> bool:
        """Whether the text of a new mark is shown.

        Of marks of one kind at one place within ``SHOWN_S``, only that of greatest magnitude has a text; it replaces the
        earlier ones.
        """
        time = new.drawn.time_s
        self._labelled = [old for old in self._labelled if time - old.drawn.time_s < SHOWN_S]
        # Bouncing contacts hit the same place many times within seconds; their texts would cover each other.
        near = [old for old in self._labelled if _distance_m(old.drawn, new.drawn) < self._scale * _APART_M]
        size = new.drawn.mark.magnitude
        if any(old.drawn.kind is new.drawn.kind and size <= old.drawn.mark.magnitude for old in near):
            return False
        for old in near:
            self._labelled.remove(old)
            if old.drawn.time_s < time:
                self._send(time, old.entity, _shape(old.drawn, self._scale, labelled=False))
        self._labelled.append(new)
        return True


def _distance_m(one: DrawnMark, other: DrawnMark) -> float:
    """Distance of the texts of two marks, which stand at the middles of their arrows."""
    places = [np.array(drawn.mark.point_m) - 0.5 * drawn.vector for drawn in (one, other)]
    return float(np.linalg.norm(places[0] - places[1]))


def _shape(drawn: DrawnMark, scale: float, *, labelled: bool) -> Any:
    """An arrow that ends at the point, so that the body that it pushes does not hide it, or a dot; optionally a text."""
    text, vector = [drawn.mark.text if labelled else ""], drawn.vector
    if not vector.any():
        return rr.Points3D.columns(positions=[drawn.mark.point_m], colors=[MARK], radii=[0.06 * scale], labels=text)
    origins = [np.array(drawn.mark.point_m) - vector]
    return rr.Arrows3D.columns(origins=origins, vectors=[vector], colors=[MARK], radii=[0.04 * scale], labels=text)
