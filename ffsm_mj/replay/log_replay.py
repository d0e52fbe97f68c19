"""Log replay: integrates from each sample of a log to the next with the logged efforts, and compares."""

from __future__ import annotations

import math
from collections.abc import Sequence

import mujoco
import numpy as np
import numpy.typing as npt

from ffsm_mj.actuation.actuation import Actuation
from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.assembly.contact_models import declared_contact_models, impacts_of
from ffsm_mj.assembly.grasps import grasp_models_of
from ffsm_mj.assembly.step_control import step_control
from ffsm_mj.balance.balance import Balance
from ffsm_mj.contact.step_control import StepLimitError
from ffsm_mj.contact_models.interface import Scene
from ffsm_mj.controller_protocol import Command
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.errors import InputError
from ffsm_mj.log.recorder import BLOCK_ROWS
from ffsm_mj.log.sampling import BETWEEN, NOWHERE
from ffsm_mj.records.columns import Columns, Row, same_names
from ffsm_mj.records.events import RunEnded
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.records.signals import FORCE_RESIDUAL, Layout, coordinate_keys, rate_keys
from ffsm_mj.replay.contact_check import ContactCheck
from ffsm_mj.replay.contact_model_check import ContactModelCheck
from ffsm_mj.replay.impact_check import ImpactCheck
from ffsm_mj.replay.logged_events import LoggedEvent, LoggedEvents
from ffsm_mj.replay.scene import LogScene
from ffsm_mj.simulation.integrator import EventDrivenIntegrator
from ffsm_mj.simulation.rows import RowWriter
from ffsm_mj.simulation.state_signals import StateSignals
from ffsm_mj.verification.agreement import AGREES, Agreement, Discrepancy, scales

_NO_TIME = 1e-15
"""Relative time difference within which an event is at the same time as the preceding state, as at a control tick.

If its state differs nevertheless, a step began in between that is shorter than rounding, with a drift projection.
"""
_FOLLOWED = 1e-14
"""Relative rounding of a state transferred from another model; a drift projection changes a state by more."""
_HUGE = 1e10
"""MuJoCo rejects states with larger values."""


class _RowBlock:
    """A block of rows, split into states and efforts."""

    def __init__(self, block: FloatArray, layout: Layout, state: IntArray, actuation: Actuation) -> None:
        self.rows, self.times, self.states = block, block[:, layout.time], np.ascontiguousarray(block[:, state])
        efforts = (np.nan_to_num(block[:, layout.places(actuation.keys[what])]) for what in ("command", "applied"))
        self.asked, self.applied = map(np.ascontiguousarray, efforts)
        self.ctrl = self.applied / actuation.gear
        # An actuator without power has neither a command nor an applied effort.
        self.powered = (self.asked != 0.0) | (self.applied != 0.0)


