"""Properties of bodies and geoms that a scenario gives: written into a specification, read back out of the compiled scene.

MuJoCo takes a mass that is written and ignores it where something else in the file decides: the geoms of a body without an
inertial, ``inertiafromgeom``, ``boundmass``, ``balanceinertia``. So the model is compiled once as it is, all its bodies get
what came out as explicit inertials, what would decide otherwise is switched off, and what is asked for is written on top.
Whether it has arrived, only the compiled scene can tell.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.errors import Fault, ScenarioFaults, unknown_name
from ffsm_mj.model.alone import compiled_alone, spec_alone
from ffsm_mj.model.compilation import compile_spec
from ffsm_mj.model.files import ModelFiles
from ffsm_mj.model.inertial import Inertial
from ffsm_mj.model.properties import (
    INERTIAL,
    SIZES,
    BodyProperties,
    Overrides,
    PropertyChange,
    Value,
    geom_size,
    inertial_value,
    kind_of_geom,
    property_value,
    shown,
)
from ffsm_mj.model.source import REFUSALS

_ROUNDING = 1e-9
_FREE, _ALIGNED = mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtAlignFree.mjALIGNFREE_TRUE
_LEFT_OPEN = mujoco.mjtAlignFree.mjALIGNFREE_AUTO
_WORLD = "world"


@dataclass
class ModelOverrides:
    """One model with other properties than its files have.

    Attributes:
        name: Its name in the scene.
        key: The uppermost key of a scenario that says so.
        warnings: MuJoCo's warnings about the model compiled alone.
        inertials: What each of its bodies is to weigh, by name; empty for a fixed model, where nothing weighs.
        changes: What was asked for by its keys, as it should come out; of two layers the upper one's.
    """

    name: str
    key: str
    warnings: tuple[str, ...] = ()
    inertials: dict[str, Inertial] = field(default_factory=dict)
    changes: dict[tuple[str, ...], PropertyChange] = field(default_factory=dict)

    def add(self, path: tuple[str, ...], before: Value, after: Value) -> None:
        """A change, which takes the place of that of a lower layer."""
        below = self.changes.pop(next((known for known in self.changes if known[1:] == path[1:]), ()), None)
        self.changes[path] = PropertyChange(path, below.after if below else before, after)

    def correct(self, place: tuple[str, ...], after: Value) -> None:
        """What a change below comes to with one above, such as a scaled inertia."""
        for path, change in self.changes.items():
            if path[1:] == place:
                self.changes[path] = replace(change, after=after)

    def read_back(self, model: Any) -> tuple[PropertyChange, ...]:
        """The changes as a compiled scene has them.

        Raises:
            ScenarioFaults: The scene has something else than was asked for, or another body weighs something else.
        """
        faults, found = [], []
        for path, change in self.changes.items():
            value = property_value(model, path)
            if not _equal(value, change.after):
                faults.append(Fault(f"MuJoCo makes {shown(value)} of it, not {shown(change.after)}", path))
            found.append(PropertyChange(path, change.before, value))
        for body, inertial in self.inertials.items() if not faults else ():
            there = Inertial.of(model, model.body(f"{self.name}/{body}").id)
            if not (_equal(there.mass_kg, inertial.mass_kg) and _equal(there.moments, inertial.moments)):
                faults.append(Fault(f"body {body!r} would weigh something else than it does", (self.key, self.name)))
        if faults:
            raise ScenarioFaults(faults)
        return tuple(found)


def override(spec: Any, name: str, files: ModelFiles, vfs: Any) -> ModelOverrides:
    """Give bodies and geoms of a specification other properties, before it is attached.

    Args:
        spec: The model; all its elements have names.
        name: What the model is called in the scene.
        files: Its files, and what is asked for: one layer at least.
        vfs: MuJoCo's virtual files.

    Raises:
        InputError: The model does not compile by itself.
        ScenarioFaults: There is no such body or geom, or it cannot have such a property.
    """
    own = compiled_alone(files, vfs)
    done = ModelOverrides(name, files.overrides[-1].key, own.warnings)
    compiled, alone = own.mj, spec_alone(files, vfs) if _compiles_again(files) else None
    if files.pose is None:
        done.inertials |= {body.name: Inertial.of(compiled, compiled.body(body.name).id) for body in spec.bodies[1:]}
    for layer in files.overrides:
        faults = [
            Fault(what, (layer.key, name, body, *keys))
            for body, asked in layer.bodies.items()
            for what, keys in _faults(spec, compiled, body, asked, files)
        ]
        if faults:
            raise ScenarioFaults(faults)
        _resize(spec, alone, compiled, layer, done)
        _weigh(alone, layer, done, vfs)
    for body, inertial in done.inertials.items():
        inertial.write(spec.body(body))
    return done


def _compiles_again(files: ModelFiles) -> bool:
    """Whether masses are to be computed from geoms with these overrides."""
    return any(asked.mass_from_geoms for layer in files.overrides for asked in layer.bodies.values())


def _resize(spec: Any, alone: Any, compiled: Any, layer: Overrides, done: ModelOverrides) -> None:
    """Write the sizes of geoms."""
    for body, asked in layer.bodies.items():
        for name, given in asked.geoms.items():
            done.add(
                (layer.key, done.name, body, "geoms", name, "size_m"),
                geom_size(compiled, compiled.geom(name).id),
                given.size_m,
            )
            for each in (spec, alone):
                if each is not None:
                    _put_size(each.geom(name), given.size_m)


def _put_size(geom: Any, size: tuple[float, ...]) -> None:
    if np.isfinite(geom.fromto[0]):  # its two ends stand in the file: it stays between them
        ends = geom.fromto.reshape(2, 3).copy()
        turn = np.empty(4)
        mujoco.mju_quatZ2Vec(turn, ends[0] - ends[1])
        geom.pos, geom.quat, geom.fromto = ends.mean(axis=0), turn, np.full(6, np.nan)
    geom.size = (*size, *[0.0] * (3 - len(size)))


def _weigh(alone: Any, layer: Overrides, done: ModelOverrides, vfs: Any) -> None:
    """Work out what bodies are to weigh."""
    of_geoms = [body for body, asked in layer.bodies.items() if asked.mass_from_geoms]
    before = dict(done.inertials)
    if of_geoms:
        for body, inertial in done.inertials.items():
            inertial.write(alone.body(body))
        done.inertials |= _of_geoms(alone, of_geoms, (layer.key, done.name), vfs)
    for body, asked in layer.bodies.items():
        if asked.sets_inertial:
            own, path = done.inertials[body], (layer.key, done.name, body)
            if not own.mass_kg > 0.0 and not (asked.mass_kg and asked.inertia_kg_m2):
                raise ScenarioFaults([Fault(_NO_MASS, path)])
            now = done.inertials[body] = own.changed(asked.mass_kg, asked.inertia_kg_m2, asked.centre_of_mass_m)
            for key in INERTIAL:
                if key in asked.inertial_keys:
                    done.add((*path, key), inertial_value(before[body], key), inertial_value(now, key))
                done.correct((done.name, body, key), inertial_value(now, key))


_NO_MASS = "the body has no mass that an inertia could be scaled with; give mass_kg and inertia_kg_m2 both"


def _of_geoms(alone: Any, bodies: list[str], path: tuple[str, str], vfs: Any) -> dict[str, Inertial]:
    """What bodies weigh by their geoms, all others having explicit inertials.

    Raises:
        ScenarioFaults: They weigh nothing.
    """
    for body in map(alone.body, bodies):
        Inertial(0.0, np.full(3, np.nan), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])).write(body)
        body.explicitinertial = False  # and without a centre MuJoCo asks the geoms
    try:
        compiled = compile_spec(alone, vfs)
    except REFUSALS as error:
        text = " ".join(str(error).split())
        raise ScenarioFaults([Fault(f"mass_from_geoms: MuJoCo finds no mass in the geoms: {text}", path)]) from error
    return {body: Inertial.of(compiled, compiled.body(body).id) for body in bodies}


def _faults(
    spec: Any, compiled: Any, name: str, asked: BodyProperties, files: ModelFiles
) -> Iterator[tuple[str, tuple[str, ...]]]:
    """What is wrong with the properties of a body, and the key that it is wrong with."""
    fixed = files.pose is not None
    names = [body.name for body in spec.bodies[0 if fixed else 1 :]]
    if name not in names:
        yield unknown_name("body", name, names), ()
        return
    body = spec.body(name)
    for key in asked.inertial_keys:
        if compiled.body_weldid[compiled.body(name).id] == 0:
            yield (
                f"{'it is fixed' if fixed else 'the body does not move'}: what it weighs has no effect; leave it out",
                (key,),
            )
        elif _is_aligned(body):
            yield (
                "MuJoCo would align the body's frame with its inertia (align, alignfree); switch that off in the model",
                (key,),
            )
    geoms = [geom.name for geom in body.geoms]
    for geom, given in asked.geoms.items():
        if geom not in geoms:
            yield unknown_name("geom of the body", geom, geoms), ("geoms", geom)
        elif fault := _fault_of_size(spec.geom(geom), given.size_m):
            yield fault, ("geoms", geom, "size_m")


def _is_aligned(body: Any) -> bool:
    """Whether the frame of a body that floats alone is turned and shifted to its inertia."""
    joints = body.joints
    if len(joints) != 1 or joints[0].type != _FREE or body.first_body() is not None:
        return False
    return bool(joints[0].align == _ALIGNED or (joints[0].align == _LEFT_OPEN and body.compiler.alignfree))


def _fault_of_size(geom: Any, size: tuple[float, ...]) -> str:
    kind = kind_of_geom(geom.type)
    if geom.meshname or kind not in SIZES:
        return (
            f"the size of a {'mesh' if geom.meshname else kind} is none of its own; kinds that have one: {', '.join(SIZES)}"
        )
    if len(size) != SIZES[kind]:
        return f"a {kind} has {SIZES[kind]} number{'s' if SIZES[kind] > 1 else ''}, got {len(size)}"
    return ""


def _equal(value: Any, asked: Any) -> bool:
    """Whether numbers are those asked for, to rounding of the greatest of them."""
    a, b = np.atleast_1d(value), np.atleast_1d(asked)
    return len(a) == len(b) and bool(np.all(np.abs(a - b) <= _ROUNDING * np.abs(b).max(initial=0.0)))
