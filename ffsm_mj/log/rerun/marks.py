"""Marks of records in a recording: arrows and dots that are shown for a while, with a text beside them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import rerun as rr

from ffsm_mj.arrays import FloatArray
from ffsm_mj.log.instants import SHOWN_S, MarkGroups
from ffsm_mj.log.rerun.forces import ARROW_M
from ffsm_mj.log.rerun.opening import Opening
from ffsm_mj.log.rerun.plots import YELLOW
from ffsm_mj.records.events import Event
from ffsm_mj.records.kinds import Mark, kind_of
from ffsm_mj.records.signals import identifier

_APART_M = 0.6
"""Texts nearer to each other would lie on each other."""

Send = Callable[[float, str, Any], None]
"""Sends one value at one time in s to an entity."""


class _Told(NamedTuple):
    """A mark whose text is shown."""

    time_s: float
    entity: str
    kind: str
    mark: Mark


class Marks:
    """Draws the marks of events as they come, and takes them away again."""

    def __init__(self, send: Send, opening: Opening) -> None:
        """Nothing is drawn yet."""
        self._send, self._opening = send, opening
        self._instants = MarkGroups()
        self._shown: list[tuple[float, str]] = []
        self._told: list[_Told] = []

    def event(self, event: Event) -> None:
        """Draw what there is to draw of an event."""
        drawn = self._instants.add(event)
        if drawn is None:
            return
        instant, before = drawn
        kind = kind_of(event)
        for i, mark in enumerate(instant.marks[before:], before):
            entity = f"world/{kind.plural}/{instant.number}/{identifier(mark.name)}_{i + 1}"
            told = self._makes_room(_Told(instant.time_s, entity, kind.name, mark))
            self._send(instant.time_s, entity, _shape(mark, told=told))
            self._shown.append((instant.time_s + SHOWN_S, entity))
            self._opening.draw(instant.time_s, mark.point_m)

    def clear(self, now_s: float) -> None:
        """Take marks away that have been shown long enough; never ahead of the motion, or a viewer would jump there."""
        for end_s, entity in [mark for mark in self._shown if mark[0] <= now_s]:
            self._shown.remove((end_s, entity))
            self._send(end_s, entity, rr.Clear.columns(is_recursive=[False]))

    def _makes_room(self, new: _Told) -> bool:
        """Whether a text has room: of hits at one place within a while the greatest is told, and what is new replaces it."""
        self._told = [old for old in self._told if new.time_s - old.time_s < SHOWN_S]
        near = [old for old in self._told if _apart_m(old.mark, new.mark) < _APART_M]
        if any(old.kind == new.kind and new.mark.magnitude <= old.mark.magnitude for old in near):
            return False
        for old in near:
            self._told.remove(old)
            if old.time_s < new.time_s:
                self._send(new.time_s, old.entity, _shape(old.mark, told=False))
        self._told.append(new)
        return True


def _apart_m(one: Mark, other: Mark) -> float:
    """Distance of the texts, which stand at the middles of the arrows."""
    places = [np.array(mark.point_m) - 0.5 * _push(mark) for mark in (one, other)]
    return float(np.linalg.norm(places[0] - places[1]))


def _push(mark: Mark) -> FloatArray:
    return np.array(mark.direction) * float(np.clip(mark.magnitude, *ARROW_M))


def _shape(mark: Mark, *, told: bool) -> Any:
    """An arrow that ends at its point, where nothing hides it, or a dot; the text beside it."""
    text = [mark.text if told else ""]
    push = _push(mark)
    if not push.any():
        return rr.Points3D.columns(positions=[mark.point_m], colors=[YELLOW], radii=[0.06], labels=text)
    origins = [np.array(mark.point_m) - push]
    return rr.Arrows3D.columns(origins=origins, vectors=[push], colors=[YELLOW], radii=[0.04], labels=text)
