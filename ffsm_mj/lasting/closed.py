"""The contacts that are closed: which of them press, with what force, and for how long that stays so."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.feature import EDGE_M, Feature, Held, features
from ffsm_mj.contact.pairs import REST_RATE, ContactPair, Proximity
from ffsm_mj.contact.regimes import Scene
from ffsm_mj.impact.time_of_impact import GAP_TOLERANCE
from ffsm_mj.lasting.acceleration import Acceleration
from ffsm_mj.lasting.exchange import Stage
from ffsm_mj.lasting.rows import Rows, Touch, rows
from ffsm_mj.model.dynamics import mass_matrix
from ffsm_mj.motion.motion import Motion

_STILL = 1e-9
"""What an impact leaves separating slower than this share of its approach is still; so much of an impact is rounding."""
_DRIFTING = 1e-6
"""What is held changes its gap slower than this share of (1 m/s + the speeds of its bodies)."""
_LEAST_RADIUS_M = 1e-4
"""Of what is round and slides over an edge, m."""
_DRIFT_M = 5e-10
"""A step that lets a closed gap drift further than this is cut there, and the drift taken out."""
_OPENS = 10.0
"""A gap opens, or a force ceases to push, where a second rate is so many times its rounding."""
_OTHER_POINT_M = 2e-10
"""A pair that is deeper than this touches at another point than those that are held."""
_LIFT_M, _SLOW_M_S = 1e-11, 1e-3
"""What would not lift off further than this counts as closed; nothing that separates faster is asked."""
_ONE_POINT = (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_ELLIPSOID)
"""Geoms that touch anything convex at one point only."""


class Decision(NamedTuple):
    """Which of the closed contacts press, at one state and under some efforts.

    Attributes:
        touches: All of them.
        rows: The same, at the state.
        problem: Their accelerations.
        forces: Forces that only push, N, (k,).
        opening: gap'' under these, m/s^2, (k,).
    """

    touches: tuple[Touch, ...]
    rows: Rows
    problem: Acceleration
    forces: FloatArray
    opening: FloatArray

    @property
    def pressing(self) -> list[int]:
        """Indices of those that press."""
        pressed = self.problem.eased(self.forces) > self.problem.rounding
        return [int(i) for i in np.flatnonzero(pressed)]

    @property
    def leaving(self) -> set[Touch]:
        """Those whose gap opens."""
        return {self.touches[int(i)] for i in np.flatnonzero(self.opening > _OPENS * self.problem.rounding)}


class Closed:
    """Closed contacts of a motion.

    Attributes:
        motion: What moves.
        by_pair: Touches of each closed pair.
        pressing: Those that are held in the stages of a step.
        stages: What was asked in the stages since the step began.
    """

    def __init__(self, scene: Scene) -> None:
        """Nothing is closed."""
        self._scene, self._model = scene, scene.system.mj
        self.motion: Motion
        self.by_pair: dict[ContactPair, tuple[Touch, ...]] = {}
        self.pressing: tuple[Touch, ...] = ()
        self.stages: list[Stage] = []
        self._others = np.zeros(self._model.nv)
        self._looked: tuple[tuple[Any, ...], Rows] | None = None
        self._decided: tuple[tuple[Any, ...], Decision] | None = None
        self._deepest: tuple[tuple[Any, ...], float] | None = None

    @property
    def touches(self) -> tuple[Touch, ...]:
        """All of them, pair by pair."""
        return tuple(touch for touches in self.by_pair.values() for touch in touches)

    def take(self, pair: ContactPair, near: Proximity, still: float) -> None:
        """Hold a pair by all features by which it is closed and whose gap changes no faster than ``still`` in m/s.

        Args:
            pair: Two geoms.
            near: How they are at the state in ``data``.
            still: Slower rates than this are none.
        """
        found = [Touch(pair, feature) for feature in features(pair, self._model, self._scene.data, near)]
        self.by_pair[pair] = tuple(touch for touch in found if abs(touch.feature.at(self._scene.data).rate) <= still)

    def keep_down(self, pairs: Sequence[tuple[ContactPair, Proximity]]) -> None:
        """Hold too what of some pairs separates so slowly, pressed as it is, that its gap would not become ``_LIFT_M``.

        A block that rocks from corner to corner would do so for ever, at heights that no number tells from zero.
        """
        model, data, held = self._model, self._scene.data, self.touches
        found = [Touch(pair, feature) for pair, near in pairs for feature in features(pair, model, data, near)]
        slow = [
            (touch, at) for touch in found if 0.0 < (at := touch.feature.at(data)).rate <= _SLOW_M_S and not self._has(at)
        ]
        if not slow:
            return
        _, problem = self._problem((*held, *(touch for touch, _ in slow)))
        pressing = problem.eased(problem.pushed())[len(held) :]
        for (touch, at), b in zip(slow, pressing.tolist(), strict=True):
            if at.rate**2 <= 2.0 * b * _LIFT_M:
                self.by_pair[touch.pair] = (*self.by_pair.get(touch.pair, ()), touch)

    def _has(self, at: Held) -> bool:
        """Whether a touch at this place is held already."""
        data = self._scene.data
        return any(math.dist(touch.feature.at(data).point, at.point) < EDGE_M for touch in self.touches)

    def push(self, data: Any) -> None:
        """Add the forces of the pressing contacts to ``data.qfrc_applied``, which holds all other pushes."""
        self._others = data.qfrc_applied.copy()
        if not self.pressing:
            return
        here, problem = self._problem(self.pressing)
        forces = problem.held(range(len(self.pressing)))
        data.qfrc_applied[:] += forces.dot(here.J)
        self.stages.append(Stage(here, forces, data.qvel.copy()))

    def _problem(self, touches: tuple[Touch, ...]) -> tuple[Rows, Acceleration]:
        """Rows and accelerations at the state in ``data``, under the efforts in it."""
        model, data = self.motion.model, self.motion.data
        mujoco.mj_fwdActuation(model, data)
        here = self._rows(touches)
        force = data.qfrc_passive - data.qfrc_bias + data.qfrc_actuator + self._others
        return here, Acceleration(lambda: mass_matrix(model, data), here, force)

    def _rows(self, touches: tuple[Touch, ...]) -> Rows:
        """Rows at the state in ``data``: the last ones where that is still the state, though efforts may have changed."""
        data = self.motion.data
        key = (data.qpos.tobytes(), data.qvel.tobytes(), touches)
        if self._looked is None or self._looked[0] != key:
            self._looked = key, rows(self.motion, self._scene.data, touches)
        return self._looked[1]

    def decide(self) -> Decision:
        """Which press at the state in ``data`` under the efforts in it."""
        data, touches = self.motion.data, self.touches
        key = (data.qpos.tobytes(), data.qvel.tobytes(), data.ctrl.tobytes(), touches)
        if self._decided is None or self._decided[0] != key:
            here, problem = self._problem(touches)
            forces = problem.pushed()
            self._decided = key, Decision(touches, here, problem, forces, problem.opening(forces))
        return self._decided[1]

    def leaving(self) -> set[Touch]:
        """Those whose gap opens."""
        return self.decide().leaving if self.touches else set()

    def press(self) -> None:
        """From here on hold those that press at the state in ``data``."""
        decision = self.decide() if self.touches else None
        self.pressing = tuple(decision.touches[i] for i in decision.pressing) if decision else ()

    def slack(self) -> float:
        """How far the state in ``data`` is from where something changes; below zero where something has.

        What presses still pushes and the rest stays at rest, every contact is within its feature, no gap has drifted off,
        and no pair touches at another point.
        """
        if not self.touches:
            return math.inf
        decision = self.decide()
        inside = min(here.inside for here in decision.rows.held) + EDGE_M
        drift = max(abs(here.gap) for here in decision.rows.held)
        return min(inside, _DRIFT_M - drift, self._others_clear(), self._accelerations_hold(decision))

    def _accelerations_hold(self, decision: Decision) -> float:
        """Whether the contacts that are held are those that press, up to forces that redundant contacts may share anew."""
        problem = decision.problem
        allowed = _OPENS * problem.rounding
        held = [decision.touches.index(touch) for touch in self.pressing]
        forces = problem.held(held)
        opening = problem.opening(forces)
        least = np.minimum(problem.eased(forces) + allowed, allowed - np.abs(opening))
        if least.min() >= 0.0:
            return float(least.min())
        return float((allowed - np.maximum(np.abs(opening - decision.opening), decision.opening)).min())

    def _others_clear(self) -> float:
        """The least gap of any point of the closed pairs, and a little."""
        data = self.motion.data
        key = data.qpos.tobytes(), data.qvel.tobytes(), len(self.by_pair)
        if self._deepest is None or self._deepest[0] != key:
            gaps = (self._gap_of_all_points(pair) for pair in self.by_pair if many_points(pair))
            self._deepest = key, min(gaps, default=math.inf) + _OTHER_POINT_M
        return self._deepest[1]

    def deeper(self) -> bool:
        """Whether a closed pair touches at another point than those that are held."""
        return self._others_clear() < 0.0

    def landed(self) -> list[Feature]:
        """The features, at other points than those that are held, by which closed pairs overlap."""
        model, data = self._model, self._scene.data
        found = (features(pair, model, data, pair.proximity(model, data)) for pair in self.by_pair if many_points(pair))
        return [feature for each in found for feature in each if feature.at(data).gap < -0.5 * _OTHER_POINT_M]

    def _gap_of_all_points(self, pair: ContactPair) -> float:
        """Gap of a pair, m; exact where it is below zero by more than MuJoCo's rounding, zero where it opens from there."""
        data = self._scene.data
        gap = pair.gap(self._model, data, 1.0)
        if gap > -0.5 * _OTHER_POINT_M:
            return gap
        near = pair.proximity(self._model, data)
        return near.gap if near.approaches else max(near.gap, 0.0)

    def beyond_an_edge(self) -> list[ContactPair]:
        """Pairs of which a contact is outside its feature."""
        return self._pairs_where(lambda at: at.inside < -EDGE_M)

    def adrift(self) -> list[ContactPair]:
        """Pairs of which a gap has drifted as far as a step may let it."""
        return self._pairs_where(lambda at: abs(at.gap) > 0.99 * _DRIFT_M)

    def _pairs_where(self, holds: Callable[[Held], bool]) -> list[ContactPair]:
        if not self.touches:
            return []
        here = self.decide()
        beyond = [touch.pair for touch, at in zip(here.touches, here.rows.held, strict=True) if holds(at)]
        return list(dict.fromkeys(beyond))


def many_points(pair: ContactPair) -> bool:
    """Whether a pair may touch at several points."""
    return not any(pair.is_of(kind) for kind in _ONE_POINT)


def stillness(near: Proximity, approach: float) -> float:
    """Rates slower than this are rounding after an impact at some speed of approach, m/s."""
    return near.still + _STILL * approach


def held_stillness(near: Proximity) -> float:
    """The same for a pair that has been held: at the end of a long step its gap drifts until the next one begins."""
    return _DRIFTING / REST_RATE * near.still


def switched_stillness(near: Proximity) -> float:
    """The same for a pair that has left a feature by EDGE_M: a normal that turns there has turned by EDGE_M / radius."""
    return EDGE_M / _LEAST_RADIUS_M / REST_RATE * near.still


def closed_and_still(near: Proximity, still: float) -> bool:
    """Whether a pair that is looked at is in contact, and some point of it neither approaches nor separates."""
    return near.gap <= GAP_TOLERANCE and bool(np.abs(near.rates).min() <= still)
