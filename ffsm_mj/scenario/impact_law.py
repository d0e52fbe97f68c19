"""The name of an impact law in a scenario: validated against the laws that are known when the file is loaded."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from ffsm_mj.contact_models.impact.law import impact_laws, plugin_fault

UNUSABLE_LAW = "impact_law"
"""Type of the pydantic error of a name that no usable law has."""


class _Known:
    """Asks for the laws at every validation and every JSON schema: one may be registered after this module is imported."""

    @classmethod
    def __get_pydantic_core_schema__(cls, _: Any, __: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(_known_law)

    @classmethod
    def __get_pydantic_json_schema__(cls, _: CoreSchema, __: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"enum": list(impact_laws()), "type": "string"}


LawName = Annotated[str, _Known]


def _known_law(name: Any) -> str:
    laws = impact_laws()
    if isinstance(name, str) and name in laws:
        return name
    if isinstance(name, str) and (fault := plugin_fault(name)):
        raise PydanticCustomError(UNUSABLE_LAW, "{fault}", {"fault": fault})
    *first, last = map(repr, laws)
    raise PydanticCustomError(UNUSABLE_LAW, "Input should be {allowed}", {"allowed": f"{', '.join(first)} or {last}"})
