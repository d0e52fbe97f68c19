"""Caps of cylinders in flat contact: the point of the rim at which the gap closes fastest.

A few fixed points represent the rim, and span a polygon within the disc. While the cylinder tips between two of them, the
point of the rim that comes nearest is none of them. The gap rate is linear in the position, so its minimum over a disc is at
one point of the rim, which is known in closed form.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.manifold import facing, touching_set
from ffsm_mj.contact.shape import Shape


@dataclass(frozen=True)
class Cap:
    """The flat end of a cylinder.

    Attributes:
        centre: Centre in world axes, m, (3,).
        axes: Two orthonormal vectors in its plane, world axes, (2, 3).
        radius: Radius in m.
    """

    centre: FloatArray
    axes: FloatArray
    radius: float

    def rise(self, point: FloatArray, normal: FloatArray) -> float:
        """Cosine of the angle between a direction and the radial direction, in the plane of the cap, towards a point."""
        outward = (self.axes @ (point - self.centre)) @ self.axes
        return float(normal @ outward) / float(np.linalg.norm(outward))

    def towards(self, direction: FloatArray) -> FloatArray | None:
        """The extreme point of the rim along a direction, (3,); None if the direction is perpendicular to the cap."""
        along = self.axes @ direction
        length = float(np.linalg.norm(along))
        return np.asarray(self.centre + self.radius / length * along @ self.axes) if length > 0.0 else None


def cap_of(shape: Shape, outward: FloatArray) -> Cap | None:
    """The cap of a cylinder that faces along a unit vector; None for other geoms, and for a cylinder tilted against it."""
    found = shape.cap(outward)
    return Cap(*found) if found else None


def lowest_of_rims(shapes: tuple[Shape, Shape], normal: FloatArray, spin: FloatArray, level: float) -> Iterator[FloatArray]:
    """For each cap of two geoms in flat contact: the rim point at which the gap rate is least, (1, 3), if it is in contact.

    Args:
        shapes: The two geoms.
        normal: Unit normal from the first geom to the second.
        spin: Angular velocity of the second geom relative to the first; the gap rate increases along normal x spin.
        level: Tolerance of :func:`~ffsm_mj.contact.manifold.touching_set`, m.
    """
    caps = cap_of(shapes[0], normal), cap_of(shapes[1], -normal)
    for mine, cap in enumerate(caps):
        lowest = cap.towards(np.cross(spin, normal)) if cap else None
        if cap is None or lowest is None:
            continue
        features = list(facing(*shapes, normal))
        features[mine] = np.concatenate((features[mine], lowest[None]))
        points = touching_set(features[0], features[1], normal, level)
        apart = np.linalg.norm(cap.axes @ (points - lowest).T, axis=0)
        if (apart <= level).any():
            yield points[[int(np.argmin(apart))]]
