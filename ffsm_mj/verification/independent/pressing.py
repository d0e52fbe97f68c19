"""Acceleration that presses a single contact together right after a plastic impact, from MuJoCo's distances alone.

The rest rule compares it with the speed of separation. Here it is minus the second difference of the distance of both geoms
along the motion that follows: q(t) = q + v t + a t^2 / 2, with the velocities v after the impact if it were plastic, and the
accelerations a that all forces but those of contacts give there.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_mj.verification.independent.accelerations import forces_known
from ffsm_mj.verification.independent.finding import Array
from ffsm_mj.verification.independent.logged_rows import LoggedRows
from ffsm_mj.verification.independent.scene import LoggedScene

_TRAVEL_M = 1e-3
"""Length that the relative motion of both geoms covers between the distances of a second difference."""
_LONGEST_S = 0.02
"""Longest time between them."""
_APART_M = 1e-4
"""The geoms are moved apart by this along the normal: distances of geoms that overlap are less exact."""
_DISTANCE_M = 1e-9
"""What a distance may be wrong by: 1e-12 m for round geoms, a few 1e-10 m for ellipsoids and meshes."""

_SMOOTH = 0.2
"""Share by which second differences over a step and over half of it may differ: at most 1e-3 m is moved, and curvatures of
smooth surfaces of 1e-2 m and more change by a tenth."""


class Pressing(NamedTuple):
    """Bounds on the acceleration that presses a contact, m/s^2."""

    least: float
    most: float


def pressing(scene: LoggedScene, rows: LoggedRows, record: Any, unsure: float) -> Pressing | None:
    """Bounds on the acceleration that presses the contact of a record; None if it is not known.

    Args:
        scene: Models of the log; no grasp is closed.
        rows: Rows of the log.
        record: Record of an impact of one contact without friction.
        unsure: Relative width of the bounds, beside the errors of distances.
    """
    model, data = scene.model, scene.data
    before = dict(rows.kept.before.kept).get(record.time_s, -1)
    efforts = rows.efforts_after(scene, before, record.time_s)
    if efforts is None or not forces_known(scene):
        return None
    scene.put(record.qpos, scene.rates(record.qvel_before), efforts, record.time_s)
    geoms = [int(model.geom(name).id) for name in record.geoms]
    normal, point = np.array(record.normal), np.array(record.point_m)
    ways = [scene.body_rows(int(model.geom_bodyid[geom]), point)[:3] for geom in geoms]
    along = normal @ (ways[1] - ways[0])
    answer = np.linalg.solve(scene.mass_matrix(), along)
    plastic = data.qvel - answer * (along @ data.qvel) / (along @ answer)
    scene.put(record.qpos, plastic, efforts, record.time_s)
    acceleration = np.linalg.solve(scene.mass_matrix(), scene.free_force())
    speed = max(float(np.linalg.norm(way @ plastic)) for way in ways) + float(np.abs(plastic).max(initial=0.0))
    step = min(_LONGEST_S, _TRAVEL_M / max(speed, 1e-12))
    here, *away = (
        _distance(scene, np.array(record.qpos), plastic * t + 0.5 * acceleration * t * t, geoms, normal)
        for t in (0.0, -step, step, -0.5 * step, 0.5 * step)
    )
    found, nearer = -(away[0] - 2.0 * here + away[1]) / step**2, -4.0 * (away[2] - 2.0 * here + away[3]) / step**2
    error = unsure * abs(found) + 16.0 * _DISTANCE_M / step**2
    # Where another vertex or edge is the nearest one on the way, the distance has a kink: second differences over a step and
    # over half of it differ, or what happens before and after is not alike, as it is to third order at rest.
    uneven = max(abs(away[1] - away[0]), 4.0 * abs(away[3] - away[2])) / step**2
    if max(abs(found - nearer), uneven) > _SMOOTH * abs(found) + 5.0 * error:
        return None
    limit, error = (4.0 * nearer - found) / 3.0, error + abs(found - nearer)
    return Pressing(limit - error, limit + error)


def _distance(scene: LoggedScene, qpos: Array, change: Array, geoms: list[int], normal: Array) -> float:
    """Distance of two geoms after a change of the coordinates, the second moved along the normal, m."""
    model, data = scene.model, scene.data
    mujoco.mj_integratePos(model, qpos, change, 1.0)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    data.geom_xpos[geoms[1]] += _APART_M * normal
    return float(mujoco.mj_geomDistance(model, data, geoms[0], geoms[1], 10.0 * _APART_M + _TRAVEL_M, None))
