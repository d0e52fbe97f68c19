"""Outline of a geom: the points, lines and face that are extreme along a contact normal."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.features.body_motion import Body, Vector, cross, shifted
from ffsm_mj.contact.features.cores import Circle, Core, Curve, Face, Line


class Outline:
    """The extreme features of a geom along a direction.

    Attributes:
        position_tolerance: Tolerance to which its points are known, in m: 0 except for meshes.
        flat: Whether it has a face perpendicular to the direction.
    """

    position_tolerance = 0.0
    flat = False

    def __init__(self, model: Any, data: Any, geom: int, outward: FloatArray, tolerance: float) -> None:  # noqa: ARG002
        """Find the features.

        Args:
            model: MuJoCo model.
            data: Its data, positions and velocities current.
            geom: Id of the geom.
            outward: Unit vector out of the geom, world axes, (3,).
            tolerance: Tolerance to which points of both geoms are known, m.
        """
        self._body = Body(model, int(model.geom_bodyid[geom]))
        self._motion = self._body.motion(data)
        self._rotation: FloatArray = data.geom_xmat[geom].reshape(3, 3)
        self._position: FloatArray = data.geom_xpos[geom]
        self._size: list[float] = model.geom_size[geom].tolist()
        self._outward = outward

    def points(self) -> list[Core]:
        """Cores that can be in contact with a face of the other geom, without bounds."""
        return self.corners()

    def rim_points(self, places: FloatArray) -> list[Core]:  # noqa: ARG002
        """Those of some places in the world, (k, 3), that are on the rim of a cap."""
        return []

    def corners(self) -> list[Core]:
        """Corners, or round parts, each with its bounds."""
        raise NotImplementedError

    def edges(self, *, bounded: bool) -> Iterator[Line]:
        """Straight edges or sides; with their bounds towards the adjacent faces if ``bounded``."""
        raise NotImplementedError

    def curves(self, *, bounded: bool) -> Iterator[Curve]:
        """Edges, or the rim around a cap."""
        yield from self.edges(bounded=bounded)

    def face(self) -> Face | None:
        """The face, or None."""
        return None

    def direction(self, curve: Curve) -> Vector:
        """Direction of a line, or tangent of a circle at its initial contact point, world axes."""
        return self._motion.turned(curve.direction if isinstance(curve, Line) else cross(curve.axis, curve.start))

    def centre(self, curve: Curve) -> Vector:
        """Centre of a curve in the world."""
        return shifted(self._motion.origin, 1.0, self._motion.turned(curve.centre))

    def crossings(self, circle: Circle, centre: Vector, direction: Vector) -> Iterator[Circle]:
        """Copies of a circle with angle 0 where a line (world axes) crosses it in projection; none if it misses."""
        raise NotImplementedError

    def aligned(self, core: Core) -> Core:
        """The core, made perpendicular to the contact normal if it is a face or line."""
        return core.aligned(self._turned(self._outward)) if isinstance(core, Face | Line) else core

    def _place(self, point: FloatArray) -> Vector:
        """Transform a point from the world to body axes, relative to the body's origin."""
        return self._turned(point - self._motion.origin)

    def _turned(self, vector: FloatArray) -> Vector:
        """Transform a vector from world axes to body axes."""
        x, y, z = vector.tolist()
        return self._motion.local((x, y, z))


class PlaneOutline(Outline):
    """Outline of a half-space along its normal, the only direction in which it ends: a face without sides.

    Contact with it is at the corners of the other geom, or at its lowest point where that is round.
    """

    flat = True

    def __init__(self, model: Any, data: Any, geom: int, outward: FloatArray, tolerance: float) -> None:
        """Find the face; see :class:`Outline`."""
        super().__init__(model, data, geom, outward, tolerance)
        self._normal: FloatArray = self._rotation[:, 2]

    def corners(self) -> list[Core]:
        """None."""
        return []

    def edges(self, *, bounded: bool) -> Iterator[Line]:  # noqa: ARG002
        """None."""
        yield from ()

    def face(self) -> Face | None:
        """The plane, without bounds."""
        return Face("face", self._body, self._place(self._position), self._turned(self._normal), ())
