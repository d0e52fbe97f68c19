"""What a robot's file has, as its vendor wrote it: its tree, its joints, and what drives them."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from warnings import catch_warnings

import mujoco

from ffsm_mj.errors import InputError, unknown_name
from ffsm_mj.model.compilation import compile_spec
from ffsm_mj.model.files import ModelFiles, read_model
from ffsm_mj.model.joint_limits import is_limited
from ffsm_mj.model.mujoco_warnings import collected_warnings
from ffsm_mj.model.source import load_spec, parse_spec
from ffsm_mj.model.strip import strip

_NEEDED = ("frictionloss", "equalities", "servos")
"""What ``strip`` takes out because a conservative scenario refuses it; springs and dampers of joints act."""


@dataclass(frozen=True)
class Vendor:
    """A robot's file.

    Attributes:
        folder: Folder that holds all the files it uses, those of packages left out; absolute.
        root: Name of the body that moves with everything below it; empty where the file gives it none.
        floats: Whether that body is free already, in space or in a plane.
        urdf: Whether the file is a URDF.
        motors: Joints that are to get a motor, with the greatest effort that the file states for each, if any.
        names: Names of bodies, joints, geoms and actuators that are taken.
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
        kinds = (spec.bodies, spec.joints, spec.geoms, spec.actuators)
        return Vendor(
            folder=Path(os.path.abspath(files.label or ".")),
            root=root.name,
            floats=floats,
            urdf=files.urdf,
            motors=_motors(spec, _below(root, own=not floats)),
            names=frozenset(each.name for kind in kinds for each in kind),
            mass=_mass(files, vfs, root.name),
        )


def needed_strips(files: ModelFiles) -> list[str]:
    """What must be taken out of a model for a conservative scenario, as the scenario's ``strip`` has it."""
    with mujoco.MjVfs() as vfs, collected_warnings([]), catch_warnings(action="ignore"):
        spec = load_spec(files, vfs)
        limited_tendons = any(map(is_limited, spec.tendons))
        elastic_tendons = any(each.stiffness.any() or each.damping.any() for each in spec.tendons)
        needed = ["damping"] if any(each.damping.any() for each in spec.actuators) else []
        needed += [word for word in _NEEDED if strip(spec, [word])]
        return [*needed, "tendons"] if limited_tendons or elastic_tendons else needed


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
        found = f"{len(moving)} ({', '.join(names)})"
        raise InputError(f"{place}: a robot is one tree of moving bodies; found {found}: name the robot's with --root")
    return moving[0]


def _below(body: Any, *, own: bool = True) -> Iterator[Any]:
    """Joints of a body, if its own count, and of all below it."""
    if own:
        yield from body.joints
    for child in body.bodies:
        yield from _below(child)


def _motors(spec: Any, joints: Iterator[Any]) -> dict[str, float | None]:
    """Joints that no plain motor drives, with the greatest effort that the file states; those without a name cannot."""
    limits: dict[str, float] = {}
    for actuator in spec.actuators:
        if actuator.trntype == mujoco.mjtTrn.mjTRN_JOINT and actuator.forcerange.any():
            limits[actuator.target] = float(abs(actuator.forcerange * actuator.gear[0]).max())
    strip(spec, ["servos"])
    driven = {each.target for each in spec.actuators if each.trntype == mujoco.mjtTrn.mjTRN_JOINT}
    wanted = [
        joint
        for joint in joints
        if joint.type in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
        and joint.name
        and joint.name not in driven
    ]
    stated = {joint.name: float(abs(joint.actfrcrange).max()) for joint in wanted if joint.actfrcrange.any()}
    return {joint.name: limits.get(joint.name, stated.get(joint.name)) for joint in wanted}


def _mass(files: ModelFiles, vfs: Any, root: str) -> float:
    try:
        model = compile_spec(load_spec(files, vfs), vfs)
    except (ValueError, RuntimeError) as error:
        raise InputError(f"{files.place}: {' '.join(str(error).split())}") from error
    return float(model.body_subtreemass[model.body(root).id if root else 0])
