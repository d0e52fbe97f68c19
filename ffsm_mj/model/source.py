"""A model as MuJoCo's editable specification, completed: names for all, and what URDF has no words for."""

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
from ffsm_mj.model.packages import SCHEME
from ffsm_mj.model.xml import elements

REFUSALS = (ValueError, RuntimeError, MemoryError)
"""What MuJoCo raises for a model that it does not take."""


def load_spec(files: ModelFiles, vfs: Any) -> Any:
    """Parse an MJCF or URDF; every body, joint, geom, site and actuator has a name afterwards.

    Args:
        files: The model.
        vfs: MuJoCo's virtual files; the model's are added. They are needed until the model is compiled.

    Raises:
        InputError: MuJoCo cannot parse it.
    """
    spec = parse_spec(files, vfs)
    for mesh in spec.meshes:  # with it, MuJoCo looks for the last part of the name alone
        mesh.file = mesh.file.removeprefix(SCHEME)
    if spec.strippath:
        _strip_folders(spec)
    if files.urdf:
        _complete_urdf(spec, floats=files.pose is None)
    _name_all(spec)
    return spec


def parse_spec(files: ModelFiles, vfs: Any) -> Any:
    """Parse an MJCF or URDF, and add nothing to it; see :func:`load_spec`.

    Raises:
        InputError: MuJoCo cannot parse it.
    """
    try:
        return mujoco.MjSpec.from_file(_mounted(files, vfs), vfs=vfs)
    except REFUSALS as error:
        raise InputError(mujoco_line(files, error)) from error


def _mounted(files: ModelFiles, vfs: Any) -> str:
    """Name of the main file among the virtual ones.

    The digest keeps apart what MuJoCo keeps by name (compiled meshes), and no such folder exists: a file that is missing
    here is not found on disk either.
    """
    folder = f"ffsm-{digest_of(files)}"
    if f"{folder}/{files.main}" not in vfs:  # two objects may be of one kind
        for name, content in files.files.items():
            vfs[f"{folder}/{name}"] = content
    return f"{folder}/{files.main}"


def digest_of(files: ModelFiles) -> str:
    """SHA-256 of the names and contents of a model's files."""
    return _digest(tuple(files.files.items()))


@lru_cache(maxsize=4)
def _digest(files: tuple[tuple[str, bytes], ...]) -> str:
    """SHA-256 of files; those of a model that is compiled again are the same objects, and need not be read again."""
    digest = hashlib.sha256()
    for name, content in files:
        digest.update(f"{len(name)} {name} {len(content)} ".encode() + content)
    return digest.hexdigest()


def _strip_folders(spec: Any) -> None:
    """Do what ``strippath`` says: the scene that the model is attached to does not, and holds files of other models."""
    for asset in (*spec.meshes, *spec.textures, *spec.hfields, *spec.skins):
        asset.file = posixpath.basename(asset.file)
    for texture in spec.textures:
        for i, file in enumerate(texture.cubefiles):
            texture.cubefiles[i] = posixpath.basename(file)


def _complete_urdf(spec: Any, *, floats: bool) -> None:
    """Give a URDF what it has no words for: a root that floats, a motor on each joint, a site on each link.

    The free joint is named ``base``, a motor ``<joint>_motor``, a site like its link.
    """
    spec.compiler.fusestatic = False  # a fixed tool frame stays a body, and so does the root
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
    """Name what has no name after what it belongs to, because logs, scenarios and errors speak of names."""
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
    for tendon in spec.tendons:
        name(tendon, "tendon")
    for key in spec.keys:  # two without a name would be one name with the prefix
        name(key, "key")
    for equality in spec.equalities:
        name(equality, f"{equality.name1 or 'equality'}_equality")


def own_words(models: Iterable[ModelFiles], vfs: Any, error: Exception) -> str:
    """A complaint of the scene, which names no file, as the complaint of the model that has the same alone."""
    models = tuple(models)
    for files in models:
        try:
            compile_spec(load_spec(files, vfs), vfs)
        except REFUSALS as own:
            return mujoco_line(files, own)
    return f"{' and '.join(files.place for files in models)}: {' '.join(str(error).split())}"


def mujoco_line(files: ModelFiles, error: Exception) -> str:
    """MuJoCo's own message on one line, with the file in front; "line 0" as the lines on which such elements stand."""
    text = " ".join(str(error).split())
    nowhere = re.search(r"Element '(\w+)', line 0\b", text)
    if nowhere:
        places = [e.place.rpartition(":")[2] for e in elements(files.files[files.main], files.place) if e.tag == nowhere[1]]
        lines = f", line {' or '.join(places)}" if places else ""
        text = text.replace(nowhere.group(), f"Element '{nowhere[1]}'{lines}")
    return f"{files.place}: {text}"
