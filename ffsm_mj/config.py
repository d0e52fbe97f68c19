"""Base of every configuration model: typed, frozen, no unknown keys, no silent conversions, no NaN."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Annotated, Any, Union

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    TypeAdapter,
    ValidationError,
    model_validator,
)
from pydantic_core import CoreSchema, core_schema

from ffsm_mj.errors import one_line

Name = Annotated[str, Field(min_length=1)]
"""A name that is not empty."""
PartName = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$")]
"""Name of a part of a phase; columns and reports of its control law begin with it."""


class RecordedInput:
    """Marks a key of a control law that names a file with recorded numbers."""


FileName = Annotated[str, Field(min_length=1), RecordedInput()]
"""A file with recorded numbers, relative to the scenario file that names it; the run keeps a copy. A control law has its
table as ``context.recorded[KEY]``."""


def _no_integer(value: Any) -> Any:
    if isinstance(value, int):
        raise ValueError("an integer of more than 64 bits")
    return value


Integer = Annotated[int, Field(gt=-(2**63), lt=2**63)]
"""An integer of SQLite and Arrow."""
Cell = bool | Integer | Annotated[float, BeforeValidator(_no_integer)] | str
"""A value in a table that another process has written."""


class StrictModel(BaseModel):
    """Immutable configuration. Sequences are tuples; YAML's and Python's lists are accepted for them."""

    # A validator is built at its first use: those of all control laws and contact models took a tenth of the imports.
    model_config = ConfigDict(strict=True, frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Schema with the docstrings of attributes as descriptions.

        Pydantic's own ``use_attribute_docstrings`` reads the sources at import: an eighth of the start of every command.
        """
        from ffsm_mj.attribute_docstrings import attribute_docstrings  # which parses sources; only schemas need it

        described = handler(schema)
        keys = handler.resolve_ref_schema(described).get("properties", {})
        for name, text in attribute_docstrings(cls).items():
            key = cls.model_fields[name].alias or name if name in cls.model_fields else name
            if key in keys:
                keys[key].setdefault("description", text)
        return described

    @model_validator(mode="before")
    @classmethod
    def _tuples_for_lists(cls, data: Any) -> Any:
        """Turn lists into tuples at every level, because strict tuple fields take nothing else."""
        return _tuples(data)


def chosen_by_kind(models: Mapping[str, type[StrictModel]]) -> Any:
    """Type of a section whose model is that of its ``kind``, as in a union of the models with the discriminator ``kind``.

    A model is looked up when a section of its kind is validated: most are of control laws that a run does not import.
    """

    def validated(kind: str, value: Any) -> StrictModel:
        return models[kind].model_validate(value)

    class ChosenByKind:
        of_kind = models

        @classmethod
        def __get_pydantic_core_schema__(cls, *_: Any) -> CoreSchema:
            choices: dict[Any, Any] = {
                kind: core_schema.no_info_plain_validator_function(partial(validated, kind)) for kind in models
            }
            return core_schema.tagged_union_schema(choices, discriminator="kind")

        @classmethod
        def __get_pydantic_json_schema__(cls, _: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
            union: Any = Annotated[Union[tuple(models[kind] for kind in models)], Field(discriminator="kind")]  # noqa: UP007
            return handler(TypeAdapter(union).core_schema)

    return ChosenByKind


class _Converted(dict[Any, Any]):
    """A mapping without lists at any level: models inside of a model need not convert it again."""


def _tuples(value: Any) -> Any:
    if isinstance(value, list | tuple):
        return tuple([_tuples(item) for item in value])
    if isinstance(value, dict) and not isinstance(value, _Converted):
        return _Converted({key: _tuples(item) for key, item in value.items()})
    return value


def first_fault(error: ValidationError) -> str:
    """Place and message of the first fault of values that no person has written."""
    first = error.errors(include_url=False, include_input=False)[0]
    return ": ".join([*([".".join(map(str, first["loc"]))] if first["loc"] else []), one_line(first["msg"])])
