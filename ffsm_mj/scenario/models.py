"""Configuration of the robot and of objects, in files of their own or in one file.

``scene``: robot, objects and surroundings in one MJCF file, written out as a robot and objects. The robot is the tree with
the body that the scenario names. Every other moving tree is an object with the name of its root body, and what the file
fixes to the world is the object ``surroundings``. A keyframe of the file is the initial state.
"""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias
from warnings import catch_warnings

import mujoco
from pydantic import (
    AliasChoices,
    Field,
    PlainSerializer,
    ValidationError,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    WithJsonSchema,
    WrapValidator,
    field_validator,
    model_validator,
)

from ffsm_mj.config import Name, StrictModel
from ffsm_mj.errors import Fault, InputError, ScenarioFaults, unknown_name
from ffsm_mj.model.cones import ConeConfig
from ffsm_mj.model.decompose import DecomposeList
from ffsm_mj.model.edits import JointFlex, LimitsMode, Strippable
from ffsm_mj.model.files import REST, ModelFiles, menagerie_file, read_model
from ffsm_mj.model.inline import InlineModel, inline_model
from ffsm_mj.model.mujoco_process import collected_warnings
from ffsm_mj.model.one_file import moving_roots
from ffsm_mj.model.properties import Pose, UnitQuaternion
from ffsm_mj.model.source import load_spec, unused
from ffsm_mj.scenario.faults import KindNames, plain_faults
from ffsm_mj.scenario.source import YamlSource


class SiteConfig(StrictModel):
    """A site added to a model, e.g. a tip at the end of a vendor's arm, or where it is to grasp an object."""

    body: Name
    """Body of the model to which the site is fixed, by its name in the file."""
    pos_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Position in the body's frame, m."""
    quaternion: UnitQuaternion = (1.0, 0.0, 0.0, 0.0)
    """Orientation w, x, y, z in the body's frame; its length must be 1 to within 1e-3, and it is normalised."""


def _source(value: Any, as_path: ValidatorFunctionWrapHandler) -> Any:
    try:
        kept = inline_model(value)
    except InputError as error:
        raise ValueError(" ".join(error.lines)) from error
    if not isinstance(kept, (str, PurePath, InlineModel)):
        raise ValueError(f"must be a path, XML text or a mujoco.MjSpec, and is {type(kept).__name__}")
    return kept if isinstance(kept, InlineModel) else as_path(kept)


if TYPE_CHECKING:
    import mujoco

    ModelSource: TypeAlias = str | Path | mujoco.MjSpec | InlineModel
else:
    ModelSource = Annotated[
        Name,
        WrapValidator(_source),
        PlainSerializer(lambda kept: kept if isinstance(kept, str) else kept.xml),
        WithJsonSchema({"type": "string", "minLength": 1}),
        Field(alias="mjcf", validation_alias=AliasChoices("mjcf", "model", "xml")),
    ]
"""An MJCF or URDF model: a path, its XML text, or a ``mujoco.MjSpec``, which is read once and not changed. The key of a file
is ``mjcf``; Python also has ``model`` and, for text, ``xml``."""
REQUIRED: Any = ...
"""No default for pydantic; type checkers, which do not know the other names, take one for it."""


class FromFile(StrictModel):
    """A configuration with a model file, which may be given as a robot of MuJoCo Menagerie."""

    if TYPE_CHECKING:
        menagerie: str = ""

    @model_validator(mode="before")
    @classmethod
    def _file_of_menagerie(cls, data: Any) -> Any:
        """Write out the name of a robot as the path of its file."""
        if not isinstance(data, Mapping) or "menagerie" not in data:
            return data
        name, rest = data["menagerie"], {key: value for key, value in data.items() if key != "menagerie"}
        if not isinstance(name, str) or not name or {"mjcf", "model", "xml"} & set(rest):
            raise ValueError("'menagerie' is the name of a robot of MuJoCo Menagerie, in place of 'mjcf'")
        try:
            return {"mjcf": str(menagerie_file(name)), **rest}
        except InputError as error:
            raise ValueError(" ".join(error.lines)) from error


class OfFile(FromFile):
    """A robot or an object, and what of its file is used; the file itself is not changed."""

    model: ModelSource = REQUIRED
    """MJCF or URDF file, relative to the scenario file that names it, in Python to the current folder; or the model itself,
    as XML text or ``mujoco.MjSpec``; the root body of a robot is the base. Lengths in m; quaternions w, x, y, z."""
    if TYPE_CHECKING:
        xml: str = ""
    body: Name | None = None
    """Body of the file, right below its ``<worldbody>``, that is used with everything below it; the rest is left out.
    ``world``, of an object with ``fixed: true``, is what the file fixes to the world."""
    asset_folders: tuple[Name, ...] = ()
    """Further folders with files of the model (meshes, includes), relative to the scenario file."""
    package_paths: tuple[Name, ...] = ()
    """Folders to search for packages of a URDF (``package://NAME/...``), after its parents; relative to the scenario."""
    strip: tuple[Strippable, ...] = ()
    """Elements to remove from the model, which would break conservation."""
    limits: LimitsMode = "stop"
    """Joints with limits in the model stop there (``stop``, see joint_limits), or move on (``ignore``)."""
    decompose: DecomposeList = ()
    """Meshes of the model that are not convex, as convex pieces: one, or a list."""
    cones: tuple[ConeConfig, ...] = ()
    """Inner surfaces of cones to add to bodies, which touch what is inside them; the file itself is not changed."""
    sites: dict[Name, SiteConfig] = {}
    """Sites to add to the model by name; the file itself is not changed."""

    @field_validator("cones")
    @classmethod
    def _have_names(cls, value: tuple[ConeConfig, ...]) -> tuple[ConeConfig, ...]:
        names = [cone.name for cone in value]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise ValueError(f"two cones are named {twice[0]!r}; give each a 'name' of its own")
        return value


