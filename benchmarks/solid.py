"""What the geometry of unions of many pieces costs: ``uv run python benchmarks/solid.py``.

Two shells of a cone, of 320 and 640 pieces: microseconds of boxes near a place, and of pairs of boxes within 1 cm at several
distances; milliseconds of what is made once. Wall time, the quickest of several repeats.
"""

from __future__ import annotations

import timeit
from collections.abc import Callable

import numpy as np

from ffsm_mj.contact.solid.edges import UnionEdge
from ffsm_mj.contact.solid.faces import UnionFace
from ffsm_mj.contact.solid.solid import Solid
from ffsm_mj.polytope import Polytope, hull_of

REPEATS, MANY = 3, 400
"""Of calls of at least milliseconds, and of shorter ones: other work on the machine leaves some of these alone."""
REACH_M = 0.01


def shell(sectors: int, rings: int) -> list[Polytope]:
    """Pieces of a shell 1 cm thick, 0.3 m high, from a radius of 5 cm to one of 30 cm, that opens the wider the higher."""
    angles = 2.0 * np.pi * np.arange(sectors) / sectors
    directions = np.column_stack((np.cos(angles), np.sin(angles)))
    shares = np.linspace(0.0, 1.0, rings + 1)
    radii, heights = 0.05 + 0.25 * shares**1.2, 0.3 * shares

    def corner(ring: int, sector: int, out: float) -> tuple[float, ...]:
        return (*((radii[ring] + out) * directions[sector % sectors]), heights[ring])

    return [
        hull_of(np.array([corner(j + b, k + a, out) for a in (0, 1) for b in (0, 1) for out in (0.0, 0.01)]), 1e-9)
        for k in range(sectors)
        for j in range(rings)
    ]


def microseconds(call: Callable[[], object], repeats: int) -> float:
    """Wall time of a call, the quickest of some."""
    return 1e6 * min(timeit.repeat(call, number=1, repeat=repeats))


def all_faces(solid: Solid) -> list[tuple[UnionFace, ...]]:
    """All faces of a solid."""
    return [solid.faces.at(plane) for plane in solid.faces.planes]


def all_edges(solid: Solid) -> list[tuple[UnionEdge, ...]]:
    """All edges of a solid, piece by piece."""
    return [solid.edges.of(k) for k in range(len(solid.pieces))]


def main() -> None:
    """Print the figures."""
    pieces, other_pieces = shell(64, 5), shell(64, 10)
    solid, other = Solid(pieces, 1e-9), Solid(other_pieces, 1e-9)
    upright = np.eye(3)
    place = np.array([0.2, 0.0, 0.15])
    print(f"{len(solid.pieces)} and {len(other.pieces)} pieces")
    print(f"near a place: {microseconds(lambda: solid.tree.near(place, place, REACH_M), MANY):.0f} us")
    for shift in (10.0, 1.0, 0.625, 0.6, 0.0):
        position = np.array([shift, 0.0, 0.0])
        arguments = solid.tree, other.tree, upright, position
        pairs = len(solid.tree.pairs(other.tree, upright, position, REACH_M))
        near = microseconds(lambda a=arguments: a[0].pairs(*a[1:], REACH_M), MANY)
        print(f"axes {shift:g} m apart: {pairs} pairs in {near:.0f} us")
    made = {
        "weld": lambda: Solid(pieces, 1e-9),
        "weld, and edges along one piece": lambda: Solid(pieces, 1e-9).edges.of(0),
        "weld, and all edges": lambda: all_edges(Solid(pieces, 1e-9)),
        "weld, and all faces": lambda: all_faces(Solid(pieces, 1e-9)),
    }
    for name, call in made.items():
        print(f"{name}: {1e-3 * microseconds(call, REPEATS):.0f} ms")
    print(f"edges along a piece again: {microseconds(lambda: solid.edges.of(0), MANY):.0f} us")


if __name__ == "__main__":
    main()
