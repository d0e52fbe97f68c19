"""Data model of an orbit in a scenario, and what is wrong with its numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Literal, NamedTuple

from pydantic import Field, NonNegativeFloat, PositiveFloat

from ffsm_mj.config import StrictModel

_LARGEST_KM = 1e6
"""Largest length that is no mistake of the unit: the Moon is at 4e5 km."""
Vector = tuple[float, float, float]


class CentralBodyConfig(StrictModel):
    """A central body by its numbers."""

    mu_km3_s2: PositiveFloat
    """Gravitational parameter, km^3/s^2."""
    radius_km: PositiveFloat
    """Equatorial radius, km."""
    j2: NonNegativeFloat | None = None
    """Second zonal harmonic; left out: ``orbit.j2: true`` is refused."""


CENTRAL_BODIES = {
    "earth": CentralBodyConfig(mu_km3_s2=398600.4418, radius_km=6378.137, j2=1.08262668e-3),
    "moon": CentralBodyConfig(mu_km3_s2=4902.800118, radius_km=1738.0, j2=2.0323e-4),
    "mars": CentralBodyConfig(mu_km3_s2=42828.37362, radius_km=3396.0, j2=1.9566e-3),
}
"""WGS 84 and EGM96; DE440 and LP165P; DE440 and GMM-3."""


class OrbitConfig(StrictModel):
    """Orbit of the origin of the scene about a central body: circular, elliptic, or by a state."""

    body: Literal["earth", "moon", "mars"] | CentralBodyConfig = "earth"
    """Central body: ``earth``, ``moon``, ``mars``, or its numbers."""
    kind: Literal["circular", "elliptic", "state"] = "circular"
    """How the orbit is stated, and with ``circular`` that it is one."""
    altitude_km: float | None = None
    """Circular: altitude above the equatorial radius, km; or ``radius_km``, or ``period_min``."""
    radius_km: PositiveFloat | None = None
    """Circular: distance from the centre of the body, km."""
    period_min: PositiveFloat | None = None
    """Circular: period, min."""
    perigee_altitude_km: float | None = None
    """Elliptic: least altitude, km, with ``apogee_altitude_km``; or ``semi_major_axis_km`` and ``eccentricity``."""
    apogee_altitude_km: float | None = None
    """Elliptic: greatest altitude, km."""
    semi_major_axis_km: PositiveFloat | None = None
    """Elliptic: semi-major axis, km."""
    eccentricity: float | None = None
    """Elliptic: eccentricity, at least 0 and less than 1."""
    true_anomaly_deg: float | None = None
    """Elliptic: true anomaly at t = 0, deg; default 0, the perigee."""
    argument_of_perigee_deg: float | None = None
    """Elliptic: argument of perigee, deg; default 0."""
    argument_of_latitude_deg: float | None = None
    """Circular: angle from the ascending node at t = 0, deg; default 0."""
    inclination_deg: Annotated[float, Field(ge=0.0, le=180.0)] | None = None
    """Inclination to the equator, deg; default 0."""
    raan_deg: float | None = None
    """Right ascension of the ascending node, deg; default 0."""
    position_km: Vector | None = None
    """State: position at t = 0 in the inertial axes of the body (ECI of the Earth), km."""
    velocity_km_s: Vector | None = None
    """State: velocity at t = 0 in these axes, km/s."""
    j2: bool = False
    """Include the oblateness of the body: the reference orbit then moves under it too."""

    @property
    def central_body(self) -> CentralBodyConfig:
        """Numbers of the central body."""
        return self.body if isinstance(self.body, CentralBodyConfig) else CENTRAL_BODIES[self.body]


_SIZES: dict[str, tuple[tuple[str, ...], ...]] = {
    "circular": (("altitude_km",), ("radius_km",), ("period_min",)),
    "elliptic": (("perigee_altitude_km", "apogee_altitude_km"), ("semi_major_axis_km", "eccentricity")),
    "state": (("position_km", "velocity_km_s"),),
}
_ANGLES = {
    "circular": ("argument_of_latitude_deg", "inclination_deg", "raan_deg"),
    "elliptic": ("true_anomaly_deg", "argument_of_perigee_deg", "inclination_deg", "raan_deg"),
    "state": (),
}


IGRF_DIPOLE_NT = (-29350.0, -1410.3, 4545.5)
"""g10, g11 and h11 of IGRF-14 at 2025.0 (IAGA Division V-MOD, https://doi.org/10.5281/zenodo.14012302), nT."""


class DipoleConfig(StrictModel):
    """Magnetic field of the Earth: its tilted dipole, which turns with it."""

    kind: Literal["dipole"]
    coefficients_nT: Vector = IGRF_DIPOLE_NT
    """g10, g11 and h11, nT, at the radius of 6371.2 km; default: IGRF-14 at 2025.0."""


class UniformMagneticConfig(StrictModel):
    """The same magnetic field everywhere, constant in world axes."""

    kind: Literal["uniform"]
    field_T: Vector
    """Flux density in world axes, T."""


MAGNETIC_KINDS = ("dipole", "uniform")
MagneticConfig = Annotated[DipoleConfig | UniformMagneticConfig, Field(discriminator="kind")]


class OrbitFault(NamedTuple):
    """What is wrong, and with which key."""

    key: str
    message: str


def orbit_faults(orbit: OrbitConfig, inertial: str = "") -> list[OrbitFault]:
    """What is wrong with an orbit.

    Args:
        orbit: The orbit.
        inertial: What needs its place in the inertial axes of the body, as text; empty: nothing.
    """
    faults = [*_faults_of_keys(orbit, inertial)]
    return faults or [*_faults_of_size(orbit)]


def _faults_of_keys(orbit: OrbitConfig, inertial: str) -> Iterator[OrbitFault]:
    """Keys that are missing, too many, or of another kind."""
    sizes, stated = _SIZES[orbit.kind], {name for name in type(orbit).model_fields if getattr(orbit, name) is not None}
    ways = " or ".join(" and ".join(keys) for keys in sizes)
    known = {*(key for keys in sizes for key in keys), *_ANGLES[orbit.kind], "body", "kind", "j2"}
    for key in [name for name in type(orbit).model_fields if name in stated and name not in known]:
        other = "; use argument_of_latitude_deg" if key in ("true_anomaly_deg", "argument_of_perigee_deg") else ""
        yield OrbitFault(key, f"is no key of 'kind: {orbit.kind}', whose size is {ways}{other}")
    begun = [keys for keys in sizes if stated.intersection(keys)]
    if len(begun) != 1:
        yield OrbitFault("", f"'kind: {orbit.kind}' takes {ways}, one way and no more")
    elif missing := [key for key in begun[0] if key not in stated]:
        yield OrbitFault("", f"{' and '.join(begun[0])} belong together; {missing[0]} is missing")
    needed = ["inclination_deg", _ANGLES[orbit.kind][0] if orbit.kind == "circular" else "argument_of_perigee_deg"]
    needed = [*(needed if orbit.j2 or inertial else ()), *(["raan_deg"] if inertial else ())]
    for key in needed if orbit.kind != "state" else ():
        if key not in stated:
            yield OrbitFault(key, f"is needed with {inertial or 'j2: true'}")
    if orbit.j2 and orbit.central_body.j2 is None:
        yield OrbitFault("j2", "the central body has no j2; give body.j2")


def _faults_of_size(orbit: OrbitConfig) -> Iterator[OrbitFault]:
    """Numbers of which there is no closed orbit above the surface."""
    for key in type(orbit).model_fields:
        value = getattr(orbit, key)
        if key.endswith("_km") and isinstance(value, float) and value > _LARGEST_KM:
            yield OrbitFault(key, f"is {value:.4g} km, farther than the Moon; it is in km, not in m")
            return
    body, key = orbit.central_body, _SIZES[orbit.kind][0][0]
    if orbit.kind == "circular":
        key = next(name for (name,) in _SIZES["circular"] if getattr(orbit, name) is not None)
    elif orbit.eccentricity is not None:
        key = "semi_major_axis_km"
        if not 0.0 <= orbit.eccentricity < 1.0:
            yield OrbitFault("eccentricity", f"is {orbit.eccentricity:g}; a closed orbit has at least 0 and less than 1")
            return
    elif (orbit.apogee_altitude_km or 0.0) < (orbit.perigee_altitude_km or 0.0):
        yield OrbitFault("apogee_altitude_km", "is below the perigee")
        return
    a, e = size_of(orbit)
    if not a > 0.0 or not e < 1.0:
        yield OrbitFault("velocity_km_s", "is at least the escape velocity, or the orbit is a line: it is not closed")
    elif (perigee := a * (1.0 - e) - body.radius_km) < 0.0:
        yield OrbitFault(key, f"perigee {-perigee:.4g} km below the surface")


def size_of(orbit: OrbitConfig) -> tuple[float, float]:
    """Semi-major axis in km, and eccentricity; of an open orbit a negative axis or an eccentricity of 1 and more."""
    body = orbit.central_body
    if orbit.kind == "circular":
        if orbit.period_min is not None:
            return (body.mu_km3_s2 * (60.0 * orbit.period_min / (2.0 * math.pi)) ** 2) ** (1.0 / 3.0), 0.0
        return (orbit.radius_km if orbit.radius_km is not None else body.radius_km + (orbit.altitude_km or 0.0)), 0.0
    if orbit.kind == "elliptic":
        if orbit.semi_major_axis_km is not None and orbit.eccentricity is not None:
            return orbit.semi_major_axis_km, orbit.eccentricity
        low, high = (
            body.radius_km + (altitude_km or 0.0) for altitude_km in (orbit.perigee_altitude_km, orbit.apogee_altitude_km)
        )
        return 0.5 * (low + high), (high - low) / (high + low)
    assert orbit.position_km is not None
    assert orbit.velocity_km_s is not None
    r, v = math.hypot(*orbit.position_km), math.hypot(*orbit.velocity_km_s)
    along = sum(x * u for x, u in zip(orbit.position_km, orbit.velocity_km_s, strict=True))
    if not r > 0.0:
        return -1.0, 1.0
    inverse = 2.0 / r - v * v / body.mu_km3_s2
    moment = r * r * v * v - along * along
    e = math.sqrt(max(0.0, 1.0 - inverse * moment / body.mu_km3_s2))
    return (1.0 / inverse if inverse > 0.0 else -1.0), (e if moment > 0.0 else 1.0)
