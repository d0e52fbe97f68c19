"""Declaration of a record: a frozen dataclass whose fields say once what they mean, and how logs and tables show them.

Fields are logged in the order of declaration (protobuf numbers), so new ones go last; ``column_after`` gives a field another
place in tables. A name ends in its unit. Fields with one value, texts, and values that have a letter each are columns of the
table of the record, unless ``column=False``::

    @record
    class Grip:
        point_m: Values = declared("Where they touch, in world axes.", components="xyz")  # point_x_m, point_y_m, point_z_m
        time_s: float = declared("Time of the grip.")
        wrench: ByName = declared("Force and moment about the point, by body, N and N m.", entries={"gripper": 6})
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields, replace
from functools import cache
from types import MappingProxyType
from typing import Any, TypeVar, dataclass_transform, get_type_hints

from ffsm_mj.records.signals import unit_of

Values = tuple[float, ...]
ByName = Mapping[str, Values]
"""Numbers by the name of the joint, actuator or subsystem that has them."""
ControllerReport = Mapping[str, float | int | str]
"""Report of a control law on a phase: finite numbers and texts by name."""
ONE_VALUE = (float, int, str)
"""Types of a field with one value."""
_IN_ONE_COLUMN = (*ONE_VALUE, float | None, tuple[str, ...])

_MEANING = "meaning"
_Record = TypeVar("_Record")


@dataclass(frozen=True)
class Meaning:
    """What a field means; several records may share it.

    Attributes:
        text: A sentence or phrase, with the frame of a vector and a unit that the name does not end in.
        column: Whether tables show the field, if they can.
        unit: Its unit, if the name does not end in it.
        components: A letter for each of its values, if their number is fixed: ``xyz``.
        entries: The numbers of values of entries of a mapping, by the name of the entry.
        column_after: The field that comes before it in tables, if that is not the one before it in the log.
    """

    text: str
    column: bool = True
    unit: str = ""
    components: str = ""
    entries: Mapping[str, int] = field(default_factory=dict)
    column_after: str = ""

    @property
    def column_text(self) -> str:
        """The text of its columns: a phrase, as those of signals."""
        return (self.text[:1].lower() + self.text[1:].rstrip(".")).replace("``", "")


_PLAIN = Meaning("")


def declared(
    meaning: str | Meaning,
    *,
    column: bool = True,
    unit: str = "",
    components: str = "",
    entries: Mapping[str, int] = MappingProxyType({}),
    column_after: str = "",
    default: Any = MISSING,
    default_factory: Any = MISSING,
) -> Any:
    """Declare a field of a record by the parts of its :class:`Meaning`, or by one that is shared and parts that differ."""
    parts = {"column": column, "unit": unit, "components": components, "entries": entries, "column_after": column_after}
    stated: dict[str, Any] = {name: part for name, part in parts.items() if part != getattr(_PLAIN, name)}
    complete = replace(Meaning(meaning) if isinstance(meaning, str) else meaning, **stated)
    return field(metadata={_MEANING: complete}, default=default, default_factory=default_factory)


@dataclass_transform(frozen_default=True, field_specifiers=(declared, field))
def record(cls: type[_Record]) -> type[_Record]:
    """Make a class a frozen dataclass; type checkers know :func:`declared` in it."""
    return dataclass(frozen=True)(cls)


hints_of = cache(get_type_hints)
"""Types of the fields of a record by name; to evaluate its annotations takes most of a millisecond."""


@cache
def meanings(of: type) -> dict[str, Meaning]:
    """Meaning of each :func:`declared` field of a record, in their order."""
    return {field.name: field.metadata[_MEANING] for field in fields(of) if _MEANING in field.metadata}


@cache
def lengths_of(of: type) -> dict[str, int]:
    """How many values a field holds, ``point_m``, or the entry of a mapping, ``energy_before_J.total``."""
    items = meanings(of).items()
    numbers = {f"{name}.{entry}": number for name, meaning in items for entry, number in meaning.entries.items()}
    return {name: len(meaning.components) for name, meaning in items if meaning.components} | numbers


@cache
def in_table_order(of: type) -> tuple[str, ...]:
    """Its fields in the order of tables."""
    meaning_of = meanings(of)
    names = list(meaning_of)
    for name in [name for name in meaning_of if meaning_of[name].column_after]:
        names.remove(name)
        names.insert(names.index(meaning_of[name].column_after) + 1, name)
    return tuple(names)


@cache
def columns_of(of: type) -> dict[str, tuple[str, str]]:
    """Unit and text of the columns of its table, in their order; ``point_{xyz}_m`` is one for each value of ``point_m``."""
    hints, ordered = hints_of(of), {name: meanings(of)[name] for name in in_table_order(of)}
    return {
        _column(name, meaning.components): (meaning.unit or unit_of(name), meaning.column_text)
        for name, meaning in ordered.items()
        if meaning.column and (meaning.components or hints[name] in _IN_ONE_COLUMN)
    }


def _column(name: str, components: str) -> str:
    """Name of a column: the letters of the components stand before the unit."""
    end = "".join(f"_{part}" for part in unit_of(name).replace("/", " ").split())
    return f"{name.removesuffix(end)}_{{{components}}}{end}" if components else name
