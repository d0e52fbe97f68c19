"""What rows and records say of closed contacts: by pair the resultant force, its centre, and how the two touch."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact_models.interface import EventTime, Scene
from ffsm_mj.contact_models.persistent.active_set import ActiveContactSet
from ffsm_mj.contact_models.persistent.rows import ContactPoint, ContactRows
from ffsm_mj.records.active_contact import ActiveContact
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.kinds import RecordKind
from ffsm_mj.records.signals import FORCE_RESIDUAL, Signal, identifier
from ffsm_mj.records.wrench import Wrench

FREE, CLOSED, PRESSING = 0.0, 1.0, 2.0
"""Modes of a pair in the log."""

_SIGNALS = (
    ("mode", "", "how {} touches: 0 not, 1 closed without force, 2 pressing"),
    ("points", "", "at how many points {} touches"),
    ("force_N", "N", "resultant force of {}, under the efforts of this row; 0 when free"),
    *((f"force_{x}_N", "N", "resultant force of {} on its second geom, world axes") for x in "xyz"),
    *((f"centre_{x}_m", "m", "centre of pressure of {}, world axes; NaN where nothing presses") for x in "xyz"),
    ("impulse_N_s", "N s", "integral of the resultant force of {} since t = 0"),
)
_RESIDUAL = (
    "largest difference between the resultant force of a pair that holds it and the one that only pushes; recomputed by "
    "ffsm analyze from the states in the log, by other functions"
)
_NOTHING = np.array([FREE, 0.0, 0.0, 0.0, 0.0, 0.0, math.nan, math.nan, math.nan, 0.0])
_IMPULSE = len(_NOTHING) - 1
_NOWHERE = [math.nan] * 3


def force_keys(pair: ContactPair) -> tuple[str, ...]:
    """Columns of the resultant force of a pair on its second geom."""
    return tuple(f"contact.{identifier(pair.name)}_force_{x}_N" for x in "xyz")


def mode_key(pair: ContactPair) -> str:
    """Column that says whether a pair is closed and presses."""
    return f"contact.{identifier(pair.name)}_mode"


class Resultant(NamedTuple):
    """What a pair exchanges at one state.

    Attributes:
        force: On its second geom, N, (3,).
        centre: Of pressure; of the points where nothing presses, m, (3,).
        normal: Mean normal, (3,).
        points: How many.
        mode: Their features.
    """

    force: FloatArray
    centre: FloatArray
    normal: FloatArray
    points: int
    mode: str

    @property
    def size(self) -> float:
        """Norm of the force, N."""
        return math.hypot(*self.force.tolist())


def resultant(touches: Sequence[ContactPoint], rows: ContactRows, forces: FloatArray, pair: ContactPair) -> Resultant:
    """Sum over the touches of one pair."""
    mine = [i for i, touch in enumerate(touches) if touch.pair is pair]
    if len(mine) == 1:  # by far the most, and asked in every stage
        only, here = mine[0], rows.held[mine[0]]
        return Resultant(forces[only] * here.normal, here.point, here.normal, 1, touches[only].feature.name)
    normals, points = (np.array([getattr(rows.held[i], name) for i in mine]).reshape(-1, 3) for name in ("normal", "point"))
    pushed = forces[mine]
    total = float(pushed.sum())
    weights = pushed / total if total > 0.0 else np.full(len(mine), 1.0 / max(1, len(mine)))
    normal = weights @ normals
    length = math.hypot(*normal.tolist())
    names = " + ".join(dict.fromkeys(touches[i].feature.name for i in mine))
    return Resultant(pushed @ normals, weights @ points, normal / length if length else normal, len(mine), names)


class ContactReport:
    """Columns of the closed contacts of a run, and their records.

    Attributes:
        columns: Of every pair that may last.
    """

    def __init__(self, scene: Scene, pairs: Sequence[ContactPair], closed: ActiveContactSet) -> None:
        """Nothing is closed yet."""
        self._scene, self._closed = scene, closed
        self._values = np.tile(_NOTHING, (len(pairs), 1))
        self._row = {pair: i for i, pair in enumerate(pairs)}
        self._blank = True
        signals = tuple(
            Signal("contact", f"{identifier(pair.name)}_{name}", unit, meaning.format(pair.name))
            for pair in pairs
            for name, unit, meaning in _SIGNALS
        )
        flat, self._residual = self._values.reshape(-1), np.zeros(1)
        self.columns = (
            Columns(signals, live=flat, note=lambda _: self._note(), resume=self._resume),
            Columns((Signal("balance", FORCE_RESIDUAL, "N", _RESIDUAL),), live=self._residual),
        )

    def told(self) -> list[ContactPair]:
        """Pairs that the columns say are closed."""
        return [pair for pair, row in self._row.items() if self._values[row, 0] != FREE]

    def _resume(self, told: FloatArray) -> None:
        self._values[:] = told.reshape(self._values.shape)
        self._blank = False

    def _note(self) -> None:
        """Say what is at the state in ``data`` under the efforts in it."""
        closed = self._closed
        if not closed.by_pair and self._blank:
            return
        self._values[:, :_IMPULSE], self._residual[0] = _NOTHING[:_IMPULSE], 0.0
        self._blank = not closed.by_pair
        if not closed.touches:
            return
        decision = closed.decide()
        forces, touches = decision.forces, decision.touches
        pressing = {touches[i].pair for i in decision.pressing}
        held = decision.problem.held(decision.pressing)
        differ = held.tolist() != forces.tolist()
        for pair, own in closed.by_pair.items():
            if own:
                found = resultant(touches, decision.rows, forces, pair)
                mode, centre = (PRESSING, found.centre.tolist()) if pair in pressing else (CLOSED, _NOWHERE)
                row = mode, found.points, found.size, *found.force.tolist(), *centre
                self._values[self._row[pair], :_IMPULSE] = row
                if pair in pressing and differ:
                    again = resultant(touches, decision.rows, held, pair).force
                    self._residual[0] = max(self._residual[0], math.dist(found.force, again))

    def active(self) -> tuple[ActiveContact, ...]:
        """The closed pairs at the state in ``data`` under the efforts in it, as control laws see them."""
        found = self.places([pair for pair, touches in self._closed.by_pair.items() if touches])
        return tuple(ActiveContact(pair.name, at.force, at.centre.copy(), at.normal.copy()) for pair, at in found.items())

    def wrenches(self) -> list[Wrench]:
        """What the closed contacts put on their bodies at the state in ``data`` under the efforts in it."""
        closed = self._closed
        if not closed.touches:
            return []
        decision, out = closed.decide(), []
        for touch, here, size in zip(decision.touches, decision.rows.held, decision.forces.tolist(), strict=True):
            if size:
                force = size * here.normal
                out += [Wrench(touch.pair.body_a, here.point, -force), Wrench(touch.pair.body_b, here.point, force)]
        return out

    def book(self, impulses: Mapping[ContactPair, float]) -> None:
        """Add what the resultant forces of some pairs came to in a step, N s."""
        for pair, impulse in impulses.items():
            self._values[self._row[pair], _IMPULSE] += impulse

    def before(self, pairs: Sequence[ContactPair]) -> dict[ContactPair, float]:
        """Resultant forces at the end of the step that has ended, N; 0 where none was made since the last event."""
        stage = self._closed.stages[-1] if self._closed.stages else None
        if stage is None:
            return dict.fromkeys(pairs, 0.0)
        return {pair: resultant(self._closed.pressing, stage.rows, stage.forces, pair).size for pair in pairs}

    def places(self, pairs: Sequence[ContactPair]) -> dict[ContactPair, Resultant]:
        """Where and with what force pairs touch at the state in ``data`` under the efforts in it."""
        closed, found = self._closed, {}
        decision = closed.decide() if closed.touches else None
        forces = decision.forces if decision else np.zeros(0)
        for pair in pairs:
            if decision and closed.by_pair.get(pair):
                found[pair] = resultant(decision.touches, decision.rows, forces, pair)
            else:
                near = pair.proximity(self._scene.system.mj, self._scene.data)
                found[pair] = Resultant(np.zeros(3), near.points.mean(axis=0), near.normal, 0, "")
        return found

    def records(
        self,
        kind: RecordKind,
        places: Mapping[ContactPair, Resultant],
        before: Mapping[ContactPair, float],
        instant: EventTime,
        event: int,
        qvel_before: Mapping[str, tuple[float, ...]],
    ) -> tuple[Any, ...]:
        """What the log says of something that happened to some pairs at the state in ``data``.

        Args:
            kind: What.
            places: Where each of the pairs touches after it; before it where it ends.
            before: Their forces just before, N.
            instant: When.
            event: Its number.
            qvel_before: Generalised velocity before, by joint.
        """
        data = self._scene.data
        ended = {pair: pair not in self._closed.by_pair for pair in places}
        return tuple(
            kind.record(
                event=event,
                time_s=instant.time_s,
                step=instant.step,
                pair=pair.name,
                geoms=pair.geoms,
                mode="" if ended[pair] else place.mode,
                points=0 if ended[pair] else place.points,
                point_m=tuple(place.centre.tolist()),
                normal=tuple(place.normal.tolist()),
                force_before_N=before[pair],
                force_after_N=0.0 if ended[pair] else place.size,
                impulse_N_s=float(self._values[self._row[pair], _IMPULSE]),
                qpos=tuple(data.qpos.tolist()),
                qvel_before=qvel_before,
                qvel_after=self._scene.system.by_joint(data.qvel),
            )
            for pair, place in places.items()
        )
