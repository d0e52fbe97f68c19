"""Forces of orbits and uniform fields from the scenario alone, by formulas other than the engine's.

The reference orbit is that of equinoctial elements (Broucke and Cefola, *On the equinoctial orbit elements*, Celestial
Mechanics 5, 1972), with J2 an integration of absolute positions; the tide is stated by log1p and expm1, the gradient by the
whole tensor of inertia in world axes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

import numpy as np

from ffsm_mj.verification.independent.finding import Array

_BODIES = {
    "earth": {"mu_km3_s2": 398600.4418, "radius_km": 6378.137, "j2": 1.08262668e-3},
    "moon": {"mu_km3_s2": 4902.800118, "radius_km": 1738.0, "j2": 2.0323e-4},
    "mars": {"mu_km3_s2": 42828.37362, "radius_km": 3396.0, "j2": 1.9566e-3},
}
"""WGS 84 and EGM96; DE440 and LP165P; DE440 and GMM-3."""
_LVLH_OF_HILL = np.array(((0.0, 1.0, 0.0), (0.0, 0.0, -1.0), (-1.0, 0.0, 0.0)))
"""Hill's axes as columns in LVLH axes: V-bar forward, -H-bar, R-bar down."""
_UNIFORM = "uniform"
_IGRF_NT = (-29350.0, -1410.3, 4545.5)
"""g10, g11 and h11 of IGRF-14 at 2025.0."""


class KnownFields:
    """Orbit and uniform fields of a scenario.

    Attributes:
        are_all: Whether these are all its external fields: others are code of users.
        orbit: The orbit; None: there is none.
        magnetic: The magnetic field; None: there is none but that of the models.
    """

    def __init__(self, scenario: Mapping[str, Any]) -> None:
        """Read the scenario.

        Raises:
            LookupError: A key is missing.
        """
        environment = scenario.get("environment") or {}
        fields = environment.get("fields") or ()
        self.are_all = all(field["kind"] == _UNIFORM for field in fields)
        uniform = [field["acceleration_m_s2"] for field in fields if field["kind"] == _UNIFORM]
        self._uniform = np.sum(np.array(uniform, dtype=float).reshape(-1, 3), axis=0)
        self.orbit = Orbit(environment) if environment.get("orbit") else None
        self.magnetic = MagneticField(environment, self.orbit) if environment.get("magnetic_field") else None

    def wrench(self, time_s: float, mass: float, position: Array, inertia: Array) -> Array:
        """Force on a body, N, and torque about its mass centre, N m, world axes, (6,).

        Args:
            time_s: Time.
            mass: Mass of the body, kg.
            position: Its mass centre, m, (3,).
            inertia: Its inertia about the mass centre in world axes, kg m^2, (3, 3).
        """
        wrench = np.concatenate((mass * self._uniform, np.zeros(3)))
        return wrench if self.orbit is None else wrench + self.orbit.wrench(time_s, mass, position, inertia)

    def acceleration(self, time_s: float, position: Array) -> Array:
        """Acceleration of a free mass at a position, world axes, m/s^2, (3,)."""
        return np.asarray(self._uniform if self.orbit is None else self._uniform + self.orbit.tide(time_s, position))


