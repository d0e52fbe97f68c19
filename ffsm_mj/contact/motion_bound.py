"""Bounds on motion, which exclude contact over a time: by closing speeds, by the travel of joints, by kinetic energy.

Bounds on how far joint motion moves two geoms towards each other.

The point of a geom that is farthest from a hinge moves by at most its distance from the hinge times the angle. That distance
has a bound in all configurations: the sum of the offsets along the kinematic chain. It is constant unless the chain has a
slide joint beyond the hinge, whose displacement lengthens it; such a bound holds up to a stated displacement.

Bound on the rate of a hinge or slide joint by the kinetic energy of the system, in any configuration.

The joint connects two rigid groups, a and b, of mass m and inertia I about their centres of mass. A generalised force on the
joint acts on them as a couple along the hinge axis n, or as a pair of forces along the line of a slide. Any further
constraint only reduces the response, so that of the two free groups bounds it:

    hinge:  (M^-1)_jj <= n . (I_a^-1 + I_b^-1) n
    slide:  (M^-1)_jj <= 1 / m_a + 1 / m_b + (r x n) . I_a^-1 (r x n),   r from the centre of a to that of b

If the joint is the only one between the two, n is fixed in both groups, and r x n does not change as b slides along n: the
bound holds in every configuration. Then |rate| <= sqrt((M^-1)_jj) sqrt(2 T).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Protocol

import mujoco
import numpy as np
import numpy.typing as npt

from ffsm_mj.arrays import FloatArray

_SPHERE, _CAPSULE, _CYLINDER = map(
    int, (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER)
)
_MARGIN = 1.1
"""Safety factor: rotations and accelerations within a step may exceed what the states at its ends show."""
_INERTIA_ROUNDING = 1e-14
"""Relative error of an eigenvalue of a sum of inertias, against the largest one: about 1e-16, with a margin."""


class MotionBound:
    """Bounds the closing speed of two geoms by their bounding spheres and axes of symmetry."""

    def __init__(self, model: Any, geoms: tuple[int, int]) -> None:
        """Look up bodies and bounding radii.

        Args:
            model: MuJoCo model.
            geoms: Ids of both geoms.
        """
        self._geoms = [(geom, int(model.geom_bodyid[geom]), _reach(model, geom)) for geom in geoms]
        self._roots = [int(model.body_rootid[body]) for _, body, _ in self._geoms]
        self._are_round = [int(model.geom_type[geom]) in (_CAPSULE, _CYLINDER) for geom in geoms]

    def closing_speed(self, data: Any) -> float:
        """Bound on the closing speed for the velocities in ``data``, m/s.

        Relative speed of the centres plus, for each geom, angular speed times reach. Turning about an axis of symmetry does
        not move a geom.
        """
        (geom_1, body_1, reach_1), (geom_2, body_2, reach_2) = self._geoms
        (root_1, root_2), (is_round_1, is_round_2) = self._roots, self._are_round
        v1, w1 = _centre_motion(data, body_1, root_1, geom_1, is_round=is_round_1)
        v2, w2 = _centre_motion(data, body_2, root_2, geom_2, is_round=is_round_2)
        return _MARGIN * (math.dist(v1, v2) + w1 * reach_1 + w2 * reach_2)


def _reach(model: Any, geom: int) -> float:
    """Greatest distance from the centre of a geom at which turning moves its surface along the normal, m.

    The surface of a sphere or capsule is at one distance from its middle or axis, along the normal.
    """
    kind = int(model.geom_type[geom])
    return 0.0 if kind == _SPHERE else float(model.geom_size[geom, 1] if kind == _CAPSULE else model.geom_rbound[geom])


class Sized(Protocol):
    """A pair of bodies whose bounding spheres are about the centres of two geoms."""

    @property
    def ids(self) -> tuple[int, int]:
        """Ids of both geoms."""
        ...

    @property
    def radii(self) -> tuple[float, float]:
        """Radii of the spheres around them that contain all that can touch, m."""
        ...


def speeds_per_root_energy(model: Any, data: Any, pairs: Sequence[Sized]) -> FloatArray:
    """Bounds on closing speeds over sqrt(2 T) in any configuration, with the kinetic energy T of the system, (n,), kg^-1/2.

    A rigid group of mass m and least moment of inertia I has |v| <= sqrt(2 T / m) and |w| <= sqrt(2 T / I), and each point
    of a geom is within a known distance of the group's centre of mass. The groups of the two geoms are distinct, so
    T >= T_a + T_b, and by Cauchy and Schwarz the closing speed, at most k_a sqrt(2 T_a) + k_b sqrt(2 T_b), is at most
    hypot(k_a, k_b) sqrt(2 T). Infinite if rounding decides the least moment of inertia.

    Args:
        model: MuJoCo model.
        data: Its data, kinematics current.
        pairs: The pairs.
    """
    known: dict[tuple[int, float], float] = {}
    for sphere in {sphere for pair in pairs for sphere in zip(pair.ids, pair.radii, strict=True)}:
        known[sphere] = _speed_per_root_energy(model, data, *sphere)
    speeds = [[known[sphere] for sphere in zip(pair.ids, pair.radii, strict=True)] for pair in pairs]
    return np.asarray(np.hypot(*np.array(speeds).reshape(-1, 2).T))


def _centre_motion(
    data: Any, body: int, root: int, geom: int, *, is_round: bool
) -> tuple[tuple[float, float, float], float]:
    """Velocity of a geom's centre in m/s, and its angular speed in rad/s: of round ones, that of their z axis."""
    # cvel is (angular, linear) about the centre of mass of the tree; plain floats are faster than arrays of three.
    wx, wy, wz, vx, vy, vz = data.cvel[body].tolist()
    x, y, z = (data.geom_xpos[geom] - data.subtree_com[root]).tolist()
    velocity = (vx + wy * z - wz * y, vy + wz * x - wx * z, vz + wx * y - wy * x)
    if is_round:
        x, y, z = data.geom_xmat[geom, 2::3].tolist()
        wx, wy, wz = wy * z - wz * y, wz * x - wx * z, wx * y - wy * x
    return velocity, math.sqrt(wx * wx + wy * wy + wz * wz)


