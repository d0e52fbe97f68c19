"""Meshes of a model that a scenario decomposes: from its files to the pieces of geoms in the compiled scene.

A decomposed mesh stays one geom of the model, which is drawn as it is. Mass and inertia that a body has from it are those of
its volume. The pieces travel as files of the model, beside it and in the log, so that a run is repeated with what it had.
"""

from __future__ import annotations

import posixpath
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal
from warnings import catch_warnings

import mujoco
import numpy as np
from pydantic import BeforeValidator, PositiveFloat, model_validator

from ffsm_mj.config import Name, StrictModel
from ffsm_mj.decomposition.stored import (
    FOLDER,
    Decomposition,
    Request,
    decompose,
    read_folder,
    stored_in,
    to_json,
    write,
)
from ffsm_mj.errors import Fault, InputError, ScenarioFaults, faults_below, unknown_name
from ffsm_mj.model.files import ModelFiles
from ffsm_mj.model.meshes import FileMesh
from ffsm_mj.model.mujoco_process import collected_warnings
from ffsm_mj.model.source import digest_of, load_spec
from ffsm_mj.polytope import Polytope


class Decompose(StrictModel):
    """A mesh of the model that is not convex, as convex pieces; the mesh is drawn and weighed as it is."""

    mesh: Name
    """Its name in the model."""
    method: Literal["planes", "coacd", "prisms"] = "planes"
    """``planes``: exact partition by its own face planes, for machined parts; ``coacd``: approximate pieces by the package
    coacd, for organic shapes; ``prisms``: what is below an open mesh, a prism for each triangle, for terrain."""
    tolerance_m: PositiveFloat | None = None
    """Of ``planes``: corners this close to the plane of a face are in it, m; by default the rounding of single precision.
    Ten times the rounding of the file is right: 1e-5 for an OBJ with six digits. Of ``coacd``: greatest concavity of a
    piece, m; by default 5 % of the size of the mesh."""
    depth_m: PositiveFloat | None = None
    """Of ``prisms``, which need it: their length against the mean normal of the mesh, m."""

    @model_validator(mode="after")
    def _has_options_of_the_method(self) -> Decompose:
        if (self.method == "prisms") != (self.depth_m is not None):
            raise ValueError("'method: prisms' and 'depth_m', the length of the prisms, belong together")
        if self.method == "prisms" and self.tolerance_m is not None:
            raise ValueError("'method: prisms' has no tolerance_m: its tops are the triangles themselves")
        return self


def _listed(value: Any) -> Any:
    return (value,) if isinstance(value, Mapping | Decompose) else value


DecomposeList = Annotated[
    tuple[Decompose, ...], BeforeValidator(_listed, json_schema_input_type=Decompose | tuple[Decompose, ...])
]
"""One mesh, or several."""


@dataclass(frozen=True)
class _Wanted:
    """Decompositions of a model, compared by what they follow from.

    Attributes:
        digest: Of the files of the model.
        main: Name of its main file.
        body: Part of the file that the model is.
        wanted: Meshes to decompose.
        kept: Where the pieces are: the folder of the model, or a digest of the files in a log.
        files: Files of the model.
        folder: Folder in which pieces are kept, if any.
        logged: Files with pieces in a log; None for a model that is in none.
    """

    digest: str
    main: str
    body: str
    wanted: tuple[Decompose, ...]
    kept: str
    files: ModelFiles = field(compare=False)
    folder: Path | None = field(default=None, compare=False)
    logged: Mapping[str, bytes] | None = field(default=None, compare=False)


def with_pieces(files: ModelFiles, wanted: Sequence[Decompose], folder: Path | None, keys: tuple[str, ...]) -> ModelFiles:
    """A model with the pieces of its meshes: those beside it, if they are of the same meshes and options, or new ones.

    Args:
        files: Files of the model.
        wanted: Meshes to decompose.
        folder: Folder of the main file, in which pieces are kept; None for a model in memory.
        keys: Keys of the model in the scenario.

    Raises:
        InputError: A mesh cannot be decomposed.
        ScenarioFaults: The model has no such mesh.
    """
    if not wanted:
        return files
    kept = "" if folder is None else str(folder.absolute())
    with faults_below(*keys, "decompose"):
        return _added(_Wanted(digest_of(files), files.main, files.body, tuple(wanted), kept, files, folder))


