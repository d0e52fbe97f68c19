"""Bounds on the speed at which two geoms close: they exclude contact over a time without evaluating the gap."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray

_MARGIN = 1.1
"""Safety factor: rotations and accelerations within a step may exceed what the states at its ends show."""
_INERTIA_ROUNDING = 1e-14
"""Relative error of an eigenvalue of a sum of inertias, against the largest one: about 1e-16, with a margin."""


class MotionBound:
    """Bounds the closing speed of two geoms by their bounding spheres."""

    def __init__(self, model: Any, geoms: tuple[int, int]) -> None:
        """Look up bodies and bounding radii.

        Args:
            model: MuJoCo model.
            geoms: Ids of both geoms.
        """
        self._geoms = [(geom, int(model.geom_bodyid[geom]), float(model.geom_rbound[geom])) for geom in geoms]
        self._roots = [int(model.body_rootid[body]) for _, body, _ in self._geoms]

    def closing_speed(self, data: Any) -> float:
        """Bound on the closing speed for the velocities in ``data``, m/s.

        Relative speed of the centres plus, for each geom, angular speed times bounding radius.
        """
        (geom_1, body_1, radius_1), (geom_2, body_2, radius_2) = self._geoms
        root_1, root_2 = self._roots
        v1, w1 = _centre_motion(data, body_1, root_1, geom_1)
        v2, w2 = _centre_motion(data, body_2, root_2, geom_2)
        return _MARGIN * (math.dist(v1, v2) + w1 * radius_1 + w2 * radius_2)


def speeds_per_root_energy(model: Any, data: Any, geoms: Sequence[tuple[int, int]]) -> FloatArray:
    """Bounds on closing speeds over sqrt(2 T) in any configuration, with the kinetic energy T of the system, (n,), kg^-1/2.

    A rigid group of mass m and least moment of inertia I has |v| <= sqrt(2 T / m) and |w| <= sqrt(2 T / I), and each point
    of a geom is within a known distance of the group's centre of mass. The groups of the two geoms are distinct, so
    T >= T_a + T_b, and by Cauchy and Schwarz the closing speed, at most k_a sqrt(2 T_a) + k_b sqrt(2 T_b), is at most
    hypot(k_a, k_b) sqrt(2 T). Infinite if rounding decides the least moment of inertia.

    Args:
        model: MuJoCo model.
        data: Its data, kinematics current.
        geoms: Ids of the geoms of each pair.
    """
    ids = np.array(geoms, dtype=np.intp).reshape(-1, 2)
    speeds = np.zeros(model.ngeom)
    for geom in set(ids.ravel().tolist()):
        speeds[geom] = _speed_per_root_energy(model, data, geom)
    return np.asarray(np.hypot(*speeds[ids].T))


def _centre_motion(data: Any, body: int, root: int, geom: int) -> tuple[tuple[float, float, float], float]:
    """Velocity of a geom's centre in m/s and its angular speed in rad/s."""
    # cvel is (angular, linear) about the centre of mass of the tree; plain floats are faster than arrays of three.
    wx, wy, wz, vx, vy, vz = data.cvel[body].tolist()
    x, y, z = (data.geom_xpos[geom] - data.subtree_com[root]).tolist()
    velocity = (vx + wy * z - wz * y, vy + wz * x - wx * z, vz + wx * y - wy * x)
    return velocity, math.sqrt(wx * wx + wy * wy + wz * wz)


def _speed_per_root_energy(model: Any, data: Any, geom: int) -> float:
    """Largest speed of a geom's points over sqrt(2 T); infinite if rounding decides the least moment of inertia."""
    if not model.body_weldid[model.geom_bodyid[geom]]:
        return 0.0  # welded to the world
    group = np.flatnonzero(model.body_weldid == model.body_weldid[model.geom_bodyid[geom]])
    masses, centres = model.body_mass[group], data.xipos[group]
    mass = float(masses.sum())
    centre = masses @ centres / mass
    inertia = np.zeros((3, 3))
    for body, m, c in zip(group, masses, centres - centre, strict=True):
        axes = data.ximat[body].reshape(3, 3)
        inertia += axes @ np.diag(model.body_inertia[body]) @ axes.T + m * ((c @ c) * np.eye(3) - np.outer(c, c))
    arm = float(np.linalg.norm(data.geom_xpos[geom] - centre)) + float(model.geom_rbound[geom])
    least, _, greatest = np.linalg.eigvalsh(inertia).tolist()
    return 1.0 / math.sqrt(mass) + arm / math.sqrt(least) if least > _INERTIA_ROUNDING * greatest else math.inf
