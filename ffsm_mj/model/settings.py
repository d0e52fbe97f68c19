"""Settings of a model file that a scene does not take over: refused where they change the plant, or else noted by name.

A scene has one set of options, those of :mod:`ffsm_mj.model.composition`, where options of MuJoCo's solvers and surroundings
are noted. Settings of its output and memory are not mentioned. An attached model's options have no effect in MuJoCo either.
"""

from __future__ import annotations

import posixpath
from collections.abc import Callable, Iterator
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.model.edits import is_limited
from ffsm_mj.model.files import ModelFiles
from ffsm_mj.model.places import Places
from ffsm_mj.model.unsupported import is_disabled
from ffsm_mj.model.xml import Element, elements

_PLANT_OPTIONS = ("gravity", "wind", "density", "viscosity", "magnetic", "actuatorgroupdisable")
_PLANT_FLAGS = (
    *("spring", "damper", "frictionloss", "equality", "actuation", "clampctrl"),
    *("limit", "gravity", "contact", "constraint"),
)
_OF_CONSTRAINT = ("frictionloss", "equality")
"""Flags that ``constraint`` includes; contacts and limits are those of contact models."""
_DISABLED: tuple[tuple[str, Callable[[Any], bool], str], ...] = (
    (
        "spring",
        lambda spec: _any(spec.joints, "stiffness"),
        "remove the stiffness of the joints, or use 'strip: [stiffness]'",
    ),
    ("damper", lambda spec: _any(spec.joints, "damping"), "remove the damping of the joints, or use 'strip: [damping]'"),
    (
        "frictionloss",
        lambda spec: any(joint.frictionloss for joint in (*spec.joints, *spec.tendons)),
        "remove the frictionloss of joints and tendons, or use 'strip: [frictionloss]'",
    ),
    (
        "equality",
        lambda spec: any(equality.active for equality in spec.equalities),
        "remove the equality constraints, or use 'strip: [equalities]'",
    ),
    ("actuation", lambda spec: bool(spec.actuators), "remove the actuators, or the flag"),
    ("clampctrl", lambda spec: _any(spec.actuators, "ctrlrange"), "remove the ctrlrange of the actuators, or the flag"),
)
"""Flags whose absence from a scene would switch something on: the flag, whether the model has it, and what to do."""


def setting_faults(spec: Any, files: ModelFiles) -> list[str]:
    """Settings of a model file with which MuJoCo would simulate another plant than a scene.

    Args:
        spec: Specification of the model.
        files: Its files.
    """
    faults = []
    constraints = is_disabled(spec, "constraint")
    for flag, present, advice in _DISABLED:
        written = flag if is_disabled(spec, flag) else "constraint" if constraints and flag in _OF_CONSTRAINT else ""
        if written and present(spec):
            faults.append(f'{_place(files, "flag", written)}: <flag {written}="disable"> has no effect in a scene; {advice}')
    off = [actuator.name for actuator in spec.actuators if spec.option.disableactuator >> actuator.group & 1]
    if off:
        where = _place(files, "option", "actuatorgroupdisable")
        faults.append(
            f"{where}: <option actuatorgroupdisable> has no effect in a scene; remove {', '.join(off)}, or the option"
        )
    return [*faults, *_merging(files), *(_deformable(files) if spec.flexes else ())]


def _merging(files: ModelFiles) -> Iterator[str]:
    """Options of attached files that MuJoCo would adopt; the specification does not say which of its options these are."""
    if any(files.elements("<attach")):
        for element in files.elements("conflict"):
            if element.tag == "compiler" and element.attributes.get("conflict") == "merge":
                yield (
                    f'{element.place}: <compiler conflict="merge"> would adopt options of attached files; remove it, and '
                    f"write them in {files.place}"
                )


def _deformable(files: ModelFiles) -> Iterator[str]:
    """Flexes, also rigid ones: their elastic and contact forces would be MuJoCo's."""
    for element in files.elements():
        if element.tag in ("flexcomp", "flex") and "equality" not in element.parents:
            yield f"{element.place}: <{element.tag}>: deformable bodies are not modelled; remove it, or use a mesh geom"


def _any(listed: Any, name: str) -> bool:
    return any(getattr(element, name).any() for element in listed)


