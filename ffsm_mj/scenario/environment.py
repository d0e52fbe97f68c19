"""Data model of the surroundings of a scenario: external fields."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import WithJsonSchema

from ffsm_mj.config import StrictModel

OF_PLUGIN = WithJsonSchema({"type": "object", "required": ["kind"], "properties": {"kind": {"type": "string"}}})
"""Schema of the configuration of a plug-in that is looked up by its kind."""


class EnvironmentConfig(StrictModel):
    """What acts on all bodies from outside, entered in the balance as external work and impulses."""

    fields: tuple[Annotated[Any, OF_PLUGIN], ...] = ()
    """External fields, each with its ``kind``: ``uniform``, or one of a package or a script; see docs/fields.md."""
