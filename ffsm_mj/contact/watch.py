"""Contacts that nobody resolves: pairs that are neither impact pairs nor ignored are watched and reported.

MuJoCo's own broad and narrow phase lists overlapping geoms at the control rate; the list is read and nothing is pushed.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable
from itertools import combinations
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.records.events import UnhandledContactRecord


class ContactWatch:
    """Follows overlaps from their first tick to their last.

    Attributes:
        rigid: Pairs of geoms that are on one rigid body now, and left out.
    """

    rigid: frozenset[frozenset[int]] = frozenset()

    def __init__(self, model: Any, data: Any, known: Iterable[frozenset[int]]) -> None:
        """Watch all pairs of geoms that MuJoCo would collide, except the known ones."""
        # A model of its own, with contacts on and filters as they suit it: the run's model is left alone.
        self._model, self._data = copy.copy(model), data
        self._model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        self._known = frozenset(known)
        self._open: dict[frozenset[int], tuple[float, float]] = {}
        self._all_known: tuple[bytes, frozenset[frozenset[int]]] = b"", self.rigid
        self._filter_known_trees()

    def _filter_known_trees(self) -> None:
        """Let MuJoCo's own filter skip a tree's contacts with itself where all of them are known.

        An arm that lies across its own body would be listed tick after tick. Only models with the default bits are touched.
        """
        model = self._model
        touchable = np.flatnonzero(model.geom_contype | model.geom_conaffinity)
        if not (np.all(model.geom_contype[touchable] == 1) and np.all(model.geom_conaffinity[touchable] == 1)):
            return
        roots = model.body_rootid[model.geom_bodyid]
        for bit, root in enumerate(sorted(set(roots[touchable].tolist()))[:30], start=1):
            geoms = touchable[roots[touchable] == root]
            if all(frozenset(pair) in self._known for pair in combinations(geoms.tolist(), 2)):
                # Its own bit marks it, and it answers to every bit but its own.
                model.geom_contype[geoms] = 1 << bit
                model.geom_conaffinity[geoms] = 0x7FFFFFFF & ~(1 << bit)
            else:
                model.geom_contype[geoms] = model.geom_conaffinity[geoms] = 0x7FFFFFFF

    def look(self, time_s: float) -> list[UnhandledContactRecord]:
        """Update at one tick; returns the overlaps that have ended."""
        mujoco.mj_collision(self._model, self._data)
        now = self._unknown_overlaps() if self._data.ncon else {}
        if not now and not self._open:
            return []
        over = [pair for pair in self._open if pair not in now]
        ended = [self._record(pair, time_s) for pair in over]
        for pair in over:
            del self._open[pair]
        for pair, depth in now.items():
            start, deepest = self._open.get(pair, (time_s, 0.0))
            self._open[pair] = (start, max(deepest, depth))
        return ended

    def _unknown_overlaps(self) -> dict[frozenset[int], float]:
        """Depth by pair of what overlaps now and is not known."""
        contact = self._data.contact
        geoms = contact.geom
        listed = geoms.tobytes(), self.rigid
        if listed == self._all_known:  # what touches mostly touches for long
            return {}
        pairs = [frozenset(both) for both in geoms.tolist()]
        known = self._known | self.rigid
        if known.issuperset(pairs):
            self._all_known = listed
            return {}
        depths: dict[frozenset[int], float] = {}
        for pair, distance in zip(pairs, contact.dist.tolist(), strict=True):
            if distance < 0.0 and pair not in known:
                depths[pair] = max(depths.get(pair, 0.0), -distance)
        return depths

    def finish(self, time_s: float) -> list[UnhandledContactRecord]:
        """Overlaps that last to the end of the run."""
        records = [self._record(pair, time_s) for pair in self._open]
        self._open.clear()
        return records

    def _record(self, pair: frozenset[int], end_s: float) -> UnhandledContactRecord:
        start, depth = self._open[pair]
        names = tuple(sorted(self._model.geom(g).name or f"geom {g}" for g in pair))
        return UnhandledContactRecord(names, start, end_s, depth)
