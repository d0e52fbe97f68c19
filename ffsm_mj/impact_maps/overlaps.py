"""Overlaps of geoms at a configuration, which would make it impossible."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.watch import ContactWatch
from ffsm_mj.impact_maps.target import Target

_FAR_M = 10.0
"""Distances are computed up to this."""

Geoms = tuple[int, int]


class Overlaps:
    """Overlaps of any two geoms that can collide, but the pair in contact and what the scenario ignores."""

    def __init__(self, target: Target) -> None:
        """Build data of its own."""
        self._model, self._data = target.system.mj, target.data()
        self._watch = ContactWatch(self._model, self._data, target.ignored | {target.pair.geom_ids})

    def at(self, qpos: FloatArray) -> dict[Geoms, float]:
        """Depth of each overlap at a configuration in m, the deepest first."""
        self._place(qpos)
        self._watch.look(0.0)
        found = {
            tuple(self._model.geom(name).id for name in each.geoms): each.max_depth_m for each in self._watch.finish(0.0)
        }
        return {(a, b): found[a, b] for a, b in sorted(found, key=lambda pair: -found[pair])}

    def names(self, geoms: Geoms) -> str:
        """Two geoms as text."""
        return " and ".join(sorted(self._model.geom(geom).name for geom in geoms))

    def distances(self, qpos: FloatArray, pairs: Sequence[Geoms]) -> FloatArray:
        """Signed distance of each pair at a configuration, m."""
        self._place(qpos)
        return np.array([mujoco.mj_geomDistance(self._model, self._data, a, b, _FAR_M, None) for a, b in pairs])

    def _place(self, qpos: FloatArray) -> None:
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
