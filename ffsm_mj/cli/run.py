"""Implementation of ``ffsm run``: simulate a scenario, or list the shipped scenarios."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ffsm_mj.cli.exit_codes import BAD_INPUT, CHECK_FAILED, INTERRUPTED, OK, RUN_FAILED, TRUNCATED
from ffsm_mj.cli.sensitivity import of_run
from ffsm_mj.cli.standard_streams import Output, complain
from ffsm_mj.errors import InputError, plural
from ffsm_mj.invocation import command
from ffsm_mj.report.terminal import listed, wrapped

if TYPE_CHECKING:
    from ffsm_mj.analysis.run import Run
    from ffsm_mj.log.run_folder import RunFolder
    from ffsm_mj.verification.truncation import ExplainedChecks

_MOST_NOTE_LINES = 4
_REASON_LINES = 3
_VIEWER = "127.0.0.1:9876"


def run(options: argparse.Namespace, output: Output) -> int:
    """Simulate a scenario and print a summary; returns the exit code.

    Raises:
        InputError: The scenario or a model is invalid, or the folder holds a run.
    """
    if options.list:
        return _list(output)
    if options.scenario is None:
        complain(f"ffsm run: name a scenario; '{command('run', '--list')}' shows the shipped ones")
        return BAD_INPUT
    from ffsm_mj.assembly.prepare import (
        prepare,  # slow imports, which --list does not need
        prepare_from,
    )
    from ffsm_mj.assembly.process import noted
    from ffsm_mj.cli.truncation import PATIENCE
    from ffsm_mj.log.run_folder import RunFolder

    if options.realtime is not None:
        options.overrides.append(f"realtime.factor={options.realtime!r}")
    if options.out == "":
        complain("--out: an empty name; leave --out away for a folder in logs/")
        return BAD_INPUT
    stated = RunFolder(Path(options.out), force=options.force) if options.out else None
    if stated is not None:
        stated.refuse_earlier_run()
    with output.progress() as stage:
        stage(f"compile {options.scenario}")
        try:
            prepared = (
                prepare(options.scenario, options.overrides)
                if options.from_s is None
                else prepare_from(options.scenario, options.from_s, options.overrides)
            )
        except InputError:
            _refuse_campaign(options.scenario)
            raise
        if prepared.origin is not None:
            stage(f"make {prepared.origin.folder} again")
            prepared.origin.start()
        if prepared.scenario.uncertainties:
            from ffsm_mj.experiments.uncertainty import uncertain_parameters

            uncertain_parameters(prepared)
        notes = prepared.notes()
    scenario = prepared.scenario
    head = _notes(notes, options)
    if head:
        output.say(head)
    folder = stated or RunFolder.in_logs(scenario.name)
    live, rerun = (options.viewer or _VIEWER) if options.live else None, False if options.no_rerun else None
    if scenario.realtime is not None:
        # How far it is follows from the time, and a line that is drawn while it runs would hold up its ticks.
        left_s = scenario.duration_s - (options.from_s or 0.0)
        complain(_until(scenario.name, left_s / scenario.realtime.factor))
        done = prepared.run(folder=folder, rerun=rerun, live=live)
    else:
        with output.progress() as stage:
            report = stage(scenario.name, "s", scenario.duration_s)
            done = prepared.run(folder=folder, rerun=rerun, live=live, report=report)
    if stated is None:
        folder.link_latest()
    said = of_run(prepared, done, folder, output)
    with noted(PATIENCE) as stopped:
        explained = _explained(done, folder, options.truncation, stopped, output)
        return _summarise(done, explained, folder, notes, options, output, len(wrapped(head).splitlines()), said)


def _until(name: str, wall_s: float) -> str:
    """Line that says how long a run in real time takes."""
    return f"{name}: {wall_s:g} s by the clock, until {time.strftime('%H:%M:%S', time.localtime(time.time() + wall_s))}"


def _refuse_campaign(name: str) -> None:
    """Say that what was to be run is a campaign, if it is.

    Raises:
        InputError: It is.
    """
    from ffsm_mj.experiments.file import is_campaign

    if is_campaign(name):
        raise InputError(f"{name}: is a campaign, not a scenario; use '{command('campaign', 'run', name)}'")


def _explained(
    run: Run, folder: RunFolder, budget_s: float | None, stopped: Callable[[], bool], output: Output
) -> ExplainedChecks:
    """Find out whether checks fail by truncation, and add the verdict to the summary, which is complete without it."""
    from ffsm_mj.analysis.run_models import all_checks
    from ffsm_mj.analysis.summary import failing_checks
    from ffsm_mj.cli.truncation import explained_checks
    from ffsm_mj.verification.truncation import ExplainedChecks

    checks = all_checks(run)
    if run.outcome == "interrupted":  # its user does not want to wait
        return ExplainedChecks(checks, "the run was interrupted")
    with output.progress() as stage:
        explained = explained_checks(run, checks, budget_s, stage, str(folder.path), stopped)
    if explained.checks != checks:
        folder.add_to_summary({"checks": failing_checks(explained.checks)})
    return explained


def _notes(notes: Sequence[str], options: argparse.Namespace) -> str:
    """The first notes on a scenario, as lines; empty if there are none."""
    lines: list[str] = []
    for note in notes:
        if lines and wrapped("\n".join([*lines, f"note: {note}"])).count("\n") >= _MOST_NOTE_LINES:
            break
        lines.append(f"note: {note}")
    left = len(notes) - len(lines)
    if left:
        again = [word for text in options.overrides for word in ("-s", text)]
        lines.append(f"and {plural(left, 'more note')}: {command('check', options.scenario, *again)}")
    return "\n".join(lines)


def _summarise(
    run: Run,
    explained: ExplainedChecks,
    folder: RunFolder,
    notes: Sequence[str],
    options: argparse.Namespace,
    output: Output,
    used: int,
    said: Iterable[str],
) -> int:
    """Print the summary of a run below ``used`` lines of output, and what is said of it; returns the exit code."""
    from ffsm_mj.report.check_report import verdict
    from ffsm_mj.report.run_report import MOST_LINES, run_report
    from ffsm_mj.verification.check_result import all_by_truncation

    failed = run.outcome != "completed" or not all(check.passes for check in explained.checks)
    output.say(run_report(run, explained, notes, MOST_LINES - used - (_REASON_LINES if failed else 0)))
    for sentence in said:
        output.say(sentence)
    output.say(f"files in {folder.path}: {', '.join(sorted(p.name for p in folder.path.iterdir()))}")
    output.command(command("view", folder.path), "view:   ")
    output.command(command("analyze", folder.path), "verify: ")
    if run.outcome != "completed":
        complain(f"{run.outcome}: {run.message}")
        return INTERRUPTED if run.outcome == "interrupted" else RUN_FAILED
    if failed:
        complain(verdict(run, explained.checks))
        code = TRUNCATED if all_by_truncation(explained.checks) else CHECK_FAILED
        return OK if options.allow_failed_checks else code
    return OK


def _list(output: Output) -> int:
    from ffsm_mj.scenario.shipped import scenario_names, scenario_path
    from ffsm_mj.scenario.source import read_yaml

    output.say(listed({name: read_yaml(scenario_path(name)).data.get("description", "") for name in scenario_names()}))
    return OK
