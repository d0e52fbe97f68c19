"""When a run is a success: conditions on metrics, joined by ``and``."""

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
        bound: What it is compared with.
    """

    metric: str
    comparison: str
    bound: float

    def holds(self, metrics: Mapping[str, Any]) -> bool:
        """Whether it holds; a metric that a run lacks, or that is a text, fulfils no condition."""
        value = metrics.get(self.metric)
        return isinstance(value, int | float) and bool(_COMPARISONS[self.comparison](value, self.bound))


def conditions(text: str) -> tuple[Condition, ...]:
    """Conditions of a text such as ``tip.min_error_m < 0.05 and impacts.count == 1``.

    Raises:
        ValueError: It is none; the message says what is allowed.
    """
    found = []
    for part in re.split(r"\band\b", text):
        match = _CONDITION.fullmatch(part)
        if match is None:
            raise ValueError(
                f"{part.strip()!r} is no condition; write METRIC OPERATOR NUMBER, e.g. tip.min_error_m < 0.05, "
                f"joined by 'and'; operators: {', '.join(_COMPARISONS)}"
            )
        metric, comparison, bound = match.groups()
        found.append(Condition(metric, comparison, _number(bound)))
    return tuple(found)


def _number(text: str) -> float:
    if text in ("true", "false"):
        return float(text == "true")
    try:
        return float(text)
    except ValueError as error:
        raise ValueError(f"{text!r} is no number, and a metric is compared with a number, true or false") from error
