"""Orbit of the origin of a scene, its axes, and the fields that bodies meet on it; method in ``docs/orbit.md``.

The world axes do not rotate, and their origin is in free fall on the reference orbit: only a tide and a torque of every body
are left of gravitation, so momenta and contacts stay those of an inertial observer. LVLH axes are those of CCSDS 500.0-G-4:
x along the V-bar, y along the -H-bar, z along the R-bar, to the central body.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache

import mujoco
import numpy as np

from ffsm_mj._core.magnetic import Dipole, MagneticField, UniformMagneticField
from ffsm_mj._core.orbit import KeplerOrbit, OrbitalField, PiecewiseOrbit, Reference, lvlh_axes
from ffsm_mj.arrays import FloatArray
from ffsm_mj.fields.config import DipoleConfig, MagneticConfig, OrbitConfig, size_of

_LVLH = np.array(((0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (0.0, -1.0, 0.0)))
"""LVLH axes in Hill's axes, as columns."""
_PIECES = 64
"""Pieces of a perturbed orbit per period."""
_DEGREE = 12
"""Degree of the polynomials of a piece: 0.1 rad of the orbit, so that the next term is below rounding."""
_SOLVED = 1e-13
"""Relative tolerance of the integration of a piece."""
_J2000, _DAY_S = datetime(2000, 1, 1, 12, tzinfo=UTC), 86400.0
"""Epoch from which days of the rotation of the Earth are counted."""


class PerturbedOrbit(PiecewiseOrbit):
    """An orbit under J2, integrated piece by piece as it is asked for.

    Each piece starts at the end of the one before, so its numbers do not depend on what was asked for.
    """

    def __init__(self, mu: float, oblateness: float, pole: FloatArray, state: FloatArray) -> None:
        """Begin at a state.

        Args:
            mu: Gravitational parameter, m^3/s^2.
            oblateness: 3/2 J2 mu R_E^2, m^5/s^2.
            pole: Axis of the central body, (3,).
            state: Position and velocity at t = 0, (6,).
        """
        self._length_s = 2.0 * math.pi / KeplerOrbit(mu, state[:3], state[3:]).rate_rad_s / _PIECES
        super().__init__(self._length_s)
        self._mu, self._oblateness, self._pole, self._start = mu, oblateness, pole, state

    def acceleration(self, position: FloatArray) -> FloatArray:
        """Acceleration at a position, m/s^2, (3,)."""
        square, z = float(position @ position), float(position @ self._pole)
        oblate = (1.0 - 5.0 * z * z / square) * position + 2.0 * z * self._pole
        return np.asarray(-self._mu / square**1.5 * position - self._oblateness / square**2.5 * oblate)

    def next_piece(self) -> FloatArray:
        """Integrate the next piece, and fit polynomials to it."""
        from scipy.integrate import solve_ivp

        nodes = np.polynomial.chebyshev.chebpts1(_DEGREE + 1)
        start, end_s = self._start, self._length_s
        # The interpolant of a step has order 7, its ends order 8: short steps make it as good.
        solution = solve_ivp(
            lambda _, y: np.concatenate((y[3:], self.acceleration(y[:3]))),
            (0.0, end_s),
            start,
            method="DOP853",
            rtol=_SOLVED,
            atol=_SOLVED * np.repeat((np.linalg.norm(start[:3]), np.linalg.norm(start[3:])), 3),
            max_step=end_s / 4.0,
            dense_output=True,
        )
        self._start = solution.y[:, -1]
        return np.asarray(np.polynomial.chebyshev.chebfit(nodes, solution.sol(0.5 * end_s * (nodes + 1.0)).T, _DEGREE))


