"""A decomposition, and its form in a file: beside the model, in run folders and in logs.

Text without programs, read with checks: a log may come from a stranger. Numbers are written so that they are read again bit
for bit, planes once for all faces in them.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.errors import InputError, plural
from ffsm_mj.polytope import Polytope

FOLDER = "pieces"
"""Folder beside a model with the pieces of its meshes."""
METHODS = ("planes", "coacd", "prisms")
_FORMAT = "ffsm-mj pieces 1"
_VERSIONS = {"planes": "1", "prisms": "1"}
"""Versions of the methods of this package: a change of the result of one is a new one."""
_MOST_PIECES = 100_000
_SHORT = 16
"""Digits of a key in names of files and in lines."""
_UNIT = 1e-9
"""Greatest deviation of the length of a normal from 1."""
_READABLE = 0o644
"""Mode of a file: a temporary one is for its owner alone."""
_CONVEX = 1e-6
"""Greatest height of a vertex above a plane of its piece, over the greatest coordinate."""


@dataclass(frozen=True)
class Request:
    """What is asked for: a mesh in double precision and how to decompose it.

    Attributes:
        vertices: (n, 3), m.
        faces: Vertices of its triangles, (m, 3).
        method: One of :data:`METHODS`.
        tolerance_m: See the methods; None: their default.
        mesh: Name of the mesh.
        place: Name of mesh and file in messages.
        depth_m: Length of prisms, m; None for other methods.
    """

    vertices: FloatArray
    faces: IntArray
    method: str
    tolerance_m: float | None
    mesh: str
    place: str
    depth_m: float | None = None

    @property
    def version(self) -> str | None:
        """Version of the method here; None if its package is not installed."""
        from ffsm_mj.decomposition.coacd import installed_version  # imports take long that only this needs

        return _VERSIONS.get(self.method) or installed_version()

    def key(self, version: str) -> str:
        """SHA-256 of mesh, method, version and options."""
        lengths = [self.tolerance_m] if self.depth_m is None else [self.depth_m]
        options = json.dumps([self.method, version, *lengths, self.vertices.shape, self.faces.shape])
        digest = hashlib.sha256(options.encode())
        digest.update(np.ascontiguousarray(self.vertices, dtype="<f8").tobytes())
        digest.update(np.ascontiguousarray(self.faces, dtype="<i8").tobytes())
        return digest.hexdigest()

    def name(self, version: str) -> str:
        """Name of the file beside the model."""
        return f"{self.stem}{self.key(version)[:_SHORT]}.json"

    @property
    def stem(self) -> str:
        """Start of the names of all files of the mesh."""
        return f"{FOLDER}/{re.sub(r'[^A-Za-z0-9_.-]', '_', self.mesh)}-"


@dataclass(frozen=True, eq=False)
class Decomposition:
    """Pieces of a mesh, in its axes in the file.

    Attributes:
        pieces: The pieces.
        method: How they came to be.
        version: Version of the method.
        tolerance_m: Tolerance that was asked for, m; None: the default of the method.
        turned: Whether the faces of the mesh were turned inwards in the file.
        outside_m: How far the pieces reach out of the mesh, at least, m.
        uncovered_m: How far the mesh reaches out of the pieces, at least, m.
        sha256: Key of mesh, method, version and options.
    """

    pieces: tuple[Polytope, ...]
    method: str
    version: str
    tolerance_m: float | None
    turned: bool
    outside_m: float
    uncovered_m: float
    sha256: str

    @property
    def sentence(self) -> str:
        """The decomposition in words."""
        which = f"{plural(len(self.pieces), 'piece')} by {self.method} {self.version}"
        key = f"; sha256 {self.sha256[:_SHORT]}"
        if self.method == "prisms":
            return which + key
        tolerance = "" if self.tolerance_m is None else f", tolerance {self.tolerance_m:g} m"
        return (
            f"{which}, at least {1e3 * self.outside_m:.3g} mm outside the mesh and {1e3 * self.uncovered_m:.3g} mm of it "
            f"not covered{tolerance}{', faces turned outwards' if self.turned else ''}{key}"
        )


def decompose(request: Request) -> Decomposition:
    """Decompose a mesh.

    Raises:
        InputError: It does not pass the gate, or the method fails.
    """
    from ffsm_mj.decomposition import coacd, planes  # runs that have their pieces do not import what makes them
    from ffsm_mj.decomposition.distances import distances
    from ffsm_mj.decomposition.gate import gate

    version = request.version or ""
    if request.depth_m is not None:
        return Decomposition(
            _terrain(request, request.depth_m), "prisms", version, None, False, 0.0, 0.0, request.key(version)
        )
    surface, turned = gate(request.vertices, request.faces, request.place)
    if request.method == "planes":
        tolerance_m = surface.rounding if request.tolerance_m is None else request.tolerance_m
        pieces = planes.partition(surface, tolerance_m, request.place)
    else:
        pieces = coacd.decompose(surface, request.tolerance_m, request.place)
    apart = distances(surface, pieces)
    return Decomposition(tuple(pieces), request.method, version, request.tolerance_m, turned, *apart, request.key(version))


def _terrain(request: Request, depth_m: float) -> tuple[Polytope, ...]:
    """Prisms below an open mesh, whose tops are its triangles.

    Raises:
        InputError: It is closed or overhangs.
    """
    from ffsm_mj.decomposition.terrain import mesh_prisms

    try:
        return mesh_prisms(request.vertices, request.faces, depth_m)
    except ValueError as error:
        raise InputError(f"{request.place}: 'method: prisms' cannot decompose it: {error}") from error


def to_json(decomposition: Decomposition) -> bytes:
    """Text of a decomposition."""
    index: dict[tuple[float, ...], int] = {}
    pieces = []
    for piece in decomposition.pieces:
        faces = []
        for normal, offset, face in zip(piece.normals.tolist(), piece.offsets.tolist(), piece.faces, strict=True):
            opposite = (*(-value + 0.0 for value in normal), -offset + 0.0)
            sense = -1 if opposite in index else 1
            key = opposite if sense < 0 else (*(value + 0.0 for value in normal), offset + 0.0)
            faces.append([index.setdefault(key, len(index)), sense, list(face)])
        pieces.append({"vertices": piece.vertices.tolist(), "faces": faces})
    head = {
        "format": _FORMAT,
        "method": decomposition.method,
        "version": decomposition.version,
        "tolerance_m": decomposition.tolerance_m,
        "sha256": decomposition.sha256,
        "turned": decomposition.turned,
        "outside_m": decomposition.outside_m,
        "uncovered_m": decomposition.uncovered_m,
    }
    return json.dumps(head | {"planes": list(index), "pieces": pieces}, separators=(",", ":")).encode()


def from_json(content: bytes, place: str) -> Decomposition:
    """A decomposition from its text.

    Args:
        content: The text.
        place: Name of the file in messages.

    Raises:
        InputError: It is none, or its pieces are not convex.
    """
    try:
        data = json.loads(content)
        if data["format"] != _FORMAT or data["method"] not in METHODS or len(data["pieces"]) > _MOST_PIECES:
            raise ValueError
        table = np.array(data["planes"], dtype=np.float64).reshape(-1, 4)
        pieces = tuple(_piece(piece, table) for piece in data["pieces"])
        tolerance_m = data["tolerance_m"]
        return Decomposition(
            pieces,
            data["method"],
            str(data["version"]),
            None if tolerance_m is None else float(tolerance_m),
            bool(data["turned"]),
            float(data["outside_m"]),
            float(data["uncovered_m"]),
            str(data["sha256"]),
        )
    except (ValueError, KeyError, TypeError, IndexError, OverflowError, RecursionError) as error:
        raise InputError(f"{place}: is not a file with the pieces of a mesh, or damaged; remove it") from error


def _piece(data: Mapping[str, Any], table: FloatArray) -> Polytope:
    """One piece.

    Raises:
        ValueError: It is not convex or has no such planes or vertices.
    """
    vertices = np.array(data["vertices"], dtype=np.float64)
    planes_and_senses = np.array([[plane, sense] for plane, sense, _ in data["faces"]])
    faces = tuple(tuple(map(int, corners)) for _, _, corners in data["faces"])
    indices = np.array([i for face in faces for i in face])
    rows, senses = planes_and_senses.T
    whole = vertices.ndim == 2 and vertices.shape[1] == 3 and len(faces) > 3 and min(map(len, faces)) > 2
    if not whole or indices.min() < 0 or indices.max() >= len(vertices) or rows.min() < 0 or (abs(senses) != 1).any():
        raise ValueError
    chosen = table[rows] * senses[:, None]
    normals, offsets = chosen[:, :3] + 0.0, chosen[:, 3] + 0.0
    heights = (normals @ vertices.T - offsets[:, None]).max()
    unit = np.abs(np.linalg.norm(normals, axis=1) - 1.0).max() <= _UNIT
    off = max(np.abs(vertices[list(face)] @ normals[k] - offsets[k]).max() for k, face in enumerate(faces))
    if not (unit and max(heights, off) <= _CONVEX * np.abs(vertices).max()):  # also where a number is not finite
        raise ValueError
    piece = Polytope(vertices, normals, offsets, faces)
    if 2 * len(piece.edges) != len(indices):  # each edge is a side of two faces; one without the other is a KeyError
        raise ValueError
    return piece


def stored_in(
    request: Request, contents: Mapping[str, bytes], place: str, *, any_version: bool
) -> tuple[str, bytes, Decomposition] | None:
    """Name and content of the file with the pieces that are asked for, and the pieces; None without one.

    Args:
        request: What is asked for.
        contents: Files beside the model by name.
        place: Name of their folder in messages.
        any_version: Whether pieces by another version of the method are taken: those of a log are what the run had.

    Raises:
        InputError: A file is damaged.
    """
    for name, content in contents.items():
        if name.startswith(request.stem):
            stored = from_json(content, f"{place}{name}")
            asked = stored.sha256 == request.key(stored.version) and name == request.name(stored.version)
            if asked and (any_version or stored.version == (request.version or stored.version)):
                return name, content, stored
    return None


def read_folder(folder: Path, request: Request) -> dict[str, bytes]:
    """Files with pieces of a mesh beside a model, by name; none where they cannot be read."""
    contents = {}
    with suppress(OSError):
        for path in sorted(folder.glob(f"{request.stem}*.json")):
            contents[f"{FOLDER}/{path.name}"] = path.read_bytes()
    return contents


def write(folder: Path, name: str, content: bytes) -> None:
    """Write a file with pieces, whole or not at all: two runs may do so at once. A folder that cannot be written is left."""
    from tempfile import NamedTemporaryFile

    path = folder / name
    with suppress(OSError):
        path.parent.mkdir(exist_ok=True)
        with NamedTemporaryFile(dir=path.parent, prefix=f".{path.name}", delete=False) as part:
            part.write(content)
        os.chmod(part.name, _READABLE)
        os.replace(part.name, path)