class Orbit:
    """The orbit of the origin of a scene, and what gravitation leaves in its free fall.

    Attributes:
        axes: World axes as columns in the inertial axes of the central body, (3, 3).
    """

    def __init__(self, environment: Mapping[str, Any]) -> None:
        """Take the state at t = 0, and the axes in which it is stated.

        Raises:
            LookupError: A key is missing.
        """
        stated = environment["orbit"]
        body = stated.get("body") or "earth"
        body = _BODIES[body] if isinstance(body, str) else body
        self._mu = 1e9 * body["mu_km3_s2"]
        self._oblateness = 1.5e6 * body["j2"] * self._mu * body["radius_km"] ** 2 if stated.get("j2") else 0.0
        along, R, V = _start(stated, self._mu, body["radius_km"])
        kind = environment.get("world_axes") or "hill"
        world = {"hill": np.eye(3), "lvlh": _LVLH_OF_HILL, "eci": along}[kind]
        self._pole, self._R, self._V = world @ along[2], world @ R, world @ V
        self.axes = along @ world.T
        self._elements = _Equinoctial(self._mu, self._R, self._V)
        self._last = 0.0, np.concatenate((self._R, self._V))

    def position(self, time_s: float) -> Array:
        """Position of the origin from the central body, world axes, m, (3,)."""
        if not self._oblateness:
            return self._elements.position(time_s)
        start_s, state = self._last if self._last[0] <= time_s else (0.0, np.concatenate((self._R, self._V)))
        if time_s > start_s:
            from scipy.integrate import solve_ivp  # takes a third of a second to import: only orbits with J2 pay

            # An error of 1 m of the origin changes a tide by 1e-7 of it.
            state = solve_ivp(
                lambda _, y: np.concatenate((y[3:], self._kepler(y[:3]) + self._oblate(y[:3]))),
                (start_s, time_s),
                state,
                method="DOP853",
                rtol=1e-12,
                atol=1e-6,
            ).y[:, -1]
        self._last = time_s, state
        return np.asarray(state[:3])

    def _kepler(self, p: Array) -> Array:
        return np.asarray(-self._mu / np.linalg.norm(p) ** 3 * p)

    def _oblate(self, p: Array) -> Array:
        """Acceleration by J2, m/s^2, (3,)."""
        r = np.linalg.norm(p)
        z = p @ self._pole / r
        return np.asarray(-self._oblateness / r**4 * ((1.0 - 5.0 * z * z) * p / r + 2.0 * z * self._pole))

    def tide(self, time_s: float, position: Array) -> Array:
        """Acceleration of a mass at a position less that of the origin, world axes, m/s^2, (3,)."""
        R = self.position(time_s)
        R2 = R @ R
        # (R / p)^3 - 1, from p^2 / R^2 - 1: a difference of the accelerations themselves is noise of 1e-15 m/s^2.
        ratio = math.expm1(-1.5 * math.log1p(position @ (position + 2.0 * R) / R2))
        a = -self._mu / R2**1.5 * (position + ratio * (R + position))
        return np.asarray(a + self._oblate(R + position) - self._oblate(R))

    def wrench(self, time_s: float, mass: float, position: Array, inertia: Array) -> Array:
        """Force and torque on a body; see :meth:`KnownFields.wrench`."""
        p = self.position(time_s) + position
        distance = np.linalg.norm(p)
        up = p / distance
        gradient, Iu = 3.0 * self._mu / distance**3, inertia @ up
        # Gradient of the second-order potential mu / (2 |p|^3) (3 u.I u - tr I), with the sign of a force.
        force = -gradient / (2.0 * distance) * ((np.trace(inertia) - 5.0 * up @ Iu) * up + 2.0 * Iu)
        return np.concatenate((mass * self.tide(time_s, position) + force, gradient * np.cross(up, Iu)))


class MagneticField:
    """Magnetic field of a scene: uniform, or the terms of degree 1 of the Earth's potential, in spherical coordinates."""

    def __init__(self, environment: Mapping[str, Any], orbit: Orbit | None) -> None:
        """Read the scenario.

        Raises:
            LookupError: A key is missing.
        """
        stated = environment["magnetic_field"]
        self._uniform = np.array(stated["field_T"], dtype=float) if stated["kind"] == _UNIFORM else None
        if self._uniform is None and orbit is not None:
            self._orbit, self._g = orbit, 1e-9 * np.array(stated.get("coefficients_nT") or _IGRF_NT)
            since = datetime.fromisoformat(environment["epoch"]) - datetime(2000, 1, 1, 12, tzinfo=UTC)
            self._days, self._seconds = since.days, since.seconds

    def at(self, time_s: float, position: Array) -> Array:
        """Flux density at a position, world axes, T, (3,)."""
        if self._uniform is not None:
            return self._uniform
        # Turns of the Earth, IERS Conventions (2010), eq. 5.15: of whole days, and of seconds.
        day = (self._seconds + time_s) / 86400.0
        turns = 0.7790572732640 + 0.00273781191135448 * self._days + 1.00273781191135448 * day
        x, y, z = self._orbit.axes @ (self._orbit.position(time_s) + position)
        east, r = math.atan2(y, x), math.sqrt(x * x + y * y + z * z)
        colatitude, longitude = math.acos(z / r), east - math.tau * (turns % 1.0)
        polar, *equatorial = self._g * (6371.2e3 / r) ** 3
        across = equatorial[0] * math.cos(longitude) + equatorial[1] * math.sin(longitude)
        sine, cosine = math.sin(colatitude), math.cos(colatitude)
        of_radius = 2.0 * (polar * cosine + across * sine)
        of_colatitude = polar * sine - across * cosine
        of_longitude = equatorial[0] * math.sin(longitude) - equatorial[1] * math.cos(longitude)
        outward, south = of_radius * sine + of_colatitude * cosine, of_radius * cosine - of_colatitude * sine
        level = (
            outward * math.cos(east) - of_longitude * math.sin(east),
            outward * math.sin(east) + of_longitude * math.cos(east),
        )
        return np.asarray(np.array((*level, south)) @ self._orbit.axes)


