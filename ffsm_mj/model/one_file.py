"""Models that share one file: each of its moving trees by the name of its root, and the rest, which is fixed to the world.

A model of such a file is the file without the other trees. Contact filters and equality constraints between two of them are
those of the file; they are added to the scene. Sensors between two of them are left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import mujoco

from ffsm_mj.errors import InputError, unknown_name
from ffsm_mj.model.files import REST, ModelFiles

_COPIED = ("active", "data", "objtype", "type")
"""Attributes of an equality constraint beside its ends: the scene's constraints are exact, and have no softness."""
_GEOM, _JOINT, _SITE = mujoco.mjtObj.mjOBJ_GEOM, mujoco.mjtObj.mjOBJ_JOINT, mujoco.mjtObj.mjOBJ_SITE
_BODY = mujoco.mjtObj.mjOBJ_BODY
_OF_KIND = {_GEOM: "geom", _JOINT: "joint", _SITE: "site", _BODY: "body"}


def moving_roots(spec: Any) -> list[Any]:
    """Bodies below the world that move, or carry something that does."""
    return [body for body in spec.worldbody.bodies if any(_joints(body))]


def _joints(body: Any) -> Iterator[Any]:
    yield from body.joints
    for child in body.bodies:
        yield from _joints(child)


def keep_body(spec: Any, body: str, place: str) -> None:
    """Leave of a specification only a body below the world with everything below it, or the rest.

    Args:
        spec: The whole file; all its elements have names.
        body: The body, or :data:`~ffsm_mj.model.files.REST` for what is fixed to the world.
        place: Name of the file in messages.

    Raises:
        InputError: No moving tree has a root of this name.
    """
    roots = {top.name: top for top in moving_roots(spec)}
    if body != REST and body not in roots:
        raise InputError(f"{place}: {unknown_name('root of a moving tree', body, list(roots))}")
    for key in list(spec.keys):  # numbers of all joints
        spec.delete(key)
    if body == REST:
        for root in roots.values():
            spec.delete(root)
        for candidate in spec.bodies:
            candidate.mocap = False  # nothing moves it here
    else:
        world = spec.worldbody
        rest = [child for child in world.bodies if child.name != body]
        for child in (*rest, *world.geoms, *world.sites, *world.cameras, *world.lights):
            spec.delete(child)
    if body != next(iter(roots), REST):  # sensors of the whole scene, such as a clock, are those of the first model
        for sensor in [candidate for candidate in spec.sensors if not candidate.objname]:
            spec.delete(sensor)
    _delete_what_misses_a_part(spec)
    _delete_unused_assets(spec)


def _delete_what_misses_a_part(spec: Any) -> None:
    """Delete elements that name geoms, sites and bodies that are gone; with a body MuJoCo deletes only what names it."""
    has = {
        int(kind): {element.name for element in elements}
        for kind, elements in ((_GEOM, spec.geoms), (_SITE, spec.sites), (_BODY, spec.bodies))
    }

    def misses(*ends: tuple[Any, str]) -> bool:
        return any(name and name not in has.get(int(kind), {name}) for kind, name in ends)

    gone = [pair for pair in spec.pairs if misses((_GEOM, pair.geomname1), (_GEOM, pair.geomname2))]
    gone += [sensor for sensor in spec.sensors if misses((sensor.objtype, sensor.objname), (sensor.reftype, sensor.refname))]
    gone += [
        equality
        for equality in spec.equalities
        if misses((equality.objtype, equality.name1), (equality.objtype, equality.name2))
    ]
    gone += [light for light in spec.lights if misses((_BODY, light.targetbody))]
    gone += [tendon for tendon in spec.tendons if any(_misses_target(wrap) for wrap in tendon.path)]
    on_sites = [actuator for actuator in spec.actuators if actuator.trntype == mujoco.mjtTrn.mjTRN_SITE]
    gone += [actuator for actuator in on_sites if misses((_SITE, actuator.target), (_SITE, actuator.refsite))]
    for orphan in gone:
        spec.delete(orphan)
    for camera in spec.cameras:
        if misses((_BODY, camera.targetbody)):  # it stays as a frame
            camera.mode, camera.targetbody = mujoco.mjtCamLight.mjCAMLIGHT_FIXED, ""


def _misses_target(wrap: Any) -> bool:
    return wrap.type != mujoco.mjtWrap.mjWRAP_PULLEY and wrap.target is None


def _delete_unused_assets(spec: Any) -> None:
    """Delete meshes that no geom or site has left, which every model of the file would compile again."""
    used = {user.meshname for user in (*spec.geoms, *spec.sites)}
    for mesh in [candidate for candidate in spec.meshes if candidate.name not in used]:
        spec.delete(mesh)


