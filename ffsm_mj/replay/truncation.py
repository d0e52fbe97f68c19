"""What of the residuals of a run is truncation: its steps made again from the logged states, in halves and shorter.

The truncation error of a step falls with the fifth power of its duration, that of a time with the fourth. What does not fall
so (an impulse of the wrong sign, a leak at a rate, or at each step) stays in the residual as it is.
"""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
import numpy.typing as npt

from ffsm_mj.actuation.step_error import StepError
from ffsm_mj.arrays import FloatArray
from ffsm_mj.assembly.blas_threads import one_blas_thread
from ffsm_mj.dynamics.free_stepper import WHOLE_STATE
from ffsm_mj.errors import InputError
from ffsm_mj.log.sampling import Sampling
from ffsm_mj.model.mujoco_warnings import collected_warnings
from ffsm_mj.records.events import RunEnded
from ffsm_mj.records.metadata import logged_start_s
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.records.signals import SUBSYSTEMS
from ffsm_mj.replay.log_replay import LogReplay
from ffsm_mj.replay.metadata import state_metadata
from ffsm_mj.replay.scene import LogScene, log_scene
from ffsm_mj.verification.checks import DEFAULT_TOLERANCE, CheckAccumulator
from ffsm_mj.verification.refined import Refined
from ffsm_mj.verification.residuals import STRETCH_STEPS

_MOST_HALVINGS = 6
_OF_ORDER_FOUR, _FALLS, _HOPELESS = 16.0, 6.0, 3.0
"""What a halving takes off falls at the next one by the first number for truncation, by 4 and 2 for lower orders: at least
by the second in the end, and by the third from the start."""
_ROUNDING = 4e-14
"""Differences over (1 + scale) below this are rounding: a few units in the last place of each of the terms that cancel."""
_RESIDUALS = 7 * len(SUBSYSTEMS) + 1
_SHARE = 0.1
"""Of what a check allows, for what is left out of the errors of all steps together."""


@np.errstate(all="ignore")
@one_blas_thread()
def refined(log: RunLog, look: Callable[[], object] = lambda: None) -> Refined | None:
    """The balance of a run with shorter steps from the same states; None where nothing can be replayed.

    Args:
        log: The run.
        look: Called now and then; what it raises ends it.
    """
    try:
        scene = log_scene(log)
        again = _Refining(scene, log)
    except InputError:
        return None
    layout, metadata = log.header.layout, dict(log.header.metadata) | state_metadata(scene)
    states, half, without = (CheckAccumulator(layout, metadata) for _ in range(3))
    period_s, start_s = scene.scenario.time_step_s * scene.scenario.steps_per_tick, logged_start_s(log.header.metadata)
    sampling = Sampling(period_s, log.instants_s, start_s)
    with collected_warnings([]):
        for block in log.blocks():
            look()
            again.corrections = []
            rows = again.take(block, sampling.ticks(block[:, layout.time]))
            added = np.array(again.corrections)
            states.rows(rows)
            half.rows(rows, added[:, 0])
            without.rows(rows, added[:, 1])
    return Refined(scene.scenario.time_step_s, states, half, without)