class LogReplay:
    """Integrates from each sample to the next, and recomputes all columns that follow from states and efforts.

    Attributes:
        motion: Agreement of each sample with the state integrated from the previous one.
        columns: Agreement of each recomputed column with the logged one.
        impacts: Agreement of each field of the events, and of the states before them.
        free: See :class:`ffsm_mj.balance.balance.Balance`.
    """

    def __init__(self, scene: LogScene, log: RunLog) -> None:
        """Build the models of a log."""
        model, scenario = scene.system.mj, scene.scenario
        self._model, self._data = model, mujoco.MjData(model)
        self._step_s, self._steps, self._last_tick = scenario.time_step_s, scenario.steps_per_tick, scenario.ticks
        self._period_s = self._step_s * self._steps
        mujoco.mj_forward(model, self._data)
        self._scene, self._free = Scene(scene.system, self._data), Motion(model, self._data)
        self._impacts, self._lasting = impacts_of(scenario, self._scene, scene.pairs)
        declared = declared_contact_models(scenario, self._scene)
        captures = grasp_models_of(scenario, self._scene, self._free, self._impacts, scene.held, (self._lasting, *declared))
        self._course = EventDrivenIntegrator(self._free, (self._impacts, self._lasting, *captures, *declared))
        self._balance = Balance(scene.system, self._data, self._free.momentum, notes=BLOCK_ROWS)
        self.free = self._balance.free
        self._course.control = step_control(scenario, scene.system, self._data, self._balance)
        self._actuation, self._command = scene.actuation, Command.off(int(model.nu))
        self._again = np.zeros((BLOCK_ROWS, len(log.header.layout.keys)))
        self._predicted = np.zeros((BLOCK_ROWS, model.nq + model.nv))
        self.motion, self.columns, self.impacts = Agreement(), Agreement(), Agreement()
        self._impact_check = ImpactCheck(self._scene, scene.pairs, self._impacts, self.impacts)
        self._events = LoggedEvents(scene.system, log, self._step_s, self.impacts, self._impact_check.fault_of)
        self._contact_model_check = ContactModelCheck(self._course, self._events, self.impacts)
        self._find_columns(scene, log.header.layout)
        self._tick: int | None = None
        self._completed = 0
        self._ending = False

    def _find_columns(self, scene: LogScene, layout: Layout) -> None:
        """Bind the columns of all parts to the layout of the log.

        Raises:
            InputError: The columns of the log are not those of its models.
        """
        state = StateSignals(scene.system, self._data, scene.task.tip_site if scene.task else None)
        known = [*state.columns, *self._balance.columns, *self._course.columns, *self._actuation.columns]
        # Columns of the controller cannot be recomputed: they are copied from the log.
        controller_signals = tuple(signal for signal in layout.signals if signal.group in ("controller", "phase"))
        self._controller_columns, self._controller_values = (
            layout.places(signal.key for signal in controller_signals),
            np.zeros(len(controller_signals)),
        )
        row = _row_of_log([*known, Columns(controller_signals, live=self._controller_values)], layout)
        self._rows = RowWriter(row, state.sampler, self._again)
        self._resume = [(part.resume, layout.places(s.key for s in part.signals)) for part in known if part.resume]
        joints, self._layout = scene.system.joints.values(), layout
        self._state = layout.places((*coordinate_keys(joints), *rate_keys(joints)))
        self._residual = layout.index[f"balance.{FORCE_RESIDUAL}"]
        self._forces_apart = np.zeros(BLOCK_ROWS)
        self._known = np.setdiff1d(np.arange(len(layout.keys)), np.concatenate((self._controller_columns, self._state)))
        self._contacts = ContactCheck(self._scene, self._impacts.pairs, self._lasting, layout)
        self._energy, self._mass = layout.index["energy.total_J"], float(self._model.body_mass.sum())

    def take(self, block: FloatArray, ticks: npt.NDArray[np.int64]) -> FloatArray:
        """Recompute the next samples and compare them with the logged ones.

        Args:
            block: Rows of the log, (n, columns).
            ticks: Control tick of each row, from :class:`ffsm_mj.log.sampling.Sampling`.

        Returns:
            Recomputed rows, (n, columns); controller columns are copied, a row without a valid state is NaN.
        """
        slices = [slice(i, i + BLOCK_ROWS) for i in range(0, len(block), BLOCK_ROWS)]
        return (
            np.concatenate([self._take(block[rows_slice], ticks[rows_slice]) for rows_slice in slices])
            if slices
            else block.copy()
        )

    def finish(self) -> None:
        """Integrate from the last sample to the events after it, one of which may have ended the run."""
        if self._tick is not None:
            self._ending = True
            first = self._tick * self._steps
            for step in range(first, first + self._steps):
                self._advance_through_events(step)
                if not self._events.pending:
                    return
                self._step(self._left)

    def _take(self, block: FloatArray, ticks: npt.NDArray[np.int64]) -> FloatArray:
        self._completed = 0
        lines = self._lines = _RowBlock(block, self._layout, self._state, self._actuation)
        usable = np.all(np.isfinite(lines.states) & (np.abs(lines.states) < _HUGE), axis=1) & (ticks != NOWHERE)
        for line, (tick, good) in enumerate(zip(ticks.tolist(), usable.tolist(), strict=True)):
            if good:
                self._line(line, tick)
                continue
            self._complete(line)
            self._tick, self._completed = None, line + 1
            self._again[line] = self._predicted[line] = self._forces_apart[line] = np.nan
        self._complete(len(block))
        again = self._again[: len(block)].copy()
        self._compare(block, again, self._predicted[: len(block)])
        again[:, self._residual] = self._forces_apart[: len(block)]  # the check uses the recomputed differences
        return again

    def _complete(self, line: int) -> None:
        """Compute the table columns of the rows so far."""
        if line > self._completed:
            self._rows.complete(self._again[self._completed : line])
        self._completed = line

    def _line(self, line: int, tick: int) -> None:
        """Integrate to a sample, and write its row as the run does."""
        lines, table = self._lines, self._actuation.table
        time = float(lines.times[line]) if tick == BETWEEN else tick * self._period_s
        if self._tick is not None and tick in (self._tick + 1, BETWEEN):
            self._predicted[line] = self._advance_to_sample(
                lines.states[line], self._tick, time if tick == BETWEEN else math.inf
            )
            if tick in (self._last_tick, BETWEEN):
                table[:, 0] = lines.asked[
                    line
                ]  # the controller is not evaluated at the end of a run: earlier efforts still act
            else:
                self._decide(line, time)
        else:
            self._complete(line)
            self._start_at_sample(line, max(tick, 0), time)
            self._predicted[line] = lines.states[line]
        self._data.ctrl[:] = lines.ctrl[line]
        self._controller_values[:] = lines.rows[line, self._controller_columns]
        self._rows.fill(line, time)
        self._forces_apart[line] = self._contacts.residual(lines.rows[line], self._course)
        self._tick = None if tick == BETWEEN else tick

    def _start_at_sample(self, line: int, tick: int, time_s: float) -> None:
        """Start at a sample: the first one, or the first after a gap, where accumulated columns are taken from the log."""
        lines = self._lines
        self._set_state(lines.states[line])
        self._events.skip_to(tick * self._steps)
        for resume, places in self._resume:
            resume(lines.rows[line, places] if tick else np.zeros(len(places)))
        self._course.restore_state(self._free)
        self._balance.carry(self._course.motion.carried)
        if not tick:
            self._decide(line, time_s)
            return
        self._scene.numbers.mark_unknown()
        self._actuation.hold(lines.applied[line], self._data, time_s)
        self._actuation.table[:, 0] = lines.asked[line]

    def _decide(self, line: int, time_s: float) -> None:
        """Apply the logged command within the actuator limits."""
        self._command.effort[:], self._command.powered[:] = self._lines.asked[line], self._lines.powered[line]
        self._actuation.apply(self._command, self._data, time_s)

    def _advance_to_sample(self, state: FloatArray, tick: int, until_s: float) -> FloatArray:
        """Integrate from the sample at a tick to the next sample, or to an event at ``until_s``; returns the state there."""
        first = tick * self._steps
        for step in range(first, first + self._steps):
            if self._advance_through_events(step, until_s):
                self._left = 0.0
                break
            if step + 1 < first + self._steps:
                self._step(self._left)
        return self._advance_to_state(self._left, state)

    def _advance_through_events(self, step: int, until_s: float = math.inf) -> bool:
        """Integrate through the events in a step; returns whether one was at ``until_s``. ``_left`` is what remains."""
        self._left = self._step_s
        for event in self._events.within(step):
            left = (step + 1) * self._step_s - event.time_s
            predicted, none = self._left - left, _NO_TIME * event.time_s
            if predicted <= none:
                predicted = 0.0 if self._is_at(event.state) else none
            self._replay_event(event, self._advance_to_state(predicted, event.state))
            self._left = left
            if event.time_s == until_s:
                return True
        return False

    def _replay_event(self, event: LoggedEvent, predicted: FloatArray) -> None:
        self._events.compare_state(event, predicted)
        self._balance.carry(None)
        if event.kind == "impact":
            self._impact_check.compare_event(event, self._events, self._balance)
        else:
            self._contact_model_check.compare_event(event, self._balance)
        self._set_state(event.state_after)
        self._course.restart()
        self._balance.carry(self._course.motion.carried)
        # If the run ended at this event, the controller was not evaluated or failed: its efforts never acted.
        if self._events.pending or not self._ending:
            self._apply_efforts(event)
            self._course.after_event(event.time_s)

    def _apply_efforts(self, event: LoggedEvent) -> None:
        """Apply the logged efforts after an event, and check them against the actuator limits."""
        actuation = self._actuation
        actuation.hold(event.efforts, self._data, event.time_s)
        name = f"{event.name} efforts_after"
        self.impacts.vector(name, event.efforts, actuation.applied.copy(), actuation.applied, "", event.time_s)
        self._data.ctrl[:] = event.efforts / actuation.gear

    def _step(self, duration_s: float) -> None:
        """Integrate with constant efforts and update the balance; no effect if the duration is not positive."""
        last_s = self._integrate(duration_s)
        if last_s > 0.0:
            self._add_to_balance(last_s)

    def _advance_to_state(self, duration_s: float, state: FloatArray) -> FloatArray:
        """Integrate to a logged state, which enters the balance; returns the integrated state for comparison."""
        last_s = self._integrate(duration_s)
        predicted = self._state_now()
        differs = not np.array_equal(predicted, state)
        if differs:
            self._set_state(state)
        if last_s > 0.0:
            self._add_to_balance(last_s)
            if differs:
                # Records hold the forces at the logged state. Under a disc that is almost flat, those of a state integrated
                # to rounding differ by more than rounding.
                self._course.motion.refresh_forces()
        return predicted

    def _integrate(self, duration_s: float) -> float:
        """Integrate for a time in the sub-steps of the run; the last one is not yet entered in the balance.

        Returns:
            Duration of the last sub-step; 0 if integration was refused.
        """
        left = self._left
        while duration_s > 0.0:
            self._before_substep(duration_s, left)
            self._balance.open()
            try:
                predicted = self._course.integrate(duration_s, left)
            except (
                RunEnded,
                StepLimitError,
            ) as end:  # integration is refused here, for example as a pair with friction carries a force
                self.motion.keep(Discrepancy(str(end), math.inf, AGREES, "", float(self._data.time)))
                return 0.0
            if predicted >= duration_s:
                return predicted
            self._add_to_balance(predicted)
            duration_s, left = duration_s - predicted, left - predicted
        return 0.0

    def _before_substep(self, duration_s: float, left_s: float) -> None:
        """Hook before each (sub-)step of at most ``duration_s``, with ``left_s`` remaining of the grid step."""

    def _state_now(self) -> FloatArray:
        return np.concatenate((self._data.qpos, self._data.qvel))

    def _is_at(self, state: FloatArray) -> bool:
        """Whether a logged state equals that in ``data`` to rounding; with a closed grasp it was transferred."""
        return bool(np.abs(self._state_now() - state).max() <= _FOLLOWED * (1.0 + np.abs(state).max()))

    def _add_to_balance(self, duration_s: float) -> None:
        self._impacts.update_overlap()
        self._balance.close(duration_s)
        for booking in self._course.exchanges(duration_s):
            self._balance.book(*booking)
        self._actuation.elapse(duration_s)

    def _set_state(self, state: FloatArray) -> None:
        """Set a logged state, and update derived quantities."""
        self._data.qpos[:], self._data.qvel[:] = np.split(state, [self._model.nq])
        if not np.isfinite(self._data.qacc_warmstart).all():  # absurd logged efforts may have left non-finite values
            self._data.qacc_warmstart.fill(0.0)
        mujoco.mj_forward(self._model, self._data)
        self._course.motion.sync_from_system()
        self._course.motion.flight.clear(math.inf)

    def _compare(self, block: FloatArray, again: FloatArray, predicted: FloatArray) -> None:
        nq = self._model.nq
        size = np.abs(predicted)
        lever, speed = size[:, :nq].max(axis=1, keepdims=True), size[:, nq:].max(axis=1, keepdims=True)
        scale = np.concatenate((np.repeat(lever, nq, axis=1), np.repeat(speed, self._model.nv, axis=1)), axis=1)
        self.motion.rows(self._layout, self._state, block, predicted, scale)
        # The sum of all m |v| is at most sqrt(2 M T).
        momentum = (1.0 + lever[:, 0]) * np.sqrt(2.0 * self._mass * np.abs(again[:, self._energy]))
        measured = scales(self._layout, self._known, again, momentum)
        self.columns.rows(self._layout, self._known, block, again[:, self._known], measured)


def _row_of_log(columns: Sequence[Columns], layout: Layout) -> Row:
    """Row layout of some parts.

    Raises:
        InputError: It differs from that of the log.
    """
    for one, other in same_names(columns):
        raise InputError(f"its models have two columns {one.key}: {one.element} and {other.element}")
    row = Row(columns)
    if layout.keys != row.layout.keys:
        odd = sorted(set(layout.keys) ^ set(row.layout.keys))
        raise InputError(f"the columns of the log are not those of its models: {', '.join(odd[:3]) or 'another order'}")
    return row
