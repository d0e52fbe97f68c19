"""Sentences that say what the tables of a study show; no variant is better where an interval contains zero."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ffsm_mj.campaign.evaluation.paired import LEAST_RUNS, PairedDifference
from ffsm_mj.campaign.evaluation.statistics import CONFIDENCE
from ffsm_mj.studies.comparison import Ranking, StudyComparison
from ffsm_mj.studies.results import SUCCESS, StudyResults


def sentences(results: StudyResults, comparison: StudyComparison) -> list[str]:
    """What a study shows, one sentence each: rankings, runs that are left out, variants and metrics without results."""
    found = [*_rankings(results, comparison), *_left_out(results)]
    found += [f"{name} is not applicable: {reason}" for name, reason in results.not_applicable.items()]
    return found + [each.sentence() for each in results.metric_faults()]


def _rankings(results: StudyResults, comparison: StudyComparison) -> Iterator[str]:
    """A sentence per objective, after one for the fraction of successes."""
    objectives = {SUCCESS: "maximize"} if results.config.conditions else {}
    for metric, direction in (objectives | dict(results.config.objectives)).items():
        ranking = comparison.ranking(metric, direction)
        if ranking is None:
            yield f"{metric} ({direction}): no two variants have a number in the same run, with checks passed in both."
        else:
            yield _ranking(ranking, results, comparison)


def _ranking(ranking: Ranking, results: StudyResults, comparison: StudyComparison) -> str:
    goal, compared = ("least", "less") if ranking.direction == "minimize" else ("most", "more")
    runs = max(each.differences[ranking.metric].n for each in comparison.pairs if ranking.metric in each.differences)
    head = f"{ranking.metric} ({ranking.direction}): "
    if runs < LEAST_RUNS:
        return f"{head}nothing is shown by {runs} run{'' if runs == 1 else 's'}; {LEAST_RUNS} or more are needed."
    reference = results.config.reference
    if reference is not None:
        return head + _against(reference, ranking, comparison)
    if ranking.best:
        return f"{head}{ranking.best} has {compared} than every other variant."
    if not ranking.beaten:
        return f"{head}no difference is shown between {_listed(ranking.unbeaten)}."
    behind = f"; {_listed(ranking.beaten)} {'is' if len(ranking.beaten) == 1 else 'are'} shown to be worse than another"
    return f"{head}no variant has the {goal}: none is shown to be better than {_listed(ranking.unbeaten)}{behind}."


def _against(reference: str, ranking: Ranking, comparison: StudyComparison) -> str:
    """Variants that differ from the reference."""
    better = -1 if ranking.direction == "minimize" else 1
    groups: dict[int, list[str]] = {1: [], -1: [], 0: []}
    for each in comparison.pairs:
        if ranking.metric in each.differences:
            groups[each.differences[ranking.metric].sign * better].append(each.second)
    words = {1: f"better than {reference}: ", -1: f"worse than {reference}: ", 0: "no difference shown: "}
    return "; ".join(words[side] + _listed(names) for side, names in groups.items() if names) + "."


def difference_sentence(found: PairedDifference, first: str, second: str) -> str:
    """What a difference shows.

    Args:
        found: The difference, second less first.
        first: Name of one variant.
        second: Name of the other one.
    """
    numbers = f"{found.second:.4g} and {found.first:.4g}, difference {found.mean:.3g}"
    if found.n < 2:
        return f"{found.metric}, {second} and {first}: {numbers} in one run."
    interval = f"[{found.low:.3g}, {found.high:.3g}]"
    runs = f"{found.n} runs, less in {found.lower} and more in {found.higher}"
    if not found.lower and not found.higher:
        return f"{found.metric}: equal in {second} and {first} ({found.second:.4g}; {found.n} runs)."
    if not found.sign:
        return f"{found.metric}: no difference is shown between {second} and {first} ({numbers} {interval}; {runs})."
    return (
        f"{found.metric}: {'less' if found.sign < 0 else 'more'} in {second} than in {first} ({numbers} {interval}; {runs})."
    )


def _left_out(results: StudyResults) -> Iterator[str]:
    """Runs that are missing, did not complete or do not pass their checks."""
    for name in results.variants:
        counts = results.counts(name)
        left = counts.runs - counts.done
        parts = [f"{left} {'has' if left == 1 else 'have'} no result yet"] if left else []
        parts += [f"{count} ended with {outcome}" for outcome, count in counts.outcomes.items() if outcome != "completed"]
        parts += [f"{counts.violated} violate{'s' if counts.violated == 1 else ''} a check"] if counts.violated else []
        if parts:
            yield (
                f"{name}: of {counts.runs} runs {_listed(parts)}; metrics are compared over runs that completed and pass "
                "their checks in both variants."
            )


def _listed(names: Sequence[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def confidence_sentence(pairs: int, metrics: int) -> str:
    """How the intervals are to be read."""
    by_chance, number = (1.0 - CONFIDENCE) * pairs * metrics, pairs * metrics
    return (
        f"Intervals are two-sided, {100 * CONFIDENCE:g} % each: bootstrap of the mean paired difference, bias-corrected, "
        f"accelerated, and expanded for few runs. Of {number} intervals without a true difference {by_chance:.1f} exclude "
        "zero by chance."
    )