class _Refining(LogReplay):
    """A replay that makes every flight in shorter steps, too.

    Attributes:
        corrections: By row, what the residuals since the start would have more at half the step, and without truncation:
            those of energy, P and L of each subsystem, then that of the heat of sliding, (2, 22).
    """

    def __init__(self, scene: LogScene, log: RunLog) -> None:
        super().__init__(scene, log)
        self._error = StepError(scene.plant.system, scene.plant.data, scene.plant.balance)
        self._so_far = np.zeros((2, _RESIDUALS))
        self.corrections: list[FloatArray] = []
        steps = min(scene.scenario.ticks * scene.scenario.steps_per_tick, STRETCH_STEPS)
        self._negligible = _SHARE * DEFAULT_TOLERANCE / steps

    def _take(self, block: FloatArray, ticks: npt.NDArray[np.int64]) -> FloatArray:
        self._rows_done: list[FloatArray] = []
        rows = super()._take(block, ticks)
        self._done_up_to(len(block))
        self.corrections += self._rows_done
        return rows

    def _line(self, line: int, tick: int) -> None:
        self._done_up_to(line)
        super()._line(line, tick)
        self._done_up_to(line + 1)

    def _done_up_to(self, line: int) -> None:
        """Rows that nothing leads to have what was found before."""
        self._rows_done += [self._so_far.copy() for _ in range(line - len(self._rows_done))]

    def _before_substep(self, duration_s: float, left_s: float) -> None:
        """Make the coming flight, then the same in shorter steps; nothing has moved after."""
        motion, control = self._plant.integrator.motion, self._plant.integrator.control
        start = np.empty(mujoco.mj_stateSize(motion.model, WHOLE_STATE))
        mujoco.mj_getState(motion.model, motion.data, start, WHOLE_STATE)
        plan = dict(vars(control)) if control is not None else {}
        self._at_start = start, self._plant.integrator.snapshot()
        try:
            self._error.begin(measured=True)
            flown_s = self._plant.integrate(duration_s, left_s)
            whole = self._left_over(flown_s)
            self._plant.integrator.control = None
            if self._size(whole) > self._left_out(flown_s):
                self._refine(whole, flown_s, left_s)
        except RunEnded:  # the flight itself says so
            pass
        finally:
            self._plant.integrator.control = control
            if control is not None:
                vars(control).update(plan)
            self._back_to_start()

    def _refine(self, whole: FloatArray, flown_s: float, left_s: float) -> None:
        found, taken, ratio = [whole], 0.0, 0.0
        for halvings in range(1, _MOST_HALVINGS + 1):
            self._back_to_start()
            found.append(self._in_parts(flown_s, left_s, 2**halvings))
            before, taken = taken, self._size(found[-2] - found[-1])
            if halvings == 1:
                continue
            ratio = min(before / taken, _OF_ORDER_FOUR) if taken > _ROUNDING else _OF_ORDER_FOUR
            # Higher powers of a long step, and stiff friction, may outweigh the fourth in the first halvings.
            if ratio < _HOPELESS:
                return
            if ratio >= _FALLS and taken / (ratio - 1.0) <= self._left_out(flown_s):
                break
        if ratio < _FALLS:
            return
        # The rest of the geometric series that the differences are: 1, 1/16, 1/256, ... for short steps.
        limit = found[-1] - (found[-2] - found[-1]) / (ratio - 1.0)
        self._so_far += (found[1] - whole, limit - whole)

    def _left_out(self, duration_s: float) -> float:
        """Error of a (sub-)step over (1 + scale) that is left out: steps before a stop are many and short."""
        return max(self._negligible * duration_s / self._step_s, _ROUNDING)

    def _in_parts(self, duration_s: float, left_s: float, parts: int) -> FloatArray:
        """Residuals over a time in so many steps, with the active contacts, friction modes and method of the one step.

        With others chosen in between, the parts would solve another problem, to which nothing converges.
        """
        total, part_s = np.zeros(_RESIDUALS), duration_s / parts
        for part in range(parts):
            self._error.begin(measured=True)
            if part:
                self._plant.continue_step(part_s)
            else:
                self._plant.integrate(part_s, left_s)
            total += self._left_over(part_s)
        return total

    def _left_over(self, duration_s: float) -> FloatArray:
        residuals = self._error.residuals(duration_s, self._plant.integrator.exchanged(duration_s))
        if self._plant.integrator.motion.grasped_object is not None:
            # What passes between robot and object is what the object gained: nothing is left of it, and all for the robot.
            residuals[1], residuals[2] = residuals[0], 0.0
        return np.append(residuals, self._plant.integrator.work_without_heat(duration_s))

    def _size(self, residuals: FloatArray) -> float:
        grasped = self._plant.integrator.motion.grasped_object is not None
        return self._error.over_scale(residuals[:-1].reshape(-1, 7), grasped=grasped) + abs(float(residuals[-1]))

    def _back_to_start(self) -> None:
        path, (start, restore) = self._plant.integrator.motion.path, self._at_start
        path.start[:], path.at_s = start, np.nan
        path.move_to(0.0)
        restore()
