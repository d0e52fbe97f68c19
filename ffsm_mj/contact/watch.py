"""Detection of unhandled contacts: overlaps of pairs that are neither contact pairs nor ignored are reported.

MuJoCo's broad and narrow phase lists overlapping geoms at the control rate; no forces are applied.
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
    """Tracks unhandled overlaps from their first tick to their last.

    Attributes:
        rigid: Pairs of geoms that are currently on one rigid body, and are ignored.
    """

    rigid: frozenset[frozenset[int]] = frozenset()

    def __init__(self, model: Any, data: Any, known: Iterable[frozenset[int]]) -> None:
        """Watch all pairs of geoms that MuJoCo would collide, except the known ones."""
        # A copy of the model, with contacts enabled and its own filters; the run's model is not modified.
        self._model, self._data = copy.copy(model), data
        self._model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        self._known = frozenset(known)
        self._open: dict[frozenset[int], tuple[float, float]] = {}
        self._all_known: tuple[bytes, frozenset[frozenset[int]]] = b"", self.rigid
        self._filter_known_trees()

    def _filter_known_trees(self) -> None:
        """Let MuJoCo's filter skip the self-contacts of a tree if all of them are known.

        An arm that overlaps its own body would be listed at every tick. Only models with default bits are changed.
        """
        model = self._model
        touchable = np.flatnonzero(model.geom_contype | model.geom_conaffinity)
        if not (np.all(model.geom_contype[touchable] == 1) and np.all(model.geom_conaffinity[touchable] == 1)):
            return
        roots = model.body_rootid[model.geom_bodyid]
        for bit, root in enumerate(sorted(set(roots[touchable].tolist()))[:30], start=1):
            geoms = touchable[roots[touchable] == root]
            if all(frozenset(pair) in self._known for pair in combinations(geoms.tolist(), 2)):
                # Its contype is a bit of its own, and its conaffinity is every bit except that one.
                model.geom_contype[geoms] = 1 << bit
                model.geom_conaffinity[geoms] = 0x7FFFFFFF & ~(1 << bit)
            else:
                model.geom_contype[geoms] = model.geom_conaffinity[geoms] = 0x7FFFFFFF

    def look(self, time_s: float) -> list[UnhandledContactRecord]:
        """Update at one tick; returns records of overlaps that have ended."""
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
        """Depth of each current overlap of an unknown pair."""
        contact = self._data.contact
        geoms = contact.geom
        listed = geoms.tobytes(), self.rigid
        if listed == self._all_known:  # contacts persist over many ticks: skip an unchanged list of known pairs
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
        """Records of overlaps that continue to the end of the run."""
        records = [self._record(pair, time_s) for pair in self._open]
        self._open.clear()
        return records

    def _record(self, pair: frozenset[int], end_s: float) -> UnhandledContactRecord:
        start, depth = self._open[pair]
        names = tuple(sorted(self._model.geom(g).name or f"geom {g}" for g in pair))
        return UnhandledContactRecord(names, start, end_s, depth)
