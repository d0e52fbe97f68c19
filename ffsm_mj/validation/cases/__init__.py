"""All validation cases, in the order of the page."""

from __future__ import annotations

from ffsm_mj.validation.case import ValidationCase
from ffsm_mj.validation.cases import (
    anymal,
    bouncing,
    captures,
    chains,
    free_motion,
    friction,
    panels,
    seed_paper,
    single_impacts,
    sliding,
    walker,
)

CASES: tuple[ValidationCase, ...] = (
    *seed_paper.CASES,
    *anymal.CASES,
    *bouncing.CASES,
    *friction.CASES,
    *sliding.CASES,
    *single_impacts.CASES,
    *chains.CASES,
    *walker.CASES,
    *free_motion.CASES,
    *panels.CASES,
    *captures.CASES,
)


def case_names() -> tuple[str, ...]:
    """Names of all cases."""
    return tuple(case.name for case in CASES)
