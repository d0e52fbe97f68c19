"""Paired differences between laws, and sentences that say no more than their intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from laws import shown
from table import Table

from ffsm_mj.experiments.comparison import PairedDifference, paired_difference


@dataclass(frozen=True)
class Gain:
    """A metric of one law less that of another one, run by run.

    Attributes:
        metric: Name of the metric.
        one: Name of the law.
        other: Name of the law that it is compared with.
        difference: Paired difference, the one less the other.
    """

    metric: str
    one: str
    other: str
    difference: PairedDifference

    @property
    def percent(self) -> float:
        """Mean difference over the mean of the other law, %."""
        return 100.0 * self.difference.mean / self.difference.first

    def told(self) -> str:
        """The difference as a cell of a table; nothing is said of one whose interval contains zero."""
        difference = self.difference
        if difference.sign == 0:
            return "none shown"
        digits = ".0f" if abs(self.percent) >= 10.0 else ".2g"
        return f"{self.percent:+{digits}} % [{shown(difference.low)}, {shown(difference.high)}]"


def balance(gains: Sequence[Gain]) -> str:
    """How many of some differences are shown, and in which direction."""
    signs = [each.difference.sign for each in gains]
    less, more, none = signs.count(-1), signs.count(1), signs.count(0)
    return f"less in {less}, more in {more}, and no difference is shown in {none} of {len(signs)} rows"


def gain(table: Table, cell: str, variant: str, metric: str, one: str, other: str) -> Gain | None:
    """The paired difference of two laws over the runs that are good with both; None if there is none."""
    second, first = (table.values(cell, law, variant, metric) for law in (one, other))
    found = paired_difference(metric, np.asarray(first), np.asarray(second))
    return Gain(metric, one, other, found) if found is not None else None


def tuning_gain(table: Table, cell: str, law: str, metric: str = "cost") -> PairedDifference | None:
    """What tuning changes, tuned less default."""
    first, second = (table.values(cell, law, variant, metric) for variant in ("default", "tuned"))
    return paired_difference(metric, first, second)
