"""Where viewers and pages look from: the direction that hides least of the first contact, the tip and the base."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property
from itertools import product

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.rigid_body import rotation_matrix
from ffsm_mj.log.drawing import box_points, colour_of, geoms_to_draw, marker_scale
from ffsm_mj.model.system import System


def _unit(vector: Iterable[float]) -> FloatArray:
    array = np.array(tuple(vector), dtype=np.float64)
    return np.asarray(array / np.linalg.norm(array))


USUAL = _unit((-0.1, -0.56, 0.82))
"""Above and a little behind, so that a planar robot fills the view."""
_ELEVATIONS_DEG, _AZIMUTHS = (20.0, 38.0, 55.0, 72.0), 12
"""Other directions, all from above: floors would hide a scene from below."""
_STEEPEST = 0.02
"""Least horizontal part of a direction: a camera that looks straight down would not know what is up in its picture."""


def directions() -> FloatArray:
    """Directions to choose from, unit vectors from the scene to the camera, (n, 3); the usual one is the first."""
    turns = 2.0 * np.pi * np.arange(_AZIMUTHS) / _AZIMUTHS
    rises = np.radians(_ELEVATIONS_DEG)
    others = [(np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)) for e, a in product(rises, turns)]
    return np.vstack((USUAL, others))


def aimed(points: FloatArray, back: FloatArray, half_view: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    """Position of a camera that sees points from as near as possible, and the point at which it looks, (3,) each, m.

    Args:
        points: Points to keep in view, (n, 3), m.
        back: Unit vector from the scene to the camera.
        half_view: Tangents of half the horizontal and vertical field of view.
    """
    right = _unit(np.cross([0.0, 0.0, 1.0], back))
    view = np.stack((right, np.cross(back, right), back))
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    distance = 0.0
    for _ in range(4):  # perspective: the middle of the picture is not the projection of the middle of the box
        viewed = (points - centre) @ view.T
        distance = float(np.max(np.abs(viewed[:, :2]) / half_view + viewed[:, 2:]))
        flat = viewed[:, :2] / np.maximum(distance - viewed[:, 2:], 1e-9)
        middle = 0.5 * (flat.min(axis=0) + flat.max(axis=0)) * distance
        centre = centre + middle @ view[:2]
    return centre + distance * back, centre


_SHARES = np.array(list(product((-0.6, 0.0, 0.6), repeat=3)))
"""Points in the box of a geom, relative to its half sizes."""
_MOST_POINTS = 81
"""Greatest number of points of one body: bodies may have hundreds of geoms."""
_NEAR = 0.3
"""Distance from a contact, at marker scale 1, at which a surface in front of it hides it fully, m: nearer ones are those
that touch, whose contact is seen between them from the side only."""
_OPAQUE = 0.5
"""Opacity from which a geom hides what is behind it."""
_WEIGHTS = {"contact": 3.0, "tip": 1.5, "base": 1.0, "apart": 0.7, "usual": 0.5}
"""Contact, tip and base: how much of each is seen. Apart: how far tip and base are from each other in the picture. Usual:
nearness to the usual direction."""
_CLEARLY = 0.5
"""Gain below which the usual direction is kept: a sixth of the contact, a third of the tip."""


class SeenScene:
    """What is seen of a scene, by rays from the camera to points of it.

    Attributes:
        contacts: Points of the first contact, (n, 3), m; none before a contact.
    """

    def __init__(self, system: System, positions: FloatArray, quaternions: FloatArray, contacts: FloatArray) -> None:
        """Pose the drawn geoms.

        Args:
            system: Robot and objects.
            positions: World positions of all bodies, (nbody, 3), m.
            quaternions: World orientations of all bodies, wxyz, (nbody, 4).
            contacts: Points of the first contact, (n, 3), m.
        """
        self._system, self._poses, self.contacts = system, (positions, quaternions), contacts
        model, self._data = system.mj, mujoco.MjData(system.mj)
        self._drawn = set(geoms_to_draw(model))
        self._near_m = _NEAR * marker_scale(system)
        for geom in range(model.ngeom):
            body = int(model.geom_bodyid[geom])
            turn = rotation_matrix(quaternions[body])
            hides = geom in self._drawn and colour_of(system, geom)[3] >= _OPAQUE
            # Rays meet every geom of a model; those that hide nothing are put out of their way.
            self._data.geom_xpos[geom] = positions[body] + turn @ model.geom_pos[geom] if hides else 1e9
            self._data.geom_xmat[geom] = (turn @ rotation_matrix(model.geom_quat[geom])).ravel()

    @cached_property
    def tip(self) -> int:
        """Body of the robot that is nearest to the contact; without one the last body of its longest chain."""
        parents, bodies = self._system.mj.body_parentid, [body for body in self._system.robot.bodies if self._geoms(body)]
        if not bodies:
            return self._system.robot.root
        if len(self.contacts):
            return min(bodies, key=self._distance_m)
        depths = {0: 0}
        for body in range(1, len(parents)):
            depths[body] = depths[int(parents[body])] + 1
        return max(bodies, key=depths.__getitem__)

    def _geoms(self, body: int) -> list[int]:
        return [geom for geom in sorted(self._drawn) if int(self._system.mj.geom_bodyid[geom]) == body]

    def _distance_m(self, body: int) -> float:
        """Distance of the first contact point from the boxes of the geoms of a body, m."""
        model, (positions, quaternions) = self._system.mj, self._poses
        local = rotation_matrix(quaternions[body]).T @ (self.contacts[0] - positions[body])
        outside = []
        for geom in self._geoms(body):
            around = model.geom_aabb[geom]
            in_geom = rotation_matrix(model.geom_quat[geom]).T @ (local - model.geom_pos[geom]) - around[:3]
            outside.append(float(np.linalg.norm(np.maximum(np.abs(in_geom) - around[3:], 0.0))))
        return min(outside)

    @cached_property
    def _points(self) -> dict[int, FloatArray]:
        """Points in the geoms of tip and base, (n, 3), m."""
        bodies, model = {self.tip, self._system.robot.root}, self._system.mj
        inside = {body: box_points(model, self._geoms(body), *self._poses, _SHARES) for body in bodies}
        return {body: points[:: max(1, -(-len(points) // _MOST_POINTS))] for body, points in inside.items()}

    def first_hits(self, eye: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Where rays from the camera first meet a body, as a fraction of the way to each point, and its id; -1: none."""
        model, fractions, bodies = self._system.mj, np.empty(len(points)), np.full(len(points), -1)
        geom = np.empty(1, dtype=np.int32)
        # One by one: mj_multiRay sorts geoms out by poses of bodies that only a whole step of kinematics sets.
        for i, ray in enumerate(points - eye):
            fractions[i] = mujoco.mj_ray(model, self._data, eye, ray, None, True, -1, geom)
            bodies[i] = model.geom_bodyid[geom[0]] if geom[0] >= 0 else -1
        return fractions, bodies

    def contact_seen(self, eye: FloatArray) -> float:
        """How freely the contact is seen, from 0 (hidden by something before it) to 1; 1 without a contact."""
        if not len(self.contacts):
            return 1.0
        fractions, _ = self.first_hits(eye, self.contacts)
        depths = np.linalg.norm(self.contacts - eye, axis=1)
        before_m = np.where(fractions >= 0.0, np.maximum(1.0 - fractions, 0.0) * depths, 0.0)
        return float(np.mean(np.maximum(1.0 - before_m / self._near_m, 0.0)))

    def body_seen(self, eye: FloatArray, body: int) -> float:
        """Share of the points of tip or base with no other body in front of them; 1 for a body without geoms."""
        points = self._points[body]
        if not len(points):
            return 1.0
        fractions, bodies = self.first_hits(eye, points)
        return float(np.mean((fractions < 0.0) | (fractions > 1.0) | (bodies == body)))

    def score(self, back: FloatArray, points: FloatArray, half_view: tuple[float, float]) -> float:
        """How well a direction shows contact, tip and base, with points to keep in view."""
        eye, _ = aimed(points, back, half_view)
        base, tip = self._system.robot.root, self.tip
        between = (self.contacts[0] if len(self.contacts) else self._poses[0][tip]) - self._poses[0][base]
        length = float(np.linalg.norm(between))
        terms = {
            "contact": self.contact_seen(eye),
            "tip": self.body_seen(eye, tip),
            "base": self.body_seen(eye, base),
            "apart": float(np.linalg.norm(np.cross(between, back))) / length if length > 0.0 else 0.0,
            "usual": float(back @ USUAL),
        }
        return float(sum(_WEIGHTS[name] * value for name, value in terms.items()))

    def best(self, points: FloatArray, half_view: tuple[float, float]) -> FloatArray:
        """Direction from the scene to the camera, (3,): the usual one, or the first that shows clearly most."""
        # Scores are rounded, so that machines whose arithmetic differs in the last bit choose the same view.
        usual, *others = ((round(self.score(back, points, half_view), 6), back) for back in directions())
        best = max(others, key=lambda scored: scored[0])
        return np.asarray(best[1] if best[0] > usual[0] + _CLEARLY else usual[1])


