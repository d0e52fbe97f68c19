"""The gate: only a mesh that bounds a solid is decomposed.

It must be closed, consistently oriented, without parts that overlap or are inside out. Beyond the gate every point
is inside or outside, and the methods need no repair, which would be another shape than that of the file.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ffsm_mj.arrays import BoolArray, FloatArray, IntArray
from ffsm_mj.decomposition.surface import Boxes, Surface, welded
from ffsm_mj.errors import InputError

MOST_FACES = 250_000
"""Greatest number of triangles."""
_BLOCK = 100_000
"""Pairs of triangles compared at once."""
_PARALLEL = 1.0 - 1e-6
"""Cosine of the angle between triangles that may lie in one plane."""
_FLAT = 1e-3
"""Volume over surface and rounding, below which a mesh is a sheet of rounding."""


class Gated(NamedTuple):
    """A mesh that has passed.

    Attributes:
        surface: Its triangles, vertices of equal coordinates as one.
        turned: Whether its faces were turned inwards, and have been turned.
    """

    surface: Surface
    turned: bool


def gate(vertices: FloatArray, faces: IntArray, name: str) -> Gated:
    """Let a mesh pass that bounds a solid.

    Args:
        vertices: (n, 3), finite, m.
        faces: Vertices of its triangles, (m, 3).
        name: Name of the mesh and its file in messages.

    Raises:
        InputError: It has too many faces, is not closed, not oriented or flat, or it overlaps itself.
    """
    if len(faces) > MOST_FACES:
        raise InputError(f"{name}: {len(faces)} faces; at most {MOST_FACES} can be decomposed: simplify it")
    surface = welded(vertices, faces)
    if len(surface.faces) < 4:
        raise InputError(f"{name}: {len(surface.faces)} triangles do not bound a solid")
    _refuse_open(surface, name)
    _refuse_flat(surface, name)
    turned = surface.volume < 0.0
    surface = surface.turned() if turned else surface
    _refuse_overlaps(surface, name)
    _refuse_inside_out(surface, name)
    return Gated(surface, turned)


def _point(point: FloatArray) -> str:
    return f"({' '.join(f'{value:.6g}' for value in point)})"


def _refuse_flat(surface: Surface, name: str) -> None:
    """Refuse a closed surface without a volume.

    Raises:
        InputError: It has none.
    """
    volume = abs(surface.volume)
    if volume <= _FLAT * surface.rounding * np.linalg.norm(surface.areas, axis=1).sum():
        raise InputError(f"{name}: has no thickness: it encloses {volume:.3g} m3, its sides lie on each other")


def _refuse_open(surface: Surface, name: str) -> None:
    """Refuse edges that are not those of two triangles, once in each direction.

    Raises:
        InputError: There is one; or a closed surface has no volume and edges of more triangles.
    """
    start, end = surface.faces.reshape(-1), np.roll(surface.faces, -1, axis=1).reshape(-1)
    edges, of_edge = np.unique(np.sort(np.stack((start, end), axis=1), axis=1), axis=0, return_inverse=True)
    uses = np.bincount(of_edge.reshape(-1), minlength=len(edges))
    forward = np.bincount(of_edge.reshape(-1)[start < end], minlength=len(edges))
    if uses.min() > 1 and uses.max() > 2:  # as of a sheet whose two sides share their edges: there are no parts to separate
        _refuse_flat(surface, name)
    for wrong, what in (
        (uses == 1, "is not closed: {} edges belong to one triangle only; close its holes"),
        (uses > 2, "is not a surface: {} edges belong to more than two triangles; separate parts that touch"),
        (forward != 1, "is not oriented: {} edges are run through twice in one direction; turn faces that are inside out"),
    ):
        if wrong.any():
            a, b = surface.vertices[edges[int(np.flatnonzero(wrong)[0])]]
            at = f"the first from {_point(a)} to {_point(b)} m"
            raise InputError(f"{name}: {what.format(int(wrong.sum()))}; {at}")


def _refuse_overlaps(surface: Surface, name: str) -> None:
    """Refuse triangles that pierce others or lie on them by more than rounding.

    Raises:
        InputError: There are some.
    """
    triangles, rounding = surface.triangles, surface.rounding
    try:
        pairs = Boxes(triangles.min(axis=1) - rounding, triangles.max(axis=1) + rounding).overlapping()
    except OverflowError:
        raise InputError(f"{name}: too many of its triangles are close to each other to be compared; simplify it") from None
    for block in range(0, len(pairs), _BLOCK):
        first, second = pairs[block : block + _BLOCK].T
        for wrong, what in (
            (
                _coplanar(surface, first, second, rounding),
                "lie on each other: it overlaps itself, or has no thickness there",
            ),
            (_pierced(surface, first, second, rounding), "intersect: it overlaps itself"),
            (_pierced(surface, second, first, rounding), "intersect: it overlaps itself"),
        ):
            if wrong.any():
                one = int(np.flatnonzero(wrong)[0])
                at = " and ".join(_point(triangles[k[one]].mean(axis=0)) for k in (first, second))
                raise InputError(f"{name}: triangles with the centres {at} m {what}")


def _heights(surface: Surface, planes: IntArray, points: FloatArray) -> FloatArray:
    """Heights of points above the planes of triangles, (k, n); 0 for a triangle without area.

    Args:
        surface: The surface.
        planes: Triangles, (k,).
        points: (k, n, 3).
    """
    areas = surface.areas[planes]
    lengths = np.linalg.norm(areas, axis=1)
    normals = areas / np.where(lengths > 0.0, lengths, np.inf)[:, None]
    return np.asarray(np.einsum("knx,kx->kn", points - surface.triangles[planes][:, :1], normals))


def _inward(surface: Surface, faces: IntArray, points: FloatArray) -> FloatArray:
    """Distances of points from the sides of triangles, seen along the normal of these and positive inside, (k, n, 3)."""
    corners, areas = surface.triangles[faces], surface.areas[faces]
    sides = np.roll(corners, -1, axis=1) - corners
    across = np.cross(areas[:, None], sides)
    lengths = np.linalg.norm(across, axis=2)
    across /= np.where(lengths > 0.0, lengths, np.inf)[:, :, None]
    return np.asarray(np.einsum("knsx,ksx->kns", points[:, :, None] - corners[:, None], across))


def _coplanar(surface: Surface, first: IntArray, second: IntArray, rounding: float) -> BoolArray:
    """Which pairs of triangles lie in one plane and have an area in common, (k,)."""
    areas = surface.areas
    lengths = np.linalg.norm(areas, axis=1)
    product = np.abs(np.einsum("kx,kx->k", areas[first], areas[second]))
    level = (product > _PARALLEL * lengths[first] * lengths[second]) & (product > 0.0)
    rows = np.flatnonzero(level)
    corners = surface.triangles
    for one, other in ((first, second), (second, first)):
        rows = rows[(np.abs(_heights(surface, one[rows], corners[other[rows]])) <= rounding).all(axis=1)]
        # Separate or with a side in common: all of one triangle is beyond a side of the other.
        beyond = _inward(surface, one[rows], corners[other[rows]]) <= rounding
        rows = rows[~np.any(np.all(beyond, axis=1), axis=1)]
    overlap = np.zeros(len(first), dtype=bool)
    overlap[rows] = True
    return overlap


def _pierced(surface: Surface, first: IntArray, second: IntArray, rounding: float) -> BoolArray:
    """In which pairs a side of the first triangle passes through the second, (k,).

    Two triangles that intersect, but not in one plane, have such a side in one of both. A side with a corner of the other
    triangle meets its plane there.
    """
    heights = _heights(surface, second, surface.triangles[first])
    through = np.zeros(len(first), dtype=bool)
    for side in range(3):
        start, end = heights[:, side], heights[:, (side + 1) % 3]
        rows = np.flatnonzero((np.minimum(start, end) < -rounding) & (np.maximum(start, end) > rounding))
        ends = surface.faces[first[rows]][:, [side, (side + 1) % 3]]
        rows = rows[~(ends[:, :, None] == surface.faces[second[rows]][:, None]).any(axis=2).any(axis=1)]
        a, b = (surface.triangles[first[rows], corner] for corner in (side, (side + 1) % 3))
        crossing = a + (start[rows] / (start[rows] - end[rows]))[:, None] * (b - a)
        inside = _inward(surface, second[rows], crossing[:, None])[:, 0].min(axis=1)
        # A crossing on a side of the second triangle counts: it may be one of both triangles of that side.
        through[rows[inside >= -1e-6 * rounding]] = True
    return through


def _refuse_inside_out(surface: Surface, name: str) -> None:
    """Refuse shells whose side does not fit: outer ones that are turned inwards, cavities outwards, and shells in shells.

    Raises:
        InputError: There is one.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    faces = surface.faces
    links = np.repeat(faces[:, 0], 2), faces[:, 1:].reshape(-1)
    size = (len(surface.vertices),) * 2
    count, labels = connected_components(coo_array((np.ones(len(links[0])), links), shape=size), directed=False)
    if count == 1:
        return
    shells = [np.flatnonzero(labels[faces[:, 0]] == k) for k in range(count)]
    shells = [shell for shell in shells if len(shell)]
    volumes = surface.volumes
    low = np.array([surface.triangles[shell].min(axis=(0, 1)) for shell in shells])
    high = np.array([surface.triangles[shell].max(axis=(0, 1)) for shell in shells])
    for k, shell in enumerate(shells):
        point = surface.triangles[shell[0], 0]
        around = np.flatnonzero(((low <= point) & (point <= high)).all(axis=1))
        depth = round(sum(surface.winding(point, shells[j]) for j in around if j != k))
        # The boundary of a solid has 0 outside of it and 1 inside: a cavity is a shell of negative volume in another.
        if depth != (1 if volumes[shell].sum() < 0.0 else 0):
            what = "is inside another one" if depth else "is turned inwards"
            raise InputError(f"{name}: the shell of {len(shell)} triangles at {_point(point)} m {what}; mend its faces")
