"""How a run ends: the outcome of an exception, and the last words of the control laws."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import mujoco

from ffsm_mj.errors import ControllerError, LogWriteError, described, raised_at
from ffsm_mj.records.events import ControllerReport, Outcome, RunEnded
from ffsm_mj.simulation.task_controller import TaskController


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
