"""The way from sample to sample of a log, flown again with the efforts that it says acted."""

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
"""Of the time since the start: an event that is this little later than the state before is at it, as at a control tick.

Where its state is another a step has begun in between, for less time than numbers tell, and drift was taken out.
"""
_FOLLOWED = 1e-14
"""A state that follows another model is known to so much of its largest number; drift that is taken out is more."""
_HUGE = 1e10
"""MuJoCo takes no larger number for a state."""


class _RowBlock:
    """A block of rows, taken apart."""

    def __init__(self, block: FloatArray, layout: Layout, state: IntArray, actuation: Actuation) -> None:
        self.rows, self.times, self.states = block, block[:, layout.time], np.ascontiguousarray(block[:, state])
        efforts = (np.nan_to_num(block[:, layout.places(actuation.keys[what])]) for what in ("command", "applied"))
        self.asked, self.applied = map(np.ascontiguousarray, efforts)
        self.ctrl = self.applied / actuation.gear
        # One without power is asked for nothing and gives nothing.
        self.powered = (self.asked != 0.0) | (self.applied != 0.0)


class LogReplay:
    """Flies from each sample to the next and writes what the balance, the limits and the models make of it.

    Attributes:
        motion: Every sample against the end of the flight from the one before.
        columns: Every column that follows from states and efforts against the log's.
        impacts: Every field of the impacts, and the states at which they happened.
        free: See :class:`ffsm_mj.balance.balance.Balance`.
    """

    def __init__(self, scene: LogScene, log: RunLog) -> None:
        """Prepare the models of a log; nothing is flown yet."""
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
        self._ledger = Balance(scene.system, self._data, self._free.momentum, notes=BLOCK_ROWS)
        self.free = self._ledger.free
        self._course.control = step_control(scenario, scene.system, self._data, self._ledger)
        self._actuation, self._command = scene.actuation, Command.off(int(model.nu))
        self._again = np.zeros((BLOCK_ROWS, len(log.header.layout.keys)))
        self._predicted = np.zeros((BLOCK_ROWS, model.nq + model.nv))
        self.motion, self.columns, self.impacts = Agreement(), Agreement(), Agreement()
        self._impact_check = ImpactCheck(self._scene, scene.pairs, self._impacts, self.impacts)
        self._events = LoggedEvents(scene.system, log, self._step_s, self.impacts, self._impact_check.fault_of)
        self._regime_check = ContactModelCheck(self._course, self._events, self.impacts)
        self._find_columns(scene, log.header.layout)
        self._tick: int | None = None
        self._noted = 0
        self._ending = False

    def _find_columns(self, scene: LogScene, layout: Layout) -> None:
        """Bind the parts of the run to rows like those of the log.

        Raises:
            InputError: The columns of the log are not those of its models.
        """
        state = StateSignals(scene.system, self._data, scene.task.tip_site if scene.task else None)
        known = [*state.columns, *self._ledger.columns, *self._course.columns, *self._actuation.columns]
        # What only a controller knows is taken over from the log.
        told = tuple(signal for signal in layout.signals if signal.group in ("controller", "phase"))
        self._told, self._telling = layout.places(signal.key for signal in told), np.zeros(len(told))
        row = _row_of_log([*known, Columns(told, live=self._telling)], layout)
        self._rows = RowWriter(row, state.sampler, self._again)
        self._resume = [(part.resume, layout.places(s.key for s in part.signals)) for part in known if part.resume]
        joints, self._layout = scene.system.joints.values(), layout
        self._state = layout.places((*coordinate_keys(joints), *rate_keys(joints)))
        self._residual = layout.index[f"balance.{FORCE_RESIDUAL}"]
        self._forces_apart = np.zeros(BLOCK_ROWS)
        self._known = np.setdiff1d(np.arange(len(layout.keys)), np.concatenate((self._told, self._state)))
        self._contacts = ContactCheck(self._scene, self._impacts.pairs, self._lasting, layout)
        self._energy, self._mass = layout.index["energy.total_J"], float(self._model.body_mass.sum())

    def take(self, block: FloatArray, ticks: npt.NDArray[np.int64]) -> FloatArray:
        """The next samples recomputed, and compared with the log's on the way.

        Args:
            block: Rows of the log, (n, columns).
            ticks: Control tick of each, from :class:`ffsm_mj.log.sampling.Sampling`.

        Returns:
            Rows, (n, columns); what only a controller knows is taken over, a row without a usable state is NaN.
        """
        ways = [slice(i, i + BLOCK_ROWS) for i in range(0, len(block), BLOCK_ROWS)]
        return np.concatenate([self._take(block[way], ticks[way]) for way in ways]) if ways else block.copy()

    def finish(self) -> None:
        """Fly on from the last sample to the impacts behind it, at which the run may have ended."""
        if self._tick is not None:
            self._ending = True
            first = self._tick * self._steps
            for step in range(first, first + self._steps):
                self._advance_through_events(step)
                if not self._events.pending:
                    return
                self._step(self._left)

    def _take(self, block: FloatArray, ticks: npt.NDArray[np.int64]) -> FloatArray:
        self._noted = 0
        lines = self._lines = _RowBlock(block, self._layout, self._state, self._actuation)
        usable = np.all(np.isfinite(lines.states) & (np.abs(lines.states) < _HUGE), axis=1) & (ticks != NOWHERE)
        for line, (tick, good) in enumerate(zip(ticks.tolist(), usable.tolist(), strict=True)):
            if good:
                self._line(line, tick)
                continue
            self._complete(line)
            self._tick, self._noted = None, line + 1
            self._again[line] = self._predicted[line] = self._forces_apart[line] = np.nan
        self._complete(len(block))
        again = self._again[: len(block)].copy()
        self._compare(block, again, self._predicted[: len(block)])
        again[:, self._residual] = self._forces_apart[: len(block)]  # what the law is judged by
        return again

    def _complete(self, line: int) -> None:
        """Work out the balance of the lines noted so far."""
        if line > self._noted:
            self._rows.complete(self._again[self._noted : line])
        self._noted = line

    def _line(self, line: int, tick: int) -> None:
        """Fly to a sample, and write it as the run would have."""
        lines, table = self._lines, self._actuation.table
        time = float(lines.times[line]) if tick == BETWEEN else tick * self._period_s
        if self._tick is not None and tick in (self._tick + 1, BETWEEN):
            self._predicted[line] = self._advance_to_sample(
                lines.states[line], self._tick, time if tick == BETWEEN else math.inf
            )
            if tick in (self._last_tick, BETWEEN):
                table[:, 0] = lines.asked[line]  # nothing is decided at the end: what acts was decided before
            else:
                self._decide(line, time)
        else:
            self._complete(line)
            self._start_at_sample(line, max(tick, 0), time)
            self._predicted[line] = lines.states[line]
        self._data.ctrl[:] = lines.ctrl[line]
        self._telling[:] = lines.rows[line, self._told]
        self._rows.fill(line, time)
        self._forces_apart[line] = self._contacts.residual(lines.rows[line], self._course)
        self._tick = None if tick == BETWEEN else tick

    def _start_at_sample(self, line: int, tick: int, time_s: float) -> None:
        """Begin at a sample: the first, or the first behind a gap, whose books the log must be believed."""
        lines = self._lines
        self._set_state(lines.states[line])
        self._events.skip_to(tick * self._steps)
        for resume, places in self._resume:
            resume(lines.rows[line, places] if tick else np.zeros(len(places)))
        self._course.restore_state(self._free)
        self._ledger.carry(self._course.motion.carried)
        if not tick:
            self._decide(line, time_s)
            return
        self._scene.numbers.mark_unknown()
        self._actuation.hold(lines.applied[line], self._data, time_s)
        self._actuation.table[:, 0] = lines.asked[line]

    def _decide(self, line: int, time_s: float) -> None:
        """What the limits make of the command at a sample."""
        self._command.effort[:], self._command.powered[:] = self._lines.asked[line], self._lines.powered[line]
        self._actuation.apply(self._command, self._data, time_s)

    def _advance_to_sample(self, state: FloatArray, tick: int, until_s: float) -> FloatArray:
        """Fly from the sample at a tick to the next, or to the one of an impact that ends the run; gives where that is."""
        first = tick * self._steps
        for step in range(first, first + self._steps):
            if self._advance_through_events(step, until_s):
                self._left = 0.0
                break
            if step + 1 < first + self._steps:
                self._step(self._left)
        return self._advance_to_state(self._left, state)

    def _advance_through_events(self, step: int, until_s: float = math.inf) -> bool:
        """Fly through the impacts in a step, and say whether one at a given time was met; ``_left`` is left of the step."""
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
        self._ledger.carry(None)
        if event.kind == "impact":
            self._impact_check.compare_event(event, self._events, self._ledger)
        else:
            self._regime_check.compare_event(event, self._ledger)
        self._set_state(event.state_after)
        self._course.restart()
        self._ledger.carry(self._course.motion.carried)
        # Where the run ended with an impact nobody decided anew, or a control law failed: those efforts never acted.
        if self._events.pending or not self._ending:
            self._apply_efforts(event)
            self._course.after_event(event.time_s)

    def _apply_efforts(self, event: LoggedEvent) -> None:
        """Let the efforts act that were decided at an event, and look whether the limits allow them."""
        actuation = self._actuation
        actuation.hold(event.efforts, self._data, event.time_s)
        name = f"{event.name} efforts_after"
        self.impacts.vector(name, event.efforts, actuation.applied.copy(), actuation.applied, "", event.time_s)
        self._data.ctrl[:] = event.efforts / actuation.gear

    def _step(self, duration_s: float) -> None:
        """Fly on with the efforts held, and book the flight; nothing is flown where the duration is not positive."""
        last_s = self._integrate(duration_s)
        if last_s > 0.0:
            self._add_to_balance(last_s)

    def _advance_to_state(self, duration_s: float, state: FloatArray) -> FloatArray:
        """Fly to a logged state, which is what is booked; gives the state at the end of the flight."""
        last_s = self._integrate(duration_s)
        predicted = self._state_now()
        if not np.array_equal(predicted, state):
            self._set_state(state)
        if last_s > 0.0:
            self._add_to_balance(last_s)
        return predicted

    def _integrate(self, duration_s: float) -> float:
        """Fly for a time, in the sub-steps of the run, the last of which is still to be booked.

        Returns:
            Duration of the last one; 0 where nothing could move.
        """
        left = self._left
        while duration_s > 0.0:
            self._before_flight(duration_s, left)
            self._ledger.open()
            try:
                predicted = self._course.integrate(duration_s, left)
            except (RunEnded, StepLimitError) as end:  # nothing moves on from here: a pair with friction is pressed
                self.motion.keep(Discrepancy(str(end), math.inf, AGREES, "", float(self._data.time)))
                return 0.0
            if predicted >= duration_s:
                return predicted
            self._add_to_balance(predicted)
            duration_s, left = duration_s - predicted, left - predicted
        return 0.0

    def _before_flight(self, duration_s: float, left_s: float) -> None:
        """A flight begins: of that time, or a sub-step of it, with so much left of the step of the grid."""

    def _state_now(self) -> FloatArray:
        return np.concatenate((self._data.qpos, self._data.qvel))

    def _is_at(self, state: FloatArray) -> bool:
        """Whether a logged state is that in ``data``, to rounding: that of a capture has followed what holds by then."""
        return bool(np.abs(self._state_now() - state).max() <= _FOLLOWED * (1.0 + np.abs(state).max()))

    def _add_to_balance(self, duration_s: float) -> None:
        self._impacts.note_overlap()
        self._ledger.close(duration_s)
        for booking in self._course.exchanges(duration_s):
            self._ledger.book(*booking)
        self._actuation.elapse(duration_s)

    def _set_state(self, state: FloatArray) -> None:
        """Move to a logged state, all derived quantities current."""
        self._data.qpos[:], self._data.qvel[:] = np.split(state, [self._model.nq])
        if not np.isfinite(self._data.qacc_warmstart).all():  # a flight with absurd efforts leaves that behind
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
    """The row of some parts.

    Raises:
        InputError: It is not that of the log.
    """
    for one, other in same_names(columns):
        raise InputError(f"its models have two columns {one.key}: {one.element} and {other.element}")
    row = Row(columns)
    if layout.keys != row.layout.keys:
        odd = sorted(set(layout.keys) ^ set(row.layout.keys))
        raise InputError(f"the columns of the log are not those of its models: {', '.join(odd[:3]) or 'another order'}")
    return row
