"""Two geoms at one instant: gap, normal, contact points, gap rates, and the second rate of the gap in closed form.

With the normal n from A to B, velocities v and accelerations a of the material points of both bodies at the contact point,
and velocities s of the contact point over each surface (in the tangent plane),

    gap''  = n_dot . (v_B - v_A) + n . (a_B - a_A) + n . (omega_B x s_B) - n . (omega_A x s_A)

n_dot, s_A and s_B follow from the shapes: s_A = R_A (n_dot - omega_A x n) with the radii of curvature R_A (0 at a vertex);
along flat directions (an edge, a face) the normal is fixed to the body; B likewise with its own normal -n. The contact
points stay opposite each other: s_B - s_A = gap n_dot - (v_B - v_A) across n.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np

from ffsm_mj._core.turning import along, flat, turning
from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.patch import Cap, caps_of
from ffsm_mj.contact.shape import Shape
from ffsm_mj.dynamics.rigid_body import cross, tangents
from ffsm_mj.tolerances import ACCELERATION, ACCELERATION_M_S2, CROSSING, PARALLEL

FAR_M = 1.0
"""Limit of a gap query unless it is stated: whatever asks whether two geoms touch does not need larger gaps."""
_PENETRATING, _EXACT = 1e3, 1e-3
"""A gap below minus the first times its rounding is penetration; the rate tolerance is then multiplied by the second."""


@dataclass(frozen=True)
class Proximity:
    """Gap, normal, contact points and gap rates of a pair at one instant, in world axes.

    Attributes:
        gap: Signed distance in m, negative when overlapping.
        normal: Unit normal from a to b, (3,).
        points: Contact points, or nearest points if the pair is apart: one point, or the extreme points of an edge or a
            face, (k, 3), m.
        rates: Gap rate at each point in m/s, negative when approaching, (k,).
        rate_tolerance: Gap rates within this of zero, in m/s, are rounding: the point neither approaches nor separates.
        rounding: Rounding of the gap, m.
        patch: Name of its patch among those of a pair of unions; empty for other pairs, which have one.
        features: Its contact features once they have been determined, see :func:`~.features.search.features`.
    """

    gap: float
    normal: FloatArray
    points: FloatArray
    rates: FloatArray
    rate_tolerance: float
    rounding: float
    patch: str = ""
    features: list[Any] = field(init=False, repr=False, compare=False, default_factory=list)

    @property
    def extreme_points(self) -> int:
        """Number of extreme points of the patch, be they of this pair or of others under which it goes on."""
        return len(self.points)

    @property
    def rate(self) -> float:
        """Least gap rate of the points, m/s."""
        return float(self.rates.min())

    @property
    def approaches(self) -> bool:
        """Whether a point approaches by more than rounding."""
        # A pair that already penetrates by more than rounding must not rest on a tolerance: a slow approach deepens it.
        penetrates = self.gap <= -_PENETRATING * self.rounding
        return self.rate < (-_EXACT * self.rate_tolerance if penetrates else -self.rate_tolerance)

    def point_at(self, place: FloatArray, offset_m: float) -> FloatArray:
        """The nearest of its points, which impacts act on, if it is within an offset of a place; else the place itself."""
        nearest = min(self.points, key=lambda point: math.dist(point, place))
        return nearest if math.dist(nearest, place) <= offset_m else place


AT_END = 1e-7
"""A contact point within this share of the length of an edge or face from its end is at its end."""


@dataclass(frozen=True)
class SecondRate:
    """Second rate of a gap in m/s^2, and the magnitude of the largest of its terms.

    Attributes:
        value: Second rate of the gap, m/s^2.
        scale: Magnitude of its largest term, m/s^2.
        acceleration: Rate of the velocity of b relative to a at the contact point, which moves over both surfaces, m/s^2,
            world axes, (3,).
    """

    value: float
    scale: float
    acceleration: FloatArray

    @property
    def rounding(self) -> float:
        """Rounding of the second rate, m/s^2."""
        return ACCELERATION * self.scale + ACCELERATION_M_S2


@dataclass(frozen=True)
class PointMotion:
    """A body's motion at the contact point: velocity and acceleration there, angular velocity; world axes."""

    velocity: FloatArray
    acceleration: FloatArray
    omega: FloatArray


def second_rate(
    model: Any,
    data: Any,
    bodies: tuple[int, int],
    shapes: tuple[Shape, Shape],
    normal: FloatArray,
    points: tuple[FloatArray, FloatArray],
) -> SecondRate:
    """Second rate of the gap at a contact point.

    Args:
        model: MuJoCo model.
        data: Its data with velocities and accelerations (``qacc``) current.
        bodies: Bodies A and B.
        shapes: Their convex geoms in contact.
        normal: Unit normal from A to B, world axes.
        points: Contact points, or nearest points, of A and of B, opposite each other along the normal, world axes.
    """
    a, b = (point_motion(model, data, body, point) for body, point in zip(bodies, points, strict=True))
    return second_rate_of((a, b), normal, *_turning(shapes, (a, b), normal, points))


