"""Conditions on named values of a run, joined by ``and``: success of a run in a campaign or of an episode."""

from __future__ import annotations

import operator
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

_COMPARISONS = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
}
_CONDITION = re.compile(r"\s*([^\s<>=!]+)\s*(<=|>=|==|!=|<|>)\s*(\S+)\s*")


@dataclass(frozen=True)
class Condition:
    """A metric compared with a number.

    Attributes:
        metric: Name of the metric.
        comparison: One of ``<``, ``<=``, ``>``, ``>=``, ``==`` and ``!=``.
        bound: Number to compare with.
    """

    metric: str
    comparison: str
    bound: float

    def holds(self, metrics: Mapping[str, Any]) -> bool:
        """Whether the condition holds; it does not for a missing metric or a text."""
        value = metrics.get(self.metric)
        return isinstance(value, int | float) and bool(_COMPARISONS[self.comparison](value, self.bound))


def conditions(text: str) -> tuple[Condition, ...]:
    """Parse conditions such as ``tip.min_error_m < 0.05 and impacts.count == 1``.

    Raises:
        ValueError: The text is not a condition; the message lists what is allowed.
    """
    parsed = []
    for part in re.split(r"\band\b", text):
        match = _CONDITION.fullmatch(part)
        if match is None:
            raise ValueError(
                f"{part.strip()!r} is not a condition; write METRIC OPERATOR NUMBER, e.g. tip.min_error_m < 0.05, "
                f"joined by 'and'; operators: {', '.join(_COMPARISONS)}"
            )
        metric, comparison, bound = match.groups()
        parsed.append(Condition(metric, comparison, _number(bound)))
    return tuple(parsed)


def _number(text: str) -> float:
    if text in ("true", "false"):
        return float(text == "true")
    try:
        return float(text)
    except ValueError as error:
        raise ValueError(f"{text!r} is not a number; a metric can be compared with a number, true or false") from error
