"""What of the residuals of a run is truncation: its steps made again from the logged states, in halves and shorter.

The truncation error of a step falls with the fifth power of its duration, that of a time with the fourth. What does not fall
so (an impulse of the wrong sign, a leak at a rate, or at each step) stays in the residual as it is.
"""

from __future__ import annotations

import itertools
import math
import statistics
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np
import numpy.typing as npt

from ffsm_mj._core.steppers import WHOLE_STATE
from ffsm_mj.arrays import FloatArray
from ffsm_mj.assembly.process import one_blas_thread
from ffsm_mj.balance.step_error import StepError
from ffsm_mj.errors import InputError
from ffsm_mj.model.mujoco_process import collected_warnings
from ffsm_mj.records.events import RunEnded
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.replay.log_replay import LogReplay
from ffsm_mj.replay.scene import LogScene, log_scene, state_metadata
from ffsm_mj.simulation.step_control import StepLimitError
from ffsm_mj.verification.check_result import Check
from ffsm_mj.verification.checks import RESIDUALS, CheckAccumulator
from ffsm_mj.verification.residuals import DRIFT_WINDOW_STEPS, ResidualDrift, drift_window_s
from ffsm_mj.verification.truncation import ENTRIES, Refined, TruncationAnalysis

_USUAL_HALVINGS, _MOST_HALVINGS = 6, 11
"""Most halvings of a step, and of one whose last halving took off less than an eighth of what the one before did.

The motion is far too fast for such a step, but what is found converges at order three or more.
"""
_OF_ORDER_FOUR = 16.0
"""What a halving takes off a truncation error of order four, over what the next one takes off."""
_ROUNDING = 1e-15
"""Rounding of the residual of one step over (1 + scale): some units in the last place of each of the terms that cancel."""
_ENTRY_OF = np.array([ENTRIES.index((check, subsystem)) for check, subsystem, _ in RESIDUALS])
"""Entry of each residual."""
_CLEARLY = 100.0
"""Changes that exceed their rounding by this factor show the order of a step."""
_STEPS_OF_AN_ORDER = 8
"""So many steps that show an order show that of the method."""
_LEAST_S = 20.0
"""Least wall time of an analysis unless the caller gives one."""
_STEPS_OF_A_STEP = 8.0
"""Most steps of fast motion are known from themselves, two halves and four quarters: 7 steps."""
_NOT_TRIED = 0.05
"""Share of what a check allows for the residuals of all steps that are not made again."""
_NOT_KNOWN = 0.75
"""Share of it for the errors of the limits of the other steps; errors of many steps mostly cancel."""
_NOT_KNOWN_AGAIN = 0.45
"""The same where the first analysis leaves open whether a check fails by truncation alone: the errors stay in the residual
without truncation, and its bound counts them again, so that _NOT_TRIED + 2 _NOT_KNOWN_AGAIN < 1 for a verdict."""


@dataclass
class AnalysisLimits:
    """What ends an analysis of the truncation before it has a verdict.

    Attributes:
        seconds: Largest wall time, s.
        steps: Largest number of steps that are made beside those of the replay.
        stopped: Polled before every step: whether to end.
        report: Called with the number of samples done and their total.
    """

    seconds: float = math.inf
    steps: float = math.inf
    stopped: Callable[[], bool] = lambda: False
    report: Callable[[float, float], None] | None = None
    _end_s: float = field(default=math.inf, init=False)
    _left: float = field(default=math.inf, init=False)

    def begin(self) -> None:
        """Start the clock."""
        self._end_s, self._left = time.monotonic() + self.seconds, self.steps

    def step(self) -> None:
        """Count a step that is about to be made.

        Raises:
            _NoVerdictError: It would exceed a limit.
        """
        self._left -= 1
        if self.stopped():
            raise _NoVerdictError("interrupted")
        if time.monotonic() > self._end_s:
            raise _NoVerdictError(f"it would take more than {self.seconds:g} s")
        if self._left < 0:
            raise _NoVerdictError(f"it would take more than {self.steps:g} steps")


def usual_seconds(log: RunLog) -> float:
    """Largest wall time of an analysis unless the caller gives one: that of the run itself, 20 s at least."""
    return max(_LEAST_S, log.outcome.wall_s if log.outcome is not None else 0.0)


def usual_steps(log: RunLog) -> float:
    """Largest number of steps of an analysis that must end at the same step on every machine: 8 times those of the run."""
    outcome = log.outcome
    return _STEPS_OF_A_STEP * max(outcome.steps, outcome.sub_steps) if outcome is not None else 0.0


