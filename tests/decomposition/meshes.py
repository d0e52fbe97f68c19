"""Meshes of machined parts: boundaries of cells of a grid, and surfaces of revolution in flat facets."""

from __future__ import annotations

import numpy as np

SIDES = {
    (0, 1): ((1, 0, 0), (1, 1, 0), (1, 1, 1), (1, 0, 1)),
    (0, -1): ((0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0)),
    (1, 1): ((0, 1, 0), (0, 1, 1), (1, 1, 1), (1, 1, 0)),
    (1, -1): ((0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1)),
    (2, 1): ((0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)),
    (2, -1): ((0, 0, 0), (0, 1, 0), (1, 1, 0), (1, 0, 0)),
}
"""Corners of the sides of a cell, counter-clockwise seen from outside."""


def of_cells(lines, filled):
    """Boundary of the filled cells between planes of x, y and z: vertices and triangles."""
    filled = np.pad(np.asarray(filled, dtype=bool), 1)
    corners, triangles = {}, []
    for cell in np.argwhere(filled):
        for (axis, step), side in SIDES.items():
            beside = cell.copy()
            beside[axis] += step
            if not filled[tuple(beside)]:
                quad = [corners.setdefault(tuple(cell + corner - 1), len(corners)) for corner in side]
                triangles += [quad[:3], [quad[0], *quad[2:]]]
    vertices = np.array([[lines[axis][i] for axis, i in enumerate(corner)] for corner in corners], dtype=float)
    return vertices, np.array(triangles)


def box():
    return of_cells([[0.0, 0.1]] * 3, np.ones((1, 1, 1)))


def plate():
    """A square plate with a square hole."""
    filled = np.ones((3, 3, 1))
    filled[1, 1] = 0
    return of_cells([[-0.3, -0.1, 0.1, 0.3], [-0.3, -0.1, 0.1, 0.3], [0.0, 0.02]], filled)


def bracket():
    """Two legs at a right angle."""
    return of_cells([[0.0, 0.01, 0.12], [0.0, 0.05], [0.0, 0.012, 0.1]], [[[1, 1]], [[1, 0]]])


def slot():
    """A bar with a T-slot along x."""
    filled = np.ones((1, 5, 3))
    filled[0, 1:4, 1] = filled[0, 2, 2] = 0
    return of_cells([[0.0, 0.3], [-0.03, -0.02, -0.008, 0.008, 0.02, 0.03], [0.0, 0.01, 0.02, 0.03]], filled)


def posts():
    """Three separate posts: the first has its top in the plane in which the second has its bottom."""
    levels = [[[1, 0]], [[0, 0]], [[0, 1]], [[0, 0]], [[1, 1]]]
    return of_cells([[0.0, 0.1, 0.2, 0.3, 0.4, 0.5], [0.0, 0.1], [0.0, 0.3, 0.6]], levels)


def frame():
    """The twelve bars along the edges of a cube."""
    lines = [-0.4, -0.37, 0.37, 0.4]
    ends = np.array([i != 1 for i in range(3)], dtype=int)
    filled = ends[:, None, None] + ends[None, :, None] + ends[None, None, :] >= 2
    return of_cells([lines] * 3, filled)


def revolved(profile, sectors):
    """Surface of revolution of a closed polygon (r, z), counter-clockwise with r to the right, about z."""
    angles = 2.0 * np.pi * np.arange(sectors) / sectors
    circle = np.stack((np.cos(angles), np.sin(angles)), axis=1)
    profile = np.asarray(profile, dtype=float)
    count = len(profile)
    vertices = np.concatenate([np.column_stack((r * circle, np.full(sectors, z))) for r, z in profile])
    triangles = []
    for k in range(count):
        for i in range(sectors):
            a, b = k * sectors + i, k * sectors + (i + 1) % sectors
            c, d = ((k + 1) % count) * sectors + (i + 1) % sectors, ((k + 1) % count) * sectors + i
            triangles += [[a, b, c], [a, c, d]]
    return vertices, np.array(triangles)


def cone(sectors=64):
    """A conical shell, wider at the top, 2 cm thick across."""
    return revolved([(0.07, 0.0), (0.32, 0.3), (0.3, 0.3), (0.05, 0.0)], sectors)


def nozzle(sectors=64, rings=12):
    """A bell nozzle: its contour opens ever less steeply."""
    z = np.linspace(0.0, 0.5, rings + 1)
    inner = 0.1 + 0.25 * np.sqrt(z / 0.5)
    outer = [(r + 0.01, height) for r, height in zip(inner, z, strict=True)]
    return revolved([*outer, *zip(inner[::-1], z[::-1], strict=True)], sectors)
