"""The contacts that are closed: which of them press, with what force, and for how long that stays so."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.contact.feature import EDGE_M, Feature, FeatureState, features
from ffsm_mj.contact.pairs import REST_RATE, ContactPair, Proximity
from ffsm_mj.contact.shape import PARALLEL
from ffsm_mj.contact_models.impact.time_of_impact import GAP_TOLERANCE
from ffsm_mj.contact_models.interface import Scene
from ffsm_mj.contact_models.persistent.acceleration import Acceleration
from ffsm_mj.contact_models.persistent.decision import Decision
from ffsm_mj.contact_models.persistent.exchange import Stage
from ffsm_mj.contact_models.persistent.rows import ContactPoint, ContactRows, rows
from ffsm_mj.contact_models.persistent.smooth import Smooth
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.dynamics.rigid_body import mass_matrix

_STILL = 1e-9
"""What an impact leaves separating slower than this share of its approach is still; so much of an impact is rounding."""
_DRIFTING = 1e-6
"""What is held changes its gap slower than this share of (1 m/s + the speeds of its bodies)."""
_LEAST_RADIUS_M = 1e-4
"""Of what is round and slides over an edge, m."""
_DRIFT_M = 5e-10
"""A step that lets a closed gap drift further than this is cut there, and the drift taken out."""
_OTHER_POINT_M = 2e-10
"""A pair that is so much deeper than what is held of it touches at another point."""
LANDS_M = _OTHER_POINT_M + _DRIFT_M
"""No point of a closed pair overlaps by more before it lands: what is held of the pair may have drifted."""
_LIFT_M, _SLOW_M_S = 1e-11, 1e-3
"""What would not lift off further than this counts as closed; nothing that separates faster is asked."""
_ONE_POINT = (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_ELLIPSOID)
"""Geoms that touch anything convex at one point only."""


class ActiveContactSet:
    """Closed contacts of a motion.

    Attributes:
        motion: What moves.
        by_pair: Touches of each closed pair; :meth:`hold` and :meth:`let_go` change them.
        touches: All of them, pair by pair.
        pressing: Those that are held in the stages of a step.
        stages: What was asked in the stages since the step began.
    """

    def __init__(self, scene: Scene) -> None:
        """Nothing is closed."""
        self._scene, self._model = scene, scene.system.mj
        self.motion: Motion
        self.by_pair: dict[ContactPair, tuple[ContactPoint, ...]] = {}
        self.touches: tuple[ContactPoint, ...] = ()
        self.pressing: tuple[ContactPoint, ...] = ()
        self.stages: list[Stage] = []
        self._spread: list[ContactPair] = []
        self._others = np.zeros(self._model.nv)
        self._looked: tuple[tuple[Any, ...], ContactRows] | None = None
        self._asked: tuple[tuple[Any, ...], Acceleration] | None = None
        self._decided: Decision | None = None
        self._deepest: tuple[tuple[Any, ...], float] | None = None

    def bind(self, motion: Motion) -> None:
        """Move with this from here on; nothing was asked of it yet, nor was anything pushed by others."""
        self.motion, self._smooth = motion, Smooth(motion, self._scene.data)
        self._others = np.zeros(motion.model.nv)
        self._looked = self._asked = self._decided = self._deepest = None
        self.forget()

    def forget(self) -> None:
        """Something changed at one instant: forces of before are none of what comes."""
        self.stages.clear()

    def hold(self, pair: ContactPair, touches: Sequence[ContactPoint]) -> None:
        """Hold a pair by some features; by none where it is about to be let go."""
        self.by_pair[pair] = tuple(touches)
        self._count()

    def let_go(self, pair: ContactPair) -> None:
        """Hold a pair no more."""
        del self.by_pair[pair]
        self._count()

    def _count(self) -> None:
        self.touches = tuple(touch for touches in self.by_pair.values() for touch in touches)
        self._spread = [pair for pair in self.by_pair if many_points(pair)]

    def take(self, pair: ContactPair, near: Proximity, still: float) -> None:
        """Hold a pair by all that is found; see :meth:`found`."""
        self.hold(pair, self.found(pair, near, still))

    def found(self, pair: ContactPair, near: Proximity, still: float) -> tuple[ContactPoint, ...]:
        """All features by which a pair is closed and whose gap changes no faster than ``still`` in m/s.

        Args:
            pair: Two geoms.
            near: How they are at the state in ``data``.
            still: Slower rates than this are none.
        """
        data = self._scene.data

        def is_still(at: FeatureState) -> bool:
            if abs(at.rate) <= still:
                return True
            # An edge that lies on a cap is parallel to it to some 1e-10 rad, and the normals of its ends differ by as much.
            # Impacts act along the normal of the pair: at 0.3 m/s of slip they leave gaps with rates of 3e-11 m/s.
            parallel = math.dist(at.normal, near.normal) <= PARALLEL
            return parallel and abs(pair.rate_along(data, near.normal, at.point)) <= still

        found = (feature for feature in features(pair, self._model, data, near) if is_still(feature.at(data)))
        return tuple(ContactPoint(pair, feature) for feature in found)

    def keep_down(self, pairs: Sequence[tuple[ContactPair, Proximity]]) -> None:
        """Hold too what of some pairs separates so slowly, pressed as it is, that its gap would not become ``_LIFT_M``.

        A block that rocks from corner to corner would do so for ever, at heights that no number tells from zero.
        """
        model, data, held = self._model, self._scene.data, self.touches
        found = [ContactPoint(pair, feature) for pair, near in pairs for feature in features(pair, model, data, near)]
        slow = [
            (touch, at) for touch in found if 0.0 < (at := touch.feature.at(data)).rate <= _SLOW_M_S and not self._has(at)
        ]
        if not slow:
            return
        problem = self._problem((*held, *(touch for touch, _ in slow)))
        pressing = problem.eased(problem.pushed())[len(held) :]
        for (touch, at), b in zip(slow, pressing.tolist(), strict=True):
            if at.rate**2 <= 2.0 * b * _LIFT_M:
                self.hold(touch.pair, (*self.by_pair.get(touch.pair, ()), touch))

    def _has(self, at: FeatureState) -> bool:
        """Whether a touch at this place is held already."""
        data = self._scene.data
        return any(math.dist(touch.feature.at(data).point, at.point) < EDGE_M for touch in self.touches)

    def push(self, data: Any) -> None:
        """Add the forces of the pressing contacts to ``data.qfrc_applied``, which holds all other pushes."""
        applied = data.qfrc_applied
        self._others = applied.copy()
        if not self.pressing:
            return
        problem = self._problem(self.pressing)
        forces = problem.held(range(len(self.pressing)))
        generalised = forces.dot(problem.rows.J)
        applied += generalised
        self.stages.append(Stage(problem.rows, forces, generalised * data.qvel))

    def _problem(self, touches: tuple[ContactPoint, ...]) -> Acceleration:
        """Accelerations at the state in ``data``, under the efforts in it: the last ones where both are still the same.

        The rows stay where the efforts alone have changed.
        """
        motion, smooth = self.motion, self._smooth
        place = touches, smooth.state()
        key = place, smooth.efforts(), self._others.tobytes()
        if self._asked is None or self._asked[0] != key:
            if self._looked is None or self._looked[0] != place:
                self._looked = place, rows(motion, self._scene.data, touches)
            M = partial(mass_matrix, motion.model, motion.data)
            self._asked = key, Acceleration(M, self._looked[1], smooth.force(self._others))
        return self._asked[1]

    def decide(self) -> Decision:
        """Which press at the state in ``data`` under the efforts in it."""
        touches = self.touches
        problem = self._problem(touches)
        if self._decided is None or self._decided.problem is not problem:
            self._decided = Decision(touches, problem)
        return self._decided

    def leaving(self) -> tuple[ContactPoint, ...]:
        """Those whose gap opens."""
        return self.decide().leaving() if self.touches else ()

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
        held = decision.rows.held
        inside, drift = min([here.inside for here in held]) + EDGE_M, max([abs(here.gap) for here in held])
        return min(inside, _DRIFT_M - drift, self._others_clear(), decision.holds_for(self.pressing))

    def _others_clear(self) -> float:
        """The least gap of any point of the closed pairs over how far what is held of the pair has drifted, and a little."""
        if not self._spread:
            return math.inf
        key = self._smooth.state(), self.touches
        if self._deepest is None or self._deepest[0] != key:
            gaps = [self._gap_of_all_points(pair) - self._drifted(pair) for pair in self._spread]
            self._deepest = key, min(gaps) + _OTHER_POINT_M
        return self._deepest[1]

    def _drifted(self, pair: ContactPair) -> float:
        """The deepest gap of what is held of a pair, m, at most 0."""
        if not self.by_pair[pair]:
            return 0.0
        decision = self.decide()
        return min(
            [0.0, *(at.gap for touch, at in zip(decision.touches, decision.rows.held, strict=True) if touch.pair is pair)]
        )

    def deeper(self) -> bool:
        """Whether a closed pair touches at another point than those that are held."""
        return self._others_clear() < 0.0

    def landed(self) -> list[Feature]:
        """The features, at other points than those that are held, by which closed pairs overlap."""
        model, data = self._model, self._scene.data
        return [
            feature
            for pair in self._spread
            for feature in features(pair, model, data, pair.proximity(model, data))
            if feature.at(data).gap < self._drifted(pair) - 0.5 * _OTHER_POINT_M
        ]

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

    def _pairs_where(self, holds: Callable[[FeatureState], bool]) -> list[ContactPair]:
        if not self.touches:
            return []
        here = self.decide()
        beyond = [touch.pair for touch, at in zip(here.touches, here.rows.held, strict=True) if holds(at)]
        return list(dict.fromkeys(beyond))


def many_points(pair: ContactPair) -> bool:
    """Whether a pair may touch at several points."""
    return not any(pair.is_of(kind) for kind in _ONE_POINT)


def rate_tolerance(near: Proximity, approach: float) -> float:
    """Rates slower than this are rounding after an impact at some speed of approach, m/s."""
    return near.still + _STILL * approach


def held_rate_tolerance(near: Proximity) -> float:
    """The same for a pair that has been held: at the end of a long step its gap drifts until the next one begins."""
    return _DRIFTING / REST_RATE * near.still


def switched_rate_tolerance(near: Proximity) -> float:
    """The same for a pair that has left a feature by EDGE_M: a normal that turns there has turned by EDGE_M / radius."""
    return EDGE_M / _LEAST_RADIUS_M / REST_RATE * near.still


def closed_and_still(near: Proximity, still: float) -> bool:
    """Whether a pair that is looked at is in contact, and some point of it neither approaches nor separates."""
    return near.gap <= GAP_TOLERANCE and bool(np.abs(near.rates).min() <= still)
