"""Inner surfaces of cones that a scenario adds to bodies: docking cones, funnels and nozzles, which are no facets.

A geom without contact bits and mass stands for each of them in the compiled model: it has an id, a name, a body and bounding
spheres, and viewers draw it. Its mesh has facets; contact uses the surface itself, in float64, from the numbers here.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Any

import mujoco
import numpy as np
import numpy.typing as npt
from pydantic import Field, NonNegativeFloat, PositiveFloat, ValidationInfo, field_validator

from ffsm_mj.arrays import FloatArray
from ffsm_mj.config import Name, StrictModel
from ffsm_mj.errors import Faults, unknown_name

_SECTORS = 64
"""Facets of the picture round the axis: chords are off the circle by 0.12 % of its radius."""
_RINGS = 8
"""Rows of facets along the axis; shading of a single long row would show its triangles."""
_COLOUR = (0.75, 0.78, 0.80, 1.0)


class ConeConfig(StrictModel):
    """The inner surface of a cone on a body: other bodies are inside, and touch it from there."""

    body: Name
    """Body of the model to which it is fixed, by its name in the file; ``world`` for what a fixed object has there."""
    apex_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Apex in the axes of the body, m."""
    axis: tuple[float, float, float]
    """Direction from the apex to the mouth in the axes of the body; of any length but zero."""
    half_angle_deg: Annotated[float, Field(gt=0.0, lt=90.0)]
    """Angle between axis and surface, degrees."""
    length_m: PositiveFloat
    """Distance along the axis from the apex to the mouth, m."""
    from_m: NonNegativeFloat = 0.0
    """Distance along the axis from the apex at which the surface begins, m: a frustum, or a nozzle with a throat."""
    name: Name = "cone"
    """Name among the geoms of its model: contact rules and records use it."""

    @field_validator("axis")
    @classmethod
    def _has_a_direction(cls, value: tuple[float, float, float]) -> tuple[float, float, float]:
        if not math.hypot(*value) > 0.0:
            raise ValueError("must have a direction; all its components are zero")
        return value

    @field_validator("from_m")
    @classmethod
    def _begins_before_the_mouth(cls, value: float, info: ValidationInfo) -> float:
        length = info.data.get("length_m")
        if length is not None and value >= length:
            raise ValueError(f"must be less than length_m, which is {length:g}: the surface is between both")
        return value

    @property
    def direction(self) -> tuple[float, float, float]:
        """Unit vector from the apex to the mouth, axes of the body."""
        length = math.hypot(*self.axis)
        x, y, z = (component / length for component in self.axis)
        return x, y, z

    @property
    def mouth_radius_m(self) -> float:
        """Radius at the mouth, m."""
        return self.length_m * math.tan(math.radians(self.half_angle_deg))


def add_cones(spec: Any, cones: Iterable[ConeConfig], keys: tuple[str, ...], *, fixed: bool) -> None:
    """Add geoms that stand for cones to a specification before it is compiled.

    Args:
        spec: Specification of a model; all its elements have names.
        cones: The cones.
        keys: Keys of the model in the scenario.
        fixed: Whether the model is fixed to the world, and its ``<worldbody>`` a body like others.

    Raises:
        ScenarioFaults: A body does not exist, or a geom of that name does.
    """
    with Faults() as faults:
        for i, cone in enumerate(cones):
            body = spec.body(cone.body)
            if body is None or (body.name == "world" and not fixed):
                names = [known.name for known in spec.bodies[0 if fixed else 1 :]]
                faults.add(unknown_name("body", cone.body, names), *keys, "cones", i, "body")
            elif cone.name in {geom.name for geom in spec.geoms}:
                message = f"the model already has a geom {cone.name!r}; choose another name"
                faults.add(message, *keys, "cones", i, "name")
            else:
                _add_geom(spec, body, cone)


def _add_geom(spec: Any, body: Any, cone: ConeConfig) -> None:
    """Add the picture of a cone to a body."""
    points, triangles = _surface(cone)
    mesh = spec.add_mesh(name=_mesh_name(spec, cone.name), uservert=points.ravel(), userface=triangles.ravel())
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # the surface encloses no volume
    geom = body.add_geom(name=cone.name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=mesh.name)
    # Defaults of the file are for its own geoms.
    geom.contype, geom.conaffinity, geom.mass, geom.group, geom.rgba = 0, 0, 0.0, 0, _COLOUR


def _mesh_name(spec: Any, name: str) -> str:
    """A name that no mesh of the model has."""
    used = {mesh.name for mesh in spec.meshes}
    while name in used:
        name += "_"
    return name


def _surface(cone: ConeConfig) -> tuple[FloatArray, npt.NDArray[np.int32]]:
    """Points of rings round the axis, axes of the body, (n, 3), and triangles between them, seen from inside, (m, 3)."""
    axis = np.array(cone.direction)
    across = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    across /= np.linalg.norm(across)
    angles = 2.0 * np.pi * np.arange(_SECTORS) / _SECTORS
    round_axis = np.outer(np.cos(angles), across) + np.outer(np.sin(angles), np.cross(axis, across))
    # A ring of the size of a point has triangles without area, which MuJoCo refuses: the tip is left out of the picture.
    first = max(cone.from_m, 1e-3 * cone.length_m)
    heights = np.linspace(first, cone.length_m, _RINGS + 1)
    slope = math.tan(math.radians(cone.half_angle_deg))
    points = np.concatenate([cone.apex_m + height * (axis + slope * round_axis) for height in heights])
    lower = np.arange(_RINGS * _SECTORS)
    beside = lower - lower % _SECTORS + (lower + 1) % _SECTORS
    upper, upper_beside = lower + _SECTORS, beside + _SECTORS
    triangles = np.concatenate((np.stack((lower, upper, beside), 1), np.stack((beside, upper, upper_beside), 1)))
    return points, triangles.astype(np.int32)
