"""A model as an editable specification of MuJoCo, with names for all elements and the parts that a URDF cannot describe."""

from __future__ import annotations

import hashlib
import posixpath
import re
from collections.abc import Iterable
from functools import lru_cache
from typing import Any

import mujoco

from ffsm_mj.errors import InputError
from ffsm_mj.model.compilation import compile_spec
from ffsm_mj.model.files import ModelFiles
from ffsm_mj.model.one_file import keep_body
from ffsm_mj.model.packages import SCHEME
from ffsm_mj.model.timing import Timing, take_timing
from ffsm_mj.model.xml import elements

REFUSALS = (ValueError, RuntimeError, MemoryError)
"""Exceptions that MuJoCo raises for a model that it refuses."""


def load_spec(files: ModelFiles, vfs: Any) -> Any:
    """Parse an MJCF or URDF; every body, joint, geom, site, actuator and sensor has a name afterwards.

    Args:
        files: Files of the model.
        vfs: MuJoCo's virtual files; the model's are added. They are needed until the model is compiled.

    Raises:
        InputError: MuJoCo cannot parse it, or it has no tree with the body of the model.
    """
    return load_with_timing(files, vfs)[0]


def load_with_timing(files: ModelFiles, vfs: Any) -> tuple[Any, Timing]:
    """Parse a model as :func:`load_spec` does; returns also the timing in the file, which MuJoCo is not given."""
    spec = parse_spec(files, vfs)
    for mesh in spec.meshes:  # with the scheme, MuJoCo searches for the base name only
        mesh.file = mesh.file.removeprefix(SCHEME)
    if spec.strippath:
        _strip_folders(spec)
    if files.urdf:
        _complete_urdf(spec, floats=files.pose is None)
    for element in [*spec.lights, *spec.cameras]:
        if element.targetbody == "world":  # it would get the prefix of the model, and be unknown
            spec.delete(element)
    for skin in [skin for skin in spec.skins if "world" in skin.bodyname]:
        spec.delete(skin)
    _name_all(spec)
    if files.body:
        keep_body(spec, files.body, files.place)
    return spec, take_timing(spec)


def parse_spec(files: ModelFiles, vfs: Any) -> Any:
    """Parse an MJCF or URDF without additions; see :func:`load_spec`.

    Raises:
        InputError: MuJoCo cannot parse it.
    """
    try:
        return mujoco.MjSpec.from_file(_mounted(files, vfs), vfs=vfs)
    except REFUSALS as error:
        raise InputError(mujoco_line(files, error)) from error


def _mounted(files: ModelFiles, vfs: Any) -> str:
    """Add the files to the virtual files of MuJoCo; returns the virtual name of the main file.

    The folder name contains a digest, because MuJoCo caches compiled meshes by name. No such folder exists on disk, so that
    MuJoCo cannot find a missing file there.
    """
    folder = f"ffsm-{digest_of(files)}"
    if f"{folder}/{files.main}" not in vfs:  # two objects may have the same model
        for name, content in files.files.items():
            vfs[f"{folder}/{name}"] = content
    return f"{folder}/{files.main}"


def digest_of(files: ModelFiles) -> str:
    """SHA-256 of the names and contents of a model's files."""
    return _digest(tuple(files.files.items()))


@lru_cache(maxsize=4)
def _digest(files: tuple[tuple[str, bytes], ...]) -> str:
    """SHA-256 of files, cached: a model that is compiled again consists of the same objects."""
    digest = hashlib.sha256()
    for name, content in files:
        digest.update(f"{len(name)} {name} {len(content)} ".encode() + content)
    return digest.hexdigest()


def _strip_folders(spec: Any) -> None:
    """Apply ``strippath`` to the names of assets, as the scene to which the model is attached lacks this option."""
    for asset in (*spec.meshes, *spec.textures, *spec.hfields, *spec.skins):
        asset.file = posixpath.basename(asset.file)
    for texture in spec.textures:
        for i, file in enumerate(texture.cubefiles):
            texture.cubefiles[i] = posixpath.basename(file)


def _complete_urdf(spec: Any, *, floats: bool) -> None:
    """Add what a URDF cannot describe: a free joint at the root, a motor on each joint, a site on each link.

    The free joint is named ``base``, a motor ``<joint>_motor``, a site like its link.
    """
    spec.compiler.fusestatic = False  # keep fixed links, such as a tool frame, and the root as bodies
    root = spec.worldbody.first_body()
    if floats and root is not None and not root.joints:
        root.add_freejoint(name="base")
    for body in spec.bodies[1:]:
        body.add_site(name=body.name)
    for joint in spec.joints:
        if joint.type in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
            motor = spec.add_actuator(name=f"{joint.name}_motor", target=joint.name)
            motor.trntype = mujoco.mjtTrn.mjTRN_JOINT
            motor.set_to_motor()


def _name_all(spec: Any) -> None:
    """Give each element without a name one derived from its parent: logs, scenarios and messages refer to names."""
    taken = {element.name for kind in ("bodies", "joints", "geoms", "sites", "actuators") for element in getattr(spec, kind)}

    def name(element: Any, wanted: str) -> None:
        if not element.name:
            element.name = next(n for n in (wanted, *(f"{wanted}_{i}" for i in range(2, 10_000))) if n not in taken)
            taken.add(element.name)

    for body in spec.bodies[1:]:  # the first is the world
        name(body, "body")
        for joint in body.joints:
            name(joint, f"{body.name}_joint")
    for geom in spec.geoms:
        name(geom, f"{geom.parent.name}_geom")
    for site in spec.sites:
        name(site, f"{site.parent.name}_site")
    for actuator in spec.actuators:
        name(actuator, f"{actuator.target or 'actuator'}_motor")
    for sensor in spec.sensors:
        kind = mujoco.mjtSensor(sensor.type).name.removeprefix("mjSENS_").lower()
        name(sensor, f"{sensor.objname}_{kind}" if sensor.objname else kind)
    for tendon in spec.tendons:
        name(tendon, "tendon")
    for key in spec.keys:  # with the prefix, two empty names would collide
        name(key, "key")
    for equality in spec.equalities:
        name(equality, f"{equality.name1 or 'equality'}_equality")


def own_words(models: Iterable[ModelFiles], vfs: Any, error: Exception) -> str:
    """Message for an error of the scene, which names no file: that of the first model which fails alone, if any."""
    models = tuple(models)
    for files in models:
        try:
            compile_spec(load_spec(files, vfs), vfs)
        except REFUSALS as own:
            return mujoco_line(files, own)
    return f"{' and '.join(files.place for files in models)}: {' '.join(str(error).split())}"


def mujoco_line(files: ModelFiles, error: Exception) -> str:
    """MuJoCo's message on one line after the name of the file; "line 0" is replaced by the lines of such elements."""
    text = " ".join(str(error).split()).replace(f"ffsm-{digest_of(files)}/", files.label)
    without_line = re.search(r"Element '(\w+)', line 0\b", text)
    if without_line:
        places = [
            e.place.rpartition(":")[2] for e in elements(files.files[files.main], files.place) if e.tag == without_line[1]
        ]
        lines = f", line {' or '.join(places)}" if places else ""
        text = text.replace(without_line.group(), f"Element '{without_line[1]}'{lines}")
    return f"{files.place}: {text}"
