"""What a robot's file has, as its vendor wrote it: its tree, its joints, and what drives them."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple
from warnings import catch_warnings

import mujoco

from ffsm_mj.errors import InputError, unknown_name
from ffsm_mj.hull import hull_offset
from ffsm_mj.model.composition import compile_system
from ffsm_mj.model.decompose import Decompose, with_pieces
from ffsm_mj.model.files import ModelFiles, read_model
from ffsm_mj.model.mujoco_process import collected_warnings
from ffsm_mj.model.source import compile_spec, load_spec, parse_spec
from ffsm_mj.model.system import System
from ffsm_mj.model.unsupported import BELOW_ZERO

_STRIPS = ("damping", "stiffness", "frictionloss", "limits", "equalities", "tendons", "servos", "sensors")
"""What may have to be taken out of a model, for a kind that is not modelled."""
_TIME_STEP_S = 0.001
_CONVEX_M = 1e-4
"""Meshes whose convex hull is closer than this need no pieces."""


@dataclass(frozen=True)
class Vendor:
    """A robot's file.

    Attributes:
        folder: Folder that holds all the files it uses, those of packages left out; absolute.
        root: Name of the body that moves with everything below it; empty where the file gives it none.
        floats: Whether that body is free already, in space or in a plane.
        urdf: Whether the file is a URDF.
        motors: Joints that are to get a motor, with the greatest effort that the file states for each, if any.
        names: Names of bodies, joints, geoms, sites and actuators that are taken.
        mass: Of everything below the root, kg.
    """

    folder: Path
    root: str
    floats: bool
    urdf: bool
    motors: dict[str, float | None]
    names: frozenset[str]
    mass: float


def read_vendor(path: Path, packages: Sequence[Path], wanted: str = "") -> Vendor:
    """Read a robot's file.

    Args:
        path: MJCF or URDF.
        packages: Folders of the packages that a URDF names, beside those above it.
        wanted: The body that the robot is with all below it, where the file has several that move; empty: the only one.

    Raises:
        InputError: It cannot be read or compiled, or is not one tree of moving bodies.
    """
    files = read_model(path, [Path(path.absolute().anchor)], packages)
    with mujoco.MjVfs() as vfs, collected_warnings([]), catch_warnings(action="ignore"):
        spec = parse_spec(files, vfs)
        root = _root(spec, files.place, wanted)
        types = [joint.type for joint in root.joints]
        slides = types.count(mujoco.mjtJoint.mjJNT_SLIDE)
        floats = mujoco.mjtJoint.mjJNT_FREE in types or slides > 1
        kinds = (spec.bodies, spec.joints, spec.geoms, spec.sites, spec.actuators)
        return Vendor(
            folder=Path(os.path.abspath(files.label or ".")),
            root=root.name,
            floats=floats,
            urdf=files.urdf,
            motors=_motors(spec, _below(root, with_root=not floats)),
            names=frozenset(element.name for kind in kinds for element in kind),
            mass=_mass(files, vfs, root.name),
        )


def needed_strips(files: ModelFiles) -> list[str]:
    """What must be taken out of a model so that a conservative scenario takes it; nothing where that would not help.

    Raises:
        InputError: The model has a friction below zero: a mistake, which is not taken out.
    """
    needed = list(_STRIPS)
    if _is_accepted(files, ()) or not _is_accepted(files, needed):
        return []
    for word in _STRIPS:
        less = [strip for strip in needed if strip != word]
        needed = less if _is_accepted(files, less) else needed
    if "frictionloss" in needed:
        refused = _refused(files, [strip for strip in needed if strip != "frictionloss"])
        if mistakes := [line for line in refused if BELOW_ZERO in line]:
            raise InputError(mistakes)
    return needed


class Decomposable(NamedTuple):
    """Meshes of a model that touch something and are not convex.

    Attributes:
        wanted: Those that can be decomposed, as a scenario has them.
        lines: What became of all of them, as text.
    """

    wanted: tuple[Decompose, ...]
    lines: tuple[str, ...]

    @property
    def data(self) -> list[dict[str, Any]]:
        """Those that can be decomposed, as plain data for a file."""
        return [one.model_dump(exclude_defaults=True) for one in self.wanted]


def decomposable(files: ModelFiles, system: System, name: str, method: str, folder: Path) -> Decomposable:
    """Find and decompose the meshes of a model that touch something and are not convex.

    Args:
        files: Files of the model.
        system: A scene with it.
        name: Its name in the scene.
        method: ``planes`` or ``coacd``.
        folder: Folder of its main file.
    """
    mj, prefix = system.mj, f"{name}/"
    solid = (mj.geom_contype | mj.geom_conaffinity) != 0
    meshes = dict[str, None]()
    for geom in range(mj.ngeom):
        if solid[geom] and mj.geom(geom).name.startswith(prefix) and hull_offset(mj, geom) > _CONVEX_M:
            meshes[mj.mesh(int(mj.geom_dataid[geom])).name.removeprefix(prefix)] = None
    wanted, lines = list[Decompose](), list[str]()
    for mesh in meshes:
        one = Decompose.model_validate({"mesh": mesh, "method": method})
        try:
            pieces = with_pieces(files, [one], folder, ()).pieces[mesh]
        except InputError as error:
            lines.append(f"{mesh} stays its hull: {error.lines[0]}")
        else:
            wanted.append(one)
            lines.append(f"{mesh}: {pieces.sentence}")
    return Decomposable(tuple(wanted), tuple(lines))


def _is_accepted(files: ModelFiles, strip_words: Sequence[str]) -> bool:
    return not _refused(files, strip_words)


def _refused(files: ModelFiles, strip_words: Sequence[str]) -> Sequence[str]:
    """Why a conservative scenario does not take a model without some elements; empty if it does."""
    try:
        compile_system(replace(files, strip=tuple(strip_words)), {}, time_step_s=_TIME_STEP_S)
    except InputError as error:
        return error.lines
    return ()


def _root(spec: Any, place: str, wanted: str) -> Any:
    """The one body below the world that moves, or under which something does."""
    moving = [body for body in spec.worldbody.bodies if any(_below(body))]
    names = [body.name or "one without a name" for body in moving]
    if wanted:
        if wanted not in names:
            raise InputError(f"new: --root: {unknown_name('root of a tree', wanted, names)}")
        return moving[names.index(wanted)]
    if not moving:
        raise InputError(f"{place}: a robot is a tree of moving bodies; no joint was found")
    if len(moving) > 1:
        several = f"{len(moving)} ({', '.join(names)})"
        raise InputError(f"{place}: a robot is one tree of moving bodies; found {several}: name the robot's with --root")
    return moving[0]


def _below(body: Any, *, with_root: bool = True) -> Iterator[Any]:
    """Joints of a body, if its own count, and of all below it."""
    if with_root:
        yield from body.joints
    for child in body.bodies:
        yield from _below(child)


def _motors(spec: Any, joints: Iterator[Any]) -> dict[str, float | None]:
    """Joints that are to get a motor, of a file without actuators, with the greatest effort that it states, if any.

    Joints without a name cannot have one, and the followers of couplings need none.
    """
    if spec.actuators:
        return {}  # what it leaves without a drive is passive
    followers = {equality.name1 for equality in spec.equalities if equality.type == mujoco.mjtEq.mjEQ_JOINT}
    return {
        joint.name: float(abs(joint.actfrcrange).max()) if joint.actfrcrange.any() else None
        for joint in joints
        if joint.type in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
        and joint.name
        and joint.name not in followers
    }


def _mass(files: ModelFiles, vfs: Any, root: str) -> float:
    try:
        model = compile_spec(load_spec(files, vfs), vfs)
    except (ValueError, RuntimeError) as error:
        raise InputError(f"{files.place}: {' '.join(str(error).split())}") from error
    return float(model.body_subtreemass[model.body(root).id if root else 0])
