"""External fields that a scenario may declare: their protocol, and the kinds; see ``docs/fields.md``.

A field acts on every moving body of the scene from outside, in each stage of a step at the stage's own time. The balance
enters its work and impulses by subsystem. It has no memory: its forces follow from time, poses and twists. A field of a
package is found through the entry-point group ``ffsm_mj.fields``; a script registers its class, or passes it to a run.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, ClassVar, Literal

import numpy as np

from ffsm_mj._core.fields import Bodies, UniformField
from ffsm_mj.arrays import FloatArray
from ffsm_mj.config import StrictModel
from ffsm_mj.errors import InputError
from ffsm_mj.plugins import Plugins

GROUP = "ffsm_mj.fields"

__all__ = ["Bodies", "Field", "StrictModel", "Uniform", "field_of", "register", "register_all"]


class Field:
    """Base class of external fields. One instance may serve several motions of a run, so it keeps nothing of the last call.

    Attributes:
        kind: Name by which a scenario declares it.
        Config: Configuration model, with a field ``kind``.
    """

    kind: ClassVar[str]
    Config: ClassVar[type[StrictModel]]

    def __init__(self, config: Any, bodies: Bodies) -> None:
        """Create the field of a scenario.

        Args:
            config: Its configuration.
            bodies: The moving bodies: names, masses and inertias; their states are not known yet.

        Raises:
            LookupError: The scene lacks a body that the configuration names.
        """

    def add_wrenches(self, time_s: float, bodies: Bodies) -> None:
        """Add its forces to ``bodies.force_N`` and its torques about the mass centres to ``bodies.torque_N_m``.

        Args:
            time_s: Time of the stage.
            bodies: The moving bodies with their poses and twists at that time, world axes.
        """
        raise NotImplementedError

    def free_fall(self, time_s: float, position_m: FloatArray) -> FloatArray:  # noqa: ARG002
        """Acceleration that it gives any mass at a position, which accelerometers there do not feel, m/s^2, (3,).

        Zero, the default, for forces that are no gravitation, such as drag: accelerometers feel them.

        Args:
            time_s: Time.
            position_m: Position in world axes, (3,).
        """
        return np.zeros(3)


def _check(field: type[Field]) -> None:
    if not (isinstance(field, type) and issubclass(field, Field)):
        raise ValueError(f"{field!r} is no ffsm_mj.fields.interface.Field")
    config = getattr(field, "Config", None)
    if not (isinstance(config, type) and issubclass(config, StrictModel) and "kind" in config.model_fields):
        raise ValueError(f"the external field {field.kind!r} needs a Config: a StrictModel with the field kind")


PLUGINS = Plugins[type[Field]](GROUP, "external field", _check)
register, field_of = PLUGINS.register, PLUGINS.named
"""Registers an external field; looks one up by kind."""


def register_all(fields: Iterable[type[Field]]) -> None:
    """Register the fields of a script.

    Raises:
        InputError: One is unfit, or another one has its kind.
    """
    for field in fields:
        try:
            register(field)
        except ValueError as error:
            raise InputError(f"fields: {error}") from None


@register
class Uniform(UniformField, Field):
    """The same acceleration of every body, such as that of a thrusting or falling frame."""

    kind = "uniform"

    class Config(StrictModel):
        """Keys of the field."""

        kind: Literal["uniform"]
        acceleration_m_s2: tuple[float, float, float]
        """Acceleration in world axes, m/s^2."""

    def __init__(self, config: Config, bodies: Bodies) -> None:  # noqa: ARG002
        """Take the acceleration."""
        super().__init__(config.acceleration_m_s2)
        self._acceleration = np.array(config.acceleration_m_s2)

    def free_fall(self, time_s: float, position_m: FloatArray) -> FloatArray:  # noqa: ARG002
        """The acceleration, at any place."""
        return self._acceleration
