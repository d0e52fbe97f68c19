"""What a random scene must satisfy: run, checks, log replay and an independent oracle say the same."""

from __future__ import annotations

import json
import re
import signal
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from unittest import mock

import numpy as np

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.dynamics.step_path import StepPath
from ffsm_mj.errors import InputError
from ffsm_mj.replay import explain, replay_log
from ffsm_mj.replay.truncation import AnalysisLimits
from tests.random_scenes.drawing import draw
from tests.random_scenes.oracle import oracle_differences

STEPS_OF_A_STEP, STEPS_OF_AN_EVENT = 100, 120
"""Most integrations of (sub-)steps for each step of ``time_step_s`` and for each record of an event; trials and those of
event localisation count. A scene that needs more has stalled, on any machine. A rim that rolls at a small tilt divides a
step into 15, and each of these is searched for events by some five integrations."""
STEPS_FOR_ACCURACY = 200
"""The same for each step where ``accuracy`` divides it. A step of 10 ms at 7 rad/s errs by 7e-9, and 1e-9 for the whole run
leaves 5e-15 of it: the fourth root of the ratio is 34 sub-steps, 1.5 times that for safety, and the trials; at 15 rad/s
twice as many."""
STATED = ("completed", "event_limit", "step_limit", "unsupported_contact", "diverged")
"""Outcomes that a random scene may have; all but the first are counted apart."""


class TimeOutError(BaseException):
    """A seed takes too long: no program part may catch this."""


@dataclass
class Verdict:
    """What became of a seed.

    Attributes:
        seed: The seed.
        end: ``refused``, ``time-out``, or the outcome of the run.
        differences: What run, checks, replay and oracle say differently; empty if they agree.
        message: Of a refusal or an early end.
        cost: Integrations of (sub-)steps over the bound on them.
    """

    seed: int
    end: str
    differences: list[str] = field(default_factory=list)
    message: str = ""
    cost: float = 0.0

    @property
    def cause(self) -> str:
        """The first difference, or the end, without numbers: what verdicts are grouped by."""
        text = self.differences[0].partition(" (")[0] if self.differences else f"{self.end}: {self.message}"
        return re.sub(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?", "#", re.sub(r"(link|tip|o|j|c)\d", r"\1N", text))[:150]

    def __str__(self) -> str:
        return f"{self.seed}: {self.end}; " + "; ".join(self.differences or [self.message])


def replay_faults(again):
    """What a log replay says differently from the log."""
    sizes = (
        f"{worst.what} ({worst.size:.1e} of {worst.allowed:.1e} {worst.unit}, at {worst.time_s:g} s)"
        for worst in again.worst.values()
        if not worst.passes
    )
    return [f"replay: {text}" for text in (*filter(None, [again.obstacle]), *sizes)]


def judge(seed: int, folder: Path, limit_s: float = 0.0) -> Verdict:
    """Run the scene of a seed and compare what there is to compare.

    Args:
        seed: The seed.
        folder: Empty folder for the scene.
        limit_s: Wall time after which the seed counts as stalled; 0: none.
    """
    try:
        with _time_out(limit_s), np.errstate(all="ignore"):
            return _judge(seed, draw(seed, folder))
    except TimeOutError:
        return Verdict(seed, "time-out", [f"takes more than {limit_s:g} s"])


def judged(seed: int, limit_s: float) -> Verdict:
    """The verdict on a seed, in a temporary folder; an exception is a difference."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            return judge(seed, Path(folder), limit_s)
        except Exception as error:  # noqa: BLE001 (whatever the program raises is what this looks for)
            at = error.__traceback__
            while at is not None and at.tb_next is not None:
                at = at.tb_next
            where = f" ({Path(at.tb_frame.f_code.co_filename).name}:{at.tb_lineno})" if at is not None else ""
            return Verdict(seed, "raised", [f"{type(error).__name__}: {error}{where}"])


def _judge(seed: int, path: Path) -> Verdict:
    try:
        with _integrations() as count:
            run = ffsm_mj.run(path)
    except InputError as error:
        return Verdict(seed, "refused", message=str(error).replace(str(path.parent), ""))
    events = sum(len(records) for records in run.records.values())
    of_a_step = STEPS_FOR_ACCURACY if "accuracy" in json.loads(path.read_text()) else STEPS_OF_A_STEP
    cost = count() / (of_a_step * (run.log.outcome.steps + 1) + STEPS_OF_AN_EVENT * events)
    found = [] if run.outcome in STATED else [f"outcome {run.outcome}: {run.log.outcome.message}"]
    again = replay_log(run.log)
    found += replay_faults(again)
    for what, checks in (("run", all_checks(run)), ("replay", again.checks())):
        for check in explain(run, checks, limits=AnalysisLimits()).checks:
            if not (check.passes or check.fails_by_truncation):
                size = f"{check.residual:.1e} of {check.tolerance:.1e} {check.unit}, at {check.time_s:g} s"
                sentence = "" if check.truncation is None else f", {check.truncation.sentence(check.unit)}"
                found.append(f"{what}: {check.name} of {check.subsystem} ({size}{sentence})")
    found += oracle_differences(path.parent, run)
    # A search that is given up, as in a motion that diverges, ends the run: it is no stall.
    found += [f"stall: {cost:.2g} times the steps that are allowed"] if cost > 1.0 and run.outcome == "completed" else []
    return Verdict(seed, run.outcome, found, run.log.outcome.message, cost)


@contextmanager
def _integrations() -> Iterator[Callable[[], int]]:
    """Count the (sub-)steps that a run makes, trials and those of event localisation included."""
    made, step, move_to = [0], Motion.step, StepPath.move_to

    def counted_step(self: Motion, duration_s: float) -> bool:
        made[0] += 1
        return step(self, duration_s)

    def counted_move(self: StepPath, at_s: float) -> None:
        made[0] += 1
        move_to(self, at_s)

    with mock.patch.object(Motion, "step", counted_step), mock.patch.object(StepPath, "move_to", counted_move):
        yield lambda: made[0]


@contextmanager
def _time_out(limit_s: float) -> Iterator[None]:
    def stop(*_: object) -> None:
        raise TimeOutError

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, limit_s)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