def second_rate_of(
    motions: tuple[PointMotion, PointMotion], normal: FloatArray, n_dot: FloatArray, s_a: FloatArray, s_b: FloatArray
) -> SecondRate:
    """Second rate of the gap from the rate of the normal and the velocities of the contact point over both surfaces.

    Args:
        motions: Motions of bodies A and B at the contact point.
        normal: Unit normal from A to B, world axes.
        n_dot: Its rate.
        s_a: Velocity of the contact point over A, relative to the material of A.
        s_b: The same over B.
    """
    a, b = motions
    turned = cross(a.omega, s_a), cross(b.omega, s_b)
    terms = (
        float(n_dot @ (b.velocity - a.velocity)),
        float(normal @ b.acceleration),
        -float(normal @ a.acceleration),
        float(normal @ turned[1]),
        -float(normal @ turned[0]),
    )
    relative = b.acceleration - a.acceleration + turned[1] - turned[0]
    return SecondRate(sum(terms), max(map(abs, terms)), relative)


def point_motion(model: Any, data: Any, body: int, point: FloatArray) -> PointMotion:
    """Motion of a body at a point fixed to it."""
    linear, angular, linear_dot = (np.empty((3, model.nv)) for _ in range(3))
    mujoco.mj_jac(model, data, linear, angular, point, body)
    mujoco.mj_jacDot(model, data, linear_dot, None, point, body)
    return PointMotion(linear @ data.qvel, linear @ data.qacc + linear_dot @ data.qvel, angular @ data.qvel)


def _turning(
    shapes: tuple[Shape, Shape],
    motions: tuple[PointMotion, PointMotion],
    normal: FloatArray,
    points: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """Rate of the normal, and velocities of the contact point over both surfaces, world axes, (3, 3)."""
    axes, caps = tangents(normal), caps_of(*shapes, normal)
    flats = _flats(shapes, normal, points, caps, axes)
    sides: list[tuple[FloatArray, FloatArray, FloatArray, FloatArray | None, float]] = []
    for shape, motion, cap, projector, point, outward in zip(shapes, motions, caps, flats, points, (1.0, -1.0), strict=True):
        # A cap is perpendicular to the normal only to within the tilt at which it counts as flat: as the contact slides
        # along the rim, n . t = 0 for its tangent t, which turns.
        tilting = cap.rise(point, normal) / cap.radius if cap and _rank(projector) == 1 else 0.0
        radii = None if cap else shape.radii(outward * normal)
        sides.append((motion.velocity, motion.omega, projector, radii, tilting))
    return turning(normal, axes, float(normal @ (points[1] - points[0])), *sides)


def _flats(
    shapes: tuple[Shape, Shape],
    normal: FloatArray,
    points: tuple[FloatArray, FloatArray],
    caps: tuple[Cap | None, Cap | None],
    axes: FloatArray,
) -> Sequence[FloatArray]:
    """Projectors on the flat directions of both features at the contact point, (2, 2) each."""
    first, second = caps
    if first and second:
        return _flats_of_caps(first, second, points, axes)
    flats = [
        np.eye(2) if shape.is_plane else flat(shape.extreme(outward * normal, PARALLEL), point, axes, AT_END)
        for shape, point, outward in zip(shapes, points, (1.0, -1.0), strict=True)
    ]
    return [flats[k] if cap is None else _flat_of_cap(cap, points[k], axes, flats[1 - k]) for k, cap in enumerate(caps)]


def _flat_of_cap(cap: Cap, point: FloatArray, axes: FloatArray, other: FloatArray) -> FloatArray:
    """The same at a point of a cap: all directions within it, and on its rim the tangent if an edge crosses it there.

    On a face, a point of the rim is a material point of the body, like the fixed points of the rim.
    """
    rim = _along_rim(cap, point, axes)
    if rim is None:
        return np.eye(2)
    return rim if _rank(other) == 1 else np.zeros((2, 2))


def _flats_of_caps(
    first: Cap, second: Cap, points: tuple[FloatArray, FloatArray], axes: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The same where two caps lie on each other: both tangents where the rims cross, else a point of one rim on a face."""
    one, other = (_along_rim(cap, point, axes) for cap, point in zip((first, second), points, strict=True))
    face, corner = np.eye(2), np.zeros((2, 2))
    if one is None:
        return face, corner
    if other is None:
        return corner, face
    # Of one point of both rims: the trace of the product is the squared cosine of the angle between the tangents.
    return (one, other) if 1.0 - float(np.trace(one @ other)) > CROSSING**2 else (corner, face)


def _along_rim(cap: Cap, point: FloatArray, axes: FloatArray) -> FloatArray | None:
    """Projector on the tangent of the rim of a cap at one of its points, (2, 2); None for other points."""
    rim = axes @ (point - cap.centre)
    if abs(float(np.linalg.norm(rim)) - cap.radius) > 2.0 * AT_END * cap.radius:
        return None
    return along(-rim[1], rim[0])


def _rank(projector: FloatArray) -> int:
    return round(float(np.trace(projector)))
