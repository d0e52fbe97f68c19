"""Choice of the gap function for a pair of cores."""

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
    """The gap function of a core of a and a core of b.

    Args:
        a: Core of geom a, which the normal points away from.
        b: Core of geom b.
        sense: Sign of the normal along (direction of a) x (direction of b), for two lines or circles.

    Returns:
        None if there is none: the normal between two sharp points, or a sharp point and an edge, is undefined in contact.
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
