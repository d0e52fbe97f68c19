"""What a frozen contact feature says of one state: its gap, how that changes, and where the force acts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.carrier import Vector

EDGE_M = 1e-9
"""A feature is left when its contact is further than this beyond the feature's bounds; one is taken up within half of it."""


class FeatureState(NamedTuple):
    """One feature at one state, in world axes.

    Attributes:
        gap: Of the frozen gap function, in m, negative when overlapping.
        rate: Its rate in m/s.
        normal: Unit normal from a to b, (3,).
        point: Where the force acts: midway between both surfaces, (3,).
        point_a: Material point of a whose acceleration counts, (3,).
        point_b: That of b, (3,): gap'' = normal . (acceleration of b there - acceleration of a there) + bend.
        bend: All of gap'' that is no material acceleration at these points, in m/s^2; of positions and velocities only.
        scale: Largest of the terms of ``bend``, in m/s^2: rounding is a share of it.
        inside: How far the contact is inside the feature's own bounds, in m: below 0 beyond an edge of a face or an end of
            an edge; inf where it has none.
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


class Feature(Protocol):
    """One smooth gap function of two geoms, frozen: also where another feature is nearer."""

    @property
    def name(self) -> str:
        """What meets what, as ``sphere on face``."""
        ...

    def at(self, data: Any) -> FeatureState:
        """At the positions and velocities in ``data`` (``xpos``, ``xmat``, ``cvel`` and ``subtree_com`` current)."""
        ...


class Pairing:
    """Two cores, of which the first may be a's or b's: what all features share.

    Attributes:
        name: What meets what.
    """

    def __init__(self, name: str, swapped: bool, first_radius: float, second_radius: float) -> None:
        """Of two cores with their radii in m; swapped where the first core is b's."""
        self.name = name
        self._swapped = swapped
        self._first_radius = first_radius
        self._radius = first_radius + second_radius

    def at(self, data: Any) -> FeatureState:
        """At the state in ``data``."""
        raise NotImplementedError

    def absorb(self, length: float) -> None:
        """Take a length in m off the gap, once and for all: what the vertices of a mesh are not known better than."""
        self._first_radius += length
        self._radius += length

    def _held(
        self,
        core_gap: float,
        rate: float,
        normal: Vector,
        points: tuple[Vector, Vector],
        terms: Sequence[float],
        inside: float,
    ) -> FeatureState:
        """Of the normal from the first core to the second, and the material point of each, the second over the contact."""
        gap = core_gap - self._radius
        (x, y, z), (here, there) = normal, points
        u, v, w = there
        # From the second point back to the first core, and out of it to the middle between the surfaces.
        level = self._first_radius + 0.5 * gap - core_gap
        point = np.array((u + level * x, v + level * y, w + level * z))
        second = np.array(there)
        first = second if here is there else np.array(here)
        bend, scale = math.fsum(terms), max(map(abs, terms))
        if self._swapped:
            return FeatureState(gap, rate, np.array((-x, -y, -z)), point, second, first, bend, scale, inside)
        return FeatureState(gap, rate, np.array(normal), point, first, second, bend, scale, inside)
