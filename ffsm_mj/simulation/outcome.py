"""How a run ends: the outcome of an exception, its record, last words of the control laws, and the guard of all parts."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from traceback import format_exception
from types import TracebackType
from typing import NamedTuple

import mujoco

from ffsm_mj.errors import ControllerError, LogWriteError, described, raised_at, raised_in
from ffsm_mj.log.recorder import Recorder
from ffsm_mj.records.events import InternalErrorRecord, Outcome, RunEnded
from ffsm_mj.records.record import ControllerReport
from ffsm_mj.simulation.controller import TaskController
from ffsm_mj.simulation.progress import Progress


class Ended(NamedTuple):
    """How a run ended: its outcome, and the message of one that was not completed."""

    outcome: Outcome
    message: str = ""


def outcome_of(error: BaseException) -> Ended | None:
    """How an exception ends a run; None if it is an unexpected one."""
    if isinstance(error, RunEnded):
        return Ended(error.outcome, error.message if error.outcome != Outcome.COMPLETED else "")
    if isinstance(error, KeyboardInterrupt):
        return Ended(Outcome.INTERRUPTED, Outcome.INTERRUPTED.sentence)
    if isinstance(error, LogWriteError):
        return Ended(Outcome.WRITE_FAILED, str(error))
    if isinstance(error, mujoco.FatalError):
        return Ended(Outcome.DIVERGED, f"{Outcome.DIVERGED.sentence}: MuJoCo gave up ({described(error)})")
    return None


def last_reports(controller: TaskController) -> tuple[Mapping[str, ControllerReport], Exception | None, str]:
    """Reports of the control laws at the end of a run; the exception of a law that raises in its report, with a message."""
    try:
        return controller.reports(), None, ""
    except Exception as error:  # noqa: BLE001 (a plugin's code)
        reason = str(error) if isinstance(error, ControllerError) else described(error) + raised_at(error)
        return {}, error, f"{controller.in_charge} at its end: {reason}"


_LONGEST_TRACEBACK = 20_000
_PACKAGE = Path(__file__).parents[1]


def internal_error(error: BaseException, time_s: float, step: int) -> InternalErrorRecord:
    """Describe an exception for the log.

    Args:
        error: The exception, as it was caught.
        time_s: Simulation time.
        step: Integration step, from 0.
    """
    text = "".join(format_exception(error))[-_LONGEST_TRACEBACK:]
    return InternalErrorRecord(time_s, step, described(error), _raised_in(error), _relative(text))


def _raised_in(error: BaseException) -> str:
    """File, line and function of :func:`ffsm_mj.errors.raised_in`."""
    frame = raised_in(error)
    if frame is None:
        return "unknown"
    place = Path(frame.filename)
    return f"{place.relative_to(_PACKAGE) if _PACKAGE in place.parents else place.name}:{frame.lineno} in {frame.name}"


def _relative(text: str) -> str:
    """A traceback with paths relative to ``sys.path``: logs must not contain folders of this machine."""
    for folder in sorted(filter(None, map(os.path.abspath, sys.path)), key=len, reverse=True):
        text = text.replace(f'File "{folder}{os.sep}', 'File "')
    return text


class Guard:
    """Knows how a run ended. A context manager: what is raised in it becomes the outcome of the run.

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

    def __enter__(self) -> None:
        """Begin a part of the run."""

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> bool:
        """End it; what ended it is the outcome, and is not raised."""
        if error is None:
            return True
        if error is self.passed_on or not isinstance(error, (Exception, KeyboardInterrupt)):
            return False
        if isinstance(error, RunEnded) and error.outcome == Outcome.CONTROLLER_FAILED:
            self.error = _cause(error)
        self.ended = outcome_of(error) or self._failed(error)
        return True

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
        """Take the last part, and settle how the run ended; one that has not reached its end was interrupted.

        Returns:
            Reports of the control laws.
        """
        ended = self.ended or Ended(Outcome.INTERRUPTED, Outcome.INTERRUPTED.sentence)
        self.ended = None
        with self:
            part()
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