def _start(stated: Mapping[str, Any], mu: float, radius_km: float) -> tuple[Array, Array, Array]:
    """Hill's axes at t = 0 as columns in the inertial axes of the body; position and velocity in Hill's axes, m and m/s."""
    angle = {key: math.radians(stated.get(key) or 0.0) for key in stated if key.endswith("_deg")}.get
    kind = stated.get("kind") or "circular"
    if kind == "state":
        R, V = (1e3 * np.array(stated[key], dtype=float) for key in ("position_km", "velocity_km_s"))
        x, z = R / np.linalg.norm(R), np.cross(R, V) / np.linalg.norm(np.cross(R, V))
        along = np.stack((x, np.cross(z, x), z), axis=1)
        return along, R @ along, V @ along
    a, e = _size(stated, radius_km) if kind == "elliptic" else (_radius(stated, mu, radius_km), 0.0)
    true = angle("true_anomaly_deg", 0.0)
    u = true + angle("argument_of_perigee_deg", 0.0) + angle("argument_of_latitude_deg", 0.0)
    node, tilt = angle("raan_deg", 0.0), angle("inclination_deg", 0.0)
    speed = math.sqrt(mu / (a * (1.0 - e * e)))
    R = np.array((a * (1.0 - e * e) / (1.0 + e * math.cos(true)), 0.0, 0.0))
    V = np.array((speed * e * math.sin(true), speed * (1.0 + e * math.cos(true)), 0.0))
    ascending = np.array((math.cos(node), math.sin(node), 0.0))
    normal = np.array((math.sin(tilt) * math.sin(node), -math.sin(tilt) * math.cos(node), math.cos(tilt)))
    across = np.cross(normal, ascending)
    up, forward = (math.cos(s) * ascending + math.sin(s) * across for s in (u, u + 0.5 * math.pi))
    return np.stack((up, forward, normal), axis=1), R, V


def _radius(stated: Mapping[str, Any], mu: float, radius_km: float) -> float:
    """Radius of a circular orbit, m."""
    if stated.get("period_min") is not None:
        return float((mu * (60.0 * stated["period_min"] / math.tau) ** 2) ** (1.0 / 3.0))
    if stated.get("radius_km") is not None:
        return 1e3 * float(stated["radius_km"])
    return 1e3 * (radius_km + float(stated["altitude_km"]))


def _size(stated: Mapping[str, Any], radius_km: float) -> tuple[float, float]:
    """Semi-major axis in m and eccentricity of an elliptic orbit."""
    if stated.get("semi_major_axis_km") is not None:
        return 1e3 * float(stated["semi_major_axis_km"]), float(stated["eccentricity"])
    low, high = (radius_km + float(stated[f"{end}_altitude_km"]) for end in ("perigee", "apogee"))
    return 500.0 * (low + high), (high - low) / (high + low)


class _Equinoctial:
    """A Kepler orbit by elements that are regular at any eccentricity below 1."""

    def __init__(self, mu: float, R: Array, V: Array) -> None:
        """Take the elements from a state at t = 0."""
        r = float(np.linalg.norm(R))
        moment = np.cross(R, V)
        self._f = R / r
        self._g = np.cross(moment / np.linalg.norm(moment), self._f)
        eccentricity = np.cross(V, moment) / mu - self._f
        self._k, self._h = float(eccentricity @ self._f), float(eccentricity @ self._g)
        self._a = 1.0 / (2.0 / r - V @ V / mu)
        root = math.sqrt(1.0 - self._k**2 - self._h**2)
        self._beta, self._n = 1.0 / (1.0 + root), math.sqrt(mu / self._a**3)
        # At t = 0 the body is along f.
        start = math.atan2(
            self._h - self._h * self._k * self._beta * r / (self._a * root),
            self._k + (1.0 - self._k**2 * self._beta) * r / (self._a * root),
        )
        self._start = start - self._k * math.sin(start) + self._h * math.cos(start)

    def position(self, time_s: float) -> Array:
        """Position at a time, m, (3,)."""
        k, h, beta = self._k, self._h, self._beta
        mean = self._start + self._n * time_s
        F = mean
        for _ in range(50):
            change = (F - k * math.sin(F) + h * math.cos(F) - mean) / (1.0 - k * math.cos(F) - h * math.sin(F))
            F -= change
            if abs(change) < 1e-15 * (1.0 + abs(F)):
                break
        x = (1.0 - h * h * beta) * math.cos(F) + h * k * beta * math.sin(F) - k
        y = (1.0 - k * k * beta) * math.sin(F) + h * k * beta * math.cos(F) - h
        return np.asarray(self._a * (x * self._f + y * self._g))
