"""Past estimates with what was done to them, so that late samples are used at their own time."""

from __future__ import annotations

import math
from bisect import bisect_right, insort
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from ffsm_controllers.estimators.mekf.estimate import Estimate, GraspedPose
from ffsm_controllers.estimators.mekf.propagation import Propagation
from ffsm_controllers.estimators.mekf.update import Innovation
from ffsm_mj.controller_protocol import FloatArray, StateError, Stateful
from ffsm_mj.tolerances import SCHEDULED_S


class Entry(NamedTuple):
    """Something that is done to the estimate at a time.

    Attributes:
        time_s: The time.
        rank: Order among entries of one time; those of one rank are done in the order in which they became known.
        kind: What is done.
        names: What it is done with: a sensor, floating bodies, or a grasp.
        values: What is measured or given.
    """

    time_s: float
    rank: int
    kind: str
    names: tuple[str, ...]
    values: tuple[FloatArray, ...] = ()


class Knot(NamedTuple):
    """The estimate at the time of a call.

    Attributes:
        time_s: The time.
        through_s: Entries up to this time are in it.
        ctrl: Efforts held until then, (nu,).
        qpos: Estimated coordinates, (nq,).
        qvel: Estimated rates, (nv,).
        biases: Estimated biases of gyros.
        covariance: Covariance of the error state.
        grasped: The closed grasp.
    """

    time_s: float
    through_s: float
    ctrl: FloatArray
    qpos: FloatArray
    qvel: FloatArray
    biases: FloatArray
    covariance: FloatArray
    grasped: GraspedPose | None


class History(Stateful):
    """The estimates at past calls and the entries since the oldest of them.

    An entry that becomes known late takes the estimate back to the call before its time, from where all later entries are
    applied again under the efforts of the time: the estimate is that of a filter to which nothing was late.
    """

    @dataclass
    class State:
        """Estimates at past calls, of which the last is the present one, and the entries since the first of them."""

        knots: list[Knot]
        entries: list[Entry]

    def __init__(
        self,
        estimate: Estimate,
        propagation: Propagation,
        longest_s: float,
        apply: Callable[[Entry, Estimate], Innovation | None],
    ) -> None:
        """Keep entries for as long as samples may be under way.

        Args:
            estimate: The estimate.
            propagation: Its prediction.
            longest_s: Longest time for which samples may be under way, s.
            apply: Does to an estimate what an entry says; returns the innovation of a measurement of a floating body.
        """
        self._estimate, self._propagation, self._longest_s, self._apply = estimate, propagation, longest_s, apply
        self._knots: list[Knot] = []
        self._entries: list[Entry] = []

    @property
    def time_s(self) -> float:
        """Time of the estimate, s."""
        return self._knots[-1].time_s

    def set_state(self, state: Any) -> None:
        """Go on from a state, with the estimate that it ends with."""
        super().set_state(state)
        try:
            self._entries = [Entry(*entry) for entry in self._entries]
            self._knots = [Knot(*knot) for knot in self._knots]
            self._knots = [
                knot._replace(grasped=GraspedPose(*knot.grasped)) if knot.grasped is not None else knot
                for knot in self._knots
            ]
            if self._knots:
                self._return_to(self._knots[-1])
        except (TypeError, ValueError) as error:
            raise StateError(f"state of History: {error}") from error

    def begin(self, time_s: float) -> None:
        """Begin with the present estimate, which nothing has been done to."""
        self._entries.clear()
        self._knots[:] = [self._knot(time_s, -math.inf, self._estimate.data.ctrl.copy())]

    def advance(self, time_s: float, ctrl: FloatArray, new: Sequence[Entry]) -> list[Innovation]:
        """Bring the estimate to a time, with new entries; returns the innovations of those.

        Args:
            time_s: Time of the call; nothing has happened after it.
            ctrl: Efforts held since the last call, (nu,).
            new: What has become known since then.
        """
        known = [entry for entry in new if entry.time_s > self._knots[0].through_s + SCHEDULED_S]
        for entry in known:
            insort(self._entries, entry, key=lambda other: (other.time_s, other.rank))
        first_s = min((entry.time_s for entry in known), default=math.inf)
        calls = [(time_s, ctrl.copy())]
        while self._knots[-1].through_s > first_s - SCHEDULED_S:
            undone = self._knots.pop()
            calls.insert(0, (undone.time_s, undone.ctrl))
        self._return_to(self._knots[-1])
        innovations = []
        for call_s, command in calls:
            for entry, innovation in self._replay(call_s, command):
                if any(entry is known_entry for known_entry in known):
                    innovations.append(innovation)
        self._forget(time_s)
        return innovations

    def _replay(self, call_s: float, ctrl: FloatArray) -> list[tuple[Entry, Innovation]]:
        """From the last knot to the next call."""
        last, innovations = self._knots[-1], []
        now_s = last.time_s
        for entry in self._entries[self._after(last.through_s) : self._after(call_s)]:
            self._propagation.advance(self._estimate, entry.time_s - now_s, ctrl)
            now_s = max(now_s, entry.time_s)
            innovation = self._apply(entry, self._estimate)
            self._propagation.follow(self._estimate)
            if innovation is not None:
                innovations.append((entry, innovation))
        self._propagation.advance(self._estimate, call_s - now_s, ctrl)
        self._knots.append(self._knot(call_s, call_s, ctrl))
        return innovations

    def _knot(self, time_s: float, through_s: float, ctrl: FloatArray) -> Knot:
        estimate = self._estimate
        qpos, qvel = estimate.data.qpos.copy(), estimate.data.qvel.copy()
        return Knot(time_s, through_s, ctrl, qpos, qvel, estimate.biases.copy(), estimate.covariance, estimate.grasped)

    def _return_to(self, knot: Knot) -> None:
        estimate = self._estimate
        estimate.data.qpos[:], estimate.data.qvel[:], estimate.data.time = knot.qpos, knot.qvel, knot.time_s
        estimate.biases, estimate.covariance, estimate.grasped = knot.biases.copy(), knot.covariance, knot.grasped

    def _forget(self, time_s: float) -> None:
        """Drop what no sample under way can change."""
        knots = self._knots
        while len(knots) > 1 and knots[1].time_s <= time_s - self._longest_s:
            del knots[0]
        del self._entries[: self._after(knots[0].through_s)]

    def _after(self, time_s: float) -> int:
        """Place of the first entry after a time."""
        return bisect_right(self._entries, time_s + SCHEDULED_S, key=lambda entry: entry.time_s)
