"""Distances of geoms of different models by MuJoCo's own query, without any contact pair of ours.

``mj_geomDistance`` is accurate to 1e-7 m where round geoms touch. A pair that it finds closer than 1e-6 m is decided by
support functions: the separation along any unit vector n, min over b of n . x - max over a of n . x, is a lower bound of the
signed distance of two convex geoms, so one direction along which they are apart proves that they do not overlap. The
directions that are tried come from queries with one geom moved away along the direction before.
"""

from __future__ import annotations

from itertools import combinations
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

_BROAD_M, _NEAR_M = 1e-3, 1e-6
_SHIFTS_M = (1.0, 0.3, 0.1, 0.03, 0.01, 0.01, 0.01, 3e-3, 1e-3, 1e-3, 1e-4, 1e-4, 1e-5, 1e-5, 1e-6, 1e-7)
_GEOM = mujoco.mjtGeom


class Deepest(NamedTuple):
    """Greatest overlap of some pairs.

    Attributes:
        overlap_m: The overlap, m; 0 without.
        pair: Ids of the geoms; empty without.
        near: Number of pairs closer than 1e-6 m, which were decided by support functions.
    """

    overlap_m: float
    pair: tuple[int, ...]
    near: int


class Distances:
    """All pairs of collision geoms of different free trees of a model.

    Attributes:
        pairs: Ids of the geoms of each pair.
    """

    def __init__(self, model: Any) -> None:
        """List the pairs that MuJoCo would collide."""
        self._model = model
        root, bits = model.body_rootid[model.geom_bodyid], (model.geom_contype, model.geom_conaffinity)
        self.pairs = [
            (a, b)
            for a, b in combinations(range(model.ngeom), 2)
            if root[a] != root[b] and ((bits[0][a] & bits[1][b]) or (bits[0][b] & bits[1][a]))
        ]
        self._a, self._b = np.array(self.pairs).T
        self._reach = model.geom_rbound[self._a] + model.geom_rbound[self._b]

    def smallest(self, data: Any) -> float:
        """Smallest distance as MuJoCo finds it, m; kinematics current."""
        return min(mujoco.mj_geomDistance(self._model, data, a, b, 20.0, None) for a, b in self.pairs)

    def deepest(self, data: Any) -> Deepest:
        """Greatest overlap of all pairs; kinematics current."""
        apart = np.linalg.norm(data.geom_xpos[self._a] - data.geom_xpos[self._b], axis=1) - self._reach
        found = Deepest(0.0, (), 0)
        for k in np.flatnonzero(apart < _BROAD_M):
            pair = self.pairs[k]
            if mujoco.mj_geomDistance(self._model, data, *pair, 0.1, None) < _NEAR_M:
                overlap = -self._separation(data, pair)
                deeper = overlap > found.overlap_m
                found = Deepest(overlap if deeper else found.overlap_m, pair if deeper else found.pair, found.near + 1)
        return found

    def _separation(self, data: Any, pair: tuple[int, int]) -> float:
        """Largest separation in m along the directions that queries with one geom moved away give."""
        a, b = pair
        place, fromto, best = data.geom_xpos[b].copy(), np.zeros(6), -np.inf
        way = place - data.geom_xpos[a]
        # From far along the line of centres, where the two are apart, towards the contact.
        for shift in _SHIFTS_M:
            data.geom_xpos[b] = place + shift * way / np.linalg.norm(way)
            distance = mujoco.mj_geomDistance(self._model, data, a, b, 10.0, fromto)
            data.geom_xpos[b] = place
            if distance > 0.0:
                way = fromto[3:] - fromto[:3]
                best = max(best, self._along(data, pair, way / np.linalg.norm(way)))
        return best

    def _along(self, data: Any, pair: tuple[int, int], way: Vector) -> float:
        a, b = pair
        return -_support(self._model, data, b, -way) - _support(self._model, data, a, way)


def _support(model: Any, data: Any, geom: int, way: Vector) -> float:
    """Support function max of n . x over a geom."""
    axes, size, kind = data.geom_xmat[geom].reshape(3, 3), model.geom_size[geom], model.geom_type[geom]
    local, middle = axes.T @ way, float(data.geom_xpos[geom] @ way)
    if kind == _GEOM.mjGEOM_SPHERE:
        return middle + float(size[0])
    if kind == _GEOM.mjGEOM_CAPSULE:
        return middle + float(size[0] + size[1] * abs(local[2]))
    if kind == _GEOM.mjGEOM_CYLINDER:
        return middle + float(size[0] * np.hypot(local[0], local[1]) + size[1] * abs(local[2]))
    if kind == _GEOM.mjGEOM_ELLIPSOID:
        return middle + float(np.linalg.norm(size * local))
    if kind == _GEOM.mjGEOM_BOX:
        return middle + float(size @ np.abs(local))
    assert kind == _GEOM.mjGEOM_MESH
    mesh = model.geom_dataid[geom]
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    return middle + float((model.mesh_vert[first : first + count] @ local).max())