def outermost_faults(spec: Any, files: ModelFiles) -> Iterator[str]:
    """``settotalmass`` and ``fitaabb`` of any file of a model: MuJoCo applies those of the outermost model, the scene."""
    fitted = any(geom.meshname and geom.type != mujoco.mjtGeom.mjGEOM_MESH for geom in spec.geoms)
    for element in files.elements("settotalmass", "fitaabb"):
        if element.tag != "compiler":
            continue
        if not element.attributes.get("settotalmass", "-1").lstrip().startswith("-"):
            mass = element.attributes["settotalmass"]
            yield (
                f"{element.place}: <compiler settotalmass={mass!r}> would have no effect in a scene; "
                "scale the masses and densities in the file, or give masses under 'model' in the scenario, and remove it"
            )
        if fitted and element.attributes.get("fitaabb") == "true":
            yield (
                f'{element.place}: <compiler fitaabb="true"> would have no effect in a scene; '
                "write sizes in place of meshes for the geoms that fit one, and remove it"
            )


def setting_notes(spec: Any, name: str, files: ModelFiles) -> Iterator[str]:
    """Settings and contact attributes of a model file that a scene replaces, and settings of the files that it attaches.

    Args:
        spec: Specification of the model; all its elements have names.
        name: Name of the model in the scene.
        files: Its files.
    """
    for flag in ("limit", "constraint"):
        if is_disabled(spec, flag) and any(map(is_limited, spec.joints)):
            yield (
                f'{_place(files, "flag", flag)}: <flag {flag}="disable"> has no effect in a scene: joints stop at their '
                "limits; write 'limits: ignore' in the scenario to remove them"
            )
    for flag in ("contact", "constraint", "filterparent"):
        if is_disabled(spec, flag):
            where = _place(files, "flag", flag)
            yield f'{where}: <flag {flag}="disable"> has no effect in a scene: contact rules say what meets'
    places = Places(spec, {name: files})
    for kind, element, attribute in _contact_forces(spec):
        place = places.of(kind, f"{name}/{element}")
        yield f"{place} has {attribute}, which has no effect: contact models replace MuJoCo's contact forces"
    for inner in _of_attached_files(files):
        known = _PLANT_OPTIONS if inner.tag == "option" else _PLANT_FLAGS if inner.tag == "flag" else ()
        for key in known:
            if key in inner.attributes and not _holds(spec, inner.tag, key, inner.attributes[key]):
                yield (
                    f"{inner.place}: <{inner.tag} {key}={inner.attributes[key]!r}> of an attached file has no effect, "
                    f"as in MuJoCo: write it in {files.place}"
                )


def _contact_forces(spec: Any) -> Iterator[tuple[str, str, str]]:
    """Attributes by which MuJoCo's contacts pull or drive, unlike a material property: kind and name of the element."""
    for geom in spec.geoms:
        if geom.adhesion:
            yield "geom", geom.name, "adhesion"
        if np.any(geom.surfacevel):
            yield "geom", geom.name, "surfacevel"
    yield from (("pair", pair.name, "adhesion") for pair in spec.pairs if pair.adhesion)


def _holds(spec: Any, tag: str, name: str, value: str) -> bool:
    """Whether a setting has the value that the model has anyway."""
    if tag == "flag":
        return (value == "disable") == is_disabled(spec, name)
    if name == "actuatorgroupdisable":
        return False
    try:
        return np.array_equal(np.array(value.split(), dtype=np.float64), np.atleast_1d(getattr(spec.option, name)))
    except ValueError:
        return False  # MuJoCo refuses it


def _of_attached_files(files: ModelFiles) -> Iterator[Element]:
    """Elements of the MJCF files that are neither the main file nor included in it; none if no file has options."""
    others = [name for name in files.files if name.lower().endswith(".xml") and name != files.main]
    if not any(b"<option" in files.files[name] for name in others):
        return  # nothing to say: parsing a large file takes as long as compiling it
    home, included = posixpath.dirname(files.main), {files.main}
    waiting = [files.main]
    while waiting:
        name = waiting.pop()
        for element in elements(files.files[name], name):
            inner = element.attributes.get("file", "") if element.tag == "include" else ""
            targets = {
                posixpath.normpath(posixpath.join(folder, inner)) for folder in (home, posixpath.dirname(name)) if inner
            }
            waiting += sorted(targets & set(others) - included)
            included |= targets
    for name in others:
        if name not in included:
            yield from elements(files.files[name], files.place_of(name))


def _place(files: ModelFiles, tag: str, attribute: str) -> str:
    """``file:line`` of an attribute, in an included file too."""
    return next(
        (element.place for element in files.elements() if element.tag == tag and attribute in element.attributes),
        files.place,
    )
