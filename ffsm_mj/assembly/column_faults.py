"""Refuses columns with equal names before a run: one would silently overwrite the other."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence

from ffsm_controllers.parts import Parts
from ffsm_controllers.phases import Phase
from ffsm_mj.errors import Fault, InputError, ScenarioFaults
from ffsm_mj.model.files import ModelFiles
from ffsm_mj.model.system import System
from ffsm_mj.model.xml import elements
from ffsm_mj.records.columns import Columns, same_names
from ffsm_mj.records.signals import Signal

_NAME = re.compile(r"[A-Za-z]\w*", re.ASCII)


def refuse_same_names(columns: Iterable[Columns], system: System) -> None:
    """Refuse model elements whose names are equal in the log, which keeps only letters, digits and underscores.

    Raises:
        InputError: A line for each two, with the file of the second.
    """
    lines: dict[tuple[str, str], str] = {}
    for one, other in same_names(columns):
        names = f"{one.element or one.description!r} and {other.element or other.description!r}"
        message = f"{_place(system, other.element)}: {names} are both logged as {other.key}; rename one of them"
        lines.setdefault((one.element, other.element), message)
    if lines:
        raise InputError(list(lines.values()))


def _place(system: System, element: str) -> str:
    """``file`` or ``file:line`` of an element by kind and full name, or ``file`` by its full name."""
    kind, _, full = element.partition(" ") if " " in element else ("", "", element)
    model, _, short = full.partition("/")
    files = system.files.get(model)
    if files is None:
        return " and ".join(each.place for each in system.files.values())
    return next(_lines(files, kind, short), files.place)


def _lines(files: ModelFiles, kind: str, name: str) -> Iterator[str]:
    tags = {"joint": ("joint", "freejoint"), "actuator": ("motor", "general")}
    for element in elements(files.files[files.main], files.place):
        if element.tag in tags.get(kind, ()) and element.attributes.get("name") == name:
            yield element.place


def refuse_telemetry(phases: Sequence[Phase]) -> None:
    """Refuse control laws whose signals cannot be columns, or differ in meaning under the same name.

    Raises:
        ScenarioFaults: A line for each law.
    """
    faults = []
    known: dict[str, tuple[Signal, str]] = {}
    for i, phase in enumerate(phases):
        fault = signals_fault(phase.controller.telemetry_signals)
        for name, law in () if fault else phase.held.items():
            if tuple(law.telemetry_signals) != tuple(phase.controller.telemetry_signals):
                fault = f"it reports other signals while {name!r} is closed than before"
        for signal in () if fault else phase.controller.telemetry_signals:
            other, where = known.setdefault(signal.key, (signal, phase.name))
            if other != signal:
                fault = f"{signal.key} is {signal.description!r} here and {other.description!r} in phase {where!r}"
        if fault:
            key = ("controllers",) if isinstance(phase.controller, Parts) else ("controller", "kind")
            faults.append(Fault(f"telemetry of kind {phase.kind!r}: {fault}", ("phases", i, *key)))
    if faults:
        raise ScenarioFaults(faults)


def signals_fault(signals: object, group: str = "controller") -> str:
    """What is wrong with the signals of one law, or of an estimator, of this group; empty if they are valid."""
    if not isinstance(signals, Sequence) or not all(isinstance(signal, Signal) for signal in signals):
        return "telemetry_signals is no sequence of Signal"
    for signal in signals:
        if signal.group != group or not _NAME.fullmatch(signal.name):
            return f"{signal.key!r} is no name in the group {group}, of letters, digits and _"
    names = [signal.key for signal in signals]
    twice = next((name for name in names if names.count(name) > 1), "")
    return f"{twice} is listed twice" if twice else ""
