"""Log replay: the plant of a run under the logged efforts, set to the logged states where the log has them, and compared."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.interface import EventEffect, LoggedEvent
from ffsm_mj.controller_protocol import Command
from ffsm_mj.errors import ControllerError
from ffsm_mj.log.recorder import RECORDED_ROWS
from ffsm_mj.log.sampling import BETWEEN, NOWHERE, Sampling
from ffsm_mj.records.events import EffortChange, RunEnded
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.replay.logged_events import EventCheck, LoggedEvents
from ffsm_mj.replay.logged_motion import LoggedMotion
from ffsm_mj.replay.replayed_rows import LoggedRows, ReplayedRows
from ffsm_mj.replay.scene import LogScene
from ffsm_mj.simulation.controller import calls_controller, reported_records
from ffsm_mj.simulation.step_control import StepLimitError
from ffsm_mj.ties import logged
from ffsm_mj.verification.agreement import Agreement, impossible

_HUGE = 1e10
"""MuJoCo rejects states with larger values."""


@dataclass
class Agreements:
    """Agreement of a log with its states.

    Attributes:
        motion: Agreement of each sample with the state integrated from the previous one.
        columns: Agreement of each recomputed column with the logged one.
        impacts: Agreement of each field of the events, and of the states before them.
    """

    motion: Agreement = field(default_factory=Agreement)
    columns: Agreement = field(default_factory=Agreement)
    impacts: Agreement = field(default_factory=Agreement)


class LogReplay:
    """Integrates from each sample to the next, and recomputes all columns that follow from states and efforts.

    Attributes:
        current: Agreement so far, since the last part of the log that is lost.
        sampling: Ticks of the rows so far, and their gaps.
        forces_apart: Differences of the logged contact forces of the last :meth:`take` from independent checks, N, (n,).
        before_loss: The time of the first row after the first part of the log that is lost, s, and the agreement before
            that part, once the replay is past it: an event that is lost may have closed a contact or a grasp, of which later
            rows do not say enough to recompute them.
    """

    def __init__(self, scene: LogScene, log: RunLog) -> None:
        """Bind the plant of a log to its rows and events.

        Raises:
            InputError: The columns of the log are not those of its models.
        """
        scenario, self._plant = scene.scenario, scene.plant
        self._step_s, self._steps, self._last_tick = scenario.time_step_s, scenario.steps_per_tick, scenario.ticks
        self._period_s, self._feedback_impulse_N_s = self._step_s * self._steps, scenario.feedback_impulse_N_s
        self.sampling = Sampling(log, self._period_s)
        self._system_motion = self._plant.integrator.motion
        self._command = Command.off(int(self._plant.system.mj.nu))
        self.current, self.forces_apart = Agreements(), np.zeros(0)
        self._check = EventCheck(self._plant.integrator.event_sources, self.current.impacts)
        self._events = LoggedEvents(self._plant.system, log, self._step_s, self.current.impacts, self._check.fault_of)
        self._rows = ReplayedRows(self._plant, log.header.layout)
        self._logged: LoggedRows
        self._logged_motion = LoggedMotion.of(self._plant, self._rows, self._command, self._step_s, self._steps)
        self._lost_from, self._time = np.array([start for start, _ in log.lost]), log.header.layout.time
        self.before_loss: tuple[float, Agreements] | None = None
        self._last_s = -math.inf
        self._tick: int | None = None
        self._left = 0.0
        self._ending = False
        self._at_logged_state = False
        # The step to go on with after ticks that the core took, and whether it is made already; whether the motion bound
        # holds from the last event on.
        self._next_step, self._stepped, self._bounded = 0, False, False

    def take(self, block: FloatArray) -> FloatArray:
        """Recompute the next samples and compare them with the logged ones.

        Args:
            block: Rows of the log, (n, columns).

        Returns:
            Recomputed rows, (n, columns); controller columns are copied, a row without a valid state is NaN. Rows after a
            lost part of the log are those of the log, as contacts and grasps there may not be known.
        """
        times, edges = block[:, self._time], {*range(0, len(block), RECORDED_ROWS), len(block)}
        ticks = self.sampling.ticks(times)
        # A block must not reach over a lost part: what was recomputed before it says nothing about rows behind it.
        edges |= {*np.searchsorted(times, self._lost_from, side="right").tolist()}
        parts, apart = [], []
        for first, end in pairwise(sorted(edges)):
            self._pass_lost(float(times[first]))
            again = self._take(block[first:end], ticks[first:end])
            known = self.before_loss is None
            parts.append(again if known else block[first:end])
            apart.append(self._rows.forces_apart[: end - first].copy() if known else np.zeros(end - first))
            self._last_s = float(times[end - 1])
        self.forces_apart = np.concatenate(apart) if apart else np.zeros(0)
        return np.concatenate(parts) if parts else block.copy()

    def _pass_lost(self, time_s: float) -> None:
        """Start anew at a row after a part of the log that is lost."""
        if np.any((self._last_s <= self._lost_from) & (self._lost_from < time_s)):
            self._tick = None
            if self.before_loss is None:
                self.before_loss, self.current = (time_s, self.current), Agreements()
                self._check.agreement = self._events.agreement = self.current.impacts

    def finish(self) -> None:
        """Integrate from the last sample to the events after it, one of which may have ended the run."""
        if self._tick is not None:
            self._ending = True
            first = self._tick * self._steps
            # A run may end at an event between its last row and the next tick: that event has to follow from the last row
            # too.
            for step in range(first, first + self._steps):
                self._advance_through_events(step)
                if not self._events.pending:
                    return
                self._enter(self._integrate(self._left))

    def agreements(self) -> tuple[dict[str, Agreement], float]:
        """The three agreements by name, and the time from which nothing could be verified; infinite if everything was.

        What follows a lost part counts if it agrees, and else says nothing.
        """
        last: dict[str, Agreement] = vars(self.current)
        if self.before_loss is None:
            return last, math.inf
        until_s, first = self.before_loss[0], vars(self.before_loss[1])
        # A lost event may have closed a contact or a grasp. Behind it a difference may be due to what is not known, so only
        # agreement counts.
        if not all(item.worst is None or item.worst.passes for item in last.values()):
            return first, until_s
        for name, item in last.items():
            first[name].numbers += item.numbers
            if item.worst is not None:
                first[name].keep(item.worst)
        return first, math.inf

    def _take(self, block: FloatArray, ticks: npt.NDArray[np.int64]) -> FloatArray:
        self._logged = self._rows.begin(block)
        states = self._logged.states
        # MuJoCo would reset such a state to that of the model file, and the replay would compare with that.
        usable = np.all(np.isfinite(states) & (np.abs(states) < _HUGE), axis=1) & (ticks != NOWHERE)
        if self._logged_motion is not None:
            self._logged_motion.begin(self._logged, usable, ticks)
        line = 0
        while line < len(block):
            if usable[line]:
                line += self._lines(line, int(ticks[line]))
            else:
                self._rows.skip(line)
                self._tick = None
                line += 1
        return self._rows.compare(block, self.current.motion, self.current.columns)

    def _lines(self, line: int, tick: int) -> int:
        """Integrate to a sample, and write its row as the run does; returns the number of rows written, from it on."""
        time_s = float(self._logged.times[line]) if tick == BETWEEN else tick * self._period_s
        starts = self._reach(line, tick, time_s)
        self._plant.data.time = time_s  # as in a run: a sum of steps accumulates rounding
        # Where the replay starts, efforts are held that were decided before: the law of the core would decide them anew.
        if not starts and (written := self._replay_ticks(line, tick)):
            return written
        self._write(line, tick, time_s, starts=starts)
        return 1

    def _reach(self, line: int, tick: int, time_s: float) -> bool:
        """Integrate to a sample, unless the core has; returns whether the replay starts there instead."""
        logged = self._logged
        # Behind a gap no state leads to this one: the replay begins here.
        if self._tick is None or tick not in (self._tick + 1, BETWEEN):
            self._rows.complete(line)
            self._start_at_sample(line, max(tick, 0), time_s)
            self._rows.predicted[line] = logged.states[line]
            return True
        if self._next_step < (self._tick + 1) * self._steps:
            until_s = time_s if tick == BETWEEN else math.inf
            self._rows.predicted[line] = self._advance_to_sample(logged.states[line], self._tick, until_s)
        return False

    def _replay_ticks(self, line: int, tick: int) -> int:
        """Have the core write rows from a sample on, if nothing but actuators acts there; returns the number of rows."""
        if self._logged_motion is None or not self._bounded:
            return 0
        # The core knows no events: it may take ticks up to that of the next logged one.
        pending = self._events.pending
        written = self._logged_motion.take(line, tick, pending[0].step // self._steps if pending else math.inf)
        if written:
            self._tick, self._next_step = tick + written - 1, self._logged_motion.steps
            self._stepped, self._at_logged_state = self._logged_motion.pass_step(), True
        return written

    def _write(self, line: int, tick: int, time_s: float, *, starts: bool) -> None:
        """Write the row of a sample as the run does."""
        logged, plant = self._logged, self._plant
        if not starts:
            if tick in (self._last_tick, BETWEEN):
                # The controller is not evaluated at the end of a run: earlier efforts still act.
                plant.actuation.table[:, 0] = logged.asked[line]
            else:
                self._decide(line, time_s)
        plant.data.ctrl[:] = logged.ctrl[line]
        self._rows.write(line, time_s, logged.rows[line])
        self._at_logged_state = True
        self._tick, self._next_step = (None, 0) if tick == BETWEEN else (tick, tick * self._steps)

    def _start_at_sample(self, line: int, tick: int, time_s: float) -> None:
        """Start at a sample: the first one, or the first after a gap, where accumulated columns are taken from the log."""
        logged, plant = self._logged, self._plant
        plant.data.time = time_s  # external fields are evaluated at it
        plant.set_coordinates(logged.states[line])
        self._events.skip_to(tick * self._steps)
        # Columns that add up since t = 0 begin at zero there, and behind a gap at their logged values: what was added in it
        # is lost.
        self._rows.restore(logged.rows[line] if tick else None)
        plant.integrator.restore_state(self._system_motion, self._events.before(tick * self._steps))
        plant.balance.set_grasped_object(plant.integrator.motion.grasped_object)
        self._bounded = True
        if not tick:
            if plant.sampler is not None:
                plant.sampler.begin()
            self._decide(line, time_s)
            return
        if plant.sampler is not None:
            plant.sampler.begin_after_gap(time_s)
        # Events in the gap had numbers: those of later ones are taken from the log.
        plant.scene.numbers.mark_unknown()
        self._hold(logged.applied[line], time_s, self.current.columns)
        plant.actuation.table[:, 0] = logged.asked[line]

    def _decide(self, line: int, time_s: float) -> None:
        """Apply the logged command within the actuator limits."""
        self._command.effort[:], self._command.powered[:] = self._logged.asked[line], self._logged.powered[line]
        with self._no_law_commands(time_s, self.current.columns):
            self._plant.actuation.apply(self._command, self._plant.data, time_s)

    def _hold(self, efforts: FloatArray, time_s: float, agreement: Agreement) -> None:
        """Apply logged efforts that were decided before."""
        with self._no_law_commands(time_s, agreement):
            self._plant.actuation.hold(efforts, self._plant.data, time_s)

    @contextmanager
    def _no_law_commands(self, time_s: float, agreement: Agreement) -> Iterator[None]:
        """Context in which an effort that would have ended the run is a disagreement."""
        try:
            yield
        # An effort that is no number ends a run. In a log it is a difference, and the replay goes on.
        except ControllerError as error:
            agreement.keep(impossible(str(error), time_s))

    def _advance_to_sample(self, state: FloatArray, tick: int, until_s: float) -> FloatArray:
        """Integrate from the sample at a tick to the next sample, or to an event at ``until_s``; returns the state there."""
        end = (tick + 1) * self._steps
        for step in range(self._next_step, end):
            # The row lies at an event within the step: the rest of the step comes after it.
            if self._advance_through_events(step, until_s):
                self._left = 0.0
                break
            if step + 1 < end:
                self._enter(self._integrate(self._left))
                # As in a run (GridStep): in a sum of steps, external fields would be evaluated at other times than there.
                self._plant.data.time = (step + 1) * self._step_s
        return self._advance_to_state(self._left, state)

    def _advance_through_events(self, step: int, until_s: float = math.inf) -> bool:
        """Integrate through the events in a step; returns whether one was at ``until_s``. ``_left`` is what remains."""
        self._left = self._step_s
        for event in self._events.within(step):
            end_s = (step + 1) * self._step_s
            # At the start of a step all of it is left, whatever the rounding of the time; see GridStep.
            # Times are rounded to half a unit in the last place; a step that is shorter or longer by that ends in another
            # state.
            left = self._left if event.time_s == end_s - self._left else end_s - event.time_s
            elapsed = logged(self._left - left, self._left, event.time_s)
            start = self._plant.state_now()
            predicted = self._advance_to_state(elapsed, event.state)
            change = float(np.abs(predicted - start)[self._plant.system.mj.nq :].max(initial=0.0))
            self._events.compare_state(event, predicted, change / elapsed if elapsed > 0.0 else 0.0)
            self._plant.data.time = event.time_s  # fields are evaluated at it
            # An event at the start of a step is found by other tests than one inside it (``due`` and ``first_event``).
            self._replay_event(replace(event, in_step=elapsed > 0.0))
            self._left = left
            if event.time_s == until_s:
                return True
        return False

    def _replay_event(self, event: LoggedEvent) -> None:
        def reproduce() -> EventEffect | None:
            return self._check.reproduce(event)

        # From the logged state after the event on: a difference at one event must not become one of all later rows.
        effect = self._plant.apply(reproduce, event.state_after)
        self._at_logged_state = self._bounded = True
        # If the run ended at this event, the controller was not evaluated or failed: its efforts never acted.
        if self._events.pending or not self._ending:
            self._apply_efforts(event, effect)
            self._plant.integrator.after_event(event.time_s)
            self._rows.add_event()

    def _apply_efforts(self, event: LoggedEvent, effect: EventEffect | None) -> None:
        """Apply the logged efforts after an event, and check them against the actuator limits.

        Efforts that still act where nothing is decided are within the limits of an earlier speed.
        """
        actuation, data = self._plant.actuation, self._plant.data
        # Efforts that are only kept are not limited anew: the torque-speed line of the present speed might cut them, which
        # the run did not.
        if not np.array_equal(event.efforts, actuation.applied) or effect is None or self._decides(effect):
            self._hold(event.efforts, event.time_s, self.current.impacts)
        name = f"{event.name} efforts_after"
        self.current.impacts.vector(name, event.efforts, actuation.applied.copy(), actuation.applied, "", event.time_s)
        data.ctrl[:] = event.efforts / actuation.gear

    def _decides(self, effect: EventEffect) -> bool:
        """Whether efforts are applied anew at an event: a command arrives, or the controller is evaluated."""
        arrives = any(isinstance(record, EffortChange) for record in effect.records)
        return arrives or calls_controller(effect, reported_records(effect.records, self._feedback_impulse_N_s))

    def _advance_to_state(self, duration_s: float, state: FloatArray) -> FloatArray:
        """Integrate to a logged state, which enters the balance; returns the integrated state for comparison."""
        last_s, plant = self._integrate(duration_s), self._plant
        predicted = plant.state_now()
        # Bit by bit: the replay makes the steps of the run with the same arithmetic, so on the same machine nothing differs.
        differs = not bool((predicted == state).all())
        if differs:
            plant.set_coordinates(state)
            # The motion bound holds for the integrated state; the logged one may be anywhere.
            self._bounded = False
        self._enter(last_s, is_set=differs)
        return predicted

    def _integrate(self, duration_s: float) -> float:
        """Integrate for a time in the sub-steps of the run; the last one is not yet entered in the balance.

        Returns:
            Duration of the last sub-step; 0 if integration was refused.
        """
        left = self._left
        # The core has made this step already, and left it to be completed.
        if self._stepped:
            self._stepped = False
            if not self._plant.integrator.motion.stepper.kinked:
                return duration_s
            path = self._plant.integrator.motion.path
            path.at_s = math.nan  # the core does not say where it is
            path.move_to(0.0)  # the step is made again, in two parts
        if self._at_logged_state and duration_s > 0.0:
            self._catch_up()
        while duration_s > 0.0:
            self._before_substep(duration_s, left)
            try:
                done_s = self._plant.integrate(duration_s, left)
            except (RunEnded, StepLimitError) as end:
                # Integration is refused here, for example as a pair with friction carries a force.
                self.current.motion.keep(impossible(str(end), float(self._plant.data.time)))
                return 0.0
            # A sub-step that ends within rounding of the end is the whole: what is left is shorter than a run makes.
            if logged(done_s, duration_s, float(self._plant.data.time)) == duration_s:
                return done_s
            self._enter(done_s)
            duration_s, left = duration_s - done_s, left - done_s
        return 0.0

    def _catch_up(self) -> None:
        """Note events that the log ought to have at the logged state in ``data``: to rounding, later states may differ."""
        self._at_logged_state, time_s = False, float(self._plant.data.time)
        integrator = self._plant.integrator
        for contact_model in integrator.replayable:
            # An event that is due here would stand in the log of a run: it is named, as later differences follow from it.
            if missing := contact_model.catch_up():
                self.current.impacts.keep(impossible(f"{missing} missing", time_s))
        integrator.discard_idle()

    def _before_substep(self, duration_s: float, left_s: float) -> None:
        """Hook before each (sub-)step of at most ``duration_s``, with ``left_s`` remaining of the grid step."""

    def _enter(self, duration_s: float, *, is_set: bool = False) -> None:
        """Enter a finished (sub-)step in the balance; see :meth:`~ffsm_mj.simulation.plant.Plant.enter`."""
        # Two events at one time leave a part without length, in which nothing is exchanged.
        if duration_s <= 0.0:
            return
        for contact_model in self._plant.integrator.replayable:
            contact_model.after_replayed_step()
        self._plant.enter(duration_s, is_set=is_set)