@dataclass(frozen=True)
class Orbit:
    """The orbit of the origin of a scene, in its world axes.

    Attributes:
        reference: Position and velocity of the origin from the central body at any time.
        mu: Gravitational parameter, m^3/s^2.
        oblateness: 3/2 J2 mu R_E^2, m^5/s^2; 0 without J2.
        pole: Axis of the central body, world axes, (3,).
        rate_rad_s: Mean motion at t = 0.
        is_circular: Whether the distance is constant.
        kind: World axes: ``hill``, ``lvlh`` or ``eci``.
        axes: World axes as columns in the inertial axes of the central body, (3, 3).
    """

    reference: Reference
    mu: float
    oblateness: float
    pole: FloatArray
    rate_rad_s: float
    is_circular: bool
    kind: str
    axes: FloatArray

    @classmethod
    @lru_cache(maxsize=8)  # an integrated orbit serves the parts of a run, and the next runs
    def of(cls, config: OrbitConfig, world_axes: str) -> Orbit:
        """The orbit of a scenario, of whose numbers nothing is wrong."""
        body = config.central_body
        position, velocity = start_of(config)
        lvlh = lvlh_axes(position[None], velocity[None], 0.0, (0.0, 0.0, 1.0))[0][0]
        world = {"hill": lvlh @ _LVLH.T, "lvlh": lvlh, "eci": np.eye(3)}[world_axes]
        position, velocity = world.T @ position, world.T @ velocity
        mu = 1e9 * body.mu_km3_s2
        oblateness = 1.5 * (body.j2 or 0.0) * mu * (1e3 * body.radius_km) ** 2 if config.j2 else 0.0
        kepler = KeplerOrbit(mu, position, velocity)
        reference: Reference = kepler
        if oblateness:
            reference = PerturbedOrbit(mu, oblateness, world[2], np.concatenate((position, velocity)))
        round_and_free = config.kind == "circular" and not oblateness
        return cls(reference, mu, oblateness, world[2], kepler.rate_rad_s, round_and_free, world_axes, world)

    @property
    def spin(self) -> FloatArray:
        """Angular velocity of LVLH axes at t = 0, world axes, rad/s, (3,)."""
        R, V = self.states(np.zeros(1))
        return np.asarray(self.lvlh(R, V)[1][0])

    def field(self) -> OrbitalField:
        """The field on the bodies of the scene."""
        return OrbitalField(self.reference, self.mu, self.oblateness, self.pole)

    def states(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions in m and velocities in m/s of the origin from the central body, world axes, (n, 3) each."""
        return self.reference.states(times_s)

    def lvlh(self, position: FloatArray, velocity: FloatArray) -> tuple[FloatArray, FloatArray]:
        """LVLH axes as columns in world axes, (..., 3, 3), and their angular velocity in world axes, rad/s, (..., 3).

        Args:
            position: Of the origin from the central body, m, (..., 3).
            velocity: Its velocity, m/s, (..., 3).
        """
        axes, spin = lvlh_axes(position.reshape(-1, 3), velocity.reshape(-1, 3), self.oblateness, self.pole)
        return axes.reshape(*position.shape, 3), spin.reshape(position.shape)


class LvlhAxes:
    """LVLH axes at the time of the last update: what is stated in them, in world axes.

    Attributes:
        axes: The axes as columns in world axes, (3, 3).
        spin: Their angular velocity in world axes, rad/s, (3,).
        spin_rate: Its rate of change, without that of J2 on the orbital plane, rad/s^2, (3,).
    """

    def __init__(self, orbit: Orbit) -> None:
        """Begin at t = 0."""
        self._orbit = orbit
        self.update(0.0)

    def update(self, time_s: float) -> None:
        """Move on to a time."""
        R, V = self._orbit.reference.state(time_s)
        self.axes, self.spin = self._orbit.lvlh(R, V)
        # The angular momentum h = R^2 spin of an orbit is constant.
        self.spin_rate = -2.0 * float(R @ V) / float(R @ R) * self.spin

    def attitude(self, quaternion: FloatArray) -> FloatArray:
        """Quaternion to world axes of one to LVLH axes, (4,)."""
        turned = np.empty(4)
        mujoco.mju_mulQuat(turned, self._quaternion(), quaternion)
        return turned

    def relative(
        self, position: FloatArray, velocity: FloatArray, quaternion: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position, velocity and attitude relative to LVLH axes for those in world axes, (3,), (3,), (4,)."""
        inverse, turned = np.empty(4), np.empty(4)
        mujoco.mju_negQuat(inverse, self._quaternion())
        mujoco.mju_mulQuat(turned, inverse, quaternion)
        return position @ self.axes, (velocity - np.cross(self.spin, position)) @ self.axes, turned

    def _quaternion(self) -> FloatArray:
        """That of the axes."""
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, self.axes.ravel())
        return quaternion


def magnetic_field_of(config: MagneticConfig, orbit: Orbit | None, epoch: str | None) -> MagneticField:
    """The magnetic field of a scenario, of whose keys nothing is wrong."""
    if not isinstance(config, DipoleConfig):
        return UniformMagneticField(config.field_T)
    assert orbit is not None
    assert epoch is not None
    g10, g11, h11 = (1e-9 * value for value in config.coefficients_nT)
    days = (datetime.fromisoformat(epoch) - _J2000).total_seconds() / _DAY_S
    return Dipole(orbit.reference, orbit.axes, (g11, h11, g10), days)


def start_of(config: OrbitConfig) -> tuple[FloatArray, FloatArray]:
    """Position in m and velocity in m/s at t = 0 in the inertial axes of the central body, (3,) each."""
    if config.position_km is not None and config.velocity_km_s is not None:
        return 1e3 * np.array(config.position_km), 1e3 * np.array(config.velocity_km_s)
    a, e = size_of(config)
    parameter, mu = 1e3 * a * (1.0 - e * e), 1e9 * config.central_body.mu_km3_s2
    anomaly = math.radians(config.true_anomaly_deg or 0.0)
    perigee = math.radians((config.argument_of_latitude_deg or 0.0) + (config.argument_of_perigee_deg or 0.0))
    node, tilt = math.radians(config.raan_deg or 0.0), math.radians(config.inclination_deg or 0.0)
    along = _turn(2, node) @ _turn(0, tilt) @ _turn(2, perigee)
    cosine, sine = math.cos(anomaly), math.sin(anomaly)
    position = parameter / (1.0 + e * cosine) * np.array((cosine, sine, 0.0))
    velocity = math.sqrt(mu / parameter) * np.array((-sine, e + cosine, 0.0))
    return along @ position, along @ velocity


def _turn(axis: int, angle: float) -> FloatArray:
    """Rotation matrix about a coordinate axis."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turned = np.eye(3)
    turned[i, i] = turned[j, j] = math.cos(angle)
    turned[j, i], turned[i, j] = math.sin(angle), -math.sin(angle)
    return turned
