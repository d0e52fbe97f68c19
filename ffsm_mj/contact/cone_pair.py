"""Contact pairs of a geom inside a cone: one pair for each place of the geom that can touch the surface first.

The distance from the surface is a concave function inside the cone, so that the least distance of a convex polytope is at
a vertex: spheres, ends of capsules and vertices of boxes and meshes are points with a radius, and each has a gap of its own
that is smooth. Several of them touch at once with different normals, as several pairs do. A rim of a cylinder and an
ellipsoid have a pair for each of two local minima of the distance.

The surface is seen from inside. A point that has passed it by more than a tenth of the radius of the mouth is behind it,
where nothing touches: the outside of a funnel is that of the geoms of its body. What comes through from behind ends the run.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.cone_rounds import SLOTS, NearestGenerators, RoundCore
from ffsm_mj.contact.features.body_motion import Body
from ffsm_mj.contact.features.cone_gaps import (
    Cone,
    ConePart,
    LevelRimOnCone,
    Meridian,
    PointOnCone,
    RoundOnCone,
    curvature_margin,
    from_axis,
    level_tilt,
)
from ffsm_mj.contact.features.cores import Circle, Ellipsoid, Point
from ffsm_mj.contact.features.gap_function import Feature, GapFunction
from ffsm_mj.contact.pairs import ContactPair, gap_rounding
from ffsm_mj.contact.proximity import FAR_M, Proximity, SecondRate, point_motion, second_rate_of
from ffsm_mj.contact.shape import Shape
from ffsm_mj.model.cones import ConeConfig
from ffsm_mj.model.system import System
from ffsm_mj.records.events import Outcome, RunEnded
from ffsm_mj.tolerances import CLEARLY_APART_M, CLOSED_RATE, CONTACT_GAP_M, EPSILON, FEATURE_BOUND_M, RATE

_BEHIND = 0.1
"""Depth in radii of the mouth from which on a point is behind the surface; steps are followed by half of it at a time."""
_ALL_ROUND_M = 4.0 * CONTACT_GAP_M
"""Difference of the distances from opposite sides of a cone below which a point touches it all round.

