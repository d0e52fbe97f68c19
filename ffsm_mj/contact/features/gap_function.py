"""Gap functions of contact features, and their states: gap, rate, normal, contact points and curvature terms."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, Self

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.features.body_motion import Vector, shifted
from ffsm_mj.state import Stateful
from ffsm_mj.tolerances import EPSILON

_ROTATION_RAD = 64.0 * EPSILON
"""Rounding of the rotation between two bodies: a transfer multiplies some ten quaternions."""


class FeatureState(NamedTuple):
    """One feature at one state, in world axes.

    Attributes:
        gap: Value of the gap function, in m, negative when overlapping.
        rate: Its rate in m/s.
        normal: Unit normal from a to b, (3,).
        point: Point of application of the force, midway between both surfaces, (3,).
        point_a: Material point of a, (3,).
        point_b: Material point of b, (3,): gap'' = normal . (acceleration at point_b - acceleration at point_a) + bend.
        bend: Velocity-dependent part of gap'' from rotation and curvature, in m/s^2.
        scale: Largest term of ``bend``, in m/s^2; rounding is a share of it.
        inside: Distance to the bounds of the feature, in m: negative beyond an edge of a face or an end of an edge; inf if
            the feature is unbounded.
        point_rate: Velocity of ``point``, which moves over both surfaces (it is not a material point), in m/s.
    """

    gap: float
    rate: float
    normal: FloatArray
    point: FloatArray
    point_a: FloatArray
    point_b: FloatArray
    bend: float
    scale: float
    inside: float
    point_rate: Vector


class Feature(Protocol):
    """A smooth gap function of two geoms, evaluated for the same feature even where another one is nearer."""

    @property
    def name(self) -> str:
        """The two features in contact, such as ``sphere on face``."""
        ...

    def tilt(self, data: Any) -> Vector | None:
        """Tilt of a rim over a face, or the like; None for features of bounded curvature."""
        ...

    @property
    def radii(self) -> tuple[float, float]:
        """Radius of the first core, and the sum of both radii, m."""
        ...

    def at(self, data: Any) -> FeatureState:
        """Evaluate at the state in ``data`` (``xpos``, ``xmat``, ``cvel`` and ``subtree_com`` current)."""
        ...


class GapFunction(Stateful):
    """Base of all gap functions: a pair of cores, the first of which may belong to geom a or b.

    Attributes:
        name: The two features in contact.
        swapped: Whether the first core belongs to geom b.
        arguments: The arguments of its class.
    """

    @dataclass
    class State:
        """Radius of the first core, and the sum of both, m: a length may have been subtracted from the gap."""

        first_radius: float
        radius: float

    arguments: tuple[Any, ...]

    def __new__(cls, *arguments: Any) -> Self:
        """Keep what it is made of."""
        feature = super().__new__(cls)
        feature.arguments = arguments
        return feature

    def __init__(self, name: str, swapped: bool, first_radius: float, second_radius: float) -> None:
        """Store the radii of the two cores in m."""
        self.name = name
        self.swapped = swapped
        self._first_radius = first_radius
        self._radius = first_radius + second_radius

    def at(self, data: Any) -> FeatureState:
        """Evaluate at the state in ``data``."""
        raise NotImplementedError

    def tilt(self, data: Any) -> Vector | None:  # noqa: ARG002
        """Tilt of a rim over a face, of a line over another one or over a cap; None for features of bounded curvature.

        It is the component of the normal of the face across the axis of the rim, in axes of the body of the rim; for lines,
        their cross product; for a line across a level cap, the sine of half the angle of its chord. The contact point
        travels at the rate of the tilt over the tilt, whatever the step.
        """
        return None

    @property
    def radii(self) -> tuple[float, float]:
        """Radius of the first core, and the sum of both radii, m."""
        return self._first_radius, self._radius

    def subtract_length(self, length: float) -> None:
        """Subtract a constant length in m from the gap: mesh vertices are known to single precision only."""
        self._first_radius += length
        self._radius += length

    def _state(
        self,
        core_gap: float,
        rate: float,
        normal: Vector,
        turning: Vector,
        points: tuple[Vector, Vector],
        moving: Vector,
        terms: Sequence[float],
        inside: float,
    ) -> FeatureState:
        """Build the state from the normal (first core to second) and its rate ``turning``, and the material point of each.

        ``moving`` is the velocity of the second core's contact point, which slides over the core.
        """
        gap = core_gap - self._radius
        (x, y, z), (on_first, on_second) = normal, points
        u, v, w = on_second
        # From the second point back to the first core, and out of it to the middle between the surfaces.
        level = self._first_radius + 0.5 * gap - core_gap
        point = np.array((u + level * x, v + level * y, w + level * z))
        point_rate = shifted(shifted(moving, level, turning), -0.5 * rate, normal)  # the level changes by -rate / 2
        second = np.array(on_second)
        first = second if on_first is on_second else np.array(on_first)
        bend, scale = math.fsum(terms), max(map(abs, terms))
        if self.swapped:
            return FeatureState(gap, rate, np.array((-x, -y, -z)), point, second, first, bend, scale, inside, point_rate)
        return FeatureState(gap, rate, np.array(normal), point, first, second, bend, scale, inside, point_rate)


def tilt_rounding(feature: Feature, data: Any, *, moves: bool) -> float:
    """Share to which the curvature terms at a feature with a tilt are known; 0 without one.

    Rotations are known to rounding, so a tilt is known to it over the tilt. The normal at round sides turns by as much, and
    the point at which they cross moves by that over the tilt again: so do the speeds there, which enter as squares.

    Args:
        feature: The feature.
        data: MuJoCo data.
        moves: Whether the rotations have been transferred, so that the point at which sides cross moves too.
    """
    tilt = feature.tilt(data)
    if tilt is None:
        return 0.0
    angle = max(math.hypot(*tilt), _ROTATION_RAD)
    share = _ROTATION_RAD / angle
    return min(1.0, share + (2.0 * share / angle if moves and feature.radii[1] > 0.0 else 0.0))
