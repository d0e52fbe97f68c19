"""A model as an editable specification of MuJoCo, with names for all elements and the parts that a URDF cannot describe.

Models are compiled alone before they are attached to a scene. A reference to a missing element is an error then; attaching
would drop such a motor or constraint silently. A campaign compiles the same files thousands of times, so results are kept
for the process.
"""

from __future__ import annotations

import hashlib
import os
import posixpath
import re
import sys
from collections.abc import Container, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import chain, count
from threading import Lock
from typing import Any

import mujoco

from ffsm_mj.errors import InputError
from ffsm_mj.model.files import SCHEME, ModelFiles
from ffsm_mj.model.meshes import weigh_by_volume
from ffsm_mj.model.mujoco_process import collected_warnings
from ffsm_mj.model.one_file import keep_body
from ffsm_mj.model.sensors import Timing, take_timing
from ffsm_mj.model.xml import elements

_REDIRECTED = Lock()
"""Descriptors belong to the process: of two threads that redirect one, the second would keep and restore the null device."""


def compile_spec(spec: Any, vfs: Any) -> Any:
    """Compile a spec without output of the libraries that MuJoCo uses.

    Qhull prints a page to the process's standard error for a mesh that is flat, before MuJoCo raises an exception that says
    the same.

    Args:
        spec: MuJoCo spec.
        vfs: MuJoCo's virtual files.

    Raises:
        ValueError: The spec does not compile; the other exceptions of ``MjSpec.compile`` likewise.
    """
    with _REDIRECTED, _standard_error_discarded():
        return spec.compile(vfs=vfs)


@contextmanager
def _standard_error_discarded() -> Iterator[None]:
    """Redirect descriptor 2 to the null device; no effect if it is closed."""
    with suppress(AttributeError, OSError, ValueError):
        sys.stderr.flush()
    try:
        kept = os.dup(2)
    except OSError:
        yield
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(nowhere)
        os.close(kept)


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
    return load_completely(files, vfs)[0]


def load_completely(files: ModelFiles, vfs: Any) -> tuple[Any, Timing, list[str]]:
    """Parse a model as :func:`load_spec` does; returns also the timing in the file, which MuJoCo is not given, and notes."""
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
    return spec, take_timing(spec), weigh_by_volume(spec, files)


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


def unused(wanted: str, used: Container[str]) -> str:
    """A name that is not used yet: the one that is wanted, or else with a number from 2 on."""
    return next(name for name in chain((wanted,), (f"{wanted}_{i}" for i in count(2))) if name not in used)


def _name_all(spec: Any) -> None:
    """Give each element without a name one derived from its parent: logs, scenarios and messages refer to names."""
    used = {element.name for kind in ("bodies", "joints", "geoms", "sites", "actuators") for element in getattr(spec, kind)}

    def name(element: Any, wanted: str) -> None:
        if not element.name:
            element.name = unused(wanted, used)
            used.add(element.name)

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


def describe_error(models: Iterable[ModelFiles], vfs: Any, error: Exception) -> str:
    """Message for an error of the scene, which names no file: that of the first model which fails alone, if any."""
    models = tuple(models)
    for files in models:
        try:
            compile_spec(load_spec(files, vfs), vfs)
        except REFUSALS as refusal:
            return mujoco_line(files, refusal)
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


_NOT_ALIGNED = mujoco.mjtAlignFree.mjALIGNFREE_FALSE


@dataclass(frozen=True)
class CompiledAlone:
    """A model compiled alone.

    Attributes:
        mj: The MuJoCo model, shared and only to be read.
        warnings: MuJoCo's warnings about it.
    """

    mj: Any
    warnings: tuple[str, ...]


def warnings_alone(files: ModelFiles, vfs: Any) -> tuple[str, ...]:
    """Compile a model as its files are; returns MuJoCo's warnings.

    Args:
        files: Files of the model.
        vfs: MuJoCo's virtual files; the model's are added if it is compiled.

    Raises:
        InputError: It does not compile.
    """
    return _warnings(_asked(files, vfs))


def compiled_alone(files: ModelFiles, vfs: Any) -> CompiledAlone:
    """Compile the specification of :func:`spec_alone`.

    Args:
        files: Files of the model.
        vfs: MuJoCo's virtual files; the model's are added if it is compiled.

    Raises:
        InputError: It does not compile.
    """
    return _compiled(_asked(files, vfs))


def spec_alone(files: ModelFiles, vfs: Any) -> Any:
    """A model with the bodies, geoms and masses that it has in a scene, each body in the frame of its file.

    Raises:
        InputError: MuJoCo cannot parse it.
    """
    spec = load_spec(files, vfs)
    spec.compiler.settotalmass = -1.0  # only the compiler of the scene could do these
    spec.compiler.fusestatic = spec.compiler.discardvisual = False
    for joint in spec.joints:
        joint.align = _NOT_ALIGNED
    return spec


@dataclass(frozen=True)
class _Request:
    """A model to be compiled, compared by the content of its files."""

    digest: str
    main: str
    floats: bool
    body: str
    files: ModelFiles = field(compare=False)
    vfs: Any = field(compare=False)


def _asked(files: ModelFiles, vfs: Any) -> _Request:
    return _Request(digest_of(files), files.main, files.pose is None, files.body, files, vfs)


@lru_cache(maxsize=8)
def _warnings(asked: _Request) -> tuple[str, ...]:
    return _compile(load_spec, asked).warnings


@lru_cache(maxsize=8)
def _compiled(asked: _Request) -> CompiledAlone:
    return _compile(spec_alone, asked)


def _compile(load: Any, asked: _Request) -> CompiledAlone:
    warnings: list[str] = []
    with collected_warnings(warnings):
        spec = load(asked.files, asked.vfs)
        try:
            return CompiledAlone(compile_spec(spec, asked.vfs), tuple(warnings))
        except REFUSALS as error:
            raise InputError(mujoco_line(asked.files, error)) from error
