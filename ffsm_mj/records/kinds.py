"""Kinds of event records: what logs, tables, viewers and reports need to know of each.

A registered kind appears everywhere: as a topic of the log, in ``/log``, as a list in ``summary.json`` and on a run, as a
table, in comparisons of runs, and as marks in Rerun, Foxglove, animations and figures. It also declares the arrows that
viewers draw from the columns of its contact model.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from operator import attrgetter
from typing import Any, NamedTuple, get_args, get_origin

from ffsm_mj.arrays import IntArray
from ffsm_mj.errors import unknown_name
from ffsm_mj.records.record import ONE_VALUE, ControllerReport, columns_of, hints_of, meanings
from ffsm_mj.records.signals import Layout

SUMMARY_KEYS = frozenset(
    (
        *("schema_version", "scenario", "outcome", "message", "start_s", "duration_s", "steps", "sub_steps"),
        *("smallest_step_s", "wall_s", "real_time_factor", "law_wall_s_per_tick", "conservative", "contacts", "grasps"),
        *("tip", "controller", "conservation", "model", "controller_model", "versions"),
        *("effort", "base_rotation", "angular_momentum", "checks", "sensitivity", "realtime"),
    )
)
"""Keys of ``summary.json`` that are not plurals of kinds; some runs lack some of them."""
_RESERVED = SUMMARY_KEYS | {"samples", "plumes"}
"""Plurals that have another meaning: in the summary, as a table or as a topic."""
_LETTERS = re.compile(r"_\{(\w+)\}")
_KNOWN: dict[str, RecordKind] = {}


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
    return {field.name: _plain(getattr(record, field.name)) for field in fields(record)}


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _plain(entry) for name, entry in value.items()}
    return list(value) if isinstance(value, tuple) else value


@dataclass(frozen=True, kw_only=True)
class RecordKind:
    """Description of one kind of record; all functions but ``arrows`` take a record.

    Attributes:
        record: Its class, declared as :mod:`.record` says; its fields are numbers and text, tuples of either, mappings from
            names to text or to tuples of numbers.
        name: ``impact``: its topic is ``/ffsm/impact``, its schema ``ffsm.Impact``.
        plural: ``impacts``: its list in ``summary.json`` and on a run, its table; empty if a run has only one.
        when: When a record is written, as text.
        time: Time of a record, s; by default its field ``time_s``.
        sentence: One line that describes the event.
        summary: Its entry in ``summary.json``.
        summarised: Whether ``summary.json`` lists each record.
        marks: Marks to draw; None for none.
        arrows: Arrows that viewers draw from the columns of the contact model of the records; None for none. A contact model
            with several kinds of records declares its arrows with one of them.
        state: State from the event on, in a word, for a track of states; None for none.
        warning: Whether to show it as a warning.
        in_every_run: Whether every log has its topic; otherwise those whose header names it.
        in_every_report: Whether the report of a run lists its records, whatever else happened.
        series: Name of the count of its events; empty for the one that contact models share. Records with one number of a
            series are one event.
    """

    record: type
    name: str
    plural: str
    when: str
    time: Callable[[Any], float] = attrgetter("time_s")
    sentence: Callable[[Any], str]
    summary: Callable[[Any], dict[str, Any]] = all_fields
    summarised: bool = True
    marks: Callable[[Any], Sequence[Mark]] | None = None
    arrows: Callable[[Layout], Iterable[ArrowColumns]] | None = None
    state: Callable[[Any], str] | None = None
    warning: Callable[[Any], bool] = _never
    in_every_run: bool = False
    in_every_report: bool = False
    series: str = ""

    @property
    def topic(self) -> str:
        """Its topic in a log."""
        return f"/ffsm/{self.name}"

    @property
    def schema(self) -> str:
        """The name of its schema in a log."""
        return "ffsm." + "".join(word.capitalize() for word in self.name.split("_"))

    @property
    def columns(self) -> Mapping[str, tuple[str, str]]:
        """Unit and text of the columns of its table, see :func:`.record.columns_of`; the time is the first one."""
        return dict(sorted(columns_of(self.record).items(), key=lambda column: column[0] != "time_s"))


def register(kind: RecordKind, *, checked: bool = False) -> None:
    """Register a kind; registering it again has no effect.

    Args:
        kind: The kind.
        checked: It has no :func:`faults`, as a test knows of those of every run; to evaluate their annotations takes 10 ms.

    Raises:
        ValueError: Its name, plural or class belongs to another kind, or the kind is inconsistent.
    """
    if _KNOWN.get(kind.name) == kind:
        return
    for other in _KNOWN.values():
        if kind.name == other.name or kind.record is other.record or (kind.plural and kind.plural == other.plural):
            raise ValueError(f"the kind {kind.name} ({kind.plural}) of {kind.record.__name__} is {other.name} already")
    if kind.name == "sample" or kind.plural in _RESERVED:
        raise ValueError(f"the kind {kind.name} ({kind.plural}): the name is reserved")
    for fault in () if checked else faults(kind):
        raise ValueError(f"the kind {kind.name}: {fault}")
    _KNOWN[kind.name] = kind


def kinds() -> tuple[RecordKind, ...]:
    """All kinds in the order of registration: impacts first."""
    return tuple(_KNOWN.values())


def kinds_of(names: Sequence[str]) -> tuple[RecordKind, ...]:
    """The kinds of every run, then those with the given names in their order.

    Raises:
        KeyError: No such kind.
    """
    every = (name for name, kind in _KNOWN.items() if kind.in_every_run)
    return tuple(map(kind_named, dict.fromkeys((*every, *names))))


def kind_named(name: str) -> RecordKind:
    """The kind with a name.

    Raises:
        KeyError: No such kind.
    """
    if name not in _KNOWN:
        raise KeyError(unknown_name("kind of record", name, _KNOWN))
    return _KNOWN[name]


def kind_of(record: Any) -> RecordKind:
    """The kind of a record.

    Raises:
        TypeError: Its class is not registered.
    """
    for kind in _KNOWN.values():
        if kind.record is type(record):
            return kind
    raise TypeError(f"{type(record).__name__} is not a kind of record; there are {', '.join(_KNOWN)}")


def field_of(column: str) -> tuple[str, str]:
    """Field of a column of a table, and a letter for each of its values: ``point_m`` and ``xyz``."""
    match = _LETTERS.search(column)
    return _LETTERS.sub("", column), match[1] if match else ""


def faults(kind: RecordKind) -> Iterator[str]:
    """What a log or a reader could not handle."""
    if not is_dataclass(kind.record):
        yield f"{kind.record.__name__} is not a dataclass"
        return
    known, hints = meanings(kind.record), hints_of(kind.record)
    for name in (one.name for one in fields(kind.record)):
        if name not in known:
            yield f"the field {name} has no meaning, see ffsm_mj.records.record.declared"
            return
        hint, meaning = hints[name], known[name]
        if not _storable(hint):
            yield f"a log cannot hold a {hint} ({name})"
        if meaning.components and get_origin(hint) is not tuple:
            yield f"{name} has components, but one value"
        if meaning.entries and get_origin(hint) is not Mapping:
            yield f"{name} has entries, but is no mapping"
        if meaning.column_after and meaning.column_after not in known.keys() - {name}:
            yield f"there is no field {meaning.column_after} for {name} to come after"
    if kind.plural and not kind.columns:
        yield f"the table {kind.plural} has no columns"


def _storable(hint: Any) -> bool:
    """Whether a field is a number or text, a tuple of either, or a mapping from names to text or to tuples of numbers."""
    parts = get_args(hint)
    if get_origin(hint) is tuple:
        return len(parts) == 2 and parts[0] in ONE_VALUE and parts[1] is ...
    return hint in ONE_VALUE or (
        get_origin(hint) is Mapping and parts[0] is str and parts[1] in (str, ControllerReport, tuple[float, ...])
    )


class ArrowColumns(NamedTuple):
    """Columns of a force or torque and of its point of application.

    Attributes:
        name: Name of the arrow in viewers.
        meaning: Description for legends, such as ``contact force``.
        vector: Columns of the force or torque, in world axes, (3,).
        point: Columns of its point of application in world axes, (3,), m; NaN in rows in which nothing acts.
        size: Column of its magnitude; None if there is none.
        unit: ``N``, or ``N m`` for a torque.
        is_part: Whether it is a part of another arrow at the same point, as friction is of the contact force.
    """

    name: str
    meaning: str
    vector: IntArray
    point: IntArray
    size: int | None = None
    unit: str = "N"
    is_part: bool = False

    @property
    def is_torque(self) -> bool:
        """Whether the arrow is that of a torque."""
        return self.unit != "N"
