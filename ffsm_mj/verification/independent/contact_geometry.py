"""Normals and points of impacts, from MuJoCo's distances alone.

Two convex bodies touch with the normal n if and only if the second, moved by d along n, is at a distance d, and the points
that touched are the nearest ones: planes across n keep the two apart, at any d.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from ffsm_mj.verification.independent.finding import Finding, Worst
from ffsm_mj.verification.independent.kept_rows import MOST
from ffsm_mj.verification.independent.scene import LoggedScene
from ffsm_mj.verification.independent.tolerances import CONTACT_GEOMETRY, TOLERANCES

_APART_M = (0.1, 0.07, 0.13, 0.05, 0.2, 0.09, 0.16)
"""Distances to which the geoms are moved apart: lengths over them are angles.

The nearest points are the same at each. Along directions in which two bodies hardly curve, as along two sides at a small
angle, those of MuJoCo scatter by up to a millimetre: the best of them counts.
"""


def contact_geometry(scene: LoggedScene) -> list[Finding]:
    """Worst difference of the normals and points of impacts from those of the geoms moved apart, rad."""
    worst = Worst(CONTACT_GEOMETRY)
    impacts = [record for record in scene.log.impact_records if not hasattr(record, "joint")]
    for record in impacts[:: 1 + len(impacts) // MOST]:
        worst.add(f"impact {record.event + 1}", _miss(scene, record), 0.0, record.time_s, "rad")
    return worst.found


def _miss(scene: LoggedScene, record: Any) -> tuple[float, float]:
    """Angle of the normal to the line between the nearest points, and that of the contact point beside it."""
    data, second = scene.data, int(scene.model.geom(record.geoms[1]).id)
    scene.put(record.qpos, np.zeros(scene.model.nv))
    place, misses = data.geom_xpos[second].copy(), []
    for apart_m in _APART_M:
        data.geom_xpos[second] = place + apart_m * np.array(record.normal)
        misses.append(_miss_at(scene, record, apart_m))
        if max(misses[-1]) <= TOLERANCES[CONTACT_GEOMETRY]:
            break
    between, beside = zip(*misses, strict=True)
    return min(between), min(beside)


def _miss_at(scene: LoggedScene, record: Any, apart_m: float) -> tuple[float, float]:
    """The same with the geoms at a distance in m."""
    normal, point, nearest = np.array(record.normal), np.array(record.point_m), np.empty(6)
    first, second = (int(scene.model.geom(name).id) for name in record.geoms)
    mujoco.mj_geomDistance(scene.model, scene.data, first, second, 2.0 * apart_m, nearest)
    between, beside = nearest[3:] - nearest[:3] - apart_m * normal, point - nearest[:3]
    # Of several points of a face the nearest one is any: all are in the plane across the normal.
    away = np.linalg.norm(beside) if record.manifold == "point" else abs(beside @ normal)
    return float(np.linalg.norm(between)) / apart_m, float(away) / apart_m
