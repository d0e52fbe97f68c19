"""Joint limits in a scenario: their coefficients of restitution."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from ffsm_mj.config import StrictModel


class JointLimitConfig(StrictModel):
    """Limits of one joint; their values are those of the model."""

    restitution: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    """Coefficient of restitution e at both ends of the range: 0 the joint stays at the limit while pressed, 1 elastic."""
