"""Gap and contact normal of two geoms from MuJoCo's distance queries.

``mj_geomDistance`` returns a distance and two witness points. Near contact the line between them has no defined direction,
so the normal comes from shifted queries: geom b is moved away along the current estimate and the query repeated a few times.
The result is then refined on the support functions (:mod:`.normal`), which also give the gap to rounding.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.manifold import facing, opposite
from ffsm_mj.contact.normal import is_normal, refine_normal, separation
from ffsm_mj.contact.shape import Shape
from ffsm_mj.state import Stateful
from ffsm_mj.tolerances import CLEARLY_APART_M

DISTANCE_LIMIT_M = 1e3
"""Limit of distance queries: larger distances are returned as this."""
_PASSES, _SAME_DIRECTION = 20, 1e-5
"""Passes of a shifted query, and the change of direction at which they end: refinement needs 1e-4 rad.

Each pass leaves shift / (shift + radius of curvature) of the error.
"""
_SHIFT_SHARE, _LARGEST_SHIFT_M = 0.2, 1e-2
"""Shift as a share of the size of the pair (half the thinnest extent), and its largest value."""
_LEAST_SHIFT_M = 1e-9
"""Least shift: witness points are known to about 1e-15 m, which leaves the direction accurate to 1e-6 rad."""


class ContactNormal(NamedTuple):
    """A normal with the features that it was found from.

    Attributes:
        normal: Unit normal from a to b, world axes, (3,).
        features: Extreme points of a along the normal and of b opposite to it, (m, 3) and (n, 3).
        witness: Point midway between the witness points of the query, (3,), m.
    """

    normal: FloatArray
    features: tuple[FloatArray, FloatArray]
    witness: FloatArray


class NormalSearch(Stateful):
    """Distance queries of one pair of geoms; the last normal is the estimate for the next one."""

    @dataclass
    class State:
        """The last normal, (3,); None: there is no estimate."""

        last: FloatArray | None

    def __init__(self, geoms: tuple[int, int], size: float, flush: float = 0.0) -> None:
        """Start without an estimate.

        Args:
            geoms: Ids of geoms a and b.
            size: Half the thinnest extent of both, m.
            flush: Offset of sides that lie along each other; see :func:`~ffsm_mj.contact.manifold.flush_offset`.
        """
        self._flush = flush
        self._a, self._b = geoms
        self._shift = min(_LARGEST_SHIFT_M, _SHIFT_SHARE * size)
        self._fromto = np.zeros(6)
        self._last: FloatArray | None = None

    def distance(self, model: Any, data: Any, limit: float) -> float:
        """Signed distance in m, negative when overlapping; ``limit`` if it is larger."""
        distance = float(mujoco.mj_geomDistance(model, data, self._a, self._b, limit, self._fromto))
        if 0.0 < distance < limit:
            # For faces in contact the query returns, in about one of a hundred poses, centimetres with coinciding witnesses.
            x, y, z, u, v, w = self._fromto.tolist()
            return min(distance, math.hypot(u - x, v - y, w - z))
        return distance

    def normal(self, model: Any, data: Any, shapes: tuple[Shape, Shape]) -> ContactNormal:
        """Contact normal at the state in ``data``.

        Args:
            model: MuJoCo model.
            data: Its data, kinematics current; moved and restored during the search.
            shapes: Both geoms at this state.
        """
        estimate, witness = self._shifted_query(model, data, self._estimate(model, data), self._shift)
        normal = refine_normal(*shapes, estimate)
        features = facing(*shapes, normal)
        if not opposite(*features, normal, self._flush):
            # The extreme features do not overlap across the direction, so it is no normal: corners are too close.
            normal, witness = self._nearer_queries(model, data, shapes, (normal, witness))
            features = facing(*shapes, normal)
        self._last = normal
        return ContactNormal(normal, features, witness)

    def _nearer_queries(
        self, model: Any, data: Any, shapes: tuple[Shape, Shape], found: tuple[FloatArray, FloatArray]
    ) -> tuple[FloatArray, FloatArray]:
        """Normal and witness from queries at smaller and smaller shifts, for corners very close to each other.

        Each pass of a query turns the direction by at most the offset of the corners across it, over the shift. A smaller
        shift turns it far enough to reach the faces and edges that meet at the corners. Of all directions the contact normal
        has the largest separation, so only directions that increase it are kept.
        """
        (best, witness), shift = found, self._shift
        while shift > _LEAST_SHIFT_M and not is_normal(*shapes, best):
            shift *= 0.1
            direction, between = self._shifted_query(model, data, best, shift)
            normal = refine_normal(*shapes, direction)
            if separation(*shapes, normal) > separation(*shapes, best):
                best, witness = normal, between
        return best, witness

    def _shifted_query(self, model: Any, data: Any, normal: FloatArray, shift: float) -> tuple[FloatArray, FloatArray]:
        """Normal, and the midpoint of the witness points, from queries with b moved away from a, first along an estimate."""
        centre = data.geom_xpos[self._b].copy()
        try:
            for _ in range(_PASSES):
                data.geom_xpos[self._b] = centre + shift * normal
                distance = mujoco.mj_geomDistance(model, data, self._a, self._b, DISTANCE_LIMIT_M, self._fromto)
                if distance <= 0.0:  # the overlap is deeper than the shift: move further out
                    shift *= 4.0
                    continue
                before, normal = normal, _direction(self._fromto)
                if math.dist(before, normal) < _SAME_DIRECTION:
                    break
        finally:
            data.geom_xpos[self._b] = centre
        return normal, 0.5 * (self._fromto[:3] + self._fromto[3:] - shift * normal)

    def _estimate(self, model: Any, data: Any) -> FloatArray:
        """First estimate of the normal: the witness points if clearly apart, else the last normal, else the centres."""
        if self.distance(model, data, DISTANCE_LIMIT_M) > CLEARLY_APART_M:
            return _direction(self._fromto)
        if self._last is not None:
            return self._last
        direction = data.geom_xpos[self._b] - data.geom_xpos[self._a]
        length = float(np.linalg.norm(direction))
        return np.asarray(direction / length) if length > 0.0 else np.array([1.0, 0.0, 0.0])


def _direction(fromto: FloatArray) -> FloatArray:
    """Unit vector between two witness points; not divided by the returned distance, which is less accurate."""
    difference = fromto[3:] - fromto[:3]
    return np.asarray(difference / np.linalg.norm(difference))


class HalfSpaceNormal(NormalSearch):
    """Gap and normal of a pair of which one geom is a plane, in closed form; nothing is searched, and no estimate is kept.

    MuJoCo gives planes to fixed bodies only, and the size of a plane is that of its picture: it bounds a half-space. The
    normal is its z axis, from a or towards it, whatever the other geom does, and the gap is the height of the lowest point
    of that one.
    """

    def distance(self, model: Any, data: Any, limit: float) -> float:
        """Signed distance in m, negative when overlapping; ``limit`` if it is larger."""
        shapes = Shape(model, data, self._a), Shape(model, data, self._b)
        return min(separation(*shapes, _of_plane(shapes)), limit)

    def normal(self, model: Any, data: Any, shapes: tuple[Shape, Shape]) -> ContactNormal:  # noqa: ARG002
        """Contact normal at the state of both geoms; see :meth:`NormalSearch.normal`."""
        normal = _of_plane(shapes)
        features = facing(*shapes, normal)
        return ContactNormal(normal, features, 0.5 * (features[0].mean(axis=0) + features[1].mean(axis=0)))


def _of_plane(shapes: tuple[Shape, Shape]) -> FloatArray:
    """Unit normal of a pair of a plane and a geom, from a to b, world axes, (3,)."""
    a, b = shapes
    return np.array(a.axis) if a.is_plane else -b.axis
