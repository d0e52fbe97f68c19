"""Properties of models that a scenario may give: masses, sizes of geoms, friction of joints, pose of a fixed object."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import mujoco
import numpy as np
from pydantic import Field, field_validator

from ffsm_mj.config import StrictModel
from ffsm_mj.errors import unknown_name
from ffsm_mj.model.inertial import Inertial, fault_of_moments, principal
from ffsm_mj.model.number_faults import MOST_LENGTH, MOST_MASS

SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2, "ellipsoid": 3, "box": 3}
"""Number of values in the size of a geom, by its kind; other kinds have no size of their own."""
INERTIAL = ("mass_kg", "inertia_kg_m2", "centre_of_mass_m")
"""Keys of the inertial of a body."""

_Length = Annotated[float, Field(gt=0.0, le=MOST_LENGTH)]
_Coordinate = Annotated[float, Field(ge=-MOST_LENGTH, le=MOST_LENGTH)]
_UNIT_LENGTH = 1e-3
_Friction = Annotated[float, Field(ge=0.0, le=1e12)]
_Moment = Annotated[float, Field(ge=-MOST_MASS, le=MOST_MASS)]
_Name = Annotated[str, Field(min_length=1)]
Value = float | tuple[float, ...]


class GeomProperties(StrictModel):
    """Properties of a geom."""

    size_m: Annotated[tuple[_Length, ...], Field(min_length=1, max_length=3)]
    """MuJoCo's size: radius of a sphere, radius and half length of a capsule or cylinder, half lengths of a box, half axes
    of an ellipsoid, m. The inertial of the body is kept unless ``mass_from_geoms`` is set."""


class JointProperties(StrictModel):
    """Properties of a joint."""

    frictionloss: _Friction
    """Greatest dry friction of a hinge in N m, or of a slide in N."""


class BodyProperties(StrictModel):
    """Properties of a body; keys that are left out keep the values of the model."""

    mass_kg: Annotated[float, Field(gt=0.0, le=MOST_MASS)] | None = None
    """Mass, kg; the inertia is scaled with it unless it is given too."""
    inertia_kg_m2: Annotated[tuple[_Moment, ...], Field(min_length=3, max_length=6)] | None = None
    """Inertia about the centre of mass in the body's axes, kg m^2: xx, yy, zz, or these and xy, xz, yz."""
    centre_of_mass_m: Annotated[tuple[_Coordinate, ...], Field(min_length=3, max_length=3)] | None = None
    """Centre of mass in the body's frame, m; the inertia about it is kept."""
    mass_from_geoms: bool = False
    """Compute mass, inertia and centre of mass from sizes and densities of the geoms; the keys above apply on top."""
    geoms: dict[_Name, GeomProperties] = {}
    """Properties of its geoms, by their names in the model."""
    joints: dict[_Name, JointProperties] = {}
    """Properties of its joints, by their names in the model."""

    @field_validator("inertia_kg_m2")
    @classmethod
    def _of_a_body(cls, value: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if value is not None:
            if len(value) not in (3, 6):
                raise ValueError(f"must be 3 numbers (xx, yy, zz) or 6 (and xy, xz, yz), got {len(value)}")
            if fault := fault_of_moments(principal(value)[0]):
                raise ValueError(fault)
        return value

    @property
    def sets_inertial(self) -> bool:
        """Whether it changes the inertial of the body."""
        return bool(self.inertial_keys)

    @property
    def inertial_keys(self) -> tuple[str, ...]:
        """Keys of the inertial that change: those that are given, or all of them with ``mass_from_geoms``."""
        return tuple(key for key in INERTIAL if self.mass_from_geoms or getattr(self, key) is not None)


class Pose(StrictModel):
    """Pose of a fixed object: of the world frame of its file in that of the scene."""

    position_m: Annotated[tuple[_Coordinate, ...], Field(min_length=3, max_length=3)] = (0.0, 0.0, 0.0)
    """Position in world axes, m."""
    quaternion: Annotated[tuple[float, ...], Field(min_length=4, max_length=4)] = (1.0, 0.0, 0.0, 0.0)
    """Orientation w, x, y, z; its length must be 1 to within 1e-3, and it is normalised."""

    @field_validator("quaternion")
    @classmethod
    def _unit(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        length = np.linalg.norm(value)
        if not abs(length - 1.0) <= _UNIT_LENGTH:
            raise ValueError(f"the quaternion (w, x, y, z) must have length 1, got {length:.6g}")
        return value


Trees = dict[_Name, dict[_Name, BodyProperties]]
"""Properties by ``robot`` or object, then by body."""


@dataclass(frozen=True)
class Overrides:
    """Properties that one key of a scenario gives for one model.

    Attributes:
        key: The key: ``model`` or ``controller_model``.
        bodies: Properties by the name of the body in the model.
    """

    key: str
    bodies: Mapping[str, BodyProperties]


@dataclass(frozen=True)
class PropertyChange:
    """A given property, with its value in the compiled scene.

    Attributes:
        path: Keys of the property in the scenario.
        before: Value in the model; an inertia as xx, yy, zz, xy, xz, yz.
        after: Value in the compiled scene.
    """

    path: tuple[str, ...]
    before: Value
    after: Value

    @property
    def sentence(self) -> str:
        """The change as text."""
        return f"{'.'.join(self.path)} is {value_text(self.after)}; without it {value_text(self.before)}"


def property_value(model: Any, path: str | tuple[str, ...]) -> Value:
    """Value in a compiled scene of a property below ``model`` or ``controller_model``, given in the scenario or not.

    Args:
        model: Compiled MuJoCo model of a scene, :attr:`ffsm_mj.model.system.System.mj`.
        path: Keys of the property, as a tuple or joined by dots: ``model.box.lid.mass_kg``.

    Returns:
        One number or several; an inertia as xx, yy, zz, xy, xz, yz.

    Raises:
        LookupError: No such body, geom, joint or property; the message lists the valid names.
    """
    keys = tuple(path.split(".")) if isinstance(path, str) else path
    if len(keys) < 4:
        raise LookupError(f"{'.'.join(keys)!r} is not a property; write model.<tree>.<body>.<property>")
    _, tree, body, *rest = keys
    b = _index(model, "body", tree, body)
    if len(rest) == 1 and rest[0] in INERTIAL:
        return inertial_value(Inertial.of(model, b), rest[0])
    if len(rest) == 3 and (rest[0], rest[2]) == ("geoms", "size_m"):
        return geom_size(model, _index(model, "geom", tree, rest[1]))
    if len(rest) == 3 and (rest[0], rest[2]) == ("joints", "frictionloss"):
        return joint_friction(model, _index(model, "joint", tree, rest[1]))
    others = ("geoms.<geom>.size_m", "joints.<joint>.frictionloss")
    raise LookupError(unknown_name("property", ".".join(rest), (*INERTIAL, *others)))


def _index(model: Any, kind: str, tree: str, name: str) -> int:
    count = {"body": model.nbody, "geom": model.ngeom, "joint": model.njnt}[kind]
    names = [getattr(model, kind)(i).name for i in range(count)]
    full = f"{tree}/{name}"
    if full not in names:
        raise LookupError(unknown_name(kind, full, [each for each in names if "/" in each]))
    return names.index(full)


def inertial_value(inertial: Inertial, key: str) -> Value:
    """Value of a key of the inertial."""
    if key == "mass_kg":
        return inertial.mass_kg
    return tuple((inertial.inertia_kg_m2 if key == "inertia_kg_m2" else inertial.centre_m).tolist())


def geom_size(model: Any, geom: int) -> tuple[float, ...]:
    """Size of a geom of a compiled model, with the number of values of its kind; all three values of other kinds."""
    kind = kind_of_geom(model.geom_type[geom])
    return tuple(np.asarray(model.geom_size[geom], dtype=np.float64)[: SIZES.get(kind, 3)].tolist())


def joint_friction(model: Any, joint: int) -> float:
    """Dry friction of a joint of a compiled model, N m or N."""
    return float(model.dof_frictionloss[model.jnt_dofadr[joint]])


def kind_of_geom(code: int) -> str:
    """Name of a kind of geom, by MuJoCo's type number."""
    return str(mujoco.mjtGeom(code).name.removeprefix("mjGEOM_").lower())


def value_text(value: Value) -> str:
    """A value as text."""
    return f"{value:g}" if isinstance(value, float) else f"[{', '.join(f'{each:g}' for each in value)}]"