It is twice the distance from the axis times the cosine of the half angle; a feature ends a little before.
"""
_GEOM = mujoco.mjtGeom
_NO_CONE = np.empty((0, 3))


@dataclass(frozen=True)
class ConeContact:
    """A point of a geom that may touch a cone.

    Attributes:
        label: What follows the name of the pair; empty if the geom has only one such point.
        name: Name of the feature.
        place: Position in the axes of the geom, (3,), m.
        radius: Radius around it, m.
        squares: Squares of the semi-axes of a rim or an ellipsoid around it, m^2; None for a point.
    """

    label: str
    name: str
    place: FloatArray
    radius: float
    squares: FloatArray | None = None


def cone_contacts(model: Any, geom: int) -> Iterator[ConeContact]:
    """Places of a geom (id) that may touch the inside of a cone; none for shapes that have no distance from one."""
    size, kind = model.geom_size[geom], int(model.geom_type[geom])
    if kind == _GEOM.mjGEOM_SPHERE:
        yield ConeContact("", "sphere", np.zeros(3), float(size[0]))
    elif kind == _GEOM.mjGEOM_CAPSULE:
        for k, z in enumerate((-size[1], size[1])):
            yield ConeContact(f"end {k + 1}", "end", np.array([0.0, 0.0, z]), float(size[0]))
    elif kind == _GEOM.mjGEOM_BOX:
        for k in range(8):
            signs = np.array([1.0 if k >> axis & 1 else -1.0 for axis in range(3)])
            yield ConeContact(f"vertex {k + 1}", "vertex", signs * size, 0.0)
    elif kind == _GEOM.mjGEOM_CYLINDER:
        for k, z in enumerate((-size[1], size[1])):
            yield ConeContact(f"rim {k + 1}", "rim", np.array([0.0, 0.0, z]), 0.0, size[0] ** 2 * np.array([1.0, 1.0, 0.0]))
    elif kind == _GEOM.mjGEOM_ELLIPSOID:
        yield ConeContact("", "ellipsoid", np.zeros(3), 0.0, size**2)
    elif kind == _GEOM.mjGEOM_MESH:
        for k, vertex in enumerate(_hull_vertices(model, int(model.geom_dataid[geom]))):
            yield ConeContact(f"vertex {k + 1}", "vertex", vertex, 0.0)


def _hull_vertices(model: Any, mesh: int) -> FloatArray:
    """Vertices of the convex hull of a mesh, axes of the geom, (n, 3)."""
    from scipy.spatial import ConvexHull  # takes a third of a second to import: only meshes in cones pay

    first = int(model.mesh_vertadr[mesh])
    vertices = np.unique(model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])].astype(np.float64), axis=0)
    return np.asarray(vertices[np.sort(ConvexHull(vertices).vertices)])


def cone_fault(system: System, a: int, b: int) -> str:
    """Why two geoms (ids), one of which stands for a cone, have no contact; empty if they have, or are no cones."""
    model, others = system.mj, [geom for geom in (a, b) if geom not in system.cones]
    if len(others) == 2:
        return ""
    if not others:
        names = " and ".join(repr(model.geom(geom).name) for geom in (a, b))
        return f"{names} are inner surfaces of cones, which do not touch each other"
    if next(cone_contacts(model, others[0]), None) is None:
        return f"geom {model.geom(others[0]).name!r} is no convex shape that fits inside a cone"
    return ""


def cone_pairs(
    system: System, name: str, geoms: tuple[int, int], restitution: float, mu: float, rule: str
) -> Iterator[ConePair]:
    """Pairs of a cone and each place of a geom; see :class:`ConePair` and :class:`RoundConePair`."""
    cone_geom, other = geoms if geoms[0] in system.cones else geoms[::-1]
    for contact in cone_contacts(system.mj, other):
        if contact.squares is None:
            yield ConePair(system, name, geoms, restitution, mu, rule, contact)
            continue
        core = RoundCore(contact.place, contact.squares)
        generators = NearestGenerators(cone_core(system.mj, cone_geom, system.cones[cone_geom]), other, core)
        for slot in range(SLOTS):
            side = replace(contact, label=f"{contact.label} side {slot + 1}".strip())
            yield RoundConePair(system, name, geoms, restitution, mu, rule, side, generators=generators, slot=slot)


def round_core(model: Any, data: Any, geom: int, contact: ConeContact) -> Circle | Ellipsoid:
    """A rim or an ellipsoid of a geom (id) as a core of features, at the state in ``data``."""
    body = Body(model, int(model.geom_bodyid[geom]))
    motion, rotation = body.motion(data), data.geom_xmat[geom].reshape(3, 3)
    assert contact.squares is not None
    x, y, z = (data.geom_xpos[geom] + rotation @ contact.place - motion.origin).tolist()
    centre = motion.local((x, y, z))
    first, second, third = (motion.local(tuple(axis)) for axis in rotation.T.tolist())
    if contact.name == "rim":
        return Circle("rim", body, centre, third, first, math.sqrt(contact.squares[0]))
    a, b, c = contact.squares.tolist()
    return Ellipsoid("ellipsoid", body, centre, (first, second, third), (a, b, c))


def cone_core(model: Any, geom: int, cone: ConeConfig) -> Cone:
    """A cone as a core of features; its numbers are those of the scenario, to rounding."""
    angle = math.radians(cone.half_angle_deg)
    sine, cosine = math.sin(angle), math.cos(angle)
    ends = cone.from_m / cosine, cone.length_m / cosine
    return Cone("cone", Body(model, int(model.geom_bodyid[geom])), cone.apex_m, cone.direction, sine, cosine, *ends)


class ConePair(ContactPair):
    """A cone and one point of a geom; see :class:`~ffsm_mj.contact.pairs.ContactPair`.

    Attributes:
        shared_name: What the names of all pairs of the cone and the geom begin with.
    """

    has_one_patch = False

    def __init__(
        self,
        system: System,
        name: str,
        geoms: tuple[int, int],
        restitution: float,
        mu: float,
        rule: str,
        contact: ConeContact,
    ) -> None:
        """Resolve the cone and the point.

        Args:
            system: Compiled models.
            name: Name of the pair without that of the point.
            geoms: Ids of geoms a and b, one of which stands for a cone.
            restitution: Coefficient of restitution.
            mu: Coefficient of friction.
            rule: Name of the contact rule.
            contact: Point of the geom that is no cone.

        Raises:
            LookupError: See :class:`~ffsm_mj.contact.pairs.ContactPair`.
        """
        super().__init__(system, f"{name} {contact.label}".strip(), *geoms, restitution, mu, rule=rule)
        self.shared_name = name
        self._on_a = geoms[0] in system.cones
        cone_geom, self._geom = geoms if self._on_a else geoms[::-1]
        config = system.cones[cone_geom]
        model = system.mj
        self._cone = cone_core(model, cone_geom, config)
        self._contact = contact
        self._body = int(model.geom_bodyid[self._geom])
        depth = _BEHIND * config.mouth_radius_m
        self._depth = min(depth, contact.radius) if contact.radius > 0.0 else depth
        self.size, self.touches_once = 0.5 * self._depth, True
        self.position_tolerance, self.flush_offset, self.flush_angle = 0.0, 0.0, 0.0
        self._kinds = {int(model.geom_type[self._geom])}
        self._query_scatters = False

    def gap(self, model: Any, data: Any, limit: float = FAR_M) -> float:  # noqa: ARG002
        """Distance of the point from the cone, less its radius, m; negative within the depth that counts as an overlap."""
        place = self._place(data)
        return limit if place is None else min(self._seen(data, place)[0], limit)

    def _place(self, data: Any) -> FloatArray | None:
        """The point in the world, (3,), m; None if it is nowhere."""
        return np.asarray(data.geom_xpos[self._geom] + data.geom_xmat[self._geom].reshape(3, 3) @ self._contact.place)

    def _gap(self, seen: Meridian) -> float:
        gap = seen.distance - self._contact.radius
        # What is deeper has passed the surface from behind: it moves away from contact.
        return gap if gap >= -self._depth else -gap

    def _nearest(self, z: float, rho: float) -> Meridian:
        """A place in the meridian plane as seen from the part of the cone that is nearest."""
        s = z * self._cone.cosine + rho * self._cone.sine
        return self._cone.meridian(
            z, rho, "mouth" if s > self._cone.mouth else "throat" if s < self._cone.throat else "surface"
        )

    def _seen(self, data: Any, place: FloatArray) -> tuple[float, float, Meridian, FloatArray]:
        """Gap of a place, its distance from the axis, m, what the cone sees of it, and the unit vector from the axis."""
        body = self._cone.body.id
        axes = data.xmat[body].reshape(3, 3)
        offset = (place - data.xpos[body]) @ axes - self._cone.apex
        z = float(offset @ self._cone.axis)
        radial = offset - z * np.array(self._cone.axis)
        rho = math.hypot(*radial)
        seen = self._nearest(z, rho)
        outward = axes @ (radial / rho if rho > 0.0 else self._cone.outward(0.0))
        return self._gap(seen), rho, seen, outward

    def proximity(self, model: Any, data: Any) -> Proximity:
        """Gap, normal, point and rate at the state in ``data``; where it touches all round, where it approaches fastest."""
        return self.proximities(model, data)[0]

    def proximities(self, model: Any, data: Any) -> tuple[Proximity, ...]:
        """The same for each direction in which it touches: one, or four round the axis, the fastest approach first.

        Raises:
            RunEnded: It touches the cone all round.
        """
        place = self._place(data)
        if place is None:
            return (Proximity(FAR_M, np.eye(3)[0], data.geom_xpos[self._geom][None].copy(), np.zeros(1), 0.0, EPSILON),)
        gap, rho, seen, outward = self._seen(data, place)
        if abs(gap) > CONTACT_GAP_M or not self._touches_round(model, data, rho):
            return (self._along(data, place, gap, self._inward(data, seen, outward)),)
        return self._all_round(data, place)

    def _all_round(self, data: Any, place: FloatArray) -> tuple[Proximity, ...]:
        """Proximities of a place on the axis, in each direction in which it touches."""
        gap, _, seen, _ = self._seen(data, place)
        return tuple(self._along(data, place, gap, self._inward(data, seen, way)) for way in self._round(data, place))

    def _along(self, data: Any, place: FloatArray, gap: float, inward: FloatArray, patch: str = "") -> Proximity:
        """Proximity of a place at a gap, with a normal to the inside."""
        normal = inward if self._on_a else -inward
        points = (place - (self._contact.radius + 0.5 * gap) * inward)[None]
        rates, tolerance = self._velocity.along(data, normal, points)
        return Proximity(gap, normal, points, rates, tolerance, gap_rounding(points), patch)

    def _round(self, data: Any, place: FloatArray) -> list[FloatArray]:
        """Directions from the axis in which a point on it touches: that of its motion, the opposite, and those between."""
        axis = self._axis(data)
        velocity = self.slip(data, axis, place) if self._on_a else -self.slip(data, axis, place)
        speed = math.hypot(*velocity)
        still = self._velocity.along(data, axis, place[None])[1]
        # Of a motion along the axis the direction across it is rounding: a fixed one repeats.
        first = velocity / speed if speed > still else data.xmat[self._cone.body.id].reshape(3, 3) @ self._cone.outward(0.0)
        second = np.cross(axis, first)
        return [first, second, -first, -second]

    def _touches_round(self, model: Any, data: Any, rho: float) -> bool:  # noqa: ARG002
        """Whether a point in contact, at a distance from the axis in m, touches the opposite side too."""
        return 2.0 * rho * self._cone.cosine < _ALL_ROUND_M - 0.5 * FEATURE_BOUND_M

    def _inward(self, data: Any, seen: Meridian, outward: FloatArray) -> FloatArray:
        """Normal to the inside, world axes, (3,)."""
        return np.asarray(seen.normal[0] * self._axis(data) + seen.normal[1] * outward)

    def refuse_passage(self, first: Proximity, last: Proximity) -> None:
        """End the run if the point comes through the surface from behind between two instants.

        Raises:
            RunEnded: It does.
        """
        # From inside it never gets this deep. What leaves over the mouth sees its rim, in another direction.
        behind = first.gap < -CLEARLY_APART_M <= last.gap
        if behind and last.rate > 0.0 and float(first.normal @ last.normal) > 0.0:
            message = f"{self}: a {self._contact.name} comes through the surface of the cone from behind, where it is open"
            raise RunEnded(Outcome.UNSUPPORTED_CONTACT, f"{message}: make its outside of geoms of its body")

    def _axis(self, data: Any) -> FloatArray:
        return np.asarray(data.xmat[self._cone.body.id].reshape(3, 3) @ self._cone.axis)

    def nearest_points(self, data: Any) -> tuple[float, FloatArray]:
        """Gap in m, and nearest points of the cone and of the geom in the world, (2, 3), m."""
        place = self._place(data)
        if place is None:
            return math.inf, np.zeros((2, 3))
        gap, _, seen, outward = self._seen(data, place)
        inward = self._inward(data, seen, outward)
        return gap, np.stack((place - seen.distance * inward, place - self._contact.radius * inward))

    def second_rate(self, model: Any, data: Any, near: Proximity, point: FloatArray) -> SecondRate:
        """Second rate of the gap; the contact slides over the cone and over the geom, whose nearest point it is."""
        inward = near.normal if self._on_a else -near.normal
        place = point + (self._contact.radius + 0.5 * near.gap) * inward
        _, rho, seen, _ = self._seen(data, place)
        outward = (inward - seen.normal[0] * self._axis(data)) / seen.normal[1]
        cone, foot = self._cone.body.id, place - seen.distance * inward
        of_cone, of_foot, of_place, on_geom = (
            point_motion(model, data, body, where)
            for body, where in (
                (cone, place),
                (cone, foot),
                (self._body, place),
                (self._body, place - self._contact.radius * inward),
            )
        )
        w = of_place.velocity - of_cone.velocity
        across, around = seen.normal[0] * outward - seen.normal[1] * self._axis(data), np.cross(self._axis(data), outward)
        # On the axis the planes at the normals are what it touches.
        bend = 0.0 if ConePair._touches_round(self, model, data, rho) else seen.normal[1] / rho
        spun = np.cross(of_cone.omega, inward)
        radii = self._curvature_radii(model, data, -inward)
        rolling = spun - np.cross(of_place.omega, inward)
        moving = around @ (w - radii @ rolling) / (1.0 + bend * around @ radii @ around)
        turning = spun + seen.curvature * (w @ across) * across + bend * moving * around
        over_place = -radii @ (turning - np.cross(of_place.omega, inward))
        over_geom = over_place + self._contact.radius * (np.cross(of_place.omega, inward) - turning)
        over_cone = of_place.velocity + over_place - (w @ inward) * inward - seen.distance * turning - of_foot.velocity
        if self._on_a:
            return second_rate_of((of_foot, on_geom), inward, turning, over_cone, over_geom)
        return second_rate_of((on_geom, of_foot), -inward, -turning, over_geom, over_cone)

    def _curvature_radii(self, model: Any, data: Any, direction: FloatArray) -> FloatArray:  # noqa: ARG002
        """Radii of curvature of what carries the radius, along a direction, (3, 3), m: a point has none."""
        return np.zeros((3, 3))

    def features_at(self, model: Any, data: Any, near: Proximity) -> list[GapFunction]:  # noqa: ARG002
        """The contact feature at the state in ``data``; none where the point is out of the bounds of the surface.

        Raises:
            RunEnded: It touches the cone all round.
        """
        place = self._place(data)
        if place is not None:
            gap, rho, _, _ = self._seen(data, place)
            if abs(gap) <= CONTACT_GAP_M and self._touches_round(model, data, rho):
                raise self._refused(data)
        return _closed(self._candidates(model, data, place), data) if place is not None else []

    def _refused(self, data: Any) -> RunEnded:
        """The end of a run in which it touches all round."""
        message = f"{self} touch all round the axis at t = {data.time:.6g} s, where the contact normal is not defined"
        return RunEnded(
            Outcome.UNSUPPORTED_CONTACT,
            f"{message}: end the phase before, begin the cone at 'from_m', or let it bounce (restitution)",
        )

    def _candidates(self, model: Any, data: Any, place: FloatArray) -> list[GapFunction]:
        """Features for each part of the cone, of a place in the world."""
        body = Body(model, self._body)
        motion = body.motion(data)
        x, y, z = (place - motion.origin).tolist()
        centre = motion.local((x, y, z))
        point = Point(self._contact.name, body, centre, self._contact.radius, _NO_CONE)
        rims: tuple[ConePart, ...] = ("mouth", "throat") if self._contact.radius > 0.0 else ()
        parts: tuple[ConePart, ...] = ("surface", *rims)
        name = {"surface": f"{point.name} on cone", "mouth": f"{point.name} on mouth", "throat": f"{point.name} on throat"}
        return [PointOnCone(name[part], not self._on_a, self._cone, point, part) for part in parts]


def _closed(features: Sequence[GapFunction], data: Any) -> list[GapFunction]:
    """Of some features of one contact, the one in contact that is furthest inside its bounds; none if there is none."""
    states = [feature.at(data) for feature in features]
    near = [
        (state.inside, k)
        for k, state in enumerate(states)
        if abs(state.gap) <= CONTACT_GAP_M and state.inside >= -0.5 * FEATURE_BOUND_M
    ]
    return [features[max(near)[1]]] if near else []


class RoundConePair(ConePair):
    """A cone and a rim of a cylinder or an ellipsoid: one of the places at which its distance has a local minimum.

    Attributes:
        slot: Which of them.
    """

    @dataclass
    class State(ConePair.State):
        """What tells the places apart, too."""

        generators: Any

    def __init__(self, *arguments: Any, generators: NearestGenerators, slot: int) -> None:
        """See :class:`ConePair`; ``generators`` is shared by all pairs of the rim or ellipsoid."""
        super().__init__(*arguments)
        self._generators, self.slot = generators, slot
        self._closed_points: tuple[Feature, ...] = ()
        assert self._contact.squares is not None
        self._squares = self._contact.squares.tolist()

    def gap(self, model: Any, data: Any, limit: float = FAR_M) -> float:  # noqa: ARG002
        """The same of all places of the rim or ellipsoid: one may go, and come where another is, nearer than it was.

        While persistent contact holds the other place, that is no place of this pair, and it may come where none is.
        """
        if self._generators.is_closed(1 - self.slot):
            place = self._place(data)
            if place is None:
                return limit if self._is_level(data) else min(limit, self._generators.least_elsewhere(data))
            return min(limit, self._seen(data, place)[0])
        return min([limit, *(self._seen(data, place)[0] for place in self._generators.places(data))])

    def hold(self, features: Sequence[Any]) -> None:
        """Note whether persistent contact holds this place, and of a level rim by which points."""
        self._closed_points = tuple(features)
        self._generators.hold(self.slot, closed=bool(features))

    def _place(self, data: Any) -> FloatArray | None:
        if self._is_level(data):
            return self._extreme(data, self._fixed(data)) if self.slot == 0 else None
        return self._generators.place(data, self.slot)

    def _fixed(self, data: Any) -> FloatArray:
        """A direction across the axis that is fixed to the cone."""
        return np.asarray(data.xmat[self._cone.body.id].reshape(3, 3) @ self._cone.outward(0.0))

    def _extreme(self, data: Any, outward: FloatArray) -> FloatArray:
        """The point next to the generator in a direction from the axis of the cone, in the world, (3,), m."""
        rotation = data.geom_xmat[self._geom].reshape(3, 3)
        against = (self._cone.cosine * outward - self._cone.sine * self._axis(data)) @ rotation
        scaled = self._contact.squares * against
        return np.asarray(
            data.geom_xpos[self._geom] + rotation @ (self._contact.place + scaled / math.sqrt(scaled @ against))
        )

    def _is_level(self, data: Any) -> bool:
        """Whether a rim or an ellipsoid of revolution touches all round: gaps there differ by less than contact."""
        if self._contact.name != "rim":
            return self._generators.variation(data) <= 0.5 * CONTACT_GAP_M
        axis, rotation = self._axis(data), data.geom_xmat[self._geom].reshape(3, 3)
        rim = math.copysign(1.0, float(rotation[:, 2] @ axis)) * rotation[:, 2]
        tilt, radius = rim - float(rim @ axis) * axis, math.sqrt(self._squares[0])
        if math.hypot(*tilt) > level_tilt(self._cone, radius):
            return False
        body = self._cone.body.id
        apex = data.xpos[body] + data.xmat[body].reshape(3, 3) @ self._cone.apex
        offset = data.geom_xpos[self._geom] + rotation @ self._contact.place - apex
        # The distance varies round the axis with the offset of the centre, and with the height of the rim.
        varies = self._cone.cosine * (offset - float(offset @ axis) * axis) + radius * self._cone.sine * tilt
        return math.hypot(*varies) <= 0.25 * CONTACT_GAP_M

    def _all_round(self, data: Any, place: FloatArray) -> tuple[Proximity, ...]:
        """Proximities of four points of a level rim or ellipsoid: those held, or that of the fastest approach first."""
        if not self._is_level(data):
            return super()._all_round(data, place)
        first, still = self._fixed(data), 2.0
        if self._closed_points:
            # They turn with the rim, and their rates drift by the truncation error of a step.
            motion = self._cone.body.motion(data)
            x, y, z = (self._closed_points[0].at(data).point - motion.origin).tolist()
            _, _, away = from_axis(self._cone, motion.local((x, y, z)))
            first, still = np.array(motion.turned(away)), CLOSED_RATE / RATE
        second = np.cross(self._axis(data), first)
        east, north, west, south = (self._rim_point(data, way, "") for way in (first, second, -first, -second))
        # Rates vary round the axis as its sine and cosine.
        fastest = (west.rate - east.rate) * first + (south.rate - north.rate) * second
        speed = math.hypot(*fastest)
        if speed > still * east.rate_tolerance:
            first = fastest / speed
            second = np.cross(self._axis(data), first)
        # Patches of their own: points of one patch share a normal.
        return tuple(self._rim_point(data, way, str(k)) for k, way in enumerate((first, second, -first, -second)))

    def _rim_point(self, data: Any, outward: FloatArray, patch: str) -> Proximity:
        place = self._extreme(data, outward)
        gap, _, seen, way = self._seen(data, place)
        return self._along(data, place, gap, self._inward(data, seen, way), patch)

    def recall(self, data: Any, point: FloatArray) -> None:
        """Take a logged contact point as its own: that pair of the two has it that had it in the run."""
        if point.shape == (3,) and np.isfinite(point).all():  # a log may be of unknown origin
            self._generators.recall(data, self.slot, point)

    def _touches_round(self, model: Any, data: Any, rho: float) -> bool:
        return self._is_level(data) or (self._contact.name != "rim" and super()._touches_round(model, data, rho))

    def _margin(self, model: Any, data: Any, rho: float) -> float:
        """See :func:`~ffsm_mj.contact.features.cone_gaps.curvature_margin`."""
        outward = data.xmat[self._cone.body.id].reshape(3, 3) @ self._cone.outward(self._generators.angle(data, self.slot))
        around, inward = (
            np.cross(self._axis(data), outward),
            self._cone.sine * self._axis(data) - self._cone.cosine * outward,
        )
        stiff = float(around @ self._curvature_radii(model, data, -inward) @ around)
        return curvature_margin(self._cone, rho, stiff)

    def features_at(self, model: Any, data: Any, near: Proximity) -> list[GapFunction]:
        """The contact feature at the state in ``data``; of a level rim that at the point of a proximity.

        Raises:
            RunEnded: The rim or ellipsoid is curved nearly as the cone is: it would touch along more than a point.
        """
        place = self._place(data)
        if place is not None and self._contact.name == "rim" and self._is_level(data):
            core = round_core(model, data, self._geom, self._contact)
            assert isinstance(core, Circle)
            motion = core.body.motion(data)
            x, y, z = (near.points[0] - motion.origin).tolist()
            point = Point("rim", core.body, motion.local((x, y, z)), 0.0, _NO_CONE)
            return _closed([LevelRimOnCone("level rim on cone", not self._on_a, self._cone, point, core)], data)
        if place is not None:
            gap, rho, _, _ = self._seen(data, place)
            touches = abs(gap) <= CONTACT_GAP_M and not self._is_level(data)
            if touches and self._margin(model, data, rho) < -0.5 * FEATURE_BOUND_M:
                message = (
                    f"{self} stay in contact at t = {data.time:.6g} s where the {self._contact.name} is curved as the cone"
                )
                change = "change the half angle or its size, or let it bounce (restitution)"
                raise RunEnded(Outcome.UNSUPPORTED_CONTACT, f"{message}: it touches along more than a point; {change}")
        return super().features_at(model, data, near)

    def _curvature_radii(self, model: Any, data: Any, direction: FloatArray) -> FloatArray:
        if self._is_level(data):
            return np.zeros((3, 3))  # each point of the rim stays in contact by itself
        return Shape(model, data, self._geom).radii(direction)

    def _candidates(self, model: Any, data: Any, place: FloatArray) -> list[GapFunction]:  # noqa: ARG002
        angle = self._generators.angle(data, self.slot)
        core = round_core(model, data, self._geom, self._contact)
        return [RoundOnCone(f"{core.name} on cone", not self._on_a, self._cone, core, angle)]
