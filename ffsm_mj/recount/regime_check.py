"""The events of declared regimes in a log, made again by the regimes themselves at the states of the log."""

from __future__ import annotations

from dataclasses import replace

from ffsm_mj.analysis.agreement import Agreement
from ffsm_mj.contact.course import Course
from ffsm_mj.contact.regimes import Effect, Instant, Regime
from ffsm_mj.errors import UnsupportedContactError
from ffsm_mj.plant.ledger import Ledger
from ffsm_mj.records.events import RunEnded
from ffsm_mj.recount.encounters import Encounter, Encounters


class RegimeCheck:
    """Lets regimes act where the log says that they did, and compares what they leave with the records."""

    def __init__(self, course: Course, encounters: Encounters, found: Agreement) -> None:
        """Bind to what moves; differences go to ``found``."""
        self._course, self._encounters, self._found = course, encounters, found
        self._owners = {kind.name: regime for regime in course.regimes for kind in regime.records}

    def meet(self, event: Encounter, ledger: Ledger) -> None:
        """Let the regime act at the state in ``data``, compare, book, and let what it says move from here on."""
        effect = self._effect(self._owners[event.kind], event)
        if effect is None or len(effect.records) != len(event.records):
            self._encounters.refuse(f"{event.name} records", event.time_s)
            return
        for mine, theirs in zip(effect.records, event.records, strict=True):
            again = replace(mine, time_s=theirs.time_s, efforts_after=theirs.efforts_after)
            self._found.record(event.name, theirs, again)
        if effect.booking is not None:
            ledger.book(*effect.booking)
        if effect.motion is not None:
            self._course.bind(effect.motion)

    def _effect(self, regime: Regime, event: Encounter) -> Effect | None:
        try:
            regime.meet(event.records)
            return regime.act(Instant(event.time_s, event.step))
        except (RunEnded, UnsupportedContactError, ValueError, ArithmeticError):
            return None
