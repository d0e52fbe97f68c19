"""Guard of a run: what is raised in it becomes its outcome."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress

from ffsm_mj.errors import ControllerError
from ffsm_mj.log.recorder import Recorder
from ffsm_mj.records.events import ControllerReport, Outcome, RunEnded
from ffsm_mj.simulation.ending import Ended, last_reports, outcome_of
from ffsm_mj.simulation.internal_error import internal_error
from ffsm_mj.simulation.progress import Progress
from ffsm_mj.simulation.task_controller import TaskController


class Guard:
    """Executes the parts of a run, and knows how it ended.

    Attributes:
        ended: How the run has ended; None while it lasts.
        error: Exception of a control law or an unexpected one that ended it, with its traceback; None otherwise.
        passed_on: An exception that is not an outcome of the run, and is raised.
    """

    def __init__(self, recorder: Recorder, progress: Progress) -> None:
        """Start; an unexpected exception is logged with the progress at it."""
        self._recorder, self._progress = recorder, progress
        self.ended: Ended | None = None
        self.error: Exception | None = None
        self.passed_on: Exception | None = None

    def execute(self, part: Callable[..., None], *args: bool) -> None:
        """Execute a part of the run; what ends it becomes its outcome."""
        try:
            part(*args)
        except (Exception, KeyboardInterrupt) as error:
            if error is self.passed_on:
                raise
            if isinstance(error, RunEnded) and error.outcome == Outcome.CONTROLLER_FAILED:
                self.error = _cause(error)
            self.ended = outcome_of(error) or self._failed(error)

    def _failed(self, error: BaseException) -> Ended:
        """Log an unexpected exception with its traceback."""
        assert isinstance(error, Exception)
        self.error = self.error or error
        record = internal_error(error, self._progress.time_s, self._progress.steps)
        with suppress(Exception):  # the log itself may have raised it; the outcome reports it in any case
            self._recorder.event(record)
        return Ended(Outcome.INTERNAL_ERROR, f"at t = {record.time_s:.6g} s: {record.error} ({record.where})")

    def go_on(self) -> None:
        """The run goes on from another state."""
        self.ended = self.error = None

    def finish(self, part: Callable[[], None], controller: TaskController) -> Mapping[str, ControllerReport]:
        """Execute the last part, and settle how the run ended; one that has not reached its end was interrupted.

        Returns:
            Reports of the control laws.
        """
        ended = self.ended or Ended(Outcome.INTERRUPTED, Outcome.INTERRUPTED.sentence)
        self.ended = None
        self.execute(part)
        finished = self.ended or Ended(Outcome.COMPLETED)
        # The first cause is the outcome, except that a failed write of the log is always reported.
        completed = ended.outcome == Outcome.COMPLETED or finished.outcome == Outcome.WRITE_FAILED
        outcome, message = finished if completed else ended
        reports, error, failure = last_reports(controller)
        if error is not None and outcome == Outcome.COMPLETED:
            self.error, outcome, message = error, Outcome.CONTROLLER_FAILED, failure
        self.ended = Ended(outcome, message)
        return reports


def _cause(error: BaseException) -> Exception | None:
    """What a plug-in raised: the exception below those that only say whose it is."""
    cause = error.__cause__
    if isinstance(cause, ControllerError) and cause.__cause__ is not None:
        return _cause(cause)
    return cause if isinstance(cause, Exception) else None