def _refuse_prisms(moving: OfFile) -> None:
    """Refuse prisms of a model that moves: they say what is below a surface, not what a body is.

    Raises:
        ValueError: A mesh is decomposed into prisms.
    """
    if meshes := [one.mesh for one in moving.decompose if one.method == "prisms"]:
        raise ValueError(f"mesh {meshes[0]!r}: 'method: prisms' is for objects with 'fixed: true'; use 'planes' or 'coacd'")


class Robot(OfFile):
    """The free-floating manipulator."""

    joint_flex: dict[Name, JointFlex] = {}
    """Joints of the model with a flexible drive, by their names in the file; the file itself is not changed."""

    @model_validator(mode="after")
    def _has_no_terrain(self) -> Robot:
        _refuse_prisms(self)
        return self


class Model(OfFile):
    """An object: floating, or fixed to the world."""

    fixed: bool = False
    """Fixed to the world: a wall, a docking port, a test rig. Its model has no joint; its impulses are external."""
    pose: Pose | None = None
    """Pose of the model's world frame in the scene; default: identity. Only with ``fixed: true``."""

    @field_validator("pose")
    @classmethod
    def _only_where_fixed(cls, value: Pose | None, info: ValidationInfo) -> Pose | None:
        if value is not None and info.data.get("fixed") is False:
            raise ValueError("only with 'fixed: true'; a floating object starts where initial.joints says")
        return value

    @model_validator(mode="after")
    def _terrain_is_fixed(self) -> Model:
        if not self.fixed:
            _refuse_prisms(self)
        return self

    @model_validator(mode="after")
    def _rest_is_fixed(self) -> Model:
        if (self.body == REST) != self.fixed and self.body is not None:
            raise ValueError(f"'body: {REST}' and 'fixed: true' belong together: what a file fixes to the world")
        return self

    @property
    def fixed_at(self) -> Pose | None:
        """Pose of a fixed object; None if it floats."""
        return (self.pose or Pose()) if self.fixed else None


SCENE = "scene"
SURROUNDINGS = "surroundings"
"""Name of the object that is everything that the file fixes to the world."""
_RESERVED = ("robot", "world", SURROUNDINGS)
_SIZES = {mujoco.mjtJoint.mjJNT_FREE: (7, 6), mujoco.mjtJoint.mjJNT_BALL: (4, 3)}
"""Numbers of coordinates and rates of a joint; one each for others."""


class SceneConfig(FromFile):
    """Robot, objects and surroundings in one file; ``robot`` and ``objects`` beside it may add to what it says of them."""

    model: ModelSource = REQUIRED
    """MJCF file, relative to the scenario file that names it. Each moving tree below its ``<worldbody>`` is the robot or an
    object, with the name of its root body; all else is the fixed object ``surroundings``."""
    robot: Name
    """Root body of the robot."""
    keyframe: Name | None = None
    """Keyframe that is the initial state, where ``initial`` says nothing else; default: the first one of the file."""
    asset_folders: tuple[Name, ...] = ()
    """Further folders with files of the model (meshes, includes), relative to the scenario file."""


def with_scene(source: YamlSource) -> YamlSource:
    """A source without the key ``scene``: with a robot and objects in its place; the source itself if it has none.

    Raises:
        InputError: The file cannot be read, or has no such robot or keyframe.
    """
    data = source.data
    if not isinstance(data, Mapping) or data.get(SCENE) is None:
        return source
    try:
        config = _config(data[SCENE])
        written = _written(config, _read(config, source.folder((SCENE, "mjcf"))), source)
    except ScenarioFaults as faulty:
        raise source.located(Fault(fault.message, (SCENE, *fault.path)) for fault in faulty.faults) from faulty
    return source.with_data(_merged(written, {key: value for key, value in data.items() if key != SCENE}))


def _config(value: Any) -> SceneConfig:
    """The key itself.

    Raises:
        ScenarioFaults: It is not valid.
    """
    try:
        return SceneConfig.model_validate(value)
    except ValidationError as error:
        raise ScenarioFaults(plain_faults(error, KindNames(SceneConfig, (), (), {}))) from error


