"""What editors do with the schema of scenario files."""

from __future__ import annotations

from functools import cache
from typing import Any

from jsonschema import Draft202012Validator, ValidationError

from ffsm_mj.scenario.schema import scenario_schema

__all__ = ["ValidationError", "check"]


def check(data: Any) -> None:
    """Raise :class:`ValidationError` if the data of a file does not match the schema."""
    _validator().validate(data)


@cache
def _validator() -> Draft202012Validator:
    """Made once per process: the schema itself is checked, which takes longer than any file."""
    schema = scenario_schema()
    Draft202012Validator.check_schema(schema)
    return Draft202012Validator(schema)
