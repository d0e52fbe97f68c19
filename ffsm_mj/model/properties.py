"""Properties of models that a scenario may give: masses, sizes of geoms, friction of joints, pose of a fixed object."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import mujoco
import numpy as np
from pydantic import AfterValidator, Field, field_validator

from ffsm_mj.arrays import FloatArray
from ffsm_mj.config import StrictModel
from ffsm_mj.errors import unknown_name

# The greatest moment of a flat body is the sum of the others; rounding must not make MuJoCo refuse it.
_ROUNDING = 1e-12
_FROM_GEOMS_BY_DEFAULT = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO


@dataclass(frozen=True)
class Inertial:
    """Inertial of a body.

    Attributes:
        mass_kg: Mass, kg.
        centre_m: Centre of mass in the body's frame, (3,), m.
        moments: Principal moments of inertia about the centre of mass, (3,), kg m^2.
        axes: Orientation of the principal axes in the body's frame, quaternion w, x, y, z, (4,).
    """

    mass_kg: float
    centre_m: FloatArray
    moments: FloatArray
    axes: FloatArray

    @classmethod
    def of(cls, model: Any, body: int) -> Inertial:
        """Inertial of a body of a compiled model, as a copy."""
        numbers = (model.body_ipos[body], model.body_inertia[body], model.body_iquat[body])
        return cls(float(model.body_mass[body]), *(moment.copy() for moment in numbers))

    @property
    def inertia_kg_m2(self) -> FloatArray:
        """xx, yy, zz, xy, xz, yz of the inertia about the centre of mass, in the body's axes, (6,)."""
        flat = np.empty(9)
        mujoco.mju_quat2Mat(flat, self.axes)
        turn = flat.reshape(3, 3)
        tensor = (turn * self.moments) @ turn.T
        return np.asarray(tensor[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])

    def changed(
        self, mass_kg: float | None, inertia_kg_m2: Sequence[float] | None, centre_m: Sequence[float] | None
    ) -> Inertial:
        """A copy with other values; None keeps a value.

        Args:
            mass_kg: Mass; without an inertia, the moments are scaled with it.
            inertia_kg_m2: xx, yy, zz, or these and xy, xz, yz, about the centre of mass in the body's axes.
            centre_m: Centre of mass; the inertia about it is kept.
        """
        moments, axes = self.moments, self.axes
        # A body of the same shape and another density has moments in proportion to its mass.
        if inertia_kg_m2 is not None:
            moments, axes = principal(inertia_kg_m2)
        elif mass_kg is not None:
            moments = _without_excess(moments * (mass_kg / self.mass_kg))
        mass = self.mass_kg if mass_kg is None else mass_kg
        return Inertial(mass, self.centre_m if centre_m is None else np.array(centre_m), moments, axes)

    def write(self, body: Any) -> None:
        """Set the inertial of a body of a specification, and disable all compiler options that would change it."""
        body.explicitinertial = True
        body.mass, body.ipos, body.inertia, body.iquat = self.mass_kg, self.centre_m, self.moments, self.axes
        body.fullinertia, body.ialt.type = np.full(6, np.nan), mujoco.mjtOrientation.mjORIENTATION_QUAT
        compiler = body.compiler  # that of the body's own file: a model may attach others
        compiler.inertiafromgeom = _FROM_GEOMS_BY_DEFAULT
        compiler.boundmass = compiler.boundinertia = 0.0
        compiler.balanceinertia = False


def principal(inertia_kg_m2: Sequence[float]) -> tuple[FloatArray, FloatArray]:
    """Principal moments, (3,), and the quaternion of their axes, (4,), of xx, yy, zz, or of these and xy, xz, yz."""
    moments, vectors, axes = np.array(inertia_kg_m2[:3]), np.empty(9), np.array([1.0, 0.0, 0.0, 0.0])
    if any(inertia_kg_m2[3:]):
        xx, yy, zz, xy, xz, yz = inertia_kg_m2
        tensor = np.array([xx, xy, xz, xy, yy, yz, xz, yz, zz])
        mujoco.mju_eig3(moments, vectors, axes, tensor)
    return _without_excess(moments), axes


def fault_of_moments(moments: FloatArray) -> str:
    """Fault of principal moments of inertia as text; empty if they are possible."""
    if not moments.min() > 0.0:
        return f"must have positive principal moments; they are {_listed(moments)}"
    greatest = float(moments.max())
    if greatest > (moments.sum() - greatest) * (1.0 + _ROUNDING):
        return f"the greatest principal moment must not exceed the sum of the others: {_listed(moments)}"
    return ""


def _without_excess(moments: FloatArray) -> FloatArray:
    """Moments with the greatest reduced to the sum of the others if it exceeds it by rounding only."""
    greatest = int(np.argmax(moments))
    others = float(np.delete(moments, greatest).sum())
    if others < moments[greatest] <= others * (1.0 + _ROUNDING):
        moments = moments.copy()
        moments[greatest] = others
    return moments


def _listed(moments: FloatArray) -> str:
    return ", ".join(f"{moment:.6g}" for moment in moments)


MOST_MASS = 1e20
"""Greatest mass in kg and moment of inertia in kg m^2: energies, their squares and their sums stay finite."""
MOST_LENGTH = 1e10
"""Greatest length and coordinate in m; MuJoCo's own limit for a state."""
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


def _unit(value: tuple[float, ...]) -> tuple[float, ...]:
    length = np.linalg.norm(value)
    if not abs(length - 1.0) <= _UNIT_LENGTH:
        raise ValueError(f"the quaternion (w, x, y, z) must have length 1, got {length:.6g}")
    return value


UnitQuaternion = Annotated[tuple[float, ...], Field(min_length=4, max_length=4), AfterValidator(_unit)]
"""Orientation w, x, y, z in a scenario."""


class Pose(StrictModel):
    """Pose of a fixed object: of the world frame of its file in that of the scene."""

    position_m: Annotated[tuple[_Coordinate, ...], Field(min_length=3, max_length=3)] = (0.0, 0.0, 0.0)
    """Position in world axes, m."""
    quaternion: UnitQuaternion = (1.0, 0.0, 0.0, 0.0)
    """Orientation w, x, y, z; its length must be 1 to within 1e-3, and it is normalised."""


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
        raise LookupError(unknown_name(kind, full, [candidate for candidate in names if "/" in candidate]))
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
    return f"{value:g}" if isinstance(value, float) else f"[{', '.join(f'{number:g}' for number in value)}]"
