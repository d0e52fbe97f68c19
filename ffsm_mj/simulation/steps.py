"""How steps of the time grid are made: from event to event, or many control ticks of free flight at once in the core."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial

from ffsm_mj._core.free_ticks import FreeTicks
from ffsm_mj.contact.watch import ContactWatch
from ffsm_mj.contact_models.interface import EventEffect, EventSource, EventTime
from ffsm_mj.controller_protocol import Command
from ffsm_mj.errors import UnsupportedContactError
from ffsm_mj.log.recorder import Recorder
from ffsm_mj.records.events import Outcome, RunEnded
from ffsm_mj.simulation.controller import TaskController
from ffsm_mj.simulation.plant import Plant
from ffsm_mj.simulation.progress import Progress, Settings
from ffsm_mj.simulation.rows import LogWriter, RowWriter
from ffsm_mj.simulation.step_control import StepLimitError

MOST_EVENTS_PER_STEP = 1000


class GridStep:
    """Integrates the step of the time grid that is under way."""

    def __init__(self, plant: Plant, step_s: float, progress: Progress, warnings: Sequence[str]) -> None:
        """Bind the parts.

        Args:
            plant: What is integrated.
            step_s: Time step of the grid, s.
            progress: Position on the grid, which is kept up to date.
            warnings: MuJoCo's warnings; the first one ends the run.
        """
        self._plant, self._step_s, self._progress, self._warnings = plant, step_s, progress, warnings

    def begin(self) -> None:
        """Begin the next step."""
        progress = self._progress
        progress.is_within_step, progress.left_s, progress.events_in_step = True, self._step_s, 0

    def to_event(self, *, stepped: bool = False) -> EventEffect | None:
        """Integrate to the first event in what is left of the step, and apply it.

        Args:
            stepped: Whether the whole step has been made already, though an event may be in it.

        Returns:
            Its effect; None: there is none, and the step is complete.

        Raises:
            RunEnded: The motion cannot be integrated, or has too many events.
        """
        progress, data = self._progress, self._plant.data
        end_s = (progress.steps + 1) * self._step_s
        while progress.left_s > 0.0:
            elapsed_s, contact_model = self._integrate(progress.left_s, end_s, stepped=stepped)
            stepped = False
            self._check_finite()
            progress.left_s -= elapsed_s
            if contact_model is not None:
                progress.events_in_step += 1
                if progress.left_s < self._step_s:
                    # The time is logged, rounded: a log replay knows what is left of the step from it alone.
                    progress.left_s = end_s - (end_s - progress.left_s)
                data.time = progress.time_s = end_s - progress.left_s
                effect = self._apply(contact_model)
                if effect is not None:
                    return effect
        progress.steps += 1
        progress.is_within_step = False
        # Time is a multiple of the step, not a sum, so that it does not accumulate rounding.
        data.time = progress.time_s = end_s
        return None

    def _integrate(self, left_s: float, end_s: float, *, stepped: bool) -> tuple[float, EventSource | None]:
        """Integrate in the grid step that ends at ``end_s``, with ``left_s`` seconds remaining."""
        try:
            return self._plant.advance(left_s, stepped=stepped)
        except UnsupportedContactError as error:
            self._back_to_start()
            raise RunEnded(Outcome.DIVERGED, f"{Outcome.DIVERGED.sentence}: {error}") from error
        except StepLimitError as error:
            message = f"{Outcome.STEP_LIMIT.sentence}: at t = {end_s - left_s:.6g} s {error}"
            # An unstable law makes a motion too fast by itself: no step helps, and check names the gain of a linear one.
            remedy = "use a shorter time_step_s or a larger accuracy, or mend an unstable control law (ffsm check)"
            raise RunEnded(Outcome.STEP_LIMIT, f"{message}; {remedy}") from error

    def _back_to_start(self) -> None:
        """Undo the last (sub-)step: what is recorded at the end of the run is of a state that has been reached."""
        self._plant.integrator.motion.path.move_to(0.0)

    def _check_finite(self) -> None:
        if self._warnings or not math.isfinite(self._plant.integrator.kinetic_energy_J):
            message = self._warnings[-1] if self._warnings else "the state is not finite"
            self._back_to_start()
            raise RunEnded(Outcome.DIVERGED, f"{Outcome.DIVERGED.sentence}: {' '.join(message.split())}")

    def _apply(self, contact_model: EventSource) -> EventEffect | None:
        """Apply an event, and enter it in the balance; None: there is none after all."""
        plant, progress = self._plant, self._progress
        plant.integrator.motion.path.poll()
        if progress.events_in_step > MOST_EVENTS_PER_STEP:
            touched = f"{contact_model.names()} touched {progress.events_in_step - 1} times"
            message = f"{touched} within the step before t = {progress.time_s:.6g} s; use a shorter time_step_s"
            raise RunEnded(Outcome.EVENT_LIMIT, message)
        return plant.apply(lambda: plant.integrator.act(contact_model, EventTime(progress.time_s, progress.steps)))


class FreeFlight:
    """Takes control ticks as the loop does, without Python between their parts, up to the first step with a possible event.

    The law in charge is evaluated in the core too if it is one of the core. What follows is left to the loop.
    """

    def __init__(
        self,
        plant: Plant,
        watch: ContactWatch,
        controller: TaskController,
        written: tuple[Recorder, RowWriter, LogWriter],
        settings: Settings,
        progress: Progress,
        warnings: list[str],
    ) -> None:
        """Bind the parts; see :class:`~ffsm_mj.simulation.loop.Simulation`."""
        self._plant, self._controller, self._settings = plant, controller, settings
        self._recorder, rows, log = written
        self._progress, self._warnings = progress, warnings
        self._ticks = FreeTicks(
            plant.data,
            self._recorder,
            rows.filler,
            plant.balance.work,
            watched=watch.model,
            overlaps=watch.open,
            look=partial(log.look, collided=True),
            count=self._update_progress,
            after_step=plant.after_step,
            step_s=settings.time_step_s,
            steps_per_tick=settings.steps_per_tick,
        )

    def continue_step(self) -> bool:
        """Whether the step that is due was made already and is only to be completed: an event may be in it."""
        return self._ticks.pass_step()

    def take(
        self,
        command: Command,
        decide: Callable[[float], bool],
        interrupted: Callable[[], object] | None,
        report: Callable[[float], object] | None,
    ) -> tuple[int, float]:
        """Take the control ticks that are due.

        Args:
            command: What the law commands.
            decide: Evaluates the controller at a tick; returns whether another phase has begun, or it makes a request.
            interrupted: Called at each step: raises if the run is to end.
            report: Called with the time at each tick.

        Returns:
            Number of ticks begun, and wall time of the law of the core, s.
        """
        plant, progress, ticks = self._plant, self._progress, self._ticks
        ticks.begin(progress.ticks, progress.steps, self._recorder.line)
        integrator, law, until_s, limits = plant.integrator, None, math.inf, None
        steps = integrator.begin_core_steps() if plant.control is None else None
        if steps is None:
            return 0, 0.0
        # The law for another motion takes over at its next evaluation.
        same = self._controller.grasp == integrator.motion.grasp
        if (in_core := self._controller.in_core(command, plant.data) if same else None) is not None:
            limits = plant.actuation.limits(command, plant.data, in_core.actuators)
            law, until_s = (in_core.law, in_core.until_s) if limits is not None else (None, math.inf)
        begun, steps_before = progress.ticks, progress.steps
        try:
            ticks.take(
                *steps,
                law,
                limits,
                decide=decide,
                interrupted=interrupted,
                report=report,
                warnings=self._warnings,
                ticks=self._settings.ticks,
                lines=self._recorder.lines,
                until_s=until_s,
                clock=self._recorder.next_flush_s,
            )
        finally:
            self._update_progress()
            progress.evaluations += ticks.evaluations
            if progress.steps > steps_before:
                integrator.motion.path.at_s = self._settings.time_step_s
        return progress.ticks - begun, ticks.law_s

    def _update_progress(self) -> None:
        """Set how far the run has come."""
        ticks, progress = self._ticks, self._progress
        if ticks.steps > progress.steps:
            progress.time_s = ticks.steps * self._settings.time_step_s
        progress.ticks, progress.steps, self._recorder.line = ticks.ticks, ticks.steps, ticks.line
