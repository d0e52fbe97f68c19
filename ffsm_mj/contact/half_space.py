"""The normal and the gap of a half-space, a ``plane`` of a model, and a convex geom: both in closed form.

MuJoCo gives planes to fixed bodies only, and the size of a plane is that of its picture: it bounds a half-space. The normal
is its z axis, from a or towards it, whatever the other geom does, and the gap is the height of the lowest point of that one.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.manifold import facing
from ffsm_mj.contact.normal import separation
from ffsm_mj.contact.normal_search import ContactNormal, NormalSearch
from ffsm_mj.contact.shape import Shape


class HalfSpaceNormal(NormalSearch):
    """Gap and normal of a pair of which one geom is a plane; nothing is searched, and no estimate is kept."""

    def distance(self, model: Any, data: Any, limit: float) -> float:
        """Signed distance in m, negative when overlapping; ``limit`` if it is larger."""
        shapes = Shape(model, data, self._a), Shape(model, data, self._b)
        return min(separation(*shapes, _normal(shapes)), limit)

    def normal(self, model: Any, data: Any, shapes: tuple[Shape, Shape]) -> ContactNormal:  # noqa: ARG002
        """Contact normal at the state of both geoms; see :meth:`NormalSearch.normal`."""
        normal = _normal(shapes)
        features = facing(*shapes, normal)
        return ContactNormal(normal, features, 0.5 * (features[0].mean(axis=0) + features[1].mean(axis=0)))


def _normal(shapes: tuple[Shape, Shape]) -> FloatArray:
    """Unit normal from a to b, world axes, (3,)."""
    a, b = shapes
    return np.array(a.axis) if a.is_plane else -b.axis