def direction(
    view: Iterable[float] | None,
    posed: tuple[System, FloatArray, FloatArray],
    contacts: FloatArray,
    points: FloatArray,
    half_view: tuple[float, float],
) -> FloatArray:
    """Direction from the scene to the camera, (3,): the ``view`` of a scenario, or without one that which shows most.

    Args:
        view: The view, tilted a little if it is vertical.
        posed: Robot and objects with positions and orientations of their bodies, see :class:`SeenScene`.
        contacts: Points of the first contact, (n, 3), m.
        points: Points to keep in view, (n, 3), m.
        half_view: Tangents of half the horizontal and vertical field of view.
    """
    if view is None:
        return SeenScene(*posed, contacts).best(points, half_view)
    back = _unit(view)
    if np.hypot(back[0], back[1]) < _STEEPEST:
        back[:2] = 0.0, -_STEEPEST
    return _unit(back)


def framed_points(system: System, positions: FloatArray, quaternions: FloatArray) -> FloatArray:
    """Corners of the boxes of the drawn geoms of moving bodies, (n, 3), m; else the origins of all bodies.

    Fixed bodies may be large and are left out.
    """
    model, still = system.mj, {0, *system.fixed_bodies}
    geoms = [geom for geom in geoms_to_draw(model) if int(model.geom_bodyid[geom]) not in still]
    return box_points(model, geoms, positions, quaternions) if geoms else np.asarray(positions[1:])