def add_shared_elements(scene: Any, files: Mapping[str, ModelFiles], load: Any) -> list[str]:
    """Add the contact filters and equality constraints between models of one file to their scene.

    Args:
        scene: Specification with all models attached.
        files: Files of each model by its prefix.
        load: Returns the specification of a whole file.

    Returns:
        Notes on elements that are left out.

    Raises:
        InputError: A tendon or an actuator of the file belongs to two of the models.
    """
    notes: list[str] = []
    groups: dict[bytes, dict[str, str]] = {}
    for name, file in files.items():
        if file.body:
            groups.setdefault(file.files[file.main], {})[file.body] = name
    for models in groups.values():
        if len(models) > 1:
            first = files[next(iter(models.values()))]
            notes += _Shared(scene, load(replace(first, body="")), models, first.place).add()
    return notes


class _Shared:
    """The elements of one file that belong to two of its models."""

    def __init__(self, scene: Any, whole: Any, models: Mapping[str, str], place: str) -> None:
        self._scene, self._whole, self._place = scene, whole, place
        roots = {root.name for root in moving_roots(whole)}
        self._of_body: dict[str, str | None] = {"world": models.get(REST)}
        for body in whole.worldbody.bodies:
            owner = models.get(body.name if body.name in roots else REST)
            self._of_body |= dict.fromkeys(_names(body), owner)

    def _owner(self, kind: Any, name: str) -> str | None:
        """The model that an element of the file belongs to; None if the scenario has none with it."""
        what = _OF_KIND.get(mujoco.mjtObj(int(kind)))
        element = getattr(self._whole, what)(name) if what else None
        body = "" if element is None else element.name if what == "body" else element.parent.name
        return self._of_body.get(body)

    def _between(self, kind: Any, *names: str) -> list[str] | None:
        """Names in the scene of elements that belong to different models; None if they do not, or one is left out."""
        owners = [self._owner(kind, name) for name in names]
        full = [f"{owner}/{name}" for owner, name in zip(owners, names, strict=True) if owner]
        return full if len(full) == len(names) and len(set(owners)) > 1 else None

    def add(self) -> list[str]:
        """Add filters and constraints to the scene; returns notes.

        Raises:
            InputError: See :func:`add_shared_elements`.
        """
        whole, scene = self._whole, self._scene
        for exclude in whole.excludes:
            if names := self._between(_BODY, exclude.bodyname1, exclude.bodyname2):
                scene.add_exclude(bodyname1=names[0], bodyname2=names[1])
        for pair in whole.pairs:
            if names := self._between(_GEOM, pair.geomname1, pair.geomname2):
                scene.add_pair(geomname1=names[0], geomname2=names[1])
        for equality in whole.equalities:
            kind = _JOINT if equality.type == mujoco.mjtEq.mjEQ_JOINT else equality.objtype
            if equality.name2 and (names := self._between(kind, equality.name1, equality.name2)):
                added = scene.add_equality(
                    name=f"{names[0].partition('/')[0]}/{equality.name}", name1=names[0], name2=names[1]
                )
                for attribute in _COPIED:
                    setattr(added, attribute, getattr(equality, attribute))
        self._refuse_drives()
        return [
            f"{self._place}: left out: sensor {one.name!r}, which is of two models"
            for one in whole.sensors
            if one.objname and one.refname and self._differ((one.objtype, one.objname), (one.reftype, one.refname))
        ]

    def _differ(self, *ends: tuple[Any, str]) -> bool:
        owners = {self._owner(kind, name) for kind, name in ends} - {None}
        return len(owners) > 1

    def _refuse_drives(self) -> None:
        """Refuse tendons, and actuators at two sites, of two models.

        Raises:
            InputError: There is one.
        """
        faults = []
        for tendon in self._whole.tendons:
            targets = [wrap.target for wrap in tendon.path if wrap.target is not None]
            bodies = {self._of_body.get(target.parent.name) for target in targets}
            if len(bodies - {None}) > 1:
                faults.append(f"{self._place}: tendon {tendon.name!r} joins two models, which is not supported; remove it")
        for one in self._whole.actuators:
            ends = [(_SITE, name) for name in (one.target, one.refsite) if name]
            if one.trntype == mujoco.mjtTrn.mjTRN_SITE and self._differ(*ends):
                faults.append(f"{self._place}: actuator {one.name!r} acts on two models, which is not supported; remove it")
        if faults:
            raise InputError(faults)


def _names(body: Any) -> Iterator[str]:
    """Names of a body and of all below it."""
    yield body.name
    for child in body.bodies:
        yield from _names(child)
