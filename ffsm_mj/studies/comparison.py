"""Paired comparison of the variants of a study, and what it shows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ffsm_mj.campaign.evaluation.paired import PairedDifference, paired_difference
from ffsm_mj.campaign.evaluation.results import TableRow, numbers
from ffsm_mj.studies.results import SUCCESS, StudyResults


@dataclass(frozen=True)
class VariantPair:
    """Two variants, run by run.

    Attributes:
        first: Name of one variant.
        second: Name of the other one; differences are second less first.
        common: Number of runs that have a row in both.
        compared: Number of these that completed and pass their checks in both: metrics are compared over these.
        differences: Differences by metric; of ``success`` over all common runs.
    """

    first: str
    second: str
    common: int
    compared: int
    differences: Mapping[str, PairedDifference]

    def reversed(self) -> VariantPair:
        """The same comparison, first less second."""
        differences = {name: each.reversed() for name, each in self.differences.items()}
        return VariantPair(self.second, self.first, self.common, self.compared, differences)


@dataclass(frozen=True)
class Ranking:
    """What the paired differences of a metric show, given whether less or more of it is better.

    Attributes:
        metric: Name of the metric.
        direction: ``minimize`` or ``maximize``.
        best: The variant that is shown to be better than every other one; empty if there is none.
        unbeaten: Variants than which none is shown to be better, in the order of the study file.
        beaten: Variants than which at least one is shown to be better.
    """

    metric: str
    direction: str
    best: str
    unbeaten: tuple[str, ...]
    beaten: tuple[str, ...]


@dataclass(frozen=True)
class StudyComparison:
    """All pairs of variants.

    Attributes:
        pairs: Each pair once, in the order of the study file, with the reference first if there is one.
    """

    pairs: tuple[VariantPair, ...]

    def pair(self, first: str, second: str) -> VariantPair:
        """The comparison of two variants, second less first.

        Raises:
            KeyError: They are not compared.
        """
        for each in self.pairs:
            if (each.first, each.second) == (first, second):
                return each
            if (each.second, each.first) == (first, second):
                return each.reversed()
        raise KeyError((first, second))

    def ranking(self, metric: str, direction: str) -> Ranking | None:
        """What the differences of a metric show; None if fewer than two variants have it."""
        better = -1 if direction == "minimize" else 1
        names = dict.fromkeys(
            name for each in self.pairs if metric in each.differences for name in (each.first, each.second)
        )
        wins: dict[str, set[str]] = {name: set() for name in names}
        for each in self.pairs:
            if metric in each.differences and (sign := each.differences[metric].sign):
                winner, loser = (each.second, each.first) if sign == better else (each.first, each.second)
                wins[winner].add(loser)
        beaten = set().union(*wins.values())
        best = [name for name in names if len(wins[name]) == len(names) - 1 and name not in beaten]
        if len(names) < 2:
            return None
        return Ranking(
            metric,
            direction,
            best[0] if best else "",
            tuple(name for name in names if name not in beaten),
            tuple(name for name in names if name in beaten),
        )


def compare_variants(results: StudyResults) -> StudyComparison:
    """Compare the variants run by run: all pairs, or each with the reference if the study has one."""
    reference = results.config.reference
    names = [*results.variants]
    if reference is not None and reference in results.variants:
        pairs = [(reference, name) for name in names if name != reference]
    else:
        pairs = list(combinations(names, 2))
    return StudyComparison(tuple(each for pair in pairs if (each := _compared(results, *pair)) is not None))


def _compared(results: StudyResults, first: str, second: str) -> VariantPair | None:
    """Two variants run by run; None if they have no run in common.

    The difference is computed in the order of the names: the bits of an interval do not depend on the order of the variants.
    """
    if second < first:
        found = _compared(results, second, first)
        return found.reversed() if found is not None else None
    rows = {row["run"]: row for row in results.variants[second].rows}
    pairs = [(row, rows[row["run"]]) for row in results.variants[first].rows if row["run"] in rows]
    if not pairs:
        return None
    valid = [pair for pair in pairs if not pair[0]["failed"] and not pair[1]["failed"]]
    differences = {each.metric: each for each in _differences(results, pairs, valid)}
    return VariantPair(first, second, len(pairs), len(valid), differences)


def _differences(
    results: StudyResults, pairs: list[tuple[TableRow, TableRow]], valid: list[tuple[TableRow, TableRow]]
) -> Iterator[PairedDifference]:
    metrics = ([(SUCCESS, pairs)] if results.config.conditions else []) + [(name, valid) for name in results.metrics]
    for metric, of in metrics:
        first, second = (numbers([pair[i] for pair in of], metric) for i in (0, 1))
        if (found := paired_difference(metric, np.asarray(first), np.asarray(second))) is not None:
            yield found