def _speed_per_root_energy(model: Any, data: Any, geom: int, radius: float) -> float:
    """Largest speed of a geom's points over sqrt(2 T); infinite if rounding decides the least moment of inertia."""
    mass, centre, inertia = _group(model, data, int(model.geom_bodyid[geom]))
    if inertia is None:
        return 0.0  # welded to the world
    arm = float(np.linalg.norm(data.geom_xpos[geom] - centre)) + radius
    least, _, greatest = np.linalg.eigvalsh(inertia).tolist()
    return 1.0 / math.sqrt(mass) + arm / math.sqrt(least) if least > _INERTIA_ROUNDING * greatest else math.inf


_SLIDE, _FREE = int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_FREE)
_DOFS = {_FREE: 6, int(mujoco.mjtJoint.mjJNT_BALL): 3, _SLIDE: 1, int(mujoco.mjtJoint.mjJNT_HINGE): 1}
_SLIDE_ALLOWANCE_M = 0.5
"""Displacement of a slide joint beyond its present one for which the bounds hold."""


class TravelBound:
    """Bounds on the closing of pairs of geoms per unit of motion of each degree of freedom.

    Attributes:
        rows: Largest closing of each pair per m or rad of motion of each degree of freedom, (n, nv).
        slides: Degrees of freedom of slide joints that lengthen a lever arm, (k,).
    """

    def __init__(self, model: Any, qpos: FloatArray, pairs: Sequence[Sized]) -> None:
        """Compute the bounds.

        Args:
            model: MuJoCo model.
            qpos: Configuration from which displacements of slide joints are measured.
            pairs: The pairs.
        """
        self._model = model
        ids = np.array([pair.ids for pair in pairs], dtype=np.intp).reshape(-1, 2)
        chains = [_chain(model, int(body)) for body in range(model.nbody)]
        used = sorted({int(model.geom_bodyid[g]) for g in ids.ravel()})
        levers = {joint for body in used for joint in _lengthening(model, chains[body])}
        self._joints = np.array(sorted(levers), dtype=np.intp)
        self.slides: npt.NDArray[np.intp] = np.asarray(model.jnt_dofadr[self._joints], dtype=np.intp)
        self._lengths = np.zeros(model.njnt)
        slides = np.flatnonzero(model.jnt_type == _SLIDE)
        self._lengths[slides] = np.abs(qpos[model.jnt_qposadr[slides]]) + _SLIDE_ALLOWANCE_M
        arms = {sphere: np.zeros(model.nv) for pair in pairs for sphere in zip(pair.ids, pair.radii, strict=True)}
        for (geom, radius), row in arms.items():
            self._add_arms(row, geom, radius, chains[int(model.geom_bodyid[geom])])
        first, second = (
            np.array([arms[pair.ids[k], pair.radii[k]] for pair in pairs]).reshape(-1, model.nv) for k in (0, 1)
        )
        # A degree of freedom that moves both geoms moves them as one rigid body: it does not change their distance.
        self.rows: FloatArray = np.where((first > 0.0) & (second > 0.0), 0.0, first + second)

    def slide_allowance(self, qpos: FloatArray) -> FloatArray:
        """Displacement of each slide joint of ``slides`` for which the bounds still hold, m, (k,)."""
        return np.asarray(self._lengths[self._joints] - np.abs(qpos[self._model.jnt_qposadr[self._joints]]))

    def _add_arms(self, arms: FloatArray, geom: int, radius: float, chain: Sequence[int]) -> None:
        """Set the lever arms of a sphere around a geom, walking from its body to the root."""
        model = self._model
        length = float(np.linalg.norm(model.geom_pos[geom]) + radius)
        for body in reversed(chain):
            first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
            for joint in reversed(range(first, first + count)):
                kind, dof = int(model.jnt_type[joint]), int(model.jnt_dofadr[joint])
                offset = float(np.linalg.norm(model.jnt_pos[joint]))
                arms[dof : dof + _DOFS[kind]] = length + offset
                if kind == _SLIDE:
                    arms[dof] = 1.0
                    length += float(self._lengths[joint])
                elif kind == _FREE:
                    arms[dof : dof + 3] = 1.0
                else:
                    length += 2.0 * offset  # the body's origin circles the anchor
            length += float(np.linalg.norm(model.body_pos[body]))


