"""Contact pairs: two geoms with their gap, normal, contact points, gap rates and bounds on the closing speed.

MuJoCo's own contact forces are off; each pair is queried for its distance.

Caps of cylinders in flat contact: the point of the rim at which the gap closes fastest.

A few fixed points represent the rim, and span a polygon within the disc. While the cylinder tips between two of them, the
point of the rim that comes nearest is none of them. The gap rate is linear in the position, so its minimum over a disc is at
one point of the rim, which is known in closed form.

Unilateral constraints: what an impact or a persistent contact can act on.

Both kinds have the same interface: a gap with its rate, second rate and rounding
(:class:`~ffsm_mj.contact.proximity.Proximity`), bounds on the closing speed, and a coefficient of restitution. Pairs of
geoms add a normal, contact points, features and friction.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias

import mujoco
import numpy as np

from ffsm_mj._core.gap_rates import RelativeVelocity
from ffsm_mj._core.polygons import touching_set
from ffsm_mj._core.shapes import separation
from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.cells import chosen_cell, separating_normals
from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.contact.motion_bound import MotionBound
from ffsm_mj.contact.normal import ContactNormal, HalfSpaceNormal, NormalSearch, SphereNormal
from ffsm_mj.contact.patch import caps_of, facing, flush_offset
from ffsm_mj.contact.proximity import FAR_M, Proximity, SecondRate, second_rate
from ffsm_mj.contact.shape import Part, Shape, position_tolerance, side_radius
from ffsm_mj.contact.surfaces import AT_POINT_M
from ffsm_mj.dynamics.rigid_body import cross
from ffsm_mj.model.system import System
from ffsm_mj.state import Stateful
from ffsm_mj.tolerances import CONTACT_GAP_M, EPSILON


def lowest_of_rims(shapes: tuple[Shape, Shape], normal: FloatArray, spin: FloatArray, level: float) -> Iterator[FloatArray]:
    """For each cap of two geoms in flat contact: the rim point at which the gap rate is least, (1, 3), if it is in contact.

    Args:
        shapes: The two geoms.
        normal: Unit normal from the first geom to the second.
        spin: Angular velocity of the second geom relative to the first; the gap rate increases along normal x spin.
        level: Tolerance of :func:`~ffsm_mj._core.polygons.touching_set`, m.
    """
    caps = caps_of(*shapes, normal)
    for mine, cap in enumerate(caps):
        lowest = cap.towards(cross(spin, normal)) if cap else None
        if cap is None or lowest is None:
            continue
        features = list(facing(*shapes, normal))
        features[mine] = np.concatenate((features[mine], lowest[None]))
        if opposite := caps[1 - mine]:
            features[1 - mine] = np.concatenate((features[1 - mine], opposite.covered(lowest[None])))
        points = touching_set(features[0], features[1], normal, level)
        apart = np.linalg.norm(cap.axes @ (points - lowest).T, axis=0)
        if (apart <= level).any():
            yield points[[int(np.argmin(apart))]]


_UNSUPPORTED = {
    int(mujoco.mjtGeom.mjGEOM_HFIELD): "height field",
    int(mujoco.mjtGeom.mjGEOM_SDF): "signed distance field",
}
_SPHERE, _CYLINDER = int(mujoco.mjtGeom.mjGEOM_SPHERE), int(mujoco.mjtGeom.mjGEOM_CYLINDER)
_BOX = int(mujoco.mjtGeom.mjGEOM_BOX)
_ELLIPSOID, _PLANE = int(mujoco.mjtGeom.mjGEOM_ELLIPSOID), int(mujoco.mjtGeom.mjGEOM_PLANE)
_NEAREST = {_SPHERE, _BOX, _CYLINDER, int(mujoco.mjtGeom.mjGEOM_CAPSULE)}
"""Geoms whose point nearest to a given one is a closed form."""
_GAP_ROUNDING_M = 1e-14
"""Rounding of a gap at the origin; it grows with the distance from there."""


def shape_fault(system: System, geom: int) -> str:
    """Why a geom (id) has no exact distance; empty if it has."""
    shape = _UNSUPPORTED.get(int(system.mj.geom_type[geom]))
    if shape is None or geom in system.pieces:
        return ""
    name = system.mj.geom(geom).name
    return (
        f"geom {name!r} is a {shape}: impacts need convex geoms (sphere, capsule, box, ...), planes or fixed height fields"
    )


def gap_rounding(points: FloatArray) -> float:
    """Rounding of a gap at some points, m; world axes, (k, 3)."""
    return _GAP_ROUNDING_M + 4.0 * EPSILON * float(np.abs(points).max())


class ContactPair(Stateful):
    """Two geoms, a and b, on bodies that move relative to each other; one of them may be on a fixed object.

    Attributes:
        name: Name, unique among the pairs of a run.
        rule: Name of the contact rule that it belongs to; its own name without one.
        geom_a: Full name of the geom that the normal points away from.
        geom_b: Full name of the geom that the normal points to.
        body_a: Id of the body of a.
        body_b: Id of the body of b.
        robot_on_object: Whether a belongs to the robot and b to an object, floating or fixed.
        restitution: Coefficient of restitution e.
        mu: Coefficient of friction.
        compliance_ratio: Tangential over normal compliance, k_n / k_t; 0: rigid across the normal.
        geom_ids: Ids of both geoms.
        position_tolerance: Sum of the tolerances to which the points of both geoms are known, m: 0 except for meshes.
        flush_offset: Offset of round sides that lie along each other; see :func:`~ffsm_mj.contact.patch.flush_offset`.
        flush_angle: Angle of the normals at both ends of such sides, rad; 0 without round sides.
        size: Half the thinnest extent of both geoms in m; over a shorter motion the gap has at most one extremum.
        touches_once: Whether it touches at one point at most: one of the geoms is strictly convex.
        may_tie: Whether an edge or corner of one may lie exactly on one of the other: boxes. Meshes are in single
            precision, and unions decide themselves.
        rolls_on: Number of points at which a body that is nothing but one round geom lies on a plane, with all of it beyond:
            1 of strictly convex geoms, 2 of capsules of unions; 0 of other bodies.
        has_pieces: Whether it has pieces of which some may touch while others are apart.
        has_one_patch: Whether it has no more than one patch of contact, which its proximity is.
        is_beside: Whether the bodies may touch beside the face on which they lie flat.
        on_left: Called where pieces cease to be watched by contact points: they are to be followed by distance again.
        is_limit: False: it is no joint limit.
        parts: Parts of the geoms that touch; None: a whole geom.
    """

    is_limit: Literal[False] = False
    has_pieces = False
    has_one_patch = True
    is_beside = False
    parts: tuple[Part | None, Part | None] = (None, None)
    compliance_ratio: float = 0.0

    @dataclass
    class State:
        """The normal found last."""

        search: Any

    def __init__(
        self,
        system: System,
        name: str,
        geom_a: str | int,
        geom_b: str | int,
        restitution: float,
        mu: float = 0.0,
        *,
        rule: str = "",
    ) -> None:
        """Resolve names and constants; geoms are given by name or id.

        Raises:
            LookupError: An unknown geom, a geom of the world itself, two geoms that do not move relative to each other, or
                a shape without an exact distance.
        """
        model = system.mj
        self._g1, self._g2 = (system.index("geom", g) if isinstance(g, str) else g for g in (geom_a, geom_b))
        self.name, self.rule = name, rule or name
        self.geom_a, self.geom_b = model.geom(self._g1).name, model.geom(self._g2).name
        self.body_a, self.body_b = int(model.geom_bodyid[self._g1]), int(model.geom_bodyid[self._g2])
        self.geom_ids = frozenset((self._g1, self._g2))
        self._kinds = {int(model.geom_type[g]) for g in self.geom_ids}
        scatters = _ELLIPSOID in self._kinds or (_CYLINDER in self._kinds and _SPHERE not in self._kinds)
        self._query_scatters = scatters and _PLANE not in self._kinds
        self.touches_once, self.may_tie = bool({_SPHERE, _ELLIPSOID} & self._kinds), self._kinds == {_BOX}
        self.rolls_on = int(self.touches_once)
        self.on_left: Callable[[], None] = _nothing
        self._check(system)
        on_robot = [body in system.robot.bodies for body in (self.body_a, self.body_b)]
        self.robot_on_object = on_robot == [True, False]
        self.restitution, self.mu = restitution, mu
        self.size = 0.5 * float(min(model.geom_aabb[self._g1, 3:].min(), model.geom_aabb[self._g2, 3:].min()))
        self.position_tolerance = position_tolerance(model, self._g1) + position_tolerance(model, self._g2)
        self._velocity = RelativeVelocity(model, self.body_a, self.body_b)
        radius = side_radius(model, self._g1) + side_radius(model, self._g2)
        self.flush_offset, self.flush_angle = flush_offset(radius), flush_offset(radius) / radius if radius > 0.0 else 0.0
        self._radii = float(model.geom_rbound[self._g1]), float(model.geom_rbound[self._g2])
        self._bound = MotionBound(model, self.ids)
        self._search = self._normal_search()

    def _normal_search(self) -> NormalSearch:
        search = NormalSearch
        if _PLANE in self._kinds:
            search = HalfSpaceNormal
        elif _SPHERE in self._kinds and self._kinds <= _NEAREST:
            search = SphereNormal
        return search(self.ids, self.size, self.flush_offset)

    def _check(self, system: System) -> None:
        model = system.mj
        for geom, name, body in ((self._g1, self.geom_a, self.body_a), (self._g2, self.geom_b, self.body_b)):
            if fault := shape_fault(system, geom):
                raise LookupError(fault)
            if system.tree_of_body(body) is None and body not in system.fixed_bodies:
                raise LookupError(f"geom {name!r} is fixed to the world: move it to an object with 'fixed: true'")
        if system.fixed_bodies.issuperset((self.body_a, self.body_b)):
            raise LookupError(f"geoms {self.geom_a!r} and {self.geom_b!r} are both fixed: they cannot meet")
        if model.body_weldid[self.body_a] == model.body_weldid[self.body_b]:
            raise LookupError(f"geoms {self.geom_a!r} and {self.geom_b!r} are on one rigid body: they cannot meet")

    @property
    def geoms(self) -> tuple[str, str]:
        """Full names of a and b."""
        return self.geom_a, self.geom_b

    def geoms_at(self, near: Proximity, point: FloatArray) -> tuple[str, str]:  # noqa: ARG002
        """Full names of the geoms of a and b that touch at one of the points of a proximity."""
        return self.geoms

    def geoms_among(self, model: Any, data: Any, points: Iterable[FloatArray]) -> tuple[str, str]:  # noqa: ARG002
        """Full names of two geoms of a and b that touch at one of some contact points at the state in ``data``."""
        return self.geoms

    @property
    def together(self) -> Sequence[ContactPair]:
        """It and the pairs of the same bodies whose contact may go on with its own: of unions those of other rules."""
        return (self,)

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

    @property
    def radii(self) -> tuple[float, float]:
        """Radii of the spheres around the centres of both geoms that contain all that can touch, m."""
        return self._radii

    @property
    def geom_pairs(self) -> tuple[frozenset[int], ...]:
        """Ids of both geoms of every two geoms that can touch: one here, several between unions."""
        return (self.geom_ids,)

    def shapes(self, model: Any, data: Any) -> tuple[Shape, Shape]:
        """Shapes of a and b at the state in ``data``."""
        return Shape(model, data, self._g1), Shape(model, data, self._g2)

    def gap(self, model: Any, data: Any, limit: float = FAR_M) -> float:
        """Signed distance in m from a distance query, negative when overlapping; ``limit`` if it is larger."""
        return self._search.distance(model, data, limit)

    def watched_gap(self, model: Any, data: Any, limit: float) -> float:
        """The gap of what event location has to follow: all of it; see :meth:`gap`."""
        return self.gap(model, data, limit)

    def watched_proximity(self, model: Any, data: Any) -> Proximity:
        """The proximity of what event location has to follow: all of it; see :meth:`proximity`."""
        return self.proximity(model, data)

    def apart_within(self, model: Any, data: Any, reach: float) -> Iterable[ContactPair]:  # noqa: ARG002
        """What event location follows of it, given how near it may have come in m: all of it."""
        return (self,)

    def refuse_passage(self, first: Proximity, last: Proximity) -> None:
        """End the run if it passes between two instants in a way that no contact model covers; geoms never do."""

    def watched_by_points(self, model: Any, data: Any) -> Sequence[ContactPair]:  # noqa: ARG002
        """What contact points watch of it at the state in ``data`` while persistent contact holds it: all of it."""
        return (self,)

    def hold(self, features: Sequence[Any]) -> None:
        """Note the contact points that persistent contact holds; see :class:`~ffsm_mj.contact.union_pair.UnionPair`."""

    def join(self, model: Any, data: Any) -> None:
        """Watch by contact points what touches in patches that are held at the state in ``data``, from here on."""

    def joining(self) -> Any:
        """What :meth:`join` has found, as a state; None: nothing."""

    def set_joining(self, state: Any) -> None:
        """Take back what :meth:`joining` gave, with the same points held."""

    def lie_on(self, face: Any) -> None:
        """Note a corner on the face on which the bodies lie flat; None: they do not."""

    def gap_to_rounding(self, model: Any, data: Any, gap: float) -> float:
        """The gap at the state in ``data``, to rounding.

        Args:
            model: MuJoCo model.
            data: Its data, kinematics current.
            gap: What :meth:`gap` says there; it is to rounding already unless the query iterates on a curved surface.
        """
        if not self._query_scatters:
            return gap
        return self._contact_normal(model, data, self.shapes(model, data)).gap

    def _contact_normal(self, model: Any, data: Any, shapes: tuple[Shape, Shape]) -> ContactNormal:
        """Contact normal at the state in ``data``, and what it was found from."""
        return self._search.normal(model, data, shapes)

    def recall(self, data: Any, point: FloatArray) -> None:
        """Take a logged contact point as its own at the state in ``data``, where earlier states say which one it is."""

    def closing_speed_bound(self, data: Any) -> float:
        """Bound on the closing speed for the velocities in ``data``, m/s."""
        return self._bound.closing_speed(data)

    def proximities(self, model: Any, data: Any) -> tuple[Proximity, ...]:
        """All patches of contact at the state in ``data``: one of two convex geoms; see :meth:`proximity`."""
        return (self.proximity(model, data),)

    def proximity(self, model: Any, data: Any) -> Proximity:
        """Gap, normal, points and rates at the state in ``data`` (kinematics and velocities current)."""
        shapes = self.shapes(model, data)
        normal, features, witness, gap = self._contact_normal(model, data, shapes)
        points = touching_set(*features, normal, CONTACT_GAP_M + self.position_tolerance, self.flush_offset)
        # Features that do not overlap in projection, as corners that are too close: the middle of the witness points serves.
        points = points if len(points) else witness[None]
        rounding = gap_rounding(points)
        rates, tolerance = self._velocity.along(data, normal, points)
        near = Proximity(gap, normal, points, rates, tolerance, rounding)
        if self.may_tie and near.gap <= CONTACT_GAP_M:
            return self._untied(shapes, data, near)
        return self._with_rims(shapes, data, near) if self.is_of(mujoco.mjtGeom.mjGEOM_CYLINDER) else near

    def _untied(self, shapes: tuple[Shape, Shape], data: Any, near: Proximity) -> Proximity:
        """The proximity along a normal that the motion agrees with, where edges or corners lie on each other exactly.

        Any normal between those of the faces that end there parts the boxes, and the search finds one of them: they overlap
        only if they approach along all (:mod:`ffsm_mj.contact.cells`).
        """
        choices = np.empty((0, 3))
        for point in near.points:
            a, b = (shape.normals_at(point, AT_POINT_M) for shape in shapes)
            # A point that one of them has within a face or outside has one normal, and with it all points of the patch.
            if a is None or b is None or min(len(a), len(b)) < 2 or len(choices := separating_normals(a, b)) < 2:
                return near
        cells = [normal[None] for normal in choices if self._parted_along(shapes, data, normal) is not None]
        motions = np.array([self._velocity.at(data, point) for point in near.points])
        chosen = chosen_cell(cells, motions, near.rate_tolerance, near.normal)
        return next((one for normal in chosen if (one := self._parted_along(shapes, data, normal)) is not None), near)

    def _parted_along(self, shapes: tuple[Shape, Shape], data: Any, normal: FloatArray) -> Proximity | None:
        """The proximity along a normal; None if it does not part the geoms."""
        points = touching_set(*facing(*shapes, normal), normal, CONTACT_GAP_M)
        if not len(points) or (gap := separation(*shapes, normal)) < -CONTACT_GAP_M:
            return None
        rates, tolerance = self._velocity.along(data, normal, points)
        return Proximity(gap, normal, points, rates, tolerance, gap_rounding(points))

    def _with_rims(self, shapes: tuple[Shape, Shape], data: Any, near: Proximity) -> Proximity:
        """Add the point of a cap's rim at which the gap closes fastest, if it closes faster there than at all points."""
        spin = data.cvel[self.body_b][:3] - data.cvel[self.body_a][:3]
        for lowest in lowest_of_rims(shapes, near.normal, spin, CONTACT_GAP_M + self.position_tolerance):
            rates = self._velocity.along(data, near.normal, lowest)[0]
            if rates[0] < min(near.rate, 0.0) - near.rate_tolerance:
                near = replace(near, points=np.concatenate((near.points, lowest)), rates=np.append(near.rates, rates))
        return near

    def at_velocities(self, data: Any, near: Proximity) -> Proximity:
        """The proximity with the gap rates of the velocities in ``data``, after these changed at one instant."""
        rates, tolerance = self._velocity.along(data, near.normal, near.points)
        return replace(near, rates=rates, rate_tolerance=tolerance)

    def second_rate(self, model: Any, data: Any, near: Proximity, point: FloatArray) -> SecondRate:
        """Second rate of the gap at one of the points of a proximity; accelerations in ``data`` must be current."""
        shapes = self.shapes(model, data)
        half = 0.5 * near.gap * near.normal
        bodies, points = (self.body_a, self.body_b), (point - half, point + half)
        return second_rate(model, data, bodies, shapes, near.normal, points)

    def is_pressed(self, model: Any, data: Any, near: Proximity) -> bool:
        """Whether a closed pair at rest begins to overlap under the efforts in ``data``."""
        # A point that separates does not overlap soon, whatever its second rate: only the others count.
        points = (point for point, rate in zip(near.points, near.rates.tolist(), strict=True) if rate <= near.rate_tolerance)
        rates = (self.second_rate(model, data, near, point) for point in points)
        return any(rate.value < -rate.rounding for rate in rates)

    def rate_along(self, data: Any, normal: FloatArray, point: FloatArray) -> float:
        """Velocity of b relative to a at a point along a unit vector, m/s; velocities in ``data`` current."""
        return float(self._velocity.along(data, normal, point[None])[0][0])

    def slip(self, data: Any, normal: FloatArray, point: FloatArray) -> FloatArray:
        """Tangential velocity of b relative to a at a point, world axes, (3,), m/s."""
        relative = self._velocity.at(data, point)
        return np.asarray(relative - (relative @ normal) * normal)


def _nothing() -> None:
    """Nobody follows pieces."""


UnilateralConstraint: TypeAlias = ContactPair | JointLimit
"""Two geoms that cannot overlap, or a joint that cannot move beyond one end of its range."""


def by_kind(constraints: Iterable[UnilateralConstraint]) -> tuple[list[ContactPair], list[JointLimit]]:
    """Pairs of geoms, and joint limits."""
    every = tuple(constraints)
    return [pair for pair in every if not pair.is_limit], [limit for limit in every if limit.is_limit]
