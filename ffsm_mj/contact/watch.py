"""Detection of unhandled contacts: overlaps of pairs that no contact model resolves and that are not ignored are reported.

MuJoCo's broad and narrow phase lists overlapping geoms at the control rate; no forces are applied.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from ffsm_mj.records.events import Outcome, RunEnded, UnhandledContactRecord
from ffsm_mj.records.kinds import RecordKind
from ffsm_mj.state import Stateful

Matrix = npt.NDArray[np.bool_]


def collidable(model: Any, cones: Iterable[int] = ()) -> Matrix:
    """Whether two geoms can collide, (ngeom, ngeom), symmetric: the filters of MuJoCo's collision detection.

    Geoms that stand for cones (ids) have no bits: they can meet what collides with anything, save planes and each other.

    Geoms collide if a bit of ``contype`` of one is set in ``conaffinity`` of the other, unless they are on one rigid body,
    on bodies joined by a joint (``filterparent``), or on bodies of an ``exclude``. A ``pair`` of the MJCF overrides that.
    """
    weld = model.body_weldid[model.geom_bodyid]
    parent = model.body_weldid[model.body_parentid[weld]]
    bits = (model.geom_contype[:, None] & model.geom_conaffinity[None, :]) != 0
    inside = (model.geom_contype | model.geom_conaffinity) != 0
    inside &= model.geom_type != int(mujoco.mjtGeom.mjGEOM_PLANE)
    bits[list(cones)] = inside
    collide = (bits | bits.T) & (weld[:, None] != weld[None, :])
    if not model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_FILTERPARENT):
        # The world is no parent in this sense: a geom of the base may collide with the ground.
        moving = (weld[:, None] > 0) & (weld[None, :] > 0)
        joined = (weld[:, None] == parent[None, :]) | (parent[:, None] == weld[None, :])
        collide &= ~(moving & joined)
    for signature in model.exclude_signature.tolist():
        one, other = (model.geom_bodyid == body for body in (signature >> 16, signature & 0xFFFF))
        both = one[:, None] & other[None, :]
        collide &= ~(both | both.T)
    for a, b in zip(model.pair_geom1.tolist(), model.pair_geom2.tolist(), strict=True):
        collide[a, b] = collide[b, a] = weld[a] != weld[b]
    return np.asarray(collide)


_MOST_GROUPS = 31
"""Bits of ``contype`` and ``conaffinity`` that are used."""


class ContactWatch(Stateful):
    """Tracks unhandled overlaps from their first tick to their last.

    Attributes:
        disabled: Pairs of geoms that are currently on one rigid body, and are ignored.
        model: Model of the run whose collisions are those of the watched pairs; None if there are none.
        open: Overlaps at the last tick: since when, and how deep at most.
    """

    @dataclass
    class State:
        """Overlaps so far; the pairs on one rigid body are those of the motion."""

        open: dict[frozenset[int], tuple[float, float]]

    disabled: frozenset[frozenset[int]] = frozenset()

    def __init__(
        self,
        model: Any,
        data: Any,
        known: Iterable[frozenset[int]],
        unsupported: Mapping[frozenset[int], str] = MappingProxyType({}),
        filtered: Iterable[frozenset[int]] = (),
    ) -> None:
        """Watch all pairs of geoms that MuJoCo would collide, except the known ones.

        Args:
            model: MuJoCo model of the run, which is not modified.
            data: Its data.
            known: Geom ids of pairs that contact models resolve, and of ignored pairs.
            unsupported: Pairs that should be resolved and cannot be, with the reason: the first overlap ends the run.
            filtered: Pairs to be watched although MuJoCo would not collide them.
        """
        self._data, self._unsupported = data, unsupported
        self.open: dict[frozenset[int], tuple[float, float]] = {}
        self._watched = _with(_with(collidable(model), filtered, watched=True), known, watched=False)
        self._names_of, self.model = model, _collide_only(model, self._watched) if self._watched.any() else None

    def look(self, time_s: float, *, collided: bool = False) -> list[UnhandledContactRecord]:
        """Update at one tick; returns records of overlaps that have ended.

        Args:
            time_s: Its time, s.
            collided: Whether MuJoCo has listed the collisions of ``model`` already.

        Raises:
            RunEnded: Geoms overlap that should be resolved and cannot be.
        """
        if self.model is None:
            return []
        if not collided:
            mujoco.mj_collision(self.model, self._data)
        now = self._overlaps() if self._data.ncon else {}
        if not now and not self.open:
            return []
        for pair in now:
            if reason := self._unsupported.get(pair):
                message = f"{' and '.join(self._names(pair))} meet at t = {time_s:.6g} s: {reason}"
                raise RunEnded(Outcome.UNSUPPORTED_CONTACT, message)
        over = [pair for pair in self.open if pair not in now]
        ended = [self._record(pair, time_s) for pair in over]
        for pair in over:
            del self.open[pair]
        for pair, depth in now.items():
            start, deepest = self.open.get(pair, (time_s, 0.0))
            self.open[pair] = (start, max(deepest, depth))
        return ended

    @property
    def open_overlaps(self) -> tuple[tuple[str, ...], ...]:
        """Names of the geoms of each overlap that was found at the last tick."""
        return tuple(map(self._names, self.open))

    def _overlaps(self) -> dict[frozenset[int], float]:
        """Depth of each current overlap of a watched pair."""
        contact = self._data.contact
        geoms, distances = contact.geom, contact.dist
        overlapping = np.flatnonzero((distances < 0.0) & self._watched[geoms[:, 0], geoms[:, 1]])
        depths: dict[frozenset[int], float] = {}
        for i in overlapping.tolist():
            pair = frozenset(geoms[i].tolist())
            if pair not in self.disabled:
                depths[pair] = max(depths.get(pair, 0.0), -float(distances[i]))
        return depths

    def finish(self, time_s: float) -> list[UnhandledContactRecord]:
        """Records of overlaps that continue to the end of the run."""
        records = [self._record(pair, time_s) for pair in self.open]
        self.open.clear()
        return records

    def _record(self, pair: frozenset[int], end_s: float) -> UnhandledContactRecord:
        start, depth = self.open[pair]
        return UnhandledContactRecord(self._names(pair), start, end_s, depth)

    def _names(self, pair: frozenset[int]) -> tuple[str, ...]:
        return tuple(sorted(self._names_of.geom(geom).name for geom in pair))


def _with(pairs: Matrix, changed: Iterable[frozenset[int]], *, watched: bool) -> Matrix:
    """A matrix of pairs in which some are set."""
    ids = np.array([sorted(pair) for pair in changed if len(pair) == 2], dtype=np.intp).reshape(-1, 2)
    pairs[ids[:, 0], ids[:, 1]] = pairs[ids[:, 1], ids[:, 0]] = watched
    return pairs


def _collide_only(model: Any, watched: Matrix) -> Any:
    """A copy of a model with contacts, whose filters skip what is not watched, as far as bits by kinematic tree can say it.

    An arm that overlaps its own body would otherwise be listed at every tick, and a resolved pair in contact too.
    """
    model = copy.copy(model)
    model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    trees = model.body_rootid[model.geom_bodyid]
    numbers = np.minimum(np.unique(trees, return_inverse=True)[1], _MOST_GROUPS - 1)
    groups = np.where(watched.any(axis=1), 1 << numbers, 0)
    model.geom_contype[:] = groups
    model.geom_conaffinity[:] = [np.bitwise_or.reduce(groups[partners], initial=0) for partners in watched]
    # The broad phase looks at bodies, whose bits are those of all their geoms.
    for of_body, of_geom in ((model.body_contype, model.geom_contype), (model.body_conaffinity, model.geom_conaffinity)):
        of_body[:] = 0
        np.bitwise_or.at(of_body, model.geom_bodyid, of_geom)
    return model


def _sentence(record: UnhandledContactRecord) -> str:
    geoms, lasted = " and ".join(record.geoms), f"from {record.start_s:.3f} to {record.end_s:.3f} s"
    return f"unhandled contact: {geoms} overlapped {lasted}, up to {record.max_depth_m:.3g} m deep"


UNHANDLED_CONTACT = RecordKind(
    record=UnhandledContactRecord,
    name="unhandled_contact",
    plural="unhandled_contacts",
    when="when an unhandled overlap ends",
    time=lambda record: record.end_s,  # its greatest depth is known only then
    sentence=_sentence,
    warning=lambda _: True,
    in_every_run=True,
)
