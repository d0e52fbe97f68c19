"""Caps of cylinders in flat contact: the point of the rim at which the gap closes fastest.

A few fixed points represent the rim, and span a polygon within the disc. While the cylinder tips between two of them, the
point of the rim that comes nearest is none of them. The gap rate is linear in the position, so its minimum over a disc is at
one point of the rim, which is known in closed form.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.cap import caps_of
from ffsm_mj.contact.manifold import facing, touching_set
from ffsm_mj.contact.shape import Shape


def lowest_of_rims(shapes: tuple[Shape, Shape], normal: FloatArray, spin: FloatArray, level: float) -> Iterator[FloatArray]:
    """For each cap of two geoms in flat contact: the rim point at which the gap rate is least, (1, 3), if it is in contact.

    Args:
        shapes: The two geoms.
        normal: Unit normal from the first geom to the second.
        spin: Angular velocity of the second geom relative to the first; the gap rate increases along normal x spin.
        level: Tolerance of :func:`~ffsm_mj.contact.manifold.touching_set`, m.
    """
    caps = caps_of(*shapes, normal)
    for mine, cap in enumerate(caps):
        lowest = cap.towards(np.cross(spin, normal)) if cap else None
        if cap is None or lowest is None:
            continue
        features = list(facing(*shapes, normal))
        features[mine] = np.concatenate((features[mine], lowest[None]))
        if opposite := caps[1 - mine]:
            features[1 - mine] = np.concatenate((features[1 - mine], opposite.covered(lowest[None])))
        points = touching_set(features[0], features[1], normal, level)
        apart = np.linalg.norm(cap.axes @ (points - lowest).T, axis=0)
        if (apart <= level).any():
            yield points[[int(np.argmin(apart))]]