def _read(config: SceneConfig, folder: Path) -> Any:
    """Specification of the whole file; all its elements have names.

    Raises:
        InputError: It cannot be read or parsed.
        ScenarioFaults: There is no such file.
    """
    inline = config.model if isinstance(config.model, InlineModel) else None
    path = Path(os.path.normpath(folder / ("scene.xml" if inline else str(config.model))))
    if inline is None and not path.is_file():
        raise ScenarioFaults([Fault(f"no such model file: {path}", ("mjcf",))])
    folders = [Path(os.path.normpath(folder / subfolder)) for subfolder in config.asset_folders]
    files: ModelFiles = read_model(path, folders, (), inline.files(path.name) if inline else {})
    with mujoco.MjVfs() as vfs, collected_warnings([]), catch_warnings(action="ignore"):
        return load_spec(files, vfs)


def _written(config: SceneConfig, spec: Any, source: YamlSource) -> dict[str, Any]:
    """Robot, objects and initial state of a file.

    Raises:
        ScenarioFaults: It has no such robot or keyframe.
    """
    roots = [body.name for body in moving_roots(spec)]
    if config.robot not in roots:
        raise ScenarioFaults([Fault(unknown_name("root of a moving tree", config.robot, roots), ("robot",))])
    keys = {key.name: key for key in spec.keys}
    if config.keyframe is not None and config.keyframe not in keys:
        raise ScenarioFaults([Fault(unknown_name("keyframe", config.keyframe, list(keys)), ("keyframe",))])

    def of(body: str, *keys: str) -> dict[str, Any]:
        # Paths are relative to the file that sets a key, which may be another one than that of the scene.
        away = os.path.relpath(source.folder((SCENE, "mjcf")), source.folder((*keys, "mjcf")))
        folders = [os.path.normpath(os.path.join(away, subfolder)) for subfolder in config.asset_folders]
        inline = isinstance(config.model, InlineModel)
        model = config.model if inline else os.path.normpath(os.path.join(away, str(config.model)))
        return {"mjcf": model, "body": body, **({"asset_folders": folders} if folders else {})}

    stated = source.data.get("objects")
    left_out = {name for name, value in stated.items() if value is None} if isinstance(stated, Mapping) else set()
    bodies = {name: body for body, name in _object_names(roots, config.robot) if name not in left_out}
    objects = {name: of(body, "objects", name) for name, body in bodies.items()}
    if spec.worldbody.geoms or any(body.name not in roots for body in spec.worldbody.bodies):
        objects[SURROUNDINGS] = of(REST, "objects", SURROUNDINGS) | {"fixed": True}
    written: dict[str, Any] = {"robot": of(config.robot, "robot"), "objects": objects}
    chosen = config.keyframe or next(iter(keys), None)
    return written | ({"initial": _initial(spec, keys[chosen], {config.robot, *bodies.values()})} if chosen else {})


def _object_names(roots: list[str], robot: str) -> Iterator[tuple[str, str]]:
    """Root body and name of each object: of letters, digits, ``_`` and ``-``, as a scenario's objects are."""
    used = set(_RESERVED)
    for body in roots:
        if body != robot:
            name = unused(re.sub(r"[^A-Za-z0-9_-]", "_", body), used)
            used.add(name)
            yield body, name


def _initial(spec: Any, key: Any, roots: Collection[str]) -> dict[str, dict[str, Any]]:
    """Coordinates and rates of the joints of some trees at a keyframe; MuJoCo has its numbers joint by joint, depth first.

    Raises:
        ScenarioFaults: It has numbers of other joints.
    """
    start: dict[str, dict[str, Any]] = {"joints": {}, "rates": {}}
    for what, numbers, which in (("joints", list(key.qpos), 0), ("rates", list(key.qvel), 1)):
        at = 0
        for root, joint in _joints(spec) if numbers else ():
            size = _SIZES.get(joint.type, (1, 1))[which]
            values = [float(value) for value in numbers[at : at + size]]
            at += size
            if len(values) == size and root in roots:
                start[what][joint.name] = values if size > 1 else values[0]
        if at != len(numbers):
            message = f"keyframe {key.name!r} has {len(numbers)} numbers for {at} {what} of its file"
            raise ScenarioFaults([Fault(message, ("mjcf",))])
    return start


def _joints(spec: Any) -> Iterator[tuple[str, Any]]:
    """All joints in MuJoCo's order, each with the root of its tree."""
    for root in moving_roots(spec):
        waiting = [root]
        while waiting:
            body = waiting.pop()
            yield from ((root.name, joint) for joint in body.joints)
            waiting += reversed(body.bodies)


def _merged(written: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """What a file says, with what the scenario says on top; an object that is null there is left out."""
    merged = dict(written)
    for key, value in changes.items():
        both = isinstance(value, Mapping) and isinstance(merged.get(key), Mapping)
        merged[key] = _merged(merged[key], value) if both else value
    return {key: value for key, value in merged.items() if value is not None}
