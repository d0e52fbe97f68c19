"""Meshes of a model as their files state them, in double precision, and with the faces of the file.

MuJoCo keeps vertices in single precision, in axes of its own. What is decomposed are the numbers of the file: text as it is,
numbers in single precision as the shortest decimals that they stand for.
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.errors import InputError
from ffsm_mj.model.files import ModelFiles
from ffsm_mj.model.xml import Element

_STL_HEADER, _STL_TRIANGLE = 84, np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_MSH_HEADER = 16
_CONTINUED = re.compile(r"(?<!\\)\n")
"""Ends of the lines of an OBJ: a backslash before one continues the line."""
_SHOWN = 60
"""Characters of a malformed line that are shown."""


def decimals(numbers: npt.NDArray[np.float32]) -> FloatArray:
    """The shortest decimals that numbers in single precision stand for, in double precision."""
    distinct, index = np.unique(numbers, return_inverse=True)
    return np.asarray(distinct.astype(str).astype(np.float64)[index.reshape(numbers.shape)])


def numbers_in(text: str, single: npt.NDArray[np.float32]) -> FloatArray | None:
    """The numbers in a text in double precision, (n,), if they are those that MuJoCo has read of it; else None."""
    try:
        exact = np.array(text.split(), dtype=np.float64)
    except ValueError:
        return None
    return exact if len(exact) == len(single) and bool((exact.astype(np.float32) == single).all()) else None


class FileMesh:
    """A mesh of a model.

    Attributes:
        place: Place of its element, its name and its file in messages.
        vertices: Its vertices in the file, (n, 3).
        faces: Vertices of its triangles, in the order of the file, (m, 3).
    """

    def __init__(self, files: ModelFiles, spec: Any, mesh: Any) -> None:
        """Read it.

        Args:
            files: Files of the model.
            spec: Its specification.
            mesh: The mesh in it.

        Raises:
            InputError: Its file cannot be read, it has no faces, a vertex that is not finite, or a face without its vertex.
        """
        element = next(_elements_of(files, mesh), None)
        file = f" ({mesh.file})" if mesh.file else ""
        self.place = f"{element.place if element is not None else files.place}: mesh {mesh.name!r}{file}"
        self._scale, self._origin = np.array(mesh.scale), np.array(mesh.refpos)
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, np.array(mesh.refquat) / np.linalg.norm(mesh.refquat))
        self._turn = turn.reshape(3, 3)
        kind = ""
        if mesh.file:
            content = _content(files, spec, mesh.file, self.place)
            kind = posixpath.splitext(mesh.file)[1].lower() or f".{mesh.content_type.rpartition('/')[2]}"
            self.vertices, self.faces = _parsed(content, kind, self.place)
        else:
            single = np.array(list(mesh.uservert), dtype=np.float32)
            exact = numbers_in(element.attributes.get("vertex", ""), single) if element is not None else None
            self.vertices = (decimals(single) if exact is None else exact).reshape(-1, 3)
            self.faces = np.array(list(mesh.userface), dtype=np.intp).reshape(-1, 3)
        if not len(self.faces):
            raise InputError(f"{self.place}: has no faces: MuJoCo takes the hull of its points, which is convex already")
        self._refuse_wrong_numbers(1 if kind == ".obj" else 0)

    def _refuse_wrong_numbers(self, first: int) -> None:
        """Refuse coordinates that are not finite, and faces of vertices that are not there.

        Args:
            first: Number of the first vertex in the format.

        Raises:
            InputError: There is one.
        """
        infinite = np.flatnonzero(~np.isfinite(self.vertices).all(axis=1))
        if len(infinite):
            point = " ".join(f"{value:.6g}" for value in self.vertices[infinite[0]])
            number = f"vertex {infinite[0] + first}, counted from {first},"
            raise InputError(f"{self.place}: {number} is ({point}); every coordinate must be finite")
        missing = self.faces[(self.faces < 0) | (self.faces >= len(self.vertices))]
        if len(missing):
            raise InputError(
                f"{self.place}: a face names vertex {missing[0] + first}; it has {len(self.vertices)}, counted from {first}"
            )

    @property
    def compiled_vertices(self) -> FloatArray:
        """Vertices as MuJoCo has them before it moves the origin to the centre of mass, (n, 3), m."""
        return np.asarray((self.vertices - self._origin) @ self._turn * self._scale)

    @property
    def compiled_faces(self) -> IntArray:
        """Triangles as MuJoCo has them: turned where the scale mirrors, (m, 3)."""
        return self.faces if np.prod(self._scale) > 0.0 else self.faces[:, ::-1]


def _elements_of(files: ModelFiles, mesh: Any) -> Iterator[Element]:
    """The element of a mesh in the files of a model."""
    base = posixpath.basename(mesh.file)
    for element in files.elements("mesh"):
        written = element.attributes.get("file", element.attributes.get("filename", ""))
        named = element.attributes.get("name", posixpath.splitext(posixpath.basename(written))[0])
        if element.tag == "mesh" and named == mesh.name and posixpath.basename(written) == base:
            yield element


def _content(files: ModelFiles, spec: Any, written: str, place: str) -> bytes:
    """Content of the file of a mesh.

    Raises:
        InputError: The model has no such file, or several of its base name.
    """
    path = posixpath.normpath(posixpath.join(posixpath.dirname(files.main), spec.meshdir, written))
    if path in files.files:
        return files.files[path]
    base = posixpath.basename(written)
    named = [content for name, content in files.files.items() if posixpath.basename(name) == base]
    if len(named) != 1:
        raise InputError(f"{place}: {len(named)} files of the model are called {base!r}; give its mesh a name of its own")
    return named[0]


def _parsed(content: bytes, kind: str, place: str) -> tuple[FloatArray, IntArray]:
    """Vertices and triangles of a file.

    Raises:
        InputError: It is not of its format.
    """
    try:
        return {".obj": _obj, ".stl": _stl, ".msh": _msh}[kind](content)
    except (ValueError, KeyError, OverflowError) as error:
        why = error if isinstance(error, _MalformedLineError) else "its content is not of this format, or cut off"
        raise InputError(f"{place}: cannot be read as {kind[1:].upper()}: {why}") from error


class _MalformedLineError(ValueError):
    """A line of a mesh in text, counted from 1."""

    def __init__(self, number: int, line: str) -> None:
        super().__init__(f"line {number} is malformed: {line.strip()[:_SHOWN]!r}")


def _obj(content: bytes) -> tuple[FloatArray, IntArray]:
    """Vertices and faces of an OBJ; polygons become fans.

    Raises:
        _MalformedLineError: A vertex has fewer than three numbers, or a face what is no number of a vertex.
    """
    vertices, faces = list[tuple[float, float, float]](), list[tuple[int, int, int]]()
    number = 1
    for line in _CONTINUED.split("\n".join(content.decode().splitlines())):
        words = line.replace("\\\n", " ").split()
        try:
            if words[:1] == ["v"]:
                x, y, z = map(float, words[1:4])
                vertices.append((x, y, z))
            elif words[:1] == ["f"]:
                corners = [_corner(word, len(vertices)) for word in words[1:]]
                faces += [(corners[0], corners[k], corners[k + 1]) for k in range(1, len(corners) - 1)]
        except ValueError as error:
            raise _MalformedLineError(number, line) from error
        number += 1 + line.count("\n")
    return np.array(vertices, dtype=np.float64).reshape(-1, 3), np.array(faces, dtype=np.intp).reshape(-1, 3)


def _corner(word: str, count: int) -> int:
    """Index of the vertex that a corner of a face names, from the first or back from the last one so far.

    Raises:
        ValueError: It names none.
    """
    number = int(word.partition("/")[0])
    if number == 0 or number < -count:
        raise ValueError
    return number - 1 if number > 0 else count + number


def _stl(content: bytes) -> tuple[FloatArray, IntArray]:
    """Vertices, three for each triangle, and triangles of a binary STL."""
    count = int.from_bytes(content[_STL_HEADER - 4 : _STL_HEADER], "little")
    triangles = np.frombuffer(content, dtype=_STL_TRIANGLE, offset=_STL_HEADER, count=count)
    return decimals(triangles["corners"].reshape(-1, 3)), np.arange(3 * count).reshape(-1, 3)


def _msh(content: bytes) -> tuple[FloatArray, IntArray]:
    """Vertices and triangles of a file of MuJoCo's own format."""
    vertices, normals, coordinates, faces = np.frombuffer(content, dtype="<i4", count=4).tolist()
    first = _MSH_HEADER + 12 * (vertices + normals) + 8 * coordinates
    points = np.frombuffer(content, dtype="<f4", offset=_MSH_HEADER, count=3 * vertices)
    triangles = np.frombuffer(content, dtype="<i4", offset=first, count=3 * faces)
    return decimals(points.reshape(-1, 3)), triangles.reshape(-1, 3).astype(np.intp)


