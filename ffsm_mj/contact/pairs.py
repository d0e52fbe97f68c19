"""Pairs of geoms that may touch: signed gap, normal, contact point and how fast the gap can close.

MuJoCo's contacts are off; ``mj_geomDistance`` is asked for each pair. Its witness direction is meaningless at touch, so a
normal starts from a shifted query (one geom moved away along the estimate, asked again, a few passes) and is then
polished on the geoms' support functions, which also give the gap to rounding.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.caps import lowest_of_rims
from ffsm_mj.contact.manifold import facing, opposite, touching_set
from ffsm_mj.contact.normal import is_normal, polished, separation
from ffsm_mj.contact.second_rate import SecondRate, second_rate
from ffsm_mj.contact.shape import Shape, vagueness
from ffsm_mj.model.system import System
from ffsm_mj.tolerances import CLEARLY_APART_M, CONTACT_GAP_M, EPSILON, RATE

_UNSUPPORTED = {
    int(mujoco.mjtGeom.mjGEOM_PLANE): "plane",
    int(mujoco.mjtGeom.mjGEOM_HFIELD): "height field",
    int(mujoco.mjtGeom.mjGEOM_SDF): "signed distance field",
}
# A gap is below zero where it is so many times its rounding below; there, rates are told from zero more finely.
_FALLEN, _EXACT = 1e3, 1e-3
_ROUNDING = 1e-14
FAR = 1e3
"""Gaps are not told apart beyond this, m."""
# Passes of the shifted query, each leaving shift / (shift + radius of curvature) of the error, until it is this small.
_PASSES, _SETTLED = 20, 1e-5
# Its stand-off, as a share of the pair's size (half the thinnest extent), and in m at most.
_SHARE, _SHIFT = 0.2, 1e-2
# The least stand-off, m: there MuJoCo's witnesses, good to some 1e-15, give a direction within the reach of the polish.
_NEAREST = 1e-9
# Rotations and accelerations inside a step may exceed what its ends show; the bound keeps this margin.
_BOUND_MARGIN = 1.1
# Relative error of an eigenvalue of a sum of inertias, against the greatest: some 1e-16, with room.
_INERTIA_ROUNDING = 1e-14


@dataclass(frozen=True)
class Proximity:
    """A pair at one instant, in world axes.

    Attributes:
        gap: Signed distance in m, negative when overlapping.
        normal: Unit normal from a to b, (3,).
        points: Where they touch, or would: one point, or the extreme points of an edge or a face, (k, 3).
        rates: Rate of the gap at each point in m/s, negative when approaching, (k,).
        still: Rates within this of zero in m/s are rounding: neither approaching nor separating.
        rounding: Gaps within this of each other in m are the same.
    """

    gap: float
    normal: FloatArray
    points: FloatArray
    rates: FloatArray
    still: float
    rounding: float

    @property
    def rate(self) -> float:
        """Rate at the point that approaches most."""
        return float(self.rates.min())

    @property
    def approaches(self) -> bool:
        """Whether the gap closes: by more than rounding, or at all where it has fallen below zero by much more than that."""
        return self.rate < (-self.still if self.gap > -_FALLEN * self.rounding else -_EXACT * self.still)


class ContactPair:
    """Two geoms, a and b, on bodies that move against each other: of the robot, of objects, of one of them itself.

    One of them may be on a fixed object.

    Attributes:
        name: What it is called, unique among the pairs of a run.
        geom_a: Full name of the geom that the normal points away from.
        geom_b: Full name of the geom that the normal points to.
        body_a: Id of the body of a.
        body_b: Id of the body of b.
        robot_on_object: Whether a is the robot's and b an object's, floating or fixed.
        restitution: Coefficient e of this pair.
        mu: Coefficient of friction of this pair.
        geom_ids: Ids of both geoms.
        vague: How well the places of the points of both are known, m: 0 but for meshes.
        size: Length in m below which the pair's gap is a simple function of time (half the thinnest extent).
    """

    def __init__(self, system: System, name: str, geom_a: str, geom_b: str, restitution: float, mu: float = 0.0) -> None:
        """Resolve names and constants.

        Raises:
            LookupError: An unknown geom, one of the bare world, two that do not move against each other, or a shape without
                an exact distance.
        """
        model = system.mj
        self._g1, self._g2 = system.index("geom", geom_a), system.index("geom", geom_b)
        self.name, self.geom_a, self.geom_b = name, model.geom(self._g1).name, model.geom(self._g2).name
        self.body_a, self.body_b = int(model.geom_bodyid[self._g1]), int(model.geom_bodyid[self._g2])
        self.geom_ids = frozenset((self._g1, self._g2))
        self._kinds = {int(model.geom_type[g]) for g in self.geom_ids}
        self._check(system)
        on_robot = [body in system.robot.bodies for body in (self.body_a, self.body_b)]
        self.robot_on_object = on_robot == [True, False]
        self.restitution, self.mu = restitution, mu
        self.size = 0.5 * float(min(model.geom_aabb[self._g1, 3:].min(), model.geom_aabb[self._g2, 3:].min()))
        self._r1, self._r2 = float(model.geom_rbound[self._g1]), float(model.geom_rbound[self._g2])
        self.vague = vagueness(model, self._g1) + vagueness(model, self._g2)
        self._root1, self._root2 = int(model.body_rootid[self.body_a]), int(model.body_rootid[self.body_b])
        self._fromto = np.zeros(6)
        self._normal: FloatArray | None = None

    def _check(self, system: System) -> None:
        model = system.mj
        for geom, name, body in ((self._g1, self.geom_a, self.body_a), (self._g2, self.geom_b, self.body_b)):
            shape = _UNSUPPORTED.get(int(model.geom_type[geom]))
            if shape:
                raise LookupError(f"geom {name!r} is a {shape}: impacts need convex geoms (sphere, capsule, box, ...)")
            if system.tree_of_body(body) is None and body not in system.fixed_bodies:
                raise LookupError(f"geom {name!r} is fixed to the world: let it be of an object with 'fixed: true'")
        if system.fixed_bodies.issuperset((self.body_a, self.body_b)):
            raise LookupError(f"geoms {self.geom_a!r} and {self.geom_b!r} are both fixed: they cannot meet")
        if model.body_weldid[self.body_a] == model.body_weldid[self.body_b]:
            raise LookupError(f"geoms {self.geom_a!r} and {self.geom_b!r} are on one rigid body: they cannot meet")

    @property
    def geoms(self) -> tuple[str, str]:
        """Full names of a and b."""
        return self.geom_a, self.geom_b

    @property
    def ids(self) -> tuple[int, int]:
        """Ids of geoms a and b."""
        return self._g1, self._g2

    def is_of(self, kind: mujoco.mjtGeom) -> bool:
        """Whether one of the geoms is of a kind."""
        return int(kind) in self._kinds

    def __str__(self) -> str:
        """Both geoms, for messages."""
        return f"{self.geom_a} - {self.geom_b}"

    def gap(self, model: Any, data: Any, limit: float) -> float:
        """Signed distance in m, negative when overlapping; ``limit`` where it is larger than that."""
        return self._distance(model, data, limit)

    def _distance(self, model: Any, data: Any, limit: float) -> float:
        """The query, and its witnesses in ``_fromto`` where it is below ``limit``.

        Of faces that just touch it gives, once in some hundred poses, centimetres of distance with witnesses at one point.
        """
        distance = float(mujoco.mj_geomDistance(model, data, self._g1, self._g2, limit, self._fromto))
        if 0.0 < distance < limit:
            x, y, z, u, v, w = self._fromto.tolist()
            return min(distance, math.hypot(u - x, v - y, w - z))
        return distance

    def closing_bound(self, data: Any) -> float:
        """Speed in m/s that the gap cannot change faster than: centres apart, plus spins times bounding radii."""
        v1, w1 = self._centre_motion(data, self.body_a, self._root1, self._g1)
        v2, w2 = self._centre_motion(data, self.body_b, self._root2, self._g2)
        return _BOUND_MARGIN * (math.dist(v1, v2) + w1 * self._r1 + w2 * self._r2)

    @staticmethod
    def _centre_motion(data: Any, body: int, root: int, geom: int) -> tuple[tuple[float, float, float], float]:
        """Velocity of a geom's centre and its angular speed; cvel is (angular, linear) about the tree's centre of mass."""
        wx, wy, wz, vx, vy, vz = data.cvel[body].tolist()
        x, y, z = (data.geom_xpos[geom] - data.subtree_com[root]).tolist()
        velocity = (vx + wy * z - wz * y, vy + wz * x - wx * z, vz + wx * y - wy * x)
        return velocity, math.sqrt(wx * wx + wy * wy + wz * wz)

    def reach_per_root_energy(self, model: Any, data: Any) -> float:
        """Bound on the closing speed over sqrt(2 T), T the kinetic energy of everything, in any configuration.

        A rigid group of mass m and least moment of inertia I has |v| <= sqrt(2 T / m) and |w| <= sqrt(2 T / I); a point of a
        geom is at most its distance from the group's mass centre plus its bounding radius away from that centre. The groups
        of a and b are two, of one tree or not, and T is at least T_a + T_b: the speed at which they close, at most
        k_a sqrt(2 T_a) + k_b sqrt(2 T_b), is by Cauchy and Schwarz at most hypot(k_a, k_b) sqrt(2 T).
        """
        parts = (
            _speed_per_root_energy(model, data, self._g1, self._r1),
            _speed_per_root_energy(model, data, self._g2, self._r2),
        )
        return math.hypot(*parts)

    def proximity(self, model: Any, data: Any) -> Proximity:
        """Gap, normal, points and rates at the state in ``data`` (kinematics and velocities current)."""
        first, second = Shape(model, data, self._g1), Shape(model, data, self._g2)
        estimate, witness = self._shifted_query(model, data, self._estimate(model, data), min(_SHIFT, _SHARE * self.size))
        normal = polished(first, second, estimate)
        features = facing(first, second, normal)
        if not opposite(*features, normal):
            normal, witness = self._nearer_query(model, data, (normal, witness))
            features = facing(first, second, normal)
        self._normal = normal
        level = CONTACT_GAP_M + self.vague
        points = touching_set(*features, normal, level)
        points = points if len(points) else witness[None]
        rounding = _ROUNDING + 4.0 * EPSILON * float(np.abs(points).max())
        rates, still = self._rates(data, normal, points)
        near = Proximity(separation(first, second, normal), normal, points, rates, still, rounding)
        return self._with_rims((first, second), data, near) if self.is_of(mujoco.mjtGeom.mjGEOM_CYLINDER) else near

    def _with_rims(self, shapes: tuple[Shape, Shape], data: Any, near: Proximity) -> Proximity:
        """The same with the point of a cap's rim that approaches, if it does so faster than all others."""
        spin = data.cvel[self.body_b][:3] - data.cvel[self.body_a][:3]
        for here in lowest_of_rims(shapes, near.normal, spin, CONTACT_GAP_M + self.vague):
            rates = self._rates(data, near.normal, here)[0]
            if rates[0] < min(near.rate, 0.0) - near.still:
                near = replace(near, points=np.concatenate((near.points, here)), rates=np.append(near.rates, rates))
        return near

    def at_velocities(self, data: Any, near: Proximity) -> Proximity:
        """The same proximity after velocities changed at one instant; those in ``data`` are current."""
        rates, still = self._rates(data, near.normal, near.points)
        return replace(near, rates=rates, still=still)

    def _rates(self, data: Any, normal: FloatArray, points: FloatArray) -> tuple[FloatArray, float]:
        """Rate of the gap at each point, and what of it is rounding."""
        here = self._velocity(data, self.body_a, self._root1, points)
        there = self._velocity(data, self.body_b, self._root2, points)
        still = RATE * (1.0 + float(np.abs(here).max()) + float(np.abs(there).max()))
        return (there - here) @ normal, still

    def second_rate(self, model: Any, data: Any, near: Proximity, point: FloatArray) -> SecondRate:
        """Second rate of the gap at one of the points of a proximity; accelerations in ``data`` must be current."""
        shapes = Shape(model, data, self._g1), Shape(model, data, self._g2)
        half = 0.5 * near.gap * near.normal
        bodies, points = (self.body_a, self.body_b), (point - half, point + half)
        return second_rate(model, data, bodies, shapes, near.normal, points)

    def pressed(self, model: Any, data: Any, near: Proximity) -> bool:
        """Whether a pair that is closed and still begins to overlap with the efforts in ``data``.

        Where it touches at several points, those that separate overlap nowhere soon, whatever their gaps' second rates.
        """
        points = (point for point, rate in zip(near.points, near.rates.tolist(), strict=True) if rate <= near.still)
        rates = (self.second_rate(model, data, near, point) for point in points)
        return any(rate.value < -rate.rounding for rate in rates)

    def rate_along(self, data: Any, normal: FloatArray, point: FloatArray) -> float:
        """Velocity of b relative to a at a point along a unit vector, m/s; velocities in ``data`` current."""
        return float(self._rates(data, normal, point[None])[0][0])

    def slip(self, data: Any, normal: FloatArray, point: FloatArray) -> FloatArray:
        """Velocity of b relative to a at a point, less its part along the normal, world axes, (3,), m/s."""
        here = self._velocity(data, self.body_a, self._root1, point)
        relative = self._velocity(data, self.body_b, self._root2, point) - here
        return np.asarray(relative - (relative @ normal) * normal)

    @staticmethod
    def _velocity(data: Any, body: int, root: int, points: FloatArray) -> FloatArray:
        """Velocities of points fixed to a body, (k, 3)."""
        angular, linear = data.cvel[body][:3], data.cvel[body][3:]
        return np.asarray(linear + np.cross(angular, points - data.subtree_com[root]))

    def _nearer_query(self, model: Any, data: Any, found: tuple[FloatArray, FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Normal and witness where those of the usual shift, which are given, are none: corners within a hair of each other.

        There each pass of the query turns the direction by the corners' offset across it over the shift, no more; from less
        and less far away it turns far enough to see the faces and edges that the corners belong to. The separation along
        none of the directions on the way is larger than that along the normal.
        """
        first, second = Shape(model, data, self._g1), Shape(model, data, self._g2)
        (best, witness), shift = found, min(_SHIFT, _SHARE * self.size)
        while shift > _NEAREST and not is_normal(first, second, best):
            shift *= 0.1
            direction, between = self._shifted_query(model, data, best, shift)
            normal = polished(first, second, direction)
            if separation(first, second, normal) > separation(first, second, best):
                best, witness = normal, between
        return best, witness

    def _shifted_query(self, model: Any, data: Any, normal: FloatArray, shift: float) -> tuple[FloatArray, FloatArray]:
        """Normal and the midpoint of the witnesses, asked with b moved clear of a, first along an estimate."""
        centre = data.geom_xpos[self._g2].copy()
        try:
            for _ in range(_PASSES):
                data.geom_xpos[self._g2] = centre + shift * normal
                distance = mujoco.mj_geomDistance(model, data, self._g1, self._g2, FAR, self._fromto)
                if distance <= 0.0:  # overlapping deeper than the shift: move further out
                    shift *= 4.0
                    continue
                before, normal = normal, _direction(self._fromto)
                if math.dist(before, normal) < _SETTLED:
                    break
        finally:
            data.geom_xpos[self._g2] = centre
        return normal, 0.5 * (self._fromto[:3] + self._fromto[3:] - shift * normal)

    def _estimate(self, model: Any, data: Any) -> FloatArray:
        """A direction to start from: the last normal, the witnesses when clearly apart, else the centres."""
        if self._distance(model, data, FAR) > CLEARLY_APART_M:
            return _direction(self._fromto)
        if self._normal is not None:
            return self._normal
        direction = data.geom_xpos[self._g2] - data.geom_xpos[self._g1]
        length = float(np.linalg.norm(direction))
        return np.asarray(direction / length) if length > 0.0 else np.array([1.0, 0.0, 0.0])


def _direction(fromto: FloatArray) -> FloatArray:
    """Unit vector between two witness points; not divided by the distance, which is known less well."""
    difference = fromto[3:] - fromto[:3]
    return np.asarray(difference / np.linalg.norm(difference))


def _speed_per_root_energy(model: Any, data: Any, geom: int, radius: float) -> float:
    """Greatest speed of a geom's points over sqrt(2 T); infinite where rounding decides the least moment of inertia."""
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
    arm = float(np.linalg.norm(data.geom_xpos[geom] - centre)) + radius
    least, _, greatest = np.linalg.eigvalsh(inertia).tolist()
    return 1.0 / math.sqrt(mass) + arm / math.sqrt(least) if least > _INERTIA_ROUNDING * greatest else math.inf
