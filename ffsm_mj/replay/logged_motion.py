"""Samples of a log between which nothing acts on the system but its actuators, recomputed in the core."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ffsm_mj._core.free_ticks import FreeTicks
from ffsm_mj._core.logged_law import LoggedLaw
from ffsm_mj.arrays import BoolArray, IntArray
from ffsm_mj.controller_protocol import Command
from ffsm_mj.replay.replayed_rows import LoggedRows, ReplayedRows
from ffsm_mj.simulation.plant import Plant

_WORTH = 8
"""Fewer rows than these are not worth what it takes to bound the motion: the next attempts wait longer and longer.

An attempt takes some 0.3 ms (``resting``), a row of ``baseline`` 40 us in the core and 65 us in the loop.
"""
_LONGEST_PAUSE = 16
"""Longest wait for the next attempt, in rows: attempts in vain then take 0.3 ms per ms of the loop at the most."""


class LoggedMotion:
    """Takes control ticks as a run does, under the commands of the log, while each ends at the logged state.

    Where the motion bound excludes every event, no overlap and no missing event is to be looked for either, and no force if
    the log says of none.
    """

    def __init__(self, plant: Plant, rows: ReplayedRows, command: Command, step_s: float, steps_per_tick: int) -> None:
        """Bind to the plant, the rows and the command of a replay."""
        self._plant, self._rows, self._command = plant, rows, command
        self._step_s, self._per_tick = step_s, steps_per_tick
        self._others = np.array(sorted(plant.actuation.others), dtype=np.intp)
        self._driven = np.setdiff1d(np.arange(plant.system.mj.nu), self._others)
        self._law = LoggedLaw(plant.data, command.effort, command.powered, *rows.copied)
        self._ticks = FreeTicks(
            plant.data,
            None,
            rows.filler,
            plant.balance.work,
            watched=None,
            overlaps={},
            look=None,
            count=None,
            after_step=plant.after_step,
            step_s=step_s,
            steps_per_tick=steps_per_tick,
        )
        self._runs: IntArray
        self._pause = self._waits = 0

    @classmethod
    def of(
        cls, plant: Plant, rows: ReplayedRows, command: Command, step_s: float, steps_per_tick: int
    ) -> LoggedMotion | None:
        """The same, if the core can take ticks of this plant: without sensors, delays and step-size control."""
        # Sensors and delays have instants of their own, and step-size control divides steps: the core knows none of these.
        possible = plant.sampler is None and plant.control is None and plant.integrator.control is None
        return cls(plant, rows, command, step_s, steps_per_tick) if possible else None

    def begin(self, logged: LoggedRows, usable: BoolArray, ticks: npt.NDArray[np.int64]) -> None:
        """Begin a block of rows: usable ones have a valid state."""
        self._law.begin(logged, self._rows.predicted)
        follows = np.zeros(len(ticks), dtype=np.bool_)
        follows[:-1] = usable[:-1] & usable[1:] & (ticks[:-1] >= 0) & (ticks[1:] == ticks[:-1] + 1)
        # On-off actuators have valves, which the loop opens and closes; logged contact forces need the rows of their
        # contacts.
        follows &= ~(logged.powered[:, self._others].any(axis=1) | logged.rows[:, self._rows.forces].any(axis=1))
        # Of each row the number of rows from it on that the core may write: the state of the next one is known.
        ends = np.where(follows, len(ticks), np.arange(len(ticks)))
        self._runs = np.minimum.accumulate(ends[::-1])[::-1] - np.arange(len(ticks))

    def take(self, line: int, tick: int, until_tick: float) -> int:
        """Write rows, from that of the state in ``data`` on, and make the steps between them.

        Args:
            line: Row of the state in its block.
            tick: Its tick.
            until_tick: Tick before which the first logged event is not.

        Returns:
            Number of rows written. The steps made are those of :attr:`steps`.
        """
        count = min(int(self._runs[line]), until_tick - tick)
        self._waits = max(self._waits - 1, 0)
        # After an event columns show the largest values since the row before it, which the loop has to pass on.
        if count < 1 or self._waits or self._rows.follows_event:
            return 0
        # Where an event may be near, the core would make one step and give up.
        written = self._written_rows(line, tick, int(count)) if self._plant.integrator.excludes_events() else 0
        self._pause = self._waits = min(2 * self._pause + 2, _LONGEST_PAUSE) if written < min(_WORTH, count) else 0
        return written

    def _written_rows(self, line: int, tick: int, count: int) -> int:
        plant, first = self._plant, tick * self._per_tick
        steps = plant.integrator.begin_core_steps()
        limits = plant.actuation.limits(self._command, plant.data, self._driven)
        # Contact forces are recomputed with checks of their own, row by row.
        if steps is None or steps.forces is not None or limits is None:
            return 0
        self._rows.complete(line)
        self._law.go_to(line)
        self._ticks.begin(tick, first, line)
        self._ticks.take(
            *steps,
            self._law,
            limits,
            decide=None,
            interrupted=None,
            report=None,
            warnings=[],
            ticks=tick + count,
            lines=line + count + 2,
            until_s=math.inf,
            clock=math.inf,
        )
        if self.steps > first:
            plant.integrator.motion.path.at_s = self._step_s
        written = self._ticks.ticks - tick
        # Without contact forces nothing varies with the rounding of normals: columns have to agree to the usual tolerance.
        self._rows.accuracy[line : line + written] = 0.0
        self._rows.forces_apart[line : line + written] = 0.0
        return written

    @property
    def steps(self) -> int:
        """Steps completed since the start of the run, after the last ticks."""
        return self._ticks.steps

    def pass_step(self) -> bool:
        """Whether a further step was made, and is to be completed."""
        return self._ticks.pass_step()
