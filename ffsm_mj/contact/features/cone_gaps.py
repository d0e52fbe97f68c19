"""Gap functions of points, rims and ellipsoids inside a cone.

In the meridian plane through a point, with its height z over the apex along the axis, its distance rho from the axis and the
half angle alpha of the cone, the distance from the surface and the place of its foot along the generator are

    g = z sin(alpha) - rho cos(alpha),    s = z cos(alpha) + rho sin(alpha)

Beyond the mouth the nearest place is on the rim of the mouth, at the distance hypot(g, s - s_mouth); before the throat of a
frustum likewise. With the gradient n of the distance (n_z along the axis, n_rho along e away from the axis), t = axis x e,
and q across n in the meridian plane, the Hessian is

    N = k q q^T + (n_rho / rho) t t^T,    k = 0 on the surface, 1 / distance from a rim

For the notation see :mod:`.point_line_gaps`. Both material points are at the point p of the second body that is nearest to
the cone, which slides over that body at s. The normal changes at n' = omega_cone x n + N (w + s), so that

    gap'' = n . (a_second - a_first) + 2 (omega_cone x n) . w + w . N (w + s) + s . r,   r = (omega_cone - omega_second) x n

For a point s = 0. A rim or an ellipsoid with the radii of curvature K at its extreme point along -n is nearest to the
generator in whose meridian plane that point is; there s = -K (n' - omega_second x n).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from ffsm_mj.contact.features.body_motion import Body, BodyMotion, Vector, cross, dot, minus, scaled, shifted, unit
from ffsm_mj.contact.features.cores import Circle, Ellipsoid, Point
from ffsm_mj.contact.features.gap_function import FeatureState, GapFunction
from ffsm_mj.tolerances import CONTACT_GAP_M, NEWTON_STEP, OTHER_POINT_M

ConePart = Literal["surface", "mouth", "throat"]
"""The surface itself, the rim of its mouth, or the rim at which a frustum begins."""


class Meridian(NamedTuple):
    """A place in the meridian plane of a cone.

    Attributes:
        distance: Distance from a part of the cone, m; from the surface with its sign, positive inside.
        normal: Gradient of the distance, components along the axis and away from it.
        inside: Distance along the generator by which the foot is within the bounds of the part, m.
        curvature: Second derivative of the distance across the gradient, 1/m.
    """

    distance: float
    normal: tuple[float, float]
    inside: float
    curvature: float


@dataclass(frozen=True)
class Cone:
    """The inner surface of a cone fixed to a body.

    Attributes:
        name: Name of the feature.
        body: Body that it is fixed to.
        apex: Apex.
        axis: Unit vector from the apex to the mouth.
        sine: Sine of the half angle.
        cosine: Its cosine.
        throat: Distance along a generator from the apex at which the surface begins.
        mouth: Distance along a generator from the apex at which it ends.
        radius: Radius around it, 0.
    """

    name: str
    body: Body
    apex: Vector
    axis: Vector
    sine: float
    cosine: float
    throat: float
    mouth: float
    radius: float = 0.0

    def outward(self, angle: float) -> Vector:
        """Unit vector from the axis to the generator at an angle from a fixed one; axes of the body."""
        x, y, z = self.axis
        across = unit((0.0, z, -y) if abs(x) < 0.6 else (-z, 0.0, x))
        return shifted(scaled(math.cos(angle), across), math.sin(angle), cross(self.axis, across))

    def meridian(self, z: float, rho: float, part: ConePart) -> Meridian:
        """A place at a height over the apex and a distance from the axis, m, as seen from a part of the cone."""
        g, s = z * self.sine - rho * self.cosine, z * self.cosine + rho * self.sine
        if part == "surface":
            return Meridian(g, (self.sine, -self.cosine), min(s - self.throat, self.mouth - s), 0.0)
        away = s - (self.mouth if part == "mouth" else self.throat)
        distance = math.hypot(g, away)
        across, along = g / distance, away / distance
        normal = across * self.sine + along * self.cosine, along * self.sine - across * self.cosine
        return Meridian(distance, normal, away if part == "mouth" else -away, 1.0 / distance)


_TURNS = 30
"""Largest number of Newton steps for the generator; a few suffice from the last one."""
_LONGEST_TURN = 0.3
"""Longest Newton step, rad."""
_FLATTEST_M = 1e-9
"""Least curvature by which a Newton step is divided, m; contact ends a run before it is so flat."""
ALIKE = 0.02
"""Share of the distance from the axis by which curvatures must differ in persistent contact.