class _NoVerdictError(Exception):
    """An analysis ends without a verdict; the message says why."""


@np.errstate(all="ignore")
@one_blas_thread()
def analyze_truncation(log: RunLog, checks: Iterable[Check], limits: AnalysisLimits | None = None) -> TruncationAnalysis:
    """Find which share of the residuals of a run is truncation, by a replay with shorter steps from the same states.

    Args:
        log: The run.
        checks: Its checks: the residuals of those that may fail by truncation are found, to their tolerances.
        limits: What ends the analysis early; None: nothing.
    """
    limits = limits if limits is not None else AnalysisLimits()
    limits.begin()
    analysis, checks = TruncationAnalysis(None), tuple(checks)
    try:
        for share in (_NOT_KNOWN, _NOT_KNOWN_AGAIN):
            analysis = TruncationAnalysis(_refined(log, checks, limits, share))
            # The first pass spends less. Only a verdict that its errors leave open is worth a second one with smaller
            # shares.
            if not analysis.leaves_open(checks):
                break
        return analysis
    except _NoVerdictError as end:
        # The second pass only sharpens the first: where it does not end, the first one counts.
        return analysis if analysis.refined is not None else TruncationAnalysis(None, str(end))
    except InputError as error:
        return TruncationAnalysis(None, error.lines[0])


def _refined(log: RunLog, checks: Iterable[Check], limits: AnalysisLimits, not_known: float) -> Refined:
    """Residuals of a log with shorter steps; ``not_known`` of what a check allows is for the errors of their limits."""
    allowed = {(check.name, check.subsystem): check.tolerance for check in checks if check.may_be_truncation}
    scene = log_scene(log)
    spared = np.outer((_NOT_TRIED, not_known), [allowed.get(entry, math.inf) for entry in ENTRIES])
    again = _Refining(scene, log, spared, limits)
    layout, metadata = log.header.layout, dict(log.header.metadata) | state_metadata(scene)
    states, half, without = (CheckAccumulator(layout, metadata) for _ in range(3))
    bounds = [ResidualDrift(drift_window_s(metadata)) for _ in ENTRIES]
    with collected_warnings([]):
        for block in log.blocks():
            again.corrections, again.bounds = [], []
            rows = again.take(block)
            added, unknown, nothing = np.array(again.corrections), np.array(again.bounds), np.zeros(len(block))
            states.rows(rows)
            half.rows(rows, added[:, 0])
            without.rows(rows, added[:, 1])
            for bound, column in zip(bounds, unknown.T, strict=True):
                bound.add(block[:, layout.time], column[:, None], nothing)
    largest = {entry: bound.worst.size for entry, bound in zip(ENTRIES, bounds, strict=True) if entry in allowed}
    return Refined(scene.scenario.time_step_s, states, half, without, largest, again.orders)


