"""The runs that the report needs, on all cores."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from ffsm_mj.all_cores import on_all_cores
from ffsm_mj.analysis.run import Run
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.reproduction.measure import Measures, measure
from ffsm_mj.reproduction.threshold import run_with_threshold

SCENARIOS = ("baseline", "no-actuation", "free-flying", "slow-impact")
STEPS_S = (1e-3, 5e-4, 2.5e-4)
LONG_S = 120.0


@dataclass(frozen=True)
class Case:
    """One run.

    Attributes:
        scenario: A shipped scenario.
        overrides: ``key=value`` as on the command line.
        threshold: Declare the impact as the paper does, see :mod:`ffsm_mj.reproduction.threshold`.
        keep: The run itself is needed, not only what it came to.
    """

    scenario: str
    overrides: tuple[str, ...] = ()
    threshold: bool = False
    keep: bool = False


@dataclass(frozen=True)
class Result:
    """What a case came to, and the run where it was to be kept."""

    values: Measures
    run: Run | None


def paper_case(scenario: str, step_s: float = 1e-3, period_s: float = 1e-3) -> Case:
    """One of the paper's runs; the run itself is kept at the paper's steps."""
    keep = (step_s, period_s) == (1e-3, 1e-3)
    return Case(scenario, (f"time_step_s={step_s}", f"control_period_s={period_s}"), keep=keep)


_LONG = f"duration_s={LONG_S}"
_VELOCITY = tuple(f"phases.{i}.controller.parameterization=velocity" for i in (0, 2))
_NO_THRUSTERS = ("phases.1.for_s=2.3", "phases.1.controller={kind: off}")

THRESHOLD = Case("baseline", threshold=True)
VELOCITY = Case("baseline", _VELOCITY, keep=True)
LONG_BASELINE = Case("baseline", (_LONG,), keep=True)
LONG_SLOW = Case("slow-impact", (_LONG, *_NO_THRUSTERS), keep=True)
LONG_FREE_FLYING = Case("free-flying", (_LONG,), keep=True)


def all_cases() -> tuple[Case, ...]:
    """Every run of the report, the long ones first so that no core idles at the end."""
    held = [paper_case(name, step) for name in SCENARIOS for step in STEPS_S]
    decided = [paper_case(name, step, step) for name in SCENARIOS for step in STEPS_S[1:]]
    return (LONG_BASELINE, LONG_SLOW, LONG_FREE_FLYING, *reversed(decided), THRESHOLD, VELOCITY, *held)


def run_cases(cases: Iterable[Case], report: Callable[[int, int], None] | None) -> dict[Case, Result]:
    """Run cases on all cores; ``report`` is told how many of how many are done."""
    cases = tuple(cases)
    return dict(zip(cases, on_all_cores(run_case, cases, report), strict=True))


def run_case(case: Case) -> Result:
    """Run one case."""
    if case.threshold:
        return Result(run_with_threshold(case.scenario), None)
    prepared = prepare(case.scenario, case.overrides)
    run = prepared.run()
    return Result(measure(run, prepared.system), run if case.keep else None)
