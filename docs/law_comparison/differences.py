"""Paired differences between laws, and sentences that say no more than their intervals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from laws import law_of
from table import Table

from ffsm_mj.campaign.evaluation.paired import PairedDifference, paired_difference

NAMES = {
    "cost": "cost",
    "error_integral": "integral of the squared error",
    "effort_integral": "integral of the squared torques",
    "least_error": "least error",
    "final_error": "final error",
    "base_turn": "turn of the base",
}


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

    @property
    def says(self) -> str:
        """``less``, ``more``, or that nothing is shown."""
        return {-1: "less", 0: "no difference shown", 1: "more"}[self.difference.sign]

    def sentence(self) -> str:
        """What the numbers show."""
        difference, name = self.difference, NAMES[self.metric]
        interval = f"[{difference.low:.3g}, {difference.high:.3g}]"
        one, other = law_of(self.one).title, law_of(self.other).title
        if difference.sign == 0:
            return f"{name}: no difference between {one} and {other} is shown, {difference.mean:+.3g} {interval}"
        return (
            f"{name}: {one} has {abs(self.percent):.0f} % {self.says} than {other} ({difference.second:.3g} and "
            f"{difference.first:.3g}, difference {difference.mean:+.3g} {interval})"
        )


def gain(table: Table, cell: str, variant: str, metric: str, one: str, other: str) -> Gain | None:
    """The paired difference of two laws over the runs that are good with both; None if there is none."""
    second, first = (table.values(cell, law, variant, metric) for law in (one, other))
    found = paired_difference(metric, np.asarray(first), np.asarray(second))
    return Gain(metric, one, other, found) if found is not None else None


def tuning_gain(table: Table, cell: str, law: str, metric: str = "cost") -> PairedDifference | None:
    """What tuning changes, tuned less default."""
    first, second = (table.values(cell, law, variant, metric) for variant in ("default", "tuned"))
    return paired_difference(metric, first, second)
