"""What of a geom lies against another one: the points, lines and the face that are extreme along the contact's normal."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.features.body_motion import Body, Vector, cross, shifted
from ffsm_mj.contact.features.cores import Circle, Core, Curve, Face, Line


class Outline:
    """One geom as it lies against another along a direction.

    Attributes:
        position_tolerance: How well the places of its points are known, in m: 0 but for meshes.
        flat: Whether it has a face there.
    """

    position_tolerance = 0.0
    flat = False

    def __init__(self, model: Any, data: Any, geom: int, outward: FloatArray) -> None:
        """Look at a geom along a unit vector that points out of it; positions and velocities in ``data`` current."""
        self._body = Body(model, int(model.geom_bodyid[geom]))
        self._motion = self._body.motion(data)
        self._rotation: FloatArray = data.geom_xmat[geom].reshape(3, 3)
        self._position: FloatArray = data.geom_xpos[geom]
        self._size: list[float] = model.geom_size[geom].tolist()
        self._outward = outward

    def points(self) -> list[Core]:
        """What of it can lie on a face, with nothing said of what else is near."""
        return self.tips()

    def tips(self) -> list[Core]:
        """Its corners, each with its bounds."""
        raise NotImplementedError

    def edges(self, *, bounded: bool) -> Iterator[Line]:
        """Its straight edges or sides; told apart from the faces beside them where ``bounded``."""
        raise NotImplementedError

    def curves(self, *, bounded: bool) -> Iterator[Curve]:
        """Its edges, or the rim around a cap."""
        yield from self.edges(bounded=bounded)

    def face(self) -> Face | None:
        """Its face, or none."""
        return None

    def direction(self, curve: Curve) -> Vector:
        """Of a line, or of a circle where the contact begins; world axes."""
        return self._motion.turned(curve.direction if isinstance(curve, Line) else cross(curve.axis, curve.start))

    def centre(self, curve: Curve) -> Vector:
        """Its middle in the world."""
        return shifted(self._motion.origin, 1.0, self._motion.turned(curve.centre))

    def crossings(self, circle: Circle, centre: Vector, direction: Vector) -> Iterator[Circle]:
        """A circle from where a line (world) enters and leaves it, seen along its axis; nothing where it passes it by."""
        raise NotImplementedError

    def aligned(self, core: Core) -> Core:
        """A face or line square to the contact's normal; other cores as they are."""
        return core.aligned(self._turned(self._outward)) if isinstance(core, Face | Line) else core

    def _place(self, point: FloatArray) -> Vector:
        return self._turned(point - self._motion.origin)

    def _turned(self, vector: FloatArray) -> Vector:
        """A vector of the world in the body's axes."""
        x, y, z = vector.tolist()
        return self._motion.local((x, y, z))
