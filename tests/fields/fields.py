"""External fields of tests, which need no package."""

from __future__ import annotations

from typing import Literal

import numpy as np

from ffsm_mj.fields.interface import Bodies, Field, StrictModel


class DragConstant(Field):
    """The example of docs/fields.md."""

    kind = "drag_constant"

    class Config(StrictModel):
        """Keys of the field."""

        kind: Literal["drag_constant"]
        coefficient_kg_s: float
        wind_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __init__(self, config: Config, bodies: Bodies) -> None:
        self._coefficient, self._wind = config.coefficient_kg_s, np.array(config.wind_m_s)

    def add_wrenches(self, time_s: float, bodies: Bodies) -> None:
        bodies.force_N += self._coefficient * (self._wind - bodies.velocity_m_s)


class Stirring(Field):
    """A force and a torque that depend on time, position and angular velocity."""

    kind = "stirring"

    class Config(StrictModel):
        """Keys of the field."""

        kind: Literal["stirring"]

    def __init__(self, config: Config, bodies: Bodies) -> None:
        self._mass = bodies.mass_kg[:, None]

    def add_wrenches(self, time_s: float, bodies: Bodies) -> None:
        bodies.force_N += self._mass * np.array((np.sin(3.0 * time_s), np.cos(2.0 * time_s), 0.4))
        bodies.force_N -= 0.3 * self._mass * bodies.position_m
        bodies.torque_N_m += 0.02 * np.cross((0.3, -0.2, np.cos(time_s)), bodies.angular_velocity_rad_s) + (0.0, 0.01, 0.0)


class Pulse(Field):
    """A force on every body that is a function of time alone."""

    kind = "pulse"

    class Config(StrictModel):
        """Keys of the field."""

        kind: Literal["pulse"]
        rate_rad_s: float

    def __init__(self, config: Config, bodies: Bodies) -> None:
        self._rate = config.rate_rad_s

    def add_wrenches(self, time_s: float, bodies: Bodies) -> None:
        bodies.force_N[:, 0] += np.cos(self._rate * time_s)


class FrozenPulse(Pulse):
    """The same with a mistake: the time is that of the start of a step of 0.1 s."""

    kind = "frozen_pulse"

    class Config(Pulse.Config):
        """Keys of the field."""

        kind: Literal["frozen_pulse"]
        step_s: float

    def __init__(self, config: Config, bodies: Bodies) -> None:
        super().__init__(config, bodies)
        self._step_s = config.step_s

    def add_wrenches(self, time_s: float, bodies: Bodies) -> None:
        # The last stage has the time of the next step's start, whose first stage has the same.
        super().add_wrenches(np.floor(time_s / self._step_s + 1e-9) * self._step_s, bodies)


FIELDS_OF_TESTS = (DragConstant, Stirring, Pulse, FrozenPulse)
