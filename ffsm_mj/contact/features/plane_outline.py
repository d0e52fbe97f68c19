"""Outline of a plane: a face without sides.

Contact with it is at the corners of the other geom, or at its lowest point where that is round.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.features.cores import Core, Face, Line
from ffsm_mj.contact.features.outline import Outline


class PlaneOutline(Outline):
    """Outline of a half-space along its normal, which is the only direction in which it ends."""

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