The contact travels, and forces grow, at its inverse; two contacts that come together there are 10 degrees apart.
"""
_NO_AXIS = 1e-300
"""Distance from the axis in m that stands for zero where it divides: contact there ends a run before it counts."""


class PointOnCone(GapFunction):
    """Gap of a point with a radius inside a cone, or over a rim of it."""

    def __init__(self, name: str, swapped: bool, cone: Cone, point: Point, part: ConePart) -> None:
        """Store the cores."""
        super().__init__(name, swapped, cone.radius, point.radius)
        self._cone, self._point, self._part = cone, point, part

    def turn_rate(self, data: Any) -> float:
        """Bound on the rate of the angle round the axis, and on that of the logarithm of the distance from it, 1/s."""
        motion = self._point.body.motion(data)
        arm = motion.turned(self._point.centre)
        return turn_rate(self._cone, shifted(motion.origin, 1.0, arm), motion.velocity_at(arm), data)

    def at(self, data: Any) -> FeatureState:
        """Evaluate the gap; the terms of gap'' are 2 (omega x n) . w and the curvature along the motion."""
        cone, first, second = self._cone, self._cone.body.motion(data), self._point.body.motion(data)
        arm = second.turned(self._point.centre)
        place = shifted(second.origin, 1.0, arm)
        first_arm = minus(place, first.origin)
        z, rho, outward = from_axis(cone, first.local(first_arm))
        seen = cone.meridian(z, rho, self._part)
        normal, across, around = meridian_axes(cone, first, seen.normal, outward)
        velocity = second.velocity_at(arm)
        w = minus(velocity, first.velocity_at(first_arm))
        spun = cross(first.omega, normal)
        curved, bent = seen.curvature * dot(across, w), seen.normal[1] / rho * dot(around, w)
        turning = shifted(shifted(spun, curved, across), bent, around)
        terms = (2.0 * dot(spun, w), curved * dot(across, w), bent * dot(around, w))
        # Near the axis the opposite side touches too, and the normal is not that of one generator. A step that passes it is
        # cut short, as the gap from the other side is negative.
        inside = min(seen.inside, 2.0 * cone.cosine * rho - 4.0 * CONTACT_GAP_M)
        return self._state(seen.distance, dot(normal, w), normal, turning, (place, place), velocity, terms, inside)


class LevelRimOnCone(PointOnCone):
    """Gap of a point of a rim that lies level in a cone: several of its points are in contact as long as it stays level."""

    def __init__(self, name: str, swapped: bool, cone: Cone, point: Point, rim: Circle) -> None:
        """Store the cores; ``rim`` is that of the point."""
        super().__init__(name, swapped, cone, point, "surface")
        self._rim = rim

    def at(self, data: Any) -> FeatureState:
        """The gap of the point; its bound is the tilt at which points of the rim between those in contact touch."""
        state, rim = super().at(data), self._rim
        axis = self._cone.body.motion(data).turned(self._cone.axis)
        tilt = math.hypot(*cross(axis, rim.body.motion(data).turned(rim.axis)))
        left = rim.size * (level_tilt(self._cone, rim.size) - tilt)
        return state._replace(inside=min(state.inside, left))


def level_tilt(cone: Cone, radius: float) -> float:
    """Greatest tilt of a rim in contact all round, rad.

    Held at some points, a rim of radius r that tilts by t moves across by r t tan(alpha), and its distance from the cone
    varies by r t^2 / (2 cos(alpha)).
    """
    return math.sqrt(2.0 * OTHER_POINT_M * cone.cosine / radius)


class RoundOnCone(GapFunction):
    """Gap of a rim or an ellipsoid inside a cone: at a generator from which the distance has a local minimum."""

    @dataclass
    class State(GapFunction.State):
        """The angle of the generator, from which the next one is found, too; rad."""

        angle: float

    def __init__(self, name: str, swapped: bool, cone: Cone, core: Circle | Ellipsoid, angle: float) -> None:
        """Store the cores, and the angle of the generator at the start, rad."""
        super().__init__(name, swapped, cone.radius, core.radius)
        self._cone, self._core, self._angle = cone, core, angle

    def tilt(self, data: Any) -> Vector | None:
        """Share by which the body is curved more than the cone, round the axis: the contact travels at its inverse."""
        cone, first, second = self._cone, self._cone.body.motion(data), self._core.body.motion(data)
        _, arm, stiff = self._follow(first, second)
        _, rho, _ = from_axis(cone, first.local(minus(shifted(second.origin, 1.0, arm), first.origin)))
        return 1.0 - cone.cosine * stiff / rho, 0.0, 0.0

    def turn_rate(self, data: Any) -> float:
        """See :meth:`PointOnCone.turn_rate`; of the contact point, which travels over both surfaces."""
        x, y, z = (at := self.at(data)).point.tolist()
        return turn_rate(self._cone, (x, y, z), at.point_rate, data)

    def at(self, data: Any) -> FeatureState:
        """Evaluate the gap at the generator that follows from the last one."""
        cone, core = self._cone, self._core
        first, second = cone.body.motion(data), core.body.motion(data)
        outward, arm, stiff = self._follow(first, second)
        place = shifted(second.origin, 1.0, arm)
        first_arm = minus(place, first.origin)
        z, rho, _ = from_axis(cone, first.local(first_arm))
        seen = cone.meridian(z, rho, "surface")
        normal, _, around = meridian_axes(cone, first, seen.normal, outward)
        velocity = second.velocity_at(arm)
        w = minus(velocity, first.velocity_at(first_arm))
        against, spun = scaled(-1.0, normal), cross(first.omega, normal)
        rolling = cross(minus(first.omega, second.omega), normal)
        bend = cone.cosine / rho
        # What is left of the motion round the axis where the surface of the second body is curved nearly as the cone is.
        moving = dot(around, minus(w, core.extreme_rate(second, against, rolling))) / (1.0 - bend * stiff)
        slide = scaled(-1.0, core.extreme_rate(second, against, shifted(rolling, -bend * moving, around)))
        turning = shifted(spun, -bend * moving, around)
        terms = (2.0 * dot(spun, w), -bend * moving * dot(around, w), dot(slide, rolling))
        inside = min(seen.inside, 2.0 * cone.cosine * rho - 4.0 * CONTACT_GAP_M, curvature_margin(cone, rho, stiff))
        return self._state(
            *(seen.distance, dot(normal, w), normal, turning, (place, place), shifted(velocity, 1.0, slide), terms, inside)
        )

    def _follow(self, first: BodyMotion, second: BodyMotion) -> tuple[Vector, Vector, float]:
        """Find the generator by Newton's method from the last one.

        Returns:
            Unit vector from the axis to it, axes of the body of the cone; arm of the extreme point; and the radius of
            curvature there round the axis, m.
        """
        cone, core = self._cone, self._core
        apex = first.place(cone.apex)
        for _ in range(_TURNS):
            outward = cone.outward(self._angle)
            normal, _, around = meridian_axes(cone, first, (cone.sine, -cone.cosine), outward)
            against = scaled(-1.0, normal)
            arm = core.extreme(second, against)
            stiff = dot(around, core.extreme_rate(second, against, around))
            offset = minus(shifted(second.origin, 1.0, arm), apex)
            # Downhill, whatever the curvature: where a trial step has left no minimum, that of the other side is next.
            curved = abs(dot(first.turned(outward), offset) - cone.cosine * stiff)
            step = dot(around, offset) / max(curved, _FLATTEST_M)
            self._angle += max(-_LONGEST_TURN, min(_LONGEST_TURN, step))
            if abs(step) < NEWTON_STEP:
                break
        return outward, arm, stiff


def turn_rate(cone: Cone, place: Vector, velocity: Vector, data: Any) -> float:
    """Speed of a place across the axis of a cone, over its distance from the axis, 1/s.

    Args:
        cone: The cone.
        place: The place, world axes, m.
        velocity: Its velocity, m/s.
        data: MuJoCo data.
    """
    motion = cone.body.motion(data)
    arm = minus(place, motion.origin)
    _, rho, _ = from_axis(cone, motion.local(arm))
    return math.hypot(*cross(motion.turned(cone.axis), minus(velocity, motion.velocity_at(arm)))) / rho


def curvature_margin(cone: Cone, rho: float, stiff: float) -> float:
    """Length by which a body is curved more, round the axis, than the cone is, less ALIKE of the distance from it; m.

    At zero they touch along more than a point, as a rim does all round where it is level.

    Args:
        cone: The cone.
        rho: Distance of the contact from the axis, m.
        stiff: Radius of curvature of the body there round the axis, m.
    """
    return rho - cone.cosine * stiff - ALIKE * rho


def from_axis(cone: Cone, local: Vector) -> tuple[float, float, Vector]:
    """Height over the apex, distance from the axis, and the unit vector away from it to a place; axes of the body."""
    offset = minus(local, cone.apex)
    z = dot(offset, cone.axis)
    radial = shifted(offset, -z, cone.axis)
    rho = max(math.hypot(*radial), _NO_AXIS)
    return z, rho, scaled(1.0 / rho, radial)


def meridian_axes(
    cone: Cone, motion: BodyMotion, normal: tuple[float, float], outward: Vector
) -> tuple[Vector, Vector, Vector]:
    """Normal, the direction across it in the meridian plane, and the one round the axis; world axes.

    Args:
        cone: The cone.
        motion: Motion of its body.
        normal: Components of the normal along the axis and away from it.
        outward: Unit vector away from the axis, axes of the body.
    """
    axis, away = motion.turned(cone.axis), motion.turned(outward)
    along, across = normal
    return shifted(scaled(along, axis), across, away), shifted(scaled(along, away), -across, axis), cross(axis, away)
