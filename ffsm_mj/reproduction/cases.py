"""The runs that the report needs, on all cores."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import active_children

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

_ENDING = (signal.SIGINT, signal.SIGTERM)

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
    """Run cases on all cores; ``report`` is told how many of how many are done. What ends this early ends its workers."""
    cases = tuple(cases)
    tell = report or (lambda *_: None)
    tell(0, len(cases))
    others = set(active_children())
    with ProcessPoolExecutor(os.cpu_count(), initializer=_left_to_the_parent) as pool:
        try:
            with _signals_wait():  # a worker that is being made when one comes would be nobody's
                running = {pool.submit(run_case, case): case for case in cases}
            for done, _ in enumerate(as_completed(running), 1):
                tell(done, len(cases))
        except BaseException:
            for worker in set(active_children()) - others:
                worker.kill()  # a run takes SIGTERM for its own end and the worker would begin the next one
            pool.shutdown(cancel_futures=True)  # waits: the interpreter's exit must not meet the pool's thread still closing
            raise
    return {case: future.result() for future, case in running.items()}


@contextmanager
def _signals_wait() -> Iterator[None]:
    """Ctrl-C and SIGTERM come after this; processes begun here hold them back too, until they say otherwise."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _ENDING) if hasattr(signal, "pthread_sigmask") else None
    try:
        yield
    finally:
        if before is not None:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _left_to_the_parent() -> None:
    """Ctrl-C on a terminal reaches the workers too: what it means is the parent's business."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _ENDING)


def run_case(case: Case) -> Result:
    """Run one case."""
    if case.threshold:
        return Result(run_with_threshold(case.scenario), None)
    prepared = prepare(case.scenario, case.overrides)
    run = prepared.run()
    return Result(measure(run, prepared.system), run if case.keep else None)
