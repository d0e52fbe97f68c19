"""A disc that lies flat against another geom: the points of its rim that its few fixed ones do not stand for.

The fixed points span a polygon within the disc, which says nothing of what of the rim comes nearest while the disc tips
between two of them. Gap rates are linear in the place, so over a disc they are least at one point of its rim.
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
        centre: Its middle, world axes, m, (3,).
        axes: Two unit vectors in its plane, (2, 3).
        radius: In m.
    """

    centre: FloatArray
    axes: FloatArray
    radius: float

    def rise(self, point: FloatArray, normal: FloatArray) -> float:
        """Cosine of the angle between a direction and that from the middle of the cap to below or above a point."""
        outward = (self.axes @ (point - self.centre)) @ self.axes
        return float(normal @ outward) / float(np.linalg.norm(outward))

    def towards(self, direction: FloatArray) -> FloatArray | None:
        """The point of the rim that is furthest along a direction, (3,); None where that is square to the cap."""
        along = self.axes @ direction
        length = float(np.linalg.norm(along))
        return np.asarray(self.centre + self.radius / length * along @ self.axes) if length > 0.0 else None


def cap_of(shape: Shape, outward: FloatArray) -> Cap | None:
    """The cap that is a cylinder's extreme face along a unit vector; None of other geoms, and of one that stands askew."""
    found = shape.cap(outward)
    return Cap(*found) if found else None


def lowest_of_rims(shapes: tuple[Shape, Shape], normal: FloatArray, spin: FloatArray, level: float) -> Iterator[FloatArray]:
    """The points of the rims of caps at which the gap of two geoms falls fastest, each (1, 3), where they touch the other.

    Args:
        shapes: The geoms.
        normal: From the first to the second.
        spin: Angular velocity of the second less that of the first; rates grow along normal x spin.
        level: See :func:`~ffsm_mj.contact.manifold.touching_set`, m.
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
