"""Free flight: control ticks in which nothing acts on the system but its actuators, taken in the core."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

from ffsm_mj._core.free_ticks import FreeTicks
from ffsm_mj.contact.watch import ContactWatch
from ffsm_mj.controller_protocol import Command
from ffsm_mj.log.recorder import Recorder
from ffsm_mj.simulation.log_writer import LogWriter
from ffsm_mj.simulation.plant import Plant
from ffsm_mj.simulation.progress import Progress
from ffsm_mj.simulation.rows import RowWriter
from ffsm_mj.simulation.settings import Settings
from ffsm_mj.simulation.task_controller import TaskController


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
            count=self._count,
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
        begun, made = progress.ticks, progress.steps
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
            self._count()
            progress.evaluations += ticks.evaluations
            if progress.steps > made:
                integrator.motion.path.at_s = self._settings.time_step_s
        return progress.ticks - begun, ticks.law_s

    def _count(self) -> None:
        """Set how far the run has come."""
        ticks, progress = self._ticks, self._progress
        if ticks.steps > progress.steps:
            progress.time_s = ticks.steps * self._settings.time_step_s
        progress.ticks, progress.steps, self._recorder.line = ticks.ticks, ticks.steps, ticks.line
