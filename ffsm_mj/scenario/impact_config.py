"""Impacts in a scenario: the impact law, and limits."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, PositiveInt

from ffsm_mj.config import StrictModel
from ffsm_mj.scenario.impact_law import LawName


class ImpactConfig(StrictModel):
    """Impact law, and limits of impact resolution."""

    law: LawName = "blend"
    """An installed impact law; the built-in ones differ where several contacts meet at once. No ``newton`` with mu."""
    rest_interval_s: Annotated[float, Field(ge=0.0)] | None = None
    """A contact with e < 1 becomes persistent when its next bounce would be shorter, s; default: time_step_s."""
    rest_speed_m_s: Annotated[float, Field(ge=0.0)] = 0.0
    """A pressed contact with e < 1 becomes persistent if it would separate more slowly than this, m/s."""
    max_impacts: PositiveInt = 10_000
    """The run ends after this many impacts, those at joint limits included."""
