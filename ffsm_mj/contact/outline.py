"""What of a geom lies against another one: the points, lines and the face that are extreme along the contact's normal."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.carrier import Carrier, Vector, cross
from ffsm_mj.contact.cores import Circle, Core, Curve, Face, Line, Point
from ffsm_mj.contact.shape import PARALLEL, Shape
from ffsm_mj.hull import hull

_SAME_M, _STRAIGHT = 1e-12, 1e-9
"""Corners no farther apart than the first are one; one that hardly turns is none (as in :mod:`.manifold`)."""
_SINGLE = 2e-7
"""Vertices of meshes are known to this share of its size."""
_NO_CONE = np.empty((0, 3))

_G = mujoco.mjtGeom
_NAMES = {_G.mjGEOM_SPHERE: "sphere", _G.mjGEOM_CAPSULE: "end", _G.mjGEOM_CYLINDER: "rim", _G.mjGEOM_ELLIPSOID: "ellipsoid"}


class Outline:
    """One geom as it lies against another along a direction.

    Attributes:
        vague: How well the places of its points are known, in m: 0 but for meshes.
        flat: Whether it has a face there.
    """

    def __init__(self, model: Any, data: Any, geom: int, outward: FloatArray) -> None:
        """Look at a geom along a unit vector that points out of it; positions and velocities in ``data`` current."""
        self._kind = mujoco.mjtGeom(model.geom_type[geom])
        self._carrier = Carrier(model, int(model.geom_bodyid[geom]))
        self._motion = self._carrier.motion(data)
        self._rotation = data.geom_xmat[geom].reshape(3, 3)
        self._position: FloatArray = data.geom_xpos[geom]
        self._size = model.geom_size[geom].tolist()
        self._outward = outward
        self.vague = _SINGLE * float(model.geom_rbound[geom]) if self._kind == _G.mjGEOM_MESH else 0.0
        self._radius = self._size[0] if self._kind in (_G.mjGEOM_SPHERE, _G.mjGEOM_CAPSULE) else 0.0
        self._all = self._points_of(model, geom)
        extreme = Shape(model, data, geom).extreme(outward, PARALLEL) - self._radius * outward
        self._extreme = self._ordered(extreme)
        self._name = _NAMES.get(self._kind, "vertex")
        self.flat = len(self._extreme) > 2

    def _points_of(self, model: Any, geom: int) -> FloatArray:
        """All points of a polytope or a capsule's axis, (n, 3) in world axes."""
        if self._kind == _G.mjGEOM_BOX:
            signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T
            local = signs * self._size
        elif self._kind == _G.mjGEOM_CAPSULE:
            local = np.array([[0.0, 0.0, -self._size[1]], [0.0, 0.0, self._size[1]]])
        elif self._kind == _G.mjGEOM_MESH:
            mesh = int(model.geom_dataid[geom])
            first = int(model.mesh_vertadr[mesh])
            local = model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])].astype(np.float64)
        else:
            local = np.zeros((1, 3))
        return np.asarray(self._position + local @ self._rotation.T)

    def _ordered(self, points: FloatArray) -> FloatArray:
        """The corners of what points span across the normal, in order around it."""
        if len(points) < 3:
            return points
        u = np.linalg.svd(self._outward[None])[2][1]
        flat = points @ np.stack((u, np.cross(self._outward, u))).T
        corners = hull(flat, merge=_SAME_M, straight=_STRAIGHT)
        return np.asarray(points[[int(np.argmin(np.abs(flat - corner).sum(axis=1))) for corner in corners]])

    def _place(self, point: FloatArray) -> Vector:
        return self._turned(point - self._motion.origin)

    def _turned(self, vector: FloatArray) -> Vector:
        x, y, z = vector.tolist()
        return self._motion.local((x, y, z))

    def points(self) -> list[Core]:
        """What is a corner of it, with nothing said of what else is near."""
        return [self._point(point, _NO_CONE) for point in self._extreme]

    def tips(self) -> list[Core]:
        """Its corners, each with its bounds."""
        return [self._point(point, self._towards(self._all - point)) for point in self._extreme]

    def _point(self, point: FloatArray, cone: FloatArray) -> Point:
        return Point(self._name, self._carrier, self._place(point), self._radius, cone)

    def _towards(self, offsets: FloatArray) -> FloatArray:
        """Unit directions in the body's axes, (k, 3)."""
        lengths = np.linalg.norm(offsets, axis=1)
        kept = lengths > _SAME_M
        rotation = np.array(self._motion.axes).reshape(3, 3)
        return np.asarray(offsets[kept] / lengths[kept, None] @ rotation)

    def lines(self, bounded: bool = True) -> Iterable[Curve]:
        """Its straight edges, or the rim around a cap; told apart from the faces beside them where ``bounded``."""
        return self.edges(bounded)

    def edges(self, bounded: bool = True) -> Iterator[Line]:
        """Its straight edges."""
        count = len(self._extreme)
        if count > 1:
            for k in range(count if count > 2 else 1):
                yield self._line(self._extreme[k], self._extreme[(k + 1) % count], bounded)

    def _line(self, start: FloatArray, end: FloatArray, bounded: bool) -> Line:
        wedge = self._wedge(start, end) if bounded else ()
        cone = np.array(wedge).reshape(-1, 3)
        ends = (self._point(start, cone), self._point(end, cone))
        return self._straight("side" if self._radius > 0.0 else "edge", start, end, self._radius, wedge, ends)

    def _straight(
        self,
        name: str,
        start: FloatArray,
        end: FloatArray,
        radius: float,
        wedge: tuple[Vector, ...],
        ends: tuple[Point | Circle, ...],
    ) -> Line:
        span = end - start
        length = float(np.linalg.norm(span))
        centre, direction = self._place(0.5 * (start + end)), self._turned(span / length)
        return Line(name, self._carrier, centre, direction, 0.5 * length, radius, wedge, ends)

    def _wedge(self, start: FloatArray, end: FloatArray) -> tuple[Vector, ...]:
        """Directions across an edge into its two faces: the outermost of those to all other points."""
        direction = (end - start) / np.linalg.norm(end - start)
        across = self._all - start
        across = across - np.outer(across @ direction, direction)
        lengths = np.linalg.norm(across, axis=1)
        across = across[lengths > max(_SAME_M, self.vague)]
        if not len(across):
            return ()
        across /= np.linalg.norm(across, axis=1)[:, None]
        middle = across.mean(axis=0)
        turned = np.arctan2(across @ np.cross(direction, middle), across @ middle)
        return self._turned(across[np.argmin(turned)]), self._turned(across[np.argmax(turned)])

    def direction(self, core: Line | Circle) -> Vector:
        """Of a line, or of a circle where the contact begins; world axes."""
        return self._motion.turned(core.direction if isinstance(core, Line) else cross(core.axis, core.start))

    def levelled(self, core: Core) -> Core:
        """A face or line square to the contact's normal."""
        return core.levelled(self._turned(self._outward)) if isinstance(core, Face | Line) else core

    def face(self) -> Face | None:
        """Its face, or none."""
        if not self.flat:
            return None
        corners = self._extreme
        normal = self._normal(corners)
        sides = []
        for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            inwards = np.cross(normal, end - start)
            inwards /= np.linalg.norm(inwards)
            sides.append((self._turned(inwards), float(inwards @ (start - self._motion.origin))))
        return Face("face", self._carrier, self._place(corners.mean(axis=0)), self._turned(normal), tuple(sides))

    def _normal(self, corners: FloatArray) -> FloatArray:
        """Of a box its axis, of a mesh that of the plane that is nearest to its corners."""
        if self._kind == _G.mjGEOM_BOX:
            axis = self._rotation[:, int(np.argmax(np.abs(self._outward @ self._rotation)))]
        else:
            axis = np.linalg.svd(corners - corners.mean(axis=0))[2][2]
        return np.asarray(axis if axis @ self._outward > 0.0 else -axis)
