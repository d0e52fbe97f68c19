"""How steps are divided where the error of the shortest ones is none of truncation."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from types import SimpleNamespace
from typing import Any, cast

import pytest

from ffsm_mj.simulation.step_control import StepControl

STEP_S = 1e-3
BUDGET = 5e-15
PARTS = 1 << 16
TRUNCATION = 1e-4
ROUNDING = 1e-13


class _Error:
    """An error that is a function of the duration of a sub-step alone."""

    is_measured = True

    def __init__(self, of: Callable[[float], float]) -> None:
        self._of = of

    def begin(self, *, measured: bool) -> None:
        assert measured

    def bound(self, duration_s: float) -> float:
        raise NotImplementedError

    def relative(self, duration_s: float, exchanges: Iterable[Any], *, grasped: bool) -> float:
        assert not grasped
        return self._of(duration_s)


def _divided(error_of: Callable[[float], float]) -> list[float]:
    """Durations of the sub-steps of a time step, s, where the error of one is a function of its duration alone."""
    path = SimpleNamespace(at_s=0.0, move_to=lambda _: None)
    motion = cast("Any", SimpleNamespace(stiff=None, step=lambda _: True, path=path, grasped_object=None))
    control, left_s, steps = StepControl(BUDGET, STEP_S, _Error(error_of), PARTS), STEP_S, list[float]()
    while left_s > 1e-9 * STEP_S:
        control.begin(left_s, pushed=True)
        duration_s, _ = control.step(motion, left_s, left_s, lambda _: [])
        steps.append(duration_s)
        left_s -= duration_s
    assert sum(steps) == pytest.approx(STEP_S, rel=1e-9)
    return steps


def test_rounding_of_the_shortest_steps_does_not_let_the_rest_be_one_long_step() -> None:
    """Rounding is 1e5 times what the budget leaves to the shortest trial, an 8192nd of the step: 5e-15 / 8192.

    A whole step leaves 1e-4. As many of the shortest leave 8192 * 1e-13, and a longer one may leave twice their rate.
    """

    def error_of(duration_s: float) -> float:
        return TRUNCATION * (duration_s / STEP_S) ** 5 + ROUNDING

    assert sum(map(error_of, _divided(error_of))) < 2.0 * 8192 * ROUNDING


def test_a_leak_is_not_divided() -> None:
    """An error in proportion to the duration is as large in many steps as in one."""
    assert _divided(lambda duration_s: 1e-7 * duration_s / STEP_S) == [STEP_S]
