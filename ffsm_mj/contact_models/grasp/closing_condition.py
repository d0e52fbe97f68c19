"""Closing condition of an armed grasp: bounds on the relative motion of two sites, when they hold, how nearly they did.

Closing time of an armed grasp: first time within a step at which its bounds hold, including dips between its ends.

Closest approach of an armed grasp to its bounds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ffsm_mj._core.closing import ClosingBounds, Norms, RelativeMotion, SiteMotion
from ffsm_mj.arrays import FloatArray
from ffsm_mj.model.grasp import Grasp
from ffsm_mj.model.system import System
from ffsm_mj.state import entries
from ffsm_mj.ties import FirstOfLeast, first_of_greatest
from ffsm_mj.tolerances import EVENT_TIME, EVENT_TIME_S


class Nearness(NamedTuple):
    """Relative pose and velocity of the object's site and the robot's at one state, as norms.

    Attributes:
        position_m: Distance of the sites.
        angle_rad: Angle between their frames.
        speed_m_s: Relative speed of their bodies at the object's site.
        rate_rad_s: Relative angular speed.
    """

    position_m: float
    angle_rad: float
    speed_m_s: float
    rate_rad_s: float


class Sites(SiteMotion):
    """The two sites of a grasp in the logged system.

    Attributes:
        link: Id of the grasping link.
        root: Id of the object's base.
        robot: Id of the robot's site.
        object: Id of the object's site.
    """

    def __init__(self, system: System, grasp: Grasp) -> None:
        """Look up the sites and their bodies."""
        self.robot, self.object = system.index("site", grasp.robot_site), system.index("site", grasp.object_site)
        self.link, self.root = system.index("body", grasp.link), system.index("body", grasp.root)
        super().__init__(system.mj, self.link, self.root, self.robot, self.object)

    def point(self, data: Any) -> FloatArray:
        """Position of the object's site, world axes, m, (3,)."""
        return np.array(data.site_xpos[self.object])

    def nearness(self, data: Any) -> Nearness:
        """Norms of the relative motion at the state in ``data``; see :meth:`at`."""
        return Nearness(*self.at(data).norms)


_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
_GOLDEN_TOLERANCE = 1e-6
"""Share of the interval to which a minimum is found: the function is flat there, its value is known to the square of
this."""
_SAMPLES = (0.25, 0.5, 0.75)
"""Shares of a step at which a ratio is sampled: it has one or two extremes in it. These are the fewest that see a dip beside
a peak."""

At = Callable[[float], RelativeMotion]
"""Moves to a time of a step in s, and evaluates the relative motion of the sites there."""


class Bounds(ClosingBounds):
    """Bounds of the closing condition of a grasp; None for a value without bound.

    Attributes:
        stated: The bounds by the name of the value in :class:`~ffsm_mj.contact_models.grasp.closing_condition.Nearness`.
    """

    def __init__(self, bounds: Sequence[float | None]) -> None:
        """Store the bounds, in the order of :class:`~ffsm_mj.contact_models.grasp.closing_condition.Nearness`."""
        super().__init__(bounds)
        self.stated = {name: bound for name, bound in zip(Nearness._fields, bounds, strict=True) if bound is not None}

    def first(self, at: At, duration_s: float) -> float | None:
        """First time at which all bounds hold in a step, s; None if there is none.

        The ratio is sampled at a few times; a local minimum among the samples is refined, in case it dips below 1.

        Args:
            at: Moves to a time of the step, and evaluates the relative motion there.
            duration_s: Length of the step.
        """

        def excess(time_s: float) -> float:
            return self.ratio(at(time_s).norms) - 1.0

        return first_at_most_zero(excess, duration_s)


def first_at_most_zero(f: Callable[[float], float], duration_s: float) -> float | None:
    """First time in a step at which a function is not positive, s, also where it dips inside; None if there is none."""
    times = [0.0, *(share * duration_s for share in _SAMPLES), duration_s]
    values = [f(time) for time in times]
    # The condition holds from the start, as where a phase arms a grasp that is within its bounds.
    if values[0] <= 0.0:
        return 0.0
    for i in range(1, len(times)):
        if values[i] <= 0.0:
            return _root(f, times[i - 1], times[i])
        # A pass faster than the step may satisfy the bounds inside it and at none of the samples: a dip between higher
        # neighbours.
        if 0 < i < len(times) - 1 and values[i] <= values[i - 1] and values[i] <= values[i + 1]:
            dip = lowest(f, times[i - 1], times[i + 1])
            if f(dip) <= 0.0:
                return _root(f, times[i - 1], dip)
    return None


