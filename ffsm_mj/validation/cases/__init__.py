"""All validation cases, in the order of the page."""

from __future__ import annotations

from ffsm_mj.validation.case import Topic, ValidationCase
from ffsm_mj.validation.cases import (
    detumbling,
    free_motion,
    friction,
    grasps,
    grips,
    impacts,
    integrators,
    seed_paper,
    simbenchmark,
    walkers,
)

_SOURCES = (seed_paper, free_motion, impacts, integrators, detumbling, walkers, friction, simbenchmark, grips, grasps)
_ALL: tuple[ValidationCase, ...] = tuple(case for source in _SOURCES for case in source.CASES)

CASES: tuple[ValidationCase, ...] = tuple(case for topic in Topic for case in _ALL if case.topic is topic)
LONGEST = "simbenchmark-rolling"
"""The case that takes the longest time."""


def case_names() -> tuple[str, ...]:
    """Names of all cases."""
    return tuple(case.name for case in CASES)


def values_of(name: str) -> dict[str, float]:
    """What the case of a name computes."""
    return dict(next(case for case in CASES if case.name == name).compute())