class _Refining(LogReplay):
    """A replay that makes every step in shorter ones, too.

    Attributes:
        corrections: By row, what the residuals since the start would have more at half the step, and without truncation:
            (2, number of :data:`~ffsm_mj.verification.checks.RESIDUALS`).
        bounds: By row, bound on the error of the latter, by entry: see :data:`~ffsm_mj.verification.truncation.ENTRIES`.
    """

    def __init__(self, scene: LogScene, log: RunLog, spared: FloatArray, limits: AnalysisLimits) -> None:
        """Start at the beginning of a log.

        Args:
            scene: Its scene.
            log: The log.
            spared: By entry, what may remain of residuals that are not made again, and of errors of the others' limits, in
                the whole run, (2, entries); infinite for those that pass.
            limits: What ends the analysis early.
        """
        super().__init__(scene, log)
        self._logged_motion = None  # every step is made in parts
        self._error = StepError(scene.plant.system, scene.plant.data, scene.plant.balance)
        self._limits, self._samples, self._expected = limits, 0, scene.scenario.ticks + 1
        self._so_far, self._bound = np.zeros((2, len(RESIDUALS))), np.zeros(len(ENTRIES))
        self._powers: list[list[float]] = [[] for _ in ENTRIES]
        self.corrections: list[FloatArray] = []
        self.bounds: list[FloatArray] = []
        # Checks allow their tolerance over a window of the run, not over all of it: shares are those of its steps.
        steps = min(scene.scenario.ticks * scene.scenario.steps_per_tick, DRIFT_WINDOW_STEPS)
        self._shares = spared / steps
        self._spare = np.zeros_like(self._shares)

    @property
    def orders(self) -> dict[tuple[str, str], float]:
        """By entry, the median of the orders of the steps that show one: a kink inside a step lowers that of this step."""
        shown = zip(ENTRIES, self._powers, strict=True)
        return {entry: statistics.median(item) for entry, item in shown if len(item) >= _STEPS_OF_AN_ORDER}

    def _take(self, block: FloatArray, ticks: npt.NDArray[np.int64]) -> FloatArray:
        self._first = len(self.corrections)
        rows = super()._take(block, ticks)
        self._done_up_to(len(block))
        return rows

    def _lines(self, line: int, tick: int) -> int:
        self._done_up_to(line)
        written = super()._lines(line, tick)
        self._done_up_to(line + 1)
        if self._limits.report is not None:
            self._samples += 1
            self._limits.report(self._samples, max(self._expected, self._samples))
        return written

    def _done_up_to(self, line: int) -> None:
        """Rows that nothing leads to have what was found before."""
        for _ in range(self._first + line - len(self.corrections)):
            self.corrections.append(self._so_far.copy())
            self.bounds.append(self._bound.copy())

    def _before_substep(self, duration_s: float, left_s: float) -> None:
        """Make the coming step, then the same in shorter ones; nothing has moved after."""
        motion, control = self._plant.integrator.motion, self._plant.integrator.control
        start = np.empty(mujoco.mj_stateSize(motion.model, WHOLE_STATE))
        # All trials start from the same bits, those of the run included: else differences of states would enter the
        # residuals.
        mujoco.mj_getState(motion.model, motion.data, start, WHOLE_STATE)
        plan = dict(vars(control)) if control is not None else {}
        self._at_start = start, self._plant.integrator.snapshot()
        try:
            self._limits.step()
            self._error.begin(measured=True)
            done_s = self._plant.integrate(duration_s, left_s)
            whole, scales = self._residuals(done_s), np.append(self._error.scales().ravel(), 1.0)
            # Step-size control would divide the parts again, by its own estimate: they have to be those of the halving.
            self._plant.integrator.control = None
            self._refine(whole, scales, done_s, left_s)
        except (RunEnded, StepLimitError):  # the step itself says so
            pass
        finally:
            self._plant.integrator.control = control
            if control is not None:
                vars(control).update(plan)
            self._back_to_start()

    def _refine(self, whole: FloatArray, scales: FloatArray, done_s: float, left_s: float) -> None:
        """Find what each entry of the residuals of a step would be without truncation, and a bound on the error of that.

        Args:
            whole: Residuals of the step.
            scales: 1 + scale of each entry.
            done_s: Duration of the step.
            left_s: Remaining time of the grid step.
        """
        # What steps before did not use of their share is there for this one: most have little truncation, few have much.
        self._spare += self._shares * (done_s / self._step_s)
        not_tried, not_known = self._spare
        error, rounding = _by_entry(whole), _ROUNDING * scales
        # Below its rounding a residual does not fall with shorter steps, and what is spared needs no verdict.
        unknown = error > np.maximum(not_tried, rounding)
        not_tried[~unknown] -= np.minimum(error, not_tried)[~unknown]
        divisions, extrapolated, limit, bound = [whole], whole, whole.copy(), np.zeros(len(ENTRIES))
        for halvings in range(1, _MOST_HALVINGS + 1):
            # An error that does not fall by eight with a halving is no truncation of order three or more: further halvings
            # are in vain.
            if not unknown.any() or (halvings > _USUAL_HALVINGS and not (unknown & _converges(divisions)).any()):
                break
            self._back_to_start()
            try:
                divisions.append(self._in_parts(done_s, left_s, 2**halvings))
            except RunEnded:  # shorter steps are refused on the way: what was found before is known no better
                break
            # Each part adds its own rounding: finer divisions end where this exceeds what they take off.
            before, rounding = extrapolated, 2**halvings * _ROUNDING * scales
            # Richardson: of order four, 1/15 of the last change is left (Hairer, Norsett & Wanner, *Solving ODEs I*, sec.
            # II.4).
            extrapolated = divisions[-1] + (divisions[-1] - divisions[-2]) / (_OF_ORDER_FOUR - 1.0)
            error = self._error_of_limit(divisions, extrapolated, before)
            known = unknown & (error <= np.maximum(not_known, rounding))
            limit[known[_ENTRY_OF]], bound[known] = extrapolated[known[_ENTRY_OF]], error[known]
            not_known[known] -= np.minimum(error, not_known)[known]
            unknown &= ~known
        if len(divisions) == 1:
            return
        self._note_orders(divisions, scales)
        # What does not converge at order four is bounded by its two finest divisions, and the rounding of their sums.
        limit[unknown[_ENTRY_OF]] = divisions[-1][unknown[_ENTRY_OF]]
        bound[unknown] = (_by_entry(divisions[-1] - divisions[-2]) + rounding)[unknown]
        self._so_far += (divisions[1] - whole, limit - whole)
        self._bound += bound

    def _note_orders(self, divisions: Sequence[FloatArray], scales: FloatArray) -> None:
        """Note the order that a step shows by the last of its changes that are not rounding, by entry."""
        changes = [_by_entry(coarse - fine) for coarse, fine in itertools.pairwise(divisions)]
        for entry, powers in enumerate(self._powers):
            rounding = _CLEARLY * _ROUNDING * scales[entry]
            clear = [
                (before[entry], after[entry])
                for halvings, (before, after) in enumerate(itertools.pairwise(changes), 2)
                if min(before[entry], after[entry]) > 2**halvings * rounding
            ]
            powers.extend(math.log2(before / after) for before, after in clear[-1:])

    @staticmethod
    def _error_of_limit(divisions: Sequence[FloatArray], limit: FloatArray, before: FloatArray) -> FloatArray:
        """Error of the residuals without truncation that follow from the last divisions, by entry.

        Richardson's extrapolation of order four is exact if a halving takes 16 times as much off as the next one. If it
        takes r times as much, the divisions go on as a geometric series of ratio r: what this series leaves differs from
        what the extrapolation leaves by the last change of the latter over r - 1. Order four gives a change over 15, where
        the next power of the step gives one over 31. An error of another order stays in the extrapolation as it is: nothing
        of a leak at a rate is taken off, one at each step doubles with each halving and never converges. Of one halving no
        ratio is known: the error is bounded by its change, where nothing but truncation is found, and by what is left where
        more seems to be. One step and two may agree by chance where the motion is too fast for both.

        Args:
            divisions: Residuals in one step, two, four and so on; two at least.
            limit: Their extrapolation.
            before: That of all but the last.
        """
        second = _by_entry(divisions[-2] - divisions[-1])
        if len(divisions) == 2:
            return np.maximum(second, _by_entry(limit))
        # A ratio above that of order four is chance, or an error that changes its sign: it must not make the bound smaller.
        ratio = np.minimum(_by_entry(divisions[-3] - divisions[-2]) / second, _OF_ORDER_FOUR)
        size = _by_entry(limit - before)
        # A series whose terms do not fall has no limit, and the error no bound.
        return np.where(ratio > 1.0, size / (ratio - 1.0), np.where(size > 0.0, np.inf, 0.0))

    def _in_parts(self, duration_s: float, left_s: float, parts: int) -> FloatArray:
        """Residuals over a time in so many steps, with the active contacts, friction modes and method of the one step.

        With others chosen in between, the parts would solve another problem, to which nothing converges.
        """
        total, part_s = np.zeros(len(RESIDUALS)), duration_s / parts
        for part in range(parts):
            self._limits.step()
            self._error.begin(measured=True)
            if part:
                self._plant.continue_step(part_s)
            else:
                self._plant.integrate(part_s, left_s)
            total += self._residuals(part_s)
        return total

    def _residuals(self, duration_s: float) -> FloatArray:
        """Residuals of the (sub-)step that was just made, (22,)."""
        exchanges = self._plant.integrator.exchanged(duration_s)
        friction_J = sum(exchange.friction_J for exchange in exchanges)
        return np.append(self._error.residuals(duration_s, exchanges), friction_J)

    def _back_to_start(self) -> None:
        path, (start, restore) = self._plant.integrator.motion.path, self._at_start
        path.start[:], path.at_s = start, np.nan
        path.move_to(0.0)
        restore()


def _converges(divisions: Sequence[FloatArray]) -> npt.NDArray[np.bool_]:
    """Whether the last halving changed each entry by less than an eighth of what the one before did."""
    before, last = (_by_entry(coarse - fine) for coarse, fine in zip(divisions[-3:-1], divisions[-2:], strict=True))
    return np.asarray(8.0 * last < before)


def _by_entry(residuals: FloatArray) -> FloatArray:
    """Norm of each entry of residuals, (number of residuals,): see :data:`~ffsm_mj.verification.truncation.ENTRIES`."""
    return np.sqrt(np.bincount(_ENTRY_OF, residuals * residuals))