def with_logged_pieces(files: ModelFiles, wanted: Sequence[Decompose], contents: Mapping[str, bytes]) -> ModelFiles:
    """A model of a log with the pieces in the log; nothing is decomposed again.

    Args:
        files: Files of the model.
        wanted: Meshes that the run decomposed.
        contents: Files of the log by their names relative to the same folder.

    Raises:
        InputError: The pieces of a mesh are not in the log, or damaged.
        ScenarioFaults: The model has no such mesh.
    """
    if not wanted:
        return files
    home = posixpath.join(posixpath.dirname(files.main), "")
    beside = {name.removeprefix(home): data for name, data in contents.items() if name.startswith(f"{home}{FOLDER}/")}
    kept = digest_of(replace(files, files=beside))
    return _added(_Wanted(digest_of(files), files.main, files.body, tuple(wanted), kept, files, logged=beside))


def _added(asked: _Wanted) -> ModelFiles:
    """The model with the pieces of its meshes, among its files too."""
    stored, home = _decomposed(asked), posixpath.dirname(asked.main)
    added = {posixpath.join(home, name): content for name, content, _ in stored.values()}
    pieces = {mesh: decomposition for mesh, (*_, decomposition) in stored.items()}
    return replace(asked.files, files={**asked.files.files, **added}, pieces=pieces)


@lru_cache(maxsize=8)
def _decomposed(asked: _Wanted) -> dict[str, tuple[str, bytes, Decomposition]]:
    """Name and content of the file with the pieces of each mesh, and the pieces.

    Raises:
        InputError: See :func:`with_pieces`.
        ScenarioFaults: See there.
    """
    stored = {}
    with mujoco.MjVfs() as vfs, collected_warnings([]), catch_warnings(action="ignore"):
        spec = load_spec(asked.files, vfs)
        meshes = {mesh.name: mesh for mesh in spec.meshes}
        for i, one in enumerate(asked.wanted):
            if one.mesh not in meshes:
                raise ScenarioFaults([Fault(unknown_name("mesh", one.mesh, list(meshes)), (i, "mesh"))])
            if one.mesh in stored:
                raise ScenarioFaults([Fault(f"mesh {one.mesh!r} is listed twice", (i, "mesh"))])
            mesh = FileMesh(asked.files, spec, meshes[one.mesh])
            shape = mesh.compiled_vertices, mesh.compiled_faces
            request = Request(*shape, one.method, one.tolerance_m, one.mesh, mesh.place, one.depth_m)
            stored[one.mesh] = _stored(asked, request)
    return stored


def _stored(asked: _Wanted, request: Request) -> tuple[str, bytes, Decomposition]:
    """Name and content of the file with the pieces of a mesh, and the pieces.

    Raises:
        InputError: It cannot be decomposed; or a log has none.
    """
    place = asked.files.place_of(posixpath.join(posixpath.dirname(asked.main), ""))
    beside = asked.logged
    if beside is None:
        beside = {} if asked.folder is None else read_folder(asked.folder, request)
    present = stored_in(request, beside, place, any_version=asked.logged is not None)
    if present is not None:
        return present
    if asked.logged is not None:
        raise InputError(f"{request.place}: its pieces by {request.method} are not in the log")
    pieces = decompose(request)
    name, content = request.name(pieces.version), to_json(pieces)
    if asked.folder is not None:
        write(asked.folder, name, content)
    return name, content, pieces


def decomposed_geoms(model: Any, files: Mapping[str, ModelFiles]) -> Iterator[tuple[int, tuple[Polytope, ...]]]:
    """Geoms of a compiled scene with decomposed meshes, by id, and their pieces in the axes of the geom.

    MuJoCo moves the origin of a mesh to its centre of mass and turns its axes to the principal ones; the pose of a geom has
    the inverse.

    Args:
        model: Compiled scene.
        files: Files of each model by name.
    """
    by_mesh = {f"{name}/{mesh}": pieces for name, file in files.items() for mesh, pieces in file.pieces.items()}
    moved = dict[int, tuple[Polytope, ...]]()
    for geom in np.flatnonzero(model.geom_type == int(mujoco.mjtGeom.mjGEOM_MESH)).tolist():
        mesh = int(model.geom_dataid[geom])
        stored = by_mesh.get(model.mesh(mesh).name)
        if stored is None:
            continue
        if mesh not in moved:
            turn = np.empty(9)
            mujoco.mju_quat2Mat(turn, model.mesh_quat[mesh])
            inverse = turn.reshape(3, 3).T
            moved[mesh] = tuple(piece.moved(-inverse @ model.mesh_pos[mesh], inverse) for piece in stored.pieces)
        yield geom, moved[mesh]
