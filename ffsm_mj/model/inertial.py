"""Mass, centre of mass and inertia of one body: read from a compiled model, changed, written to a specification."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray

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
        return cls(float(model.body_mass[body]), *(each.copy() for each in numbers))

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
    return ", ".join(f"{each:.6g}" for each in moments)
