"""What a log tells of its run in words, checked where it is read: somebody else may have written it."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ffsm_mj.records.signals import PARTIES


def fault_of_facts(facts: Mapping[str, str]) -> str:
    """What is wrong with facts that are used as numbers, or nothing."""
    for name in (f"free_components_{party}" for party in PARTIES):
        words = facts.get(name, "1 1 1 1 1 1").split()
        if len(words) != 6 or not set(words) <= {"0", "1"}:
            return f"its fact {name} is {facts[name]!r}; six of 0 and 1 are allowed"
    axes, target = (facts.get(name, "").split() for name in ("task_axes", "task_target_m"))
    if len(set(axes)) != len(axes) or not set(axes) <= set("xyz"):
        return f"its fact task_axes is {facts['task_axes']!r}; different axes of x, y and z are allowed"
    if len(target) != len(axes) or not all(map(_is_number, target)):
        return f"its fact task_target_m is {' '.join(target)!r}; a finite number for each of its task_axes is allowed"
    return ""


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False
