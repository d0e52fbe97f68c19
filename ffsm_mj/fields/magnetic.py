"""Magnetic field of the surroundings: uniform, or the tilted dipole of the Earth, which turns with it."""

from __future__ import annotations

import math
from datetime import UTC, datetime
from typing import Protocol

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.fields.config import DipoleConfig, MagneticConfig
from ffsm_mj.fields.orbit import Orbit

_RADIUS_M = 6371.2e3
"""Radius at which the coefficients of IGRF are stated."""
_J2000 = datetime(2000, 1, 1, 12, tzinfo=UTC)
_DAY_S = 86400.0


def earth_rotation_angle(days: float) -> float:
    """Angle from the axis x of the inertial axes to the meridian of Greenwich, rad from 0 to 2 pi.

    IERS Conventions (2010), equation 5.15, with UTC for UT1: they differ by less than 0.9 s, 4e-3 degrees.

    Args:
        days: UT1 from 2000-01-01 12:00 on.
    """
    # The whole days are whole turns: without them the angle keeps its digits.
    return 2.0 * math.pi * math.fmod(0.7790572732640 + 0.00273781191135448 * days + days % 1.0, 1.0)


class MagneticField(Protocol):
    """A magnetic field in the world axes of a scene."""

    def at(self, time_s: float, position_m: FloatArray) -> FloatArray:
        """Flux density at a position in world axes, T, (3,)."""


class UniformMagneticField:
    """The same everywhere and at any time."""

    def __init__(self, field_T: tuple[float, float, float]) -> None:
        """Take the flux density, world axes, T."""
        self._field = np.array(field_T)

    def at(self, time_s: float, position_m: FloatArray) -> FloatArray:  # noqa: ARG002
        """Flux density at a position in world axes, T, (3,)."""
        return self._field


class Dipole:
    """Field of the tilted dipole of the Earth: the terms of degree 1 of its potential (IGRF)."""

    def __init__(self, coefficients_nT: tuple[float, float, float], orbit: Orbit, epoch: str) -> None:
        """Place it.

        Args:
            coefficients_nT: g10, g11 and h11, nT.
            orbit: Orbit of the origin, whose place in the inertial axes is known.
            epoch: Date and time of t = 0, ISO 8601 in UTC.
        """
        polar, *equatorial = (1e-9 * value for value in coefficients_nT)
        # The potential of degree 1 is a (a/r)^2 m . u, with m of these components in axes of the Earth.
        self._polar, self._equatorial = polar, math.hypot(*equatorial)
        self._longitude = math.atan2(equatorial[1], equatorial[0])
        self._orbit, self._days = orbit, (datetime.fromisoformat(epoch) - _J2000).total_seconds() / _DAY_S
        self._time_s, self._origin, self._moment = math.nan, np.zeros(3), np.zeros(3)

    def at(self, time_s: float, position_m: FloatArray) -> FloatArray:
        """Flux density at a position in world axes, T, (3,)."""
        if time_s != self._time_s:  # bodies and sensors of one instant share it
            self._origin, _ = self._orbit.reference.state(time_s)
            angle = self._longitude + earth_rotation_angle(self._days + time_s / _DAY_S)
            across = self._equatorial * math.cos(angle), self._equatorial * math.sin(angle)
            self._moment, self._time_s = np.array((*across, self._polar)) @ self._orbit.axes, time_s
        place = self._origin + position_m
        distance = math.sqrt(place.dot(place))
        u = place / distance
        field: FloatArray = (_RADIUS_M / distance) ** 3 * (3.0 * self._moment.dot(u) * u - self._moment)
        return field


def magnetic_field_of(config: MagneticConfig, orbit: Orbit | None, epoch: str | None) -> MagneticField:
    """The magnetic field of a scenario, of whose keys nothing is wrong."""
    if not isinstance(config, DipoleConfig):
        return UniformMagneticField(config.field_T)
    assert orbit is not None
    assert epoch is not None
    return Dipole(config.coefficients_nT, orbit, epoch)