def _root(f: Callable[[float], float], start_s: float, end_s: float) -> float:
    """Root of a function that is positive at the start and not at the end, rounded up until it is not positive."""
    from scipy.optimize import brentq  # takes a second to import: only runs with a grasp pay

    # Brent's method returns this end, but rounding the root up must not go beyond it.
    if f(end_s) == 0.0:
        return end_s
    # The grasp closes only where the condition holds. A root that is early by rounding would not, and would be found again.
    root, late = float(brentq(f, start_s, end_s, xtol=EVENT_TIME_S, rtol=EVENT_TIME)), EVENT_TIME_S
    while root < end_s and f(root) > 0.0:
        root, late = min(root + late, end_s), 2.0 * late
    return root


def lowest_inside(
    bounds: Bounds, start: RelativeMotion, end: RelativeMotion, at: At, duration_s: float, enough: float
) -> float | None:
    """Time inside a step at which the largest ratio first falls and then rises, s; None if it does not.

    The minimum is the root of the rate of the ratio, which is known to rounding there; the ratio itself is flat.

    Args:
        bounds: The bounds.
        start: Relative motion at the start of the step.
        end: That at its end.
        at: Moves to a time of the step, and evaluates the relative motion there.
        duration_s: Length of the step.
        enough: Minima that are certainly above this do not matter.
    """
    lowest_ratio = bounds.lowest_by_tangents(start, end, duration_s)
    # Of a function that is not quite convex, the minimum is assumed to be at most twice as deep: a step at rest, where rates
    # are rounding, is not searched.
    if not 2.0 * lowest_ratio - min(bounds.ratio(one.norms) for one in (start, end)) <= enough:
        return None
    from scipy.optimize import brentq  # takes a second to import: only runs with a grasp pay

    first, last = start.vectors[2:], end.vectors[2:]
    mean = [[(b - a) / duration_s for a, b in zip(*both, strict=True)] for both in zip(first, last, strict=True)]
    middle = at(0.5 * duration_s).vectors
    bends = [
        [2.0 * (a - 2.0 * m + b) / duration_s for a, m, b in zip(*three, strict=True)]
        for three in zip(first, middle[2:], last, strict=True)
    ]

    def rate(time_s: float) -> float:
        # Accelerations of the parabola through the velocities at the ends and in the middle.
        part = 2.0 * time_s / duration_s - 1.0
        now = [[a + part * b for a, b in zip(*both, strict=True)] for both in zip(mean, bends, strict=True)]
        return bounds.rate(at(time_s), now)

    # The parabola may turn a rate at an end that was rounding: without a change of sign there is no bracket.
    if not rate(0.0) < 0.0 < rate(duration_s):
        return None
    return float(brentq(rate, 0.0, duration_s, xtol=EVENT_TIME_S, rtol=EVENT_TIME))


def lowest(f: Callable[[float], float], start_s: float, end_s: float) -> float:
    """Minimum of a unimodal function by golden-section search, to a millionth of the interval; stops at a value <= 0."""
    stretch = _GOLDEN_TOLERANCE * (end_s - start_s)
    a, b = end_s - _GOLDEN * (end_s - start_s), start_s + _GOLDEN * (end_s - start_s)
    fa, fb = f(a), f(b)
    # Golden sections reuse one of two values, and need no derivative, which a maximum of several ratios does not have.
    while end_s - start_s > stretch:
        if fa <= 0.0:
            return a
        if fa < fb:
            end_s, b, fb = b, a, fa
            a = end_s - _GOLDEN * (end_s - start_s)
            fa = f(a)
        else:
            start_s, a, fa = a, b, fb
            b = start_s + _GOLDEN * (end_s - start_s)
            fb = f(b)
    return a if fa < fb else b


