"""Which gap function two cores have."""

from __future__ import annotations

from ffsm_mj.contact.cores import Circle, Core, Ellipsoid, Face, Line, Point
from ffsm_mj.contact.feature_state import Pairing
from ffsm_mj.contact.rounded import OnEllipsoid, RoundOnFace
from ffsm_mj.contact.straight import LineOnCurve, PointOnCurve, PointOnFace, PointOnPoint

_ORDER: tuple[type[Core], ...] = (Face, Ellipsoid, Circle, Line, Point)
"""The first of two cores is the one whose kind comes first."""
_NAMES = ("sphere", "end", "side", "rim", "ellipsoid", "vertex", "edge", "cap", "face")
"""Of two cores of one kind the one named first is the one that comes first."""


def join(a: Core, b: Core, sense: float) -> Pairing | None:
    """The frozen gap function of a core of a and one of b.

    Args:
        a: Of the geom that the normal points away from.
        b: Of the other.
        sense: Sign of the normal along (direction of a) x (direction of b), where both have one.

    Returns:
        None where the cores have none: sharp ones that meet in a point or along a line.
    """
    swapped = _ORDER.index(type(a)) > _ORDER.index(type(b))
    first, second = (b, a) if swapped else (a, b)
    names = [second.name, first.name]
    name = " on ".join(sorted(names, key=_NAMES.index) if type(first) is type(second) else names)
    sharp = first.radius + second.radius <= 0.0
    feature: Pairing | None = None
    match first, second:
        case Face(), Point():
            feature = PointOnFace(name, swapped, first, second)
        case Face(), Circle() | Ellipsoid():
            feature = RoundOnFace(name, swapped, first, second)
        case Ellipsoid(), Point() | Line():
            feature = OnEllipsoid(name, swapped, first, second)
        case Circle() | Line(), Line():
            feature = LineOnCurve(name, swapped, first, second, sense)
        case Circle() | Line(), Point() if not sharp:
            feature = PointOnCurve(name, swapped, first, second)
        case Point(), Point() if not sharp:
            feature = PointOnPoint(name, swapped, first, second)
    return feature
