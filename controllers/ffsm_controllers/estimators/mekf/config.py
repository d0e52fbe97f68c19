"""Configuration of the filter."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat

from ffsm_mj.controller_protocol import StrictModel

SensorName = Annotated[str, Field(min_length=1)]
BodyName = Annotated[str, Field(min_length=1)]


class InitialConfig(StrictModel):
    """Standard deviations of the initial estimate of a body, of each component."""

    position_m: NonNegativeFloat = 0.05
    """Of its position, m."""
    attitude_rad: NonNegativeFloat = 0.05
    """Of its attitude, rad."""
    velocity_m_s: NonNegativeFloat = 0.02
    """Of its velocity, m/s."""
    rate_rad_s: NonNegativeFloat = 0.02
    """Of its angular velocity, rad/s."""


class ProcessConfig(StrictModel):
    """Densities of the white noise that accelerates a body, of each component."""

    acceleration_density: NonNegativeFloat = 1e-4
    """Of the acceleration, m/s^2/sqrt(Hz): after one second the velocity has this standard deviation in m/s."""
    angular_acceleration_density: NonNegativeFloat = 1e-4
    """Of the angular acceleration, rad/s^2/sqrt(Hz)."""


class FloorConfig(StrictModel):
    """Least standard deviations that the filter believes of a component of a measurement."""

    position_m: PositiveFloat = 1e-6
    """Of ``framepos``, m."""
    attitude_rad: PositiveFloat = 1e-6
    """Of ``framequat``, rad."""
    velocity_m_s: PositiveFloat = 1e-6
    """Of ``framelinvel`` and ``velocimeter``, m/s."""
    rate_rad_s: PositiveFloat = 1e-6
    """Of ``frameangvel`` and ``gyro``, rad/s."""


class BodyConfig(StrictModel):
    """What is special of one body."""

    initial: InitialConfig | None = None
    """In place of the filter's ``initial``."""
    process: ProcessConfig | None = None
    """In place of the filter's ``process``."""


class MekfConfig(StrictModel):
    """Multiplicative error-state Kalman filter of the pose and twist of every floating body."""

    kind: Literal["mekf"]
    initial: InitialConfig = InitialConfig()
    """Standard deviations of the initial estimate."""
    process: ProcessConfig = ProcessConfig()
    """Process noise."""
    bodies: dict[BodyName, BodyConfig] = {}
    """What is special of single bodies: ``robot``, or the name of an object."""
    gyro_bias_rad_s: PositiveFloat | None = None
    """Standard deviation of the initial bias of a gyro, rad/s: the biases of all gyros are then estimated, with their own
    ``bias_walk``; default: gyros are taken to have none."""
    noise: dict[SensorName, NonNegativeFloat] = {}
    """Standard deviation of a sample that the filter believes of a sensor; default: that of the sensor itself."""
    floor: FloorConfig = FloorConfig()
    """Least standard deviations of measurements, for sensors without noise."""
    gate: Annotated[float, Field(gt=0.0, lt=1.0)] | None = None
    """Probability of the chi-square gate: samples less probable than 1 - ``gate`` are left out; default: none are."""
    impact_velocity_m_s: NonNegativeFloat = 0.5
    """Standard deviation of the jump of a body's velocity in an impact that is reported to it, of each component, m/s."""
    impact_rate_rad_s: NonNegativeFloat = 0.5
    """Likewise of its angular velocity, rad/s."""
    rate_filter_s: NonNegativeFloat = 0.02
    """Time constant of the first-order filter on rates of joints from differences of samples, s; 0: none."""
