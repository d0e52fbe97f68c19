"""Broad phase: which of many pairs may be close, by the bounding spheres of their geoms; joint limits are exact.

A plane is a half-space: the sphere of the other geom is over it by the height of its centre less its radius.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from ffsm_mj._core.gap_bounds import SphereBounds
from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.joint_limit import LimitCoordinates
from ffsm_mj.contact.pairs import UnilateralConstraint, by_kind
from ffsm_mj.tolerances import DISTANCE_QUERY_M

FEW = 16
"""Up to so many pairs are queried one by one: that takes less time than arrays of spheres."""
_NEAR_LIMIT_M = 1e-3
"""Limit of distance queries that look for near pairs only: a small limit ends a query early."""


class BroadPhase:
    """Lower bounds on the gaps of many pairs, and the gaps of joint limits.

    Attributes:
        pairs: Pairs, then joint limits.
        radii: Sum of the radii of the bounding spheres of both geoms of each pair, m, (n,); -inf for joint limits, whose
            gaps are exact.
    """

    def __init__(self, model: Any, pairs: Sequence[UnilateralConstraint]) -> None:
        """Look up the geoms and joints.

        Args:
            model: MuJoCo model.
            pairs: Pairs, then joint limits.
        """
        self.pairs, self._model = tuple(pairs), model
        geoms, limits = by_kind(pairs)
        ids = np.array([pair.ids for pair in geoms], dtype=np.intp).reshape(-1, 2)
        on_a, on_b = (model.geom_type[ids] == int(mujoco.mjtGeom.mjGEOM_PLANE)).T
        self._coordinates = LimitCoordinates(limits)
        self._signs, self._limits = np.array([(limit.sign, limit.limit) for limit in limits]).reshape(-1, 2).T
        spheres = np.array([sum(pair.radii) for pair in geoms], dtype=np.float64)
        a, b = np.ascontiguousarray(ids.T)
        self._spheres = SphereBounds(a, b, spheres, np.where(on_a, -1.0, 1.0 * on_b))
        self.radii: FloatArray = np.concatenate((spheres, np.full(len(limits), -np.inf)))

    def gaps(self, data: Any) -> FloatArray:
        """Distances between the spheres and from the limits at the state in ``data``, m or rad, (n,): no gap is smaller."""
        spheres = self._spheres.gaps(data)
        if not len(self._limits):
            return spheres
        return np.concatenate((spheres, self._signs * (self._coordinates.at(data) - self._limits)))

    def within(self, data: Any, distance: float) -> Sequence[int]:
        """Indices of the pairs whose gap may be at most a distance in m."""
        if len(self.pairs) <= FEW:
            return range(len(self.pairs))
        near: list[int] = np.flatnonzero(self.gaps(data) <= distance).tolist()
        return near

    def near(self, data: Any) -> list[int]:
        """Indices of the pairs that are so close that their gap must be evaluated on the support functions."""
        model = self._model
        return [
            i for i in self.within(data, _NEAR_LIMIT_M) if self.pairs[i].gap(model, data, _NEAR_LIMIT_M) <= DISTANCE_QUERY_M
        ]
