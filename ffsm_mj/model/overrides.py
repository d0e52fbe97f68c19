"""Properties of bodies, geoms and joints given in a scenario: written to a specification, read back from the scene.

MuJoCo ignores a mass in a file if something else determines it: geoms of a body without inertial, ``inertiafromgeom``,
``boundmass`` or ``balanceinertia``. Therefore the model is compiled alone, its bodies get the result as explicit inertials,
these options are disabled, and the given properties are written on top. The values are then verified in the compiled scene.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.errors import Fault, Faults, ScenarioFaults, plural, unknown_name
from ffsm_mj.model.files import ModelFiles
from ffsm_mj.model.properties import (
    INERTIAL,
    SIZES,
    BodyProperties,
    Inertial,
    Overrides,
    PropertyChange,
    Value,
    geom_size,
    inertial_value,
    joint_friction,
    kind_of_geom,
    property_value,
    value_text,
)
from ffsm_mj.model.source import REFUSALS, compile_spec, compiled_alone, spec_alone

_ROUNDING = 1e-9
_FREE, _ALIGNED = mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtAlignFree.mjALIGNFREE_TRUE
_SCALAR = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
_LEFT_OPEN = mujoco.mjtAlignFree.mjALIGNFREE_AUTO
_WORLD = "world"


@dataclass
class ModelOverrides:
    """Changed properties of one model.

    Attributes:
        name: Name of the model in the scene.
        key: Key of the scenario with the uppermost layer of changes.
        warnings: MuJoCo's warnings about the model compiled alone.
        inertials: Expected inertial of each body, by name; empty for a fixed model, which has no masses.
        changes: Given properties with their expected values, by keys of the scenario; an upper layer replaces a lower one.
    """

    name: str
    key: str
    warnings: tuple[str, ...] = ()
    inertials: dict[str, Inertial] = field(default_factory=dict)
    changes: dict[tuple[str, ...], PropertyChange] = field(default_factory=dict)

    def add(self, path: tuple[str, ...], before: Value, after: Value) -> None:
        """Add a change; it replaces a change of the same property in a lower layer."""
        below = self.changes.pop(next((known for known in self.changes if known[1:] == path[1:]), ()), None)
        self.changes[path] = PropertyChange(path, below.after if below else before, after)

    def correct(self, place: tuple[str, ...], after: Value) -> None:
        """Set the expected value of a change that a further change affects, such as an inertia that is scaled."""
        for path, change in self.changes.items():
            if path[1:] == place:
                self.changes[path] = replace(change, after=after)

    def read_back(self, model: Any) -> tuple[PropertyChange, ...]:
        """The changes with the values in the compiled scene.

        Raises:
            ScenarioFaults: A value differs from the given one, or the inertial of another body has changed.
        """
        changes = []
        with Faults() as faults:
            for path, change in self.changes.items():
                value = property_value(model, path)
                if not _equal(value, change.after):
                    faults.add(f"MuJoCo compiles it to {value_text(value)}, not {value_text(change.after)}", *path)
                changes.append(PropertyChange(path, change.before, value))
        with Faults() as faults:
            # An option of the compiler can change bodies without a given property too, e.g. boundmass.
            for body, inertial in self.inertials.items():
                compiled = Inertial.of(model, model.body(f"{self.name}/{body}").id)
                if not (_equal(compiled.mass_kg, inertial.mass_kg) and _equal(compiled.moments, inertial.moments)):
                    faults.add(f"the mass or inertia of body {body!r} would change too", self.key, self.name)
        return tuple(changes)


def override(spec: Any, name: str, files: ModelFiles, vfs: Any) -> ModelOverrides:
    """Change properties of bodies, geoms and joints of a specification before it is attached.

    Args:
        spec: Specification of the model; all its elements have names.
        name: Name of the model in the scene.
        files: Files of the model, with at least one layer of changes.
        vfs: MuJoCo's virtual files.

    Raises:
        InputError: The model does not compile alone.
        ScenarioFaults: A body, geom or joint does not exist, or cannot have the property.
    """
    system = compiled_alone(files, vfs)
    done = ModelOverrides(name, files.overrides[-1].key, system.warnings)
    compiled, alone = system.mj, spec_alone(files, vfs) if _compiles_again(files) else None
    if files.pose is None:
        done.inertials |= {body.name: Inertial.of(compiled, compiled.body(body.name).id) for body in spec.bodies[1:]}
    for layer in files.overrides:
        with Faults() as faults:
            for body, asked in layer.bodies.items():
                for what, keys in _faults(spec, compiled, body, asked, files):
                    faults.add(what, layer.key, name, body, *keys)
        _resize(spec, alone, compiled, layer, done)
        _set_inertials(alone, layer, done, vfs)
        _set_friction(spec, compiled, layer, done)
    for body, inertial in done.inertials.items():
        inertial.write(spec.body(body))
    return done


def _compiles_again(files: ModelFiles) -> bool:
    """Whether masses are to be computed from geoms with these overrides."""
    return any(asked.mass_from_geoms for layer in files.overrides for asked in layer.bodies.values())


def _resize(spec: Any, alone: Any, compiled: Any, layer: Overrides, done: ModelOverrides) -> None:
    """Set the sizes of geoms."""
    for body, asked in layer.bodies.items():
        for name, size in asked.geoms.items():
            done.add(
                (layer.key, done.name, body, "geoms", name, "size_m"),
                geom_size(compiled, compiled.geom(name).id),
                size.size_m,
            )
            for target in (spec, alone):
                if target is not None:
                    _put_size(target.geom(name), size.size_m)


def _set_friction(spec: Any, compiled: Any, layer: Overrides, done: ModelOverrides) -> None:
    """Set the dry friction of joints."""
    for body, asked in layer.bodies.items():
        for name, joint in asked.joints.items():
            before = joint_friction(compiled, compiled.joint(name).id)
            done.add((layer.key, done.name, body, "joints", name, "frictionloss"), before, joint.frictionloss)
            spec.joint(name).frictionloss = joint.frictionloss


def _put_size(geom: Any, size: tuple[float, ...]) -> None:
    if np.isfinite(geom.fromto[0]):  # a geom given by its end points keeps its centre and axis
        ends = geom.fromto.reshape(2, 3).copy()
        turn = np.empty(4)
        mujoco.mju_quatZ2Vec(turn, ends[0] - ends[1])
        geom.pos, geom.quat, geom.fromto = ends.mean(axis=0), turn, np.full(6, np.nan)
    geom.size = (*size, *[0.0] * (3 - len(size)))


def _set_inertials(alone: Any, layer: Overrides, done: ModelOverrides, vfs: Any) -> None:
    """Compute the expected inertials of the bodies with changes."""
    of_geoms = [body for body, asked in layer.bodies.items() if asked.mass_from_geoms]
    before = dict(done.inertials)
    if of_geoms:
        # Only the bodies in question may be computed from their geoms: all others keep the values of lower layers.
        for body, inertial in done.inertials.items():
            inertial.write(alone.body(body))
        done.inertials |= _of_geoms(alone, of_geoms, (layer.key, done.name), vfs)
    for body, asked in layer.bodies.items():
        if asked.sets_inertial:
            present, path = done.inertials[body], (layer.key, done.name, body)
            if not present.mass_kg > 0.0 and not (asked.mass_kg and asked.inertia_kg_m2):
                raise ScenarioFaults([Fault(_NO_MASS, path)])
            now = done.inertials[body] = present.changed(asked.mass_kg, asked.inertia_kg_m2, asked.centre_of_mass_m)
            for key in INERTIAL:
                if key in asked.inertial_keys:
                    done.add((*path, key), inertial_value(before[body], key), inertial_value(now, key))
                done.correct((done.name, body, key), inertial_value(now, key))


_NO_MASS = "the body has no mass to scale its inertia with; give both mass_kg and inertia_kg_m2"


def _of_geoms(alone: Any, bodies: list[str], path: tuple[str, str], vfs: Any) -> dict[str, Inertial]:
    """Inertials of bodies computed from their geoms; all other bodies have explicit inertials.

    Raises:
        ScenarioFaults: The geoms have no mass.
    """
    for body in map(alone.body, bodies):
        Inertial(0.0, np.full(3, np.nan), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])).write(body)
        body.explicitinertial = False  # without a centre of mass, MuJoCo uses the geoms
    try:
        compiled = compile_spec(alone, vfs)
    except REFUSALS as error:
        text = " ".join(str(error).split())
        raise ScenarioFaults([Fault(f"mass_from_geoms: MuJoCo finds no mass in the geoms: {text}", path)]) from error
    return {body: Inertial.of(compiled, compiled.body(body).id) for body in bodies}


def _faults(
    spec: Any, compiled: Any, name: str, asked: BodyProperties, files: ModelFiles
) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield faults of the properties given for a body, each with its keys below that of the body."""
    fixed = files.pose is not None
    names = [body.name for body in spec.bodies[0 if fixed else 1 :]]
    if name not in names:
        yield unknown_name("body", name, names), ()
        return
    body = spec.body(name)
    for key in asked.inertial_keys:
        if compiled.body_weldid[compiled.body(name).id] == 0:
            yield (
                f"{'it is fixed' if fixed else 'the body does not move'}: its mass has no effect; remove the key",
                (key,),
            )
        elif _is_aligned(body):
            yield (
                "MuJoCo aligns the frame of this body with its inertia (align, alignfree); disable that in the model",
                (key,),
            )
    geoms = [geom.name for geom in body.geoms]
    for geom, geom_override in asked.geoms.items():
        if geom not in geoms:
            yield unknown_name("geom of the body", geom, geoms), ("geoms", geom)
        elif fault := _fault_of_size(spec.geom(geom), geom_override.size_m):
            yield fault, ("geoms", geom, "size_m")
    joints = [joint.name for joint in body.joints]
    for joint in asked.joints:
        if joint not in joints:
            yield unknown_name("joint of the body", joint, joints), ("joints", joint)
        elif spec.joint(joint).type not in _SCALAR or body.parent.name == _WORLD:
            yield (
                "dry friction is that of hinges and slides between links, not of ball joints and joints of a base",
                ("joints", joint),
            )


def _is_aligned(body: Any) -> bool:
    """Whether MuJoCo moves the frame of a single floating body to its centre of mass and principal axes."""
    joints = body.joints
    if len(joints) != 1 or joints[0].type != _FREE or body.first_body() is not None:
        return False
    return bool(joints[0].align == _ALIGNED or (joints[0].align == _LEFT_OPEN and body.compiler.alignfree))


def _fault_of_size(geom: Any, size: tuple[float, ...]) -> str:
    kind = kind_of_geom(geom.type)
    if geom.meshname or kind not in SIZES:
        return f"a {'mesh' if geom.meshname else kind} has no size of its own; kinds that have one: {', '.join(SIZES)}"
    if len(size) != SIZES[kind]:
        return f"the size of a {kind} has {plural(SIZES[kind], 'number')}, got {len(size)}"
    return ""


def _equal(value: Any, asked: Any) -> bool:
    """Whether values are equal to the given ones, up to rounding relative to the greatest of them."""
    a, b = np.atleast_1d(value), np.atleast_1d(asked)
    return len(a) == len(b) and bool(np.all(np.abs(a - b) <= _ROUNDING * np.abs(b).max(initial=0.0)))
