"""One integration step as a path that can be evaluated at any time: restore, step for a shorter time."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.dynamics.free_stepper import WHOLE_STATE


class StepPath:
    """One integration step as a path: the state at any time since its start, reproducible bit by bit.

    Attributes:
        start: The state that the path starts from.
        at_s: Time at which ``data`` is, where that is known: who moves it by other means says so here.
        poll: Called before every move; what it raises ends the search.
        integrate: Moves ``data`` on by a time in s; derived quantities need not follow.
        arrived: Called after every move, with derived quantities current.
    """

    def __init__(self, model: Any, data: Any) -> None:
        """Wrap model and data; the model's own time step is restored after every move."""
        self._model, self._data = model, data
        self.poll: Callable[[], None] = _nothing
        self.integrate: Callable[[float], None] = self._free_step
        self.on_event_located: Callable[[], None] = _nothing
        self.at_s = math.nan
        self.start = np.empty(mujoco.mj_stateSize(model, WHOLE_STATE))

    def move_to(self, time_s: float) -> None:
        """Put ``data`` at a time since the ``start`` state, all derived quantities current."""
        if time_s == self.at_s:
            return
        self.poll()
        self.at_s = math.nan
        mujoco.mj_setState(self._model, self._data, self.start, WHOLE_STATE)
        if time_s > 0.0:
            self.integrate(time_s)
        mujoco.mj_forward(self._model, self._data)
        self.on_event_located()
        self.at_s = time_s

    def _free_step(self, duration_s: float) -> None:
        with time_step(self._model, duration_s):
            mujoco.mj_step(self._model, self._data)


def _nothing() -> None:
    """Nobody wants to know."""


@contextmanager
def time_step(model: Any, duration_s: float) -> Iterator[None]:
    """Another time step of a model for a while."""
    usual = model.opt.timestep
    model.opt.timestep = duration_s
    try:
        yield
    finally:
        model.opt.timestep = usual