_EXACT = mujoco.mjtMeshInertia.mjMESH_INERTIA_EXACT
_OF_HULL = {
    int(mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX): "that of its hull",
    int(mujoco.mjtMeshInertia.mjMESH_INERTIA_LEGACY): "MuJoCo's 'legacy' of it, which counts overlaps twice",
}


def weigh_by_volume(spec: Any, files: ModelFiles) -> list[str]:
    """Give decomposed meshes of a specification the inertia of their volume, and turn those whose faces are turned inwards.

    A mesh of shell inertia keeps it.

    Args:
        spec: The specification; all its elements have names.
        files: Files of the model.

    Returns:
        Notes on bodies whose mass follows from another volume than before.
    """
    notes = []
    for name, pieces in files.pieces.items():
        mesh = spec.mesh(name)
        if mesh is None:  # not one of this part of the file
            continue
        if pieces.turned:
            of_file = FileMesh(files, spec, mesh)
            mesh.file = ""
            mesh.uservert = of_file.vertices.astype(np.float32).reshape(-1).tolist()
            mesh.userface = of_file.faces[:, ::-1].reshape(-1).tolist()
            for attribute in ("usernormal", "usertexcoord", "userfacenormal", "userfacetexcoord"):
                setattr(mesh, attribute, [])
        if files.pose is None and int(mesh.inertia) in _OF_HULL:  # what is fixed has no mass, and may be open
            before, mesh.inertia = _OF_HULL[int(mesh.inertia)], _EXACT
            weighed = {geom.parent.name for geom in spec.geoms if geom.meshname == name and not geom.parent.explicitinertial}
            weighed.discard("world")
            notes += [
                f"mass and inertia of {body} are of the volume of mesh {name!r}, not {before}" for body in sorted(weighed)
            ]
    return notes
