"""Configuration of what control laws see and are told."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias, Union

from pydantic import (
    Field,
)

from ffsm_controllers.estimators import estimators
from ffsm_mj.config import StrictModel


class TruthConfig(StrictModel):
    """Control laws see the true state."""

    kind: Literal["truth"]


class ToldAboveConfig(StrictModel):
    """Impacts of which control laws are told."""

    above_N_s: Annotated[float, Field(ge=0.0)]
    """Least impulse, N s; of contacts that begin or end, stick or slip, nothing is told."""


if TYPE_CHECKING:
    EstimatorConfig: TypeAlias = Any
else:
    EstimatorConfig = Annotated[
        Union[TruthConfig, *estimators().configs.values()],
        Field(discriminator="kind"),
    ]
