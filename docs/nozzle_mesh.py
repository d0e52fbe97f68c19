"""The mesh of the nozzle in ``mjcf/spent_stage.xml``, from its profile: ``uv run python docs/nozzle_mesh.py``.

The wall of a nozzle with its combustion chamber, in flat facets: a profile of x along the axis and of the radius, turned
around the axis in equal sectors. Numbers have all their digits, so that the corners of a facet are in one plane to rounding.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

MODEL = Path(__file__).parent.parent / "mjcf" / "spent_stage.xml"
SECTORS = 12
INNER = ((0.0, 0.25), (0.22, 0.19), (0.46, 0.055), (0.5, 0.055), (0.55, 0.115), (0.7, 0.115))
"""x and radius in m of the inside, from the exit over the throat, at 0.46 to 0.5, into the chamber."""
OUTER = ((0.7, 0.15), (0.5, 0.15), (0.44, 0.1), (0.22, 0.24), (0.03, 0.33), (0.0, 0.33))
"""The same of the outside, back to the rim of the exit."""


def nozzle() -> tuple[np.ndarray, np.ndarray]:
    """Vertices in m, (n, 3), and triangles, (m, 3), counter-clockwise from outside; the middle of a facet is along y."""
    x, radius = np.array(INNER + OUTER).T
    around = 2.0 * np.pi * (np.arange(SECTORS) + 0.5) / SECTORS
    ring = np.stack((np.ones(SECTORS), np.cos(around), np.sin(around)), axis=1)
    vertices = np.stack((x, radius, radius), axis=1)[:, None] * ring
    rings, sectors = np.meshgrid(np.arange(len(x)), np.arange(SECTORS), indexing="ij")
    a, b = ((rings + k) % len(x) * SECTORS for k in (0, 1))
    here, following = sectors, (sectors + 1) % SECTORS
    triangles = ((a + here, b + following, a + following), (a + here, b + here, b + following))
    faces = np.concatenate([np.stack(corners, axis=2).reshape(-1, 3) for corners in triangles])
    return vertices.reshape(-1, 3), faces


def main() -> None:
    """Write the mesh into the model."""
    vertices, faces = nozzle()
    numbers = "\n      ".join(" ".join(map(repr, vertex)) for vertex in vertices.tolist())
    corners = "\n      ".join(
        "  ".join(" ".join(map(str, f)) for f in faces[i : i + 12].tolist()) for i in range(0, len(faces), 12)
    )
    mesh = f'<mesh name="nozzle" inertia="exact"\n      vertex="\n      {numbers}"\n      face="\n      {corners}"/>'
    text = MODEL.read_text(encoding="utf-8")
    MODEL.write_text(re.sub(r'<mesh name="nozzle".*?/>', mesh, text, count=1, flags=re.DOTALL), encoding="utf-8")


if __name__ == "__main__":
    main()
