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
from ffsm_mj.verification.independent.tolerances import CONTACT_GEOMETRY

_APART_M = 0.1
"""Distance to which the geoms are moved apart: lengths over it are angles."""


def contact_geometry(scene: LoggedScene) -> list[Finding]:
    """Worst difference of the normals and points of impacts from those of the geoms moved apart, rad."""
    worst = Worst(CONTACT_GEOMETRY)
    impacts = [record for record in scene.log.impact_records if not hasattr(record, "joint")]
    for record in impacts[:: 1 + len(impacts) // MOST]:
        worst.add(f"impact {record.event + 1}", _miss(scene, record), 0.0, record.time_s, "rad")
    return worst.found


def _miss(scene: LoggedScene, record: Any) -> tuple[float, float]:
    """Angle of the normal to the line between the nearest points, and that of the contact point beside it."""
    model, data = scene.model, scene.data
    normal, point, nearest = np.array(record.normal), np.array(record.point_m), np.empty(6)
    scene.put(record.qpos, np.zeros(model.nv))
    first, second = (int(model.geom(name).id) for name in record.geoms)
    data.geom_xpos[second] += _APART_M * normal
    mujoco.mj_geomDistance(model, data, first, second, 2.0 * _APART_M, nearest)
    between, beside = nearest[3:] - nearest[:3] - _APART_M * normal, point - nearest[:3]
    # Of several points of a face the nearest one is any: all are in the plane across the normal.
    away = np.linalg.norm(beside) if record.manifold == "point" else abs(beside @ normal)
    return float(np.linalg.norm(between)) / _APART_M, float(away) / _APART_M