def _chain(model: Any, body: int) -> list[int]:
    """Bodies from the root to a body, without the world."""
    chain: list[int] = []
    while body:
        chain.insert(0, body)
        body = int(model.body_parentid[body])
    return chain


def _lengthening(model: Any, chain: Sequence[int]) -> list[int]:
    """Slide joints of a chain that follow a joint that rotates."""
    shifts, rotates = [], False
    for body in chain:
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        for joint in range(first, first + count):
            if int(model.jnt_type[joint]) != _SLIDE:
                rotates = True
            elif rotates:
                shifts.append(joint)
    return shifts


def rate_per_root_energy(model: Any, data: Any, joint: int) -> float:
    """Bound on |rate| / sqrt(2 T) of a hinge or slide joint; infinite if no energy bounds the rate.

    Args:
        model: MuJoCo model.
        data: Its data, positions current.
        joint: Id of the joint.
    """
    body, armature = int(model.jnt_bodyid[joint]), float(model.dof_armature[model.jnt_dofadr[joint]])
    response = _free_response(model, data, joint) if model.body_jntnum[body] == 1 else math.inf
    # The armature is an inertia of its own that turns with the joint: the kinetic energies add.
    inertia = armature + (1.0 / response if response > 0.0 else math.inf)
    return 1.0 / math.sqrt(inertia) if inertia > 0.0 else math.inf


def _free_response(model: Any, data: Any, joint: int) -> float:
    """Bound on (M^-1)_jj without armature, 1/(kg m^2) or 1/kg; infinite if rounding decides a moment of inertia."""
    body, axis = int(model.jnt_bodyid[joint]), data.xaxis[joint]
    groups = [_group(model, data, int(one)) for one in (model.body_parentid[body], body)]
    if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE:
        return sum(_compliance(inertia, axis) for _, _, inertia in groups)
    (mass_a, centre_a, inertia_a), (mass_b, centre_b, _) = groups
    return 1.0 / mass_a + 1.0 / mass_b + _compliance(inertia_a, np.cross(centre_b - centre_a, axis))


def _group(model: Any, data: Any, body: int) -> tuple[float, FloatArray, FloatArray | None]:
    """Mass, centre of mass and inertia of the bodies welded to a body, world axes; infinite and None for the world."""
    weld = model.body_weldid[body]
    if not weld:
        return math.inf, np.zeros(3), None
    members = np.flatnonzero(model.body_weldid == weld)
    masses, centres = model.body_mass[members], data.xipos[members]
    mass = float(masses.sum())
    centre = masses @ centres / mass
    inertia = np.zeros((3, 3))
    for member, m, c in zip(members, masses, centres - centre, strict=True):
        axes = data.ximat[member].reshape(3, 3)
        inertia += axes @ np.diag(model.body_inertia[member]) @ axes.T + m * ((c @ c) * np.eye(3) - np.outer(c, c))
    return mass, centre, inertia


def _compliance(inertia: FloatArray | None, couple: FloatArray) -> float:
    """Angular acceleration along a couple per unit couple, times its square; infinite where rounding decides it."""
    if inertia is None:
        return 0.0
    sizes, axes = np.linalg.eigh(inertia)
    along = axes.T @ couple
    if not sizes[0] > _INERTIA_ROUNDING * sizes[-1]:
        return math.inf
    return float(np.sum(along * along / sizes))
