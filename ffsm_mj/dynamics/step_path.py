"""One integration step as a path: the state at any time in it, by integrating a shorter step from its start."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import mujoco
import numpy as np

from ffsm_mj._core.steppers import WHOLE_STATE


class StepPath:
    """One integration step as a path, reproducible bit by bit.

    Event localisation integrates a shorter step from the same start instead of interpolating: the state at an event has the
    full order of the integrator, and a log replay reproduces it.

    Attributes:
        start: State at the start of the step.
        at_s: Time in the step at which ``data`` is; NaN if unknown. Whoever moves ``data`` by other means must set it.
        poll: Called before every move; an exception it raises ends the search.
        integrate: Integrates ``data`` for a time in s; derived quantities need not be updated.
        on_event_located: Called after every move, with derived quantities current.
    """

    def __init__(self, model: Any, data: Any) -> None:
        """Wrap model and data; the model's own time step is restored after every move."""
        self._model, self._data = model, data
        self.poll: Callable[[], None] = _nothing
        self.integrate: Callable[[float], None] = self._free_step
        self.on_event_located: Callable[[], None] = _nothing
        self.at_s = math.nan
        self.start = np.empty(mujoco.mj_stateSize(model, WHOLE_STATE))
        self._left, self._left_at_s = np.empty_like(self.start), math.nan

    def move_to(self, time_s: float) -> None:
        """Set ``data`` to a time since ``start``, with all derived quantities current."""
        if time_s == self.at_s:
            return
        self.poll()
        model, data = self._model, self._data
        # From the end of a step to its start and back, as at most steps: forces and works of its stages are still those.
        if self.at_s != 0.0:
            self._left_at_s = self.at_s
            mujoco.mj_getState(model, data, self._left, WHOLE_STATE)
        returns, self.at_s = time_s == self._left_at_s, math.nan
        mujoco.mj_setState(model, data, self._left if returns else self.start, WHOLE_STATE)
        if time_s > 0.0 and not returns:
            self._left_at_s = math.nan
            self.integrate(time_s)
        mujoco.mj_forward(self._model, self._data)
        self.on_event_located()
        self.at_s = time_s

    def _free_step(self, duration_s: float) -> None:
        with time_step(self._model, duration_s):
            mujoco.mj_step(self._model, self._data)


def _nothing() -> None:
    """Do nothing."""


@contextmanager
def time_step(model: Any, duration_s: float) -> Iterator[None]:
    """Context with another time step of a model."""
    usual = model.opt.timestep
    model.opt.timestep = duration_s
    try:
        yield
    finally:
        model.opt.timestep = usual
