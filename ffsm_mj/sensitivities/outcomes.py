"""Outcomes of a run: numbers of its summary by name, as the metrics of a campaign."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ffsm_mj.analysis.run import Run
from ffsm_mj.arrays import FloatArray
from ffsm_mj.campaign.execution.metrics import fault_of, value_at
from ffsm_mj.errors import InputError

_IMPACT = re.compile(r"impacts\.(\d+)\.(\w+)")
_WORDS = {
    "impulse_N_s": ("the impulse of impact {n}", "N s", True),
    "time_s": ("the time of impact {n}", "s", False),
    "approach_speed_m_s": ("the approach speed of impact {n}", "m/s", True),
}
_TIP = {
    "tip.final_error_m": ("the final error of the tip", "m"),
    "tip.min_error_m": ("the smallest error of the tip", "m"),
    "captures.0.time_s": ("the time of capture 1", "s"),
    "captures.0.loss_J": ("the loss of capture 1", "J"),
}


@dataclass(frozen=True)
class Outcome:
    """A number of a run.

    Attributes:
        name: Name in the summary: ``impacts.0.impulse_N_s``.
        words: The same in words.
        unit: Its unit, if known.
        relative: Whether its changes are told in per cent.
    """

    name: str
    words: str
    unit: str
    relative: bool

    @classmethod
    def named(cls, name: str) -> Outcome:
        """The outcome of a name.

        Raises:
            InputError: No run has such an outcome.
        """
        if (fault := fault_of(name, ())) is not None and not name.startswith("effort."):
            raise InputError(f"--of {name}: {fault}")
        match = _IMPACT.fullmatch(name)
        if match and match.group(2) in _WORDS:
            words, unit, relative = _WORDS[match.group(2)]
            return cls(name, words.format(n=int(match.group(1)) + 1), unit, relative)
        words, unit = _TIP.get(name, (name, ""))
        return cls(name, words, unit, relative=False)


def default_outcomes(run: Run) -> tuple[str, ...]:
    """Impulse and time of the first impact, and the final error of the tip, as far as the run has them."""
    summary = run.summary()
    names = ("impacts.0.impulse_N_s", "impacts.0.time_s") if summary["impacts"] else ()
    return (*names, "tip.final_error_m") if summary["tip"] is not None else names


def values(run: Run, of: Sequence[Outcome]) -> FloatArray:
    """Outcomes of a run, (n,); NaN for those that it has not, or that are no numbers."""
    summary = run.summary()
    found = [value_at(summary, each.name) for each in of]
    return np.array([float(value) if isinstance(value, int | float) else math.nan for value in found])


def impacts(run: Run) -> tuple[tuple[str, ...], ...]:
    """Pairs of each impact of a run, in order."""
    by_event: dict[int, list[str]] = {}
    for record in run.impacts:
        by_event.setdefault(record.event, []).append(record.pair)
    return tuple(tuple(sorted(pairs)) for pairs in by_event.values())
