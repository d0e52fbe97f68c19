"""Cylinders and capsules end to end: of coaxial rods of one radius the ends between them are covered.

A rim that two coaxial cylinders of one radius share is no feature of their union, which is one longer cylinder.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.tolerances import PARALLEL


@dataclass(frozen=True, eq=False)
class Rod:
    """The straight part of a cylinder or capsule.

    Attributes:
        centre: Its middle, (3,), m.
        axis: Unit vector along it, (3,).
        half: Half its length, m.
        radius: Its radius, m.
    """

    centre: FloatArray
    axis: FloatArray
    half: float
    radius: float

    def covers(self, other: Rod, sense: float, tolerance: float) -> bool:
        """Whether it continues another rod beyond one of its ends.

        Args:
            other: The other rod.
            sense: 1 for the end along the axis of the other rod, -1 for the other end.
            tolerance: Distance within which radii, axes and ends are equal, m.
        """
        end = other.centre + sense * other.half * other.axis
        # Both ends of the other axis are compared: an angle between the axes counts by what it parts.
        for place in (end, other.centre - sense * other.half * other.axis):
            offset = place - self.centre
            if np.linalg.norm(offset - (offset @ self.axis) * self.axis) > tolerance:
                return False
        along = float((end - self.centre) @ self.axis) * float(np.sign(sense * (self.axis @ other.axis)))
        return abs(self.radius - other.radius) <= tolerance and -self.half - tolerance <= along < self.half - tolerance


@dataclass(frozen=True)
class Ends:
    """Ends of a rod that others continue.

    Attributes:
        rod: The rod.
        senses: 1 for that along its axis, -1 for the other one.
        run: Number of the run of rods that it belongs to: these have one round surface.
        whole: The run as one rod; the same numbers for all of its rods.
    """

    rod: Rod
    senses: tuple[float, ...]
    run: int
    whole: Rod

    def cover(self, direction: FloatArray) -> bool:
        """Whether a direction, (3,), points out of one of these ends."""
        return any(sense * float(direction @ self.rod.axis) > PARALLEL for sense in self.senses)


def covered_ends(rods: Sequence[Rod], tolerance: float) -> list[Ends]:
    """Covered ends of each rod.

    Args:
        rods: The rods of one rigid body.
        tolerance: Distance within which radii, axes and ends are equal, m.
    """
    runs, senses = list(range(len(rods))), list[tuple[float, ...]]()
    for k, rod in enumerate(rods):
        beyond = [(sense, i) for sense in (-1.0, 1.0) for i, other in enumerate(rods) if other.covers(rod, sense, tolerance)]
        senses.append(tuple(dict.fromkeys(sense for sense, _ in beyond)))
        for _, i in beyond:
            runs = [runs[k] if run == runs[i] else run for run in runs]
    wholes = {run: _whole([rod for rod, of in zip(rods, runs, strict=True) if of == run]) for run in set(runs)}
    return [Ends(rod, covered, run, wholes[run]) for rod, covered, run in zip(rods, senses, runs, strict=True)]


def _whole(rods: Sequence[Rod]) -> Rod:
    """A run of rods as one, along the axis of the first."""
    first = rods[0]
    ends = [float((rod.centre - first.centre) @ first.axis) + sense * rod.half for rod in rods for sense in (-1.0, 1.0)]
    low, high = min(ends), max(ends)
    return Rod(first.centre + 0.5 * (low + high) * first.axis, first.axis, 0.5 * (high - low), first.radius)
