"""Kinds of event records: what logs, tables, viewers and reports need to know of each.

A registered kind appears everywhere: as a topic of the log, in ``/log``, as a list in ``summary.json`` and on a run, as a
table, in comparisons of runs, and as marks in Rerun, Foxglove, animations and figures. It also declares the arrows that
viewers draw from the columns of its contact model.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cache
from importlib import import_module
from typing import Any, get_args, get_origin, get_type_hints

from ffsm_mj.errors import unknown_name
from ffsm_mj.records.arrows import ArrowColumns
from ffsm_mj.records.events import ControllerReport
from ffsm_mj.records.signals import Layout

_TAKEN = frozenset(
    (
        *("samples", "contacts", "captures", "checks", "plumes"),  # tables and topics of every run
        *("schema_version", "scenario", "outcome", "message", "duration_s", "steps", "wall_s", "real_time_factor"),
        *("effort", "base_rotation", "angular_momentum", "sensitivity", "law_wall_s_per_tick"),
        *("sub_steps", "smallest_step_s", "conservative", "tip", "controller", "conservation"),
        *("checks", "versions"),  # keys of summary.json
    )
)
"""Plurals that have another meaning."""
_ONE = (float, int, str)
_LETTERS = re.compile(r"_\{(\w+)\}")


@dataclass(frozen=True)
class Mark:
    """A point to draw at the time of a record, with an arrow and a text, in world axes.

    Attributes:
        point_m: Position.
        direction: Unit vector of the arrow; zero for none.
        magnitude: Magnitude of the arrow in the unit of its text: 1 m per unit, within the limits of a viewer.
        text: Text beside the point.
        name: Name of the contact, for viewers that list what they draw.
    """

    point_m: tuple[float, ...]
    direction: tuple[float, ...] = (0.0, 0.0, 0.0)
    magnitude: float = 0.0
    text: str = ""
    name: str = "contact"


def _never(_: Any) -> bool:
    return False


def all_fields(record: Any) -> dict[str, Any]:
    """The fields of a record as plain data."""
    return {each.name: _plain(getattr(record, each.name)) for each in fields(record)}


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _plain(entry) for name, entry in value.items()}
    return list(value) if isinstance(value, tuple) else value


@dataclass(frozen=True, kw_only=True)
class RecordKind:
    """Description of one kind of record; all functions but ``arrows`` take a record.

    Attributes:
        record: Its class: a frozen dataclass whose fields are numbers and text, tuples of either, mappings from names to
            text or to tuples of numbers; its docstring describes each field, names end in their unit.
        name: ``impact``: its topic is ``/ffsm/impact``, its schema ``ffsm.Impact``.
        plural: ``impacts``: its list in ``summary.json`` and on a run, its table; empty if a run has only one.
        when: When a record is written, as text.
        time: Time of a record, s.
        sentence: One line that describes the event.
        summary: Its entry in ``summary.json``.
        summarised: Whether ``summary.json`` lists each record.
        columns: Unit and meaning of the columns of its table. ``impulse_N_s`` is the field of that name, ``point_{xyz}_m``
            one column for each value of the field ``point_m``.
        lengths: How many values a field holds, ``point_m``, or the entry of a mapping, ``energy_before_J.total``.
        marks: Marks to draw; None for none.
        arrows: Arrows that viewers draw from the columns of the contact model of the records; None for none. A contact model
            with several kinds of records declares its arrows with one of them.
        state: State from the event on, in a word, for a track of states; None for none.
        warning: Whether to show it as a warning.
        in_every_run: Whether every log has its topic; otherwise those whose header names it.
        own_numbers: Whether its events are numbered by themselves, not with those of the other contact models.
        event_group: Name of a group of kinds, of one contact model, whose records with one number are one event; empty: the
            kind alone.
    """

    record: type
    name: str
    plural: str
    when: str
    time: Callable[[Any], float]
    sentence: Callable[[Any], str]
    summary: Callable[[Any], dict[str, Any]] = all_fields
    summarised: bool = True
    columns: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    lengths: Mapping[str, int] = field(default_factory=dict)
    marks: Callable[[Any], Sequence[Mark]] | None = None
    arrows: Callable[[Layout], Iterable[ArrowColumns]] | None = None
    state: Callable[[Any], str] | None = None
    warning: Callable[[Any], bool] = _never
    in_every_run: bool = False
    own_numbers: bool = False
    event_group: str = ""

    @property
    def topic(self) -> str:
        """Its topic in a log."""
        return f"/ffsm/{self.name}"

    @property
    def schema(self) -> str:
        """The name of its schema in a log."""
        return "ffsm." + "".join(word.capitalize() for word in self.name.split("_"))


@cache
def _known() -> dict[str, RecordKind]:
    """All kinds by name: the built-in ones, then those that :func:`register` adds.

    The built-in ones are listed in a room that knows all contact models, far above this one, so it is imported at run time.
    """
    known: dict[str, RecordKind] = {}
    for kind in import_module("ffsm_mj.analysis.built_in_kinds").BUILT_IN:
        _add(known, kind)
    return known


def register(kind: RecordKind) -> None:
    """Register a kind; registering it again has no effect.

    Raises:
        ValueError: Its name, plural or class belongs to another kind, or the kind is inconsistent.
    """
    _add(_known(), kind)


def _add(known: dict[str, RecordKind], kind: RecordKind) -> None:
    if known.get(kind.name) == kind:
        return
    for other in known.values():
        if kind.name == other.name or kind.record is other.record or (kind.plural and kind.plural == other.plural):
            raise ValueError(f"the kind {kind.name} ({kind.plural}) of {kind.record.__name__} is {other.name} already")
    if kind.name == "sample" or kind.plural in _TAKEN:
        raise ValueError(f"the kind {kind.name} ({kind.plural}): the name is reserved")
    for fault in _faults(kind):
        raise ValueError(f"the kind {kind.name}: {fault}")
    known[kind.name] = kind


def kinds() -> tuple[RecordKind, ...]:
    """All kinds in the order of registration: impacts first."""
    return tuple(_known().values())


def kinds_of(names: Sequence[str]) -> tuple[RecordKind, ...]:
    """The kinds of every run, then those with the given names in their order.

    Raises:
        KeyError: No such kind.
    """
    every = (name for name, kind in _known().items() if kind.in_every_run)
    return tuple(map(kind_named, dict.fromkeys((*every, *names))))


def kind_named(name: str) -> RecordKind:
    """The kind with a name.

    Raises:
        KeyError: No such kind.
    """
    known = _known()
    if name not in known:
        raise KeyError(unknown_name("kind of record", name, known))
    return known[name]


def kind_of(record: Any) -> RecordKind:
    """The kind of a record.

    Raises:
        TypeError: Its class is not registered.
    """
    for kind in _known().values():
        if kind.record is type(record):
            return kind
    raise TypeError(f"{type(record).__name__} is not a kind of record; there are {', '.join(_known())}")


def field_of(column: str) -> tuple[str, str]:
    """Field of a column of a table, and a letter for each of its values: ``point_m`` and ``xyz``."""
    found = _LETTERS.search(column)
    return _LETTERS.sub("", column), found[1] if found else ""


def _faults(kind: RecordKind) -> Iterator[str]:
    """What a log or a reader could not handle."""
    if not is_dataclass(kind.record):
        yield f"{kind.record.__name__} is not a dataclass"
        return
    if kind.plural and not kind.columns:
        yield f"the table {kind.plural} has no columns"
    hints = get_type_hints(kind.record)
    yield from (
        f"a log cannot hold a {hints[each.name]} ({each.name})"
        for each in fields(kind.record)
        if not _storable(hints[each.name])
    )
    yield from (f"there is no field {name} to have a length" for name in kind.lengths if name.partition(".")[0] not in hints)
    for column in kind.columns:
        name, letters = field_of(column)
        if name not in hints:
            yield f"there is no field {name} for the column {column}"
        elif letters and kind.lengths.get(name) != len(letters):
            yield f"the column {column} shows {len(letters)} values, lengths does not say that {name} has as many"
        elif not letters and hints[name] not in _ONE:
            yield f"the column {column} shows one value, {name} has several"


def _storable(hint: Any) -> bool:
    """Whether a field is a number or text, a tuple of either, or a mapping from names to text or to tuples of numbers."""
    parts = get_args(hint)
    if get_origin(hint) is tuple:
        return len(parts) == 2 and parts[0] in _ONE and parts[1] is ...
    return hint in _ONE or (
        get_origin(hint) is Mapping and parts[0] is str and parts[1] in (str, ControllerReport, tuple[float, ...])
    )