class _Approach(NamedTuple):
    """Relative pose and velocity of the sites at a time in s."""

    time_s: float
    near: Nearness


class ClosestApproach:
    """Least ratio to the bounds of a grasp since it was armed, within steps too; of equal ones the first counts.

    The time of a minimum follows from the rates of the vectors, not from their norms, which do not change there to first
    order: it is known to rounding, and so are the speeds at it.

    Attributes:
        bounds: The bounds.
    """

    @dataclass
    class State:
        """Time up to which steps are added, s, rounding of the ratios, and the least ones, with time and norms of each."""

        clock_s: float
        rounding: float
        least: list[Any]

    def __init__(self, bounds: Bounds, time_s: float) -> None:
        """Start when the grasp is armed."""
        self.bounds, self._clock_s, self._rounding = bounds, time_s, 0.0
        self._least = FirstOfLeast[_Approach]()

    def add_step(self, start: RelativeMotion, end: RelativeMotion, at: At, duration_s: float, rounding: Norms) -> None:
        """Add a finished (sub-)step.

        Args:
            start: Relative motion at its start.
            end: That at its end.
            at: Moves to a time of the step, and evaluates the relative motion there.
            duration_s: Its length.
            rounding: Rounding of the norms.
        """
        # Ratios closer than this are equal, and the first one counts: else rounding would choose the time in the record.
        self._rounding = self.bounds.ratio(rounding)
        self._add(start.norms, 0.0)
        inside_s = lowest_inside(self.bounds, start, end, at, duration_s, self._least.least - self._rounding)
        if inside_s is not None:
            self._add(at(inside_s).norms, inside_s)
        self._add(end.norms, duration_s)
        self._clock_s += duration_s

    def add_end(self, motion: RelativeMotion) -> None:
        """Add the state at which it is disarmed, which an event at the end of the last step may have changed."""
        # Without a finished step there is no approach: a state at the time of arming alone does not count as a miss.
        if self._least.first() is not None:
            self._add(motion.norms, 0.0)

    def get_state(self) -> State:
        """The approach so far."""
        least = [(ratio, rounding, (at.time_s, tuple(at.near))) for ratio, rounding, at in self._least.get_state()]
        return self.State(self._clock_s, self._rounding, least)

    def set_state(self, state: Any) -> None:
        """Go on from an approach so far."""
        values = entries(state, ("clock_s", "rounding", "least"), "ClosestApproach")
        self._clock_s, self._rounding = values["clock_s"], values["rounding"]
        candidates = values["least"]
        self._least.set_state(
            (ratio, rounding, _Approach(time_s, Nearness(*near))) for ratio, rounding, (time_s, near) in candidates
        )

    def assume(self, near: Nearness, time_s: float) -> None:
        """Take it from a log, whose part since the arming is lost."""
        self._clock_s = time_s
        self._add(near, 0.0)

    def _add(self, norms: Norms, after_s: float) -> None:
        if not (ratio := self.bounds.ratio(norms)) >= self._least.least:
            self._least.add(ratio, self._rounding, _Approach(self._clock_s + after_s, Nearness(*norms)))

    def first(self) -> tuple[Nearness, float, str] | None:
        """Relative pose and velocity at it, its time in s, and which value has the largest ratio; None before a step."""
        first, bounds = self._least.first(), self.bounds.stated
        if first is None:
            return None
        ratios = [getattr(first.near, name) / bound for name, bound in bounds.items()]
        # Where one ratio falls and another rises, the largest of both is least where they are equal.
        return first.near, first.time_s, [*bounds][first_of_greatest(ratios, self._rounding)]

    def accuracy(self) -> Mapping[str, float]:
        """How well the fields of the record are determined, by name: how far they vary between equal approaches."""
        first, equals = self._least.first(), self._least.equals()
        if first is None:
            return {}
        spread = {
            name: max(abs(getattr(approach.near, name) - value) for approach in equals)
            for name, value in first.near._asdict().items()
        }
        return spread | {
            "least_s": max(abs(approach.time_s - first.time_s) for approach in equals),
            "failed_value": max(spread[name] for name in self.bounds.stated),
        }
