"""All validation cases, in the order of the page."""

from __future__ import annotations

from ffsm_mj.validation.case import Topic, ValidationCase
from ffsm_mj.validation.cases import (
    anymal,
    bouncing,
    breakaway,
    chains,
    compass,
    detumbling,
    free_motion,
    friction,
    grasps,
    grips,
    panels,
    rolling,
    seed_paper,
    servicer,
    single_impacts,
    sliding,
    two_grasps,
    walker,
)

_ALL: tuple[ValidationCase, ...] = (
    *seed_paper.CASES,
    *free_motion.CASES,
    *panels.CASES,
    *single_impacts.CASES,
    *anymal.CASES,
    *bouncing.CASES,
    *detumbling.CASES,
    *chains.CASES,
    *walker.CASES,
    *compass.CASES,
    *friction.CASES,
    *sliding.CASES,
    *breakaway.CASES,
    *rolling.CASES,
    *grips.CASES,
    *grasps.CASES,
    *servicer.CASES,
    *two_grasps.CASES,
)

CASES: tuple[ValidationCase, ...] = tuple(case for topic in Topic for case in _ALL if case.topic is topic)
LONGEST = "simbenchmark-rolling"
"""The case that takes the longest time."""


def case_names() -> tuple[str, ...]:
    """Names of all cases."""
    return tuple(case.name for case in CASES)


def values_of(name: str) -> dict[str, float]:
    """What the case of a name computes."""
    return dict(next(case for case in CASES if case.name == name).compute())
