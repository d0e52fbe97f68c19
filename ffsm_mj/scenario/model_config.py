"""Configuration of the robot and of objects."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

from pydantic import (
    AliasChoices,
    Field,
    PlainSerializer,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    WithJsonSchema,
    WrapValidator,
    field_validator,
    model_validator,
)

from ffsm_mj.config import Name, StrictModel
from ffsm_mj.errors import InputError
from ffsm_mj.model.edits import JointFlex, LimitsMode, Strippable
from ffsm_mj.model.files import REST, menagerie_file
from ffsm_mj.model.inline import InlineModel, inline_model
from ffsm_mj.model.properties import Pose


class SiteConfig(StrictModel):
    """A site added to the robot's model, e.g. a tip at the end of a vendor's arm."""

    body: Name
    """Body of the robot to which the site is fixed, by its name in the file."""
    pos_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Position in the body's frame, m."""


def _source(given: Any, as_path: ValidatorFunctionWrapHandler) -> Any:
    try:
        kept = inline_model(given)
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


class Robot(FromFile):
    """The free-floating manipulator."""

    model: ModelSource = REQUIRED
    """MJCF or URDF file, relative to the scenario file that names it, in Python to the current folder; or the model itself,
    as XML text or ``mujoco.MjSpec``; its root body is the base. Lengths in m; quaternions w, x, y, z."""
    if TYPE_CHECKING:
        xml: str = ""
    body: Name | None = None
    """Body of the file, right below its ``<worldbody>``, that the robot is with everything below it; the rest of the file is
    left out."""
    asset_folders: tuple[Name, ...] = ()
    """Further folders with files of the model (meshes, includes), relative to the scenario file."""
    package_paths: tuple[Name, ...] = ()
    """Folders to search for packages of a URDF (``package://NAME/...``), after its parents; relative to the scenario."""
    strip: tuple[Strippable, ...] = ()
    """Elements to remove from the model, which would break conservation; the file itself is not changed."""
    sites: dict[Name, SiteConfig] = {}
    """Sites to add to the model by name; the file itself is not changed."""
    joint_flex: dict[Name, JointFlex] = {}
    """Joints of the model with a flexible drive, by their names in the file; the file itself is not changed."""
    limits: LimitsMode = "stop"
    """Joints with limits in the model stop there (``stop``, see joint_limits), or move on (``ignore``)."""


class Model(FromFile):
    """An object: floating, or fixed to the world."""

    model: ModelSource = REQUIRED
    """MJCF or URDF file, relative to the scenario file that names it, in Python to the current folder; or the model itself,
    as XML text or ``mujoco.MjSpec``. Lengths in m; quaternions w, x, y, z."""
    if TYPE_CHECKING:
        xml: str = ""
    body: Name | None = None
    """Body of the file, right below its ``<worldbody>``, that the object is with everything below it; the rest is left out.
    ``world`` is what the file fixes to the world, with ``fixed: true``."""
    asset_folders: tuple[Name, ...] = ()
    """Further folders with files of the model (meshes, includes), relative to the scenario file."""
    package_paths: tuple[Name, ...] = ()
    """Folders to search for packages of a URDF (``package://NAME/...``), after its parents; relative to the scenario."""
    strip: tuple[Strippable, ...] = ()
    """Elements to remove from the model, which would break conservation; the file itself is not changed."""
    limits: LimitsMode = "stop"
    """Joints with limits in the model stop there (``stop``, see joint_limits), or move on (``ignore``)."""
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
    def _rest_is_fixed(self) -> Model:
        if (self.body == REST) != self.fixed and self.body is not None:
            raise ValueError(f"'body: {REST}' and 'fixed: true' belong together: what a file fixes to the world")
        return self

    @property
    def fixed_at(self) -> Pose | None:
        """Pose of a fixed object; None if it floats."""
        return (self.pose or Pose()) if self.fixed else None
