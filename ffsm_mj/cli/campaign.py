"""Implementation of ``ffsm campaign``."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from ffsm_mj.campaign.campaign import Campaign
from ffsm_mj.campaign.execution.driver import EngineLostError
from ffsm_mj.campaign.storage.status import Status
from ffsm_mj.cli.batch_progress import BatchProgress
from ffsm_mj.cli.display import Say, Stage, display
from ffsm_mj.cli.exit_codes import OK, RUN_FAILED
from ffsm_mj.cli.standard_streams import Output, complain
from ffsm_mj.errors import InputError, one_line, working_on
from ffsm_mj.invocation import command
from ffsm_mj.report.text_table import listed, wrapped


def campaign(options: argparse.Namespace, output: Output) -> int:
    """Perform the action; returns the exit code.

    Raises:
        InputError: The campaign file or the folder is invalid, or the settings differ.
    """
    with (
        display(output) as (say, shown),
        working_on(options.folder if "folder" in options else options.campaign or "campaign"),
    ):
        return _ACTIONS[options.action](options, say, shown.stage)


def _run(options: argparse.Namespace, say: Say, stage: Stage) -> int:
    if options.list:
        return _list(say)
    if options.campaign is None:
        raise InputError(
            f"ffsm campaign run: name a campaign file; '{command('campaign', 'run', '--list')}' shows the shipped ones"
        )
    from ffsm_mj.campaign.plan.loading import load_campaign

    stage("sample and validate the runs", "")
    plan = load_campaign(options.campaign, options.overrides)
    out = Path(options.out) if options.out else Path("logs") / f"campaign-{plan.config.campaign}"
    return _make(Campaign.begin(plan, out), options, say, stage)


def _list(say: Say) -> int:
    from ffsm_mj.campaign.plan.shipped import CAMPAIGNS

    say(listed(CAMPAIGNS.described()))
    return OK


def _resume(options: argparse.Namespace, say: Say, stage: Stage) -> int:
    return _make(Campaign.open(options.folder), options, say, stage)


def _extend(options: argparse.Namespace, say: Say, stage: Stage) -> int:
    found = Campaign.open(options.folder)
    found.extend(options.n)
    return _make(found, options, say, stage)


def _make(found: Campaign, options: argparse.Namespace, say: Say, stage: Stage) -> int:
    """Execute the remaining runs, then write the logs that the campaign file asks for."""
    name, folder = found.config.campaign, found.folder.path
    report = stage(name, "runs") or BatchProgress(name)
    try:
        status = found.run(
            workers=options.workers, dask=options.dask or "", retry=getattr(options, "retry", ()), report=report
        )
    except EngineLostError as error:
        complain(str(error))
        return RUN_FAILED
    except KeyboardInterrupt:
        say_status(found.status(), say)
        say(f"continue: {command('campaign', 'resume', folder)}")
        raise
    say_status(status, say)
    if status.stopped:
        complain(
            f"{status.stopped}; to continue anyway, raise the limit: {command('campaign', 'run')} -s limits.max_failed=1 ..."
        )
        return RUN_FAILED
    if status.enough:
        say(f"ended early: {status.enough}")
    _keep(found, say, stage)
    say(f"report: {command('campaign', 'report', folder)}")
    say(f"repeat a run and write its log: {command('campaign', 'rerun', folder, 0)}")
    return OK


def _keep(found: Campaign, say: Say, stage: Stage) -> None:
    wanted = [index for index in found.kept() if not found.folder.has_rerun(index)]
    report = stage("write the logs to keep", "runs")
    for done, index in enumerate(wanted):
        say(found.rerun(index).verdict)
        if report is not None:
            report(done + 1, len(wanted))


def _status(options: argparse.Namespace, say: Say, _: Stage) -> int:
    say_status(Campaign.open(options.folder).status(), say)
    return OK


def say_status(status: Status, say: Say) -> None:
    """Print the progress of a campaign."""
    outcomes = ", ".join(f"{count} {one_line(name)}" for name, count in status.outcomes.items())
    say(f"{status.name}: {status.done} of {status.runs} runs{f' ({outcomes})' if outcomes else ''}, {status.failed} failed")
    for message in status.messages:
        say(f"  {one_line(message)}")
    if status.failed > len(status.messages):
        say(f"  and {status.failed - len(status.messages)} more")
    for check in status.checks:
        runs = f"{check.runs} run{'s' if check.runs > 1 else ''}"
        worst = f"at worst {check.excess:.3g} times its tolerance, run {check.worst}"
        say(f"  check fails in {runs}: {one_line(check.name)}, {worst}")


def _rerun(options: argparse.Namespace, say: Say, stage: Stage) -> int:
    found = Campaign.open(options.folder)
    code = OK
    for index in options.index:
        stage(f"run {index}", "")
        again = found.rerun(index)
        say(f"{found.folder.rerun(index)}: {again.verdict}")
        if again.differences:
            code = RUN_FAILED
    return code


def _report(options: argparse.Namespace, say: Say, stage: Stage) -> int:
    from ffsm_mj.campaign.report.report import write_report
    from ffsm_mj.campaign.report.summary import summary_lines

    found = Campaign.open(options.folder)
    stage(f"report of {found.config.campaign}", "")
    html, page, *_ = write_report(found, Path(options.page) if options.page else None)
    for line in summary_lines(found.results(), found.config.conditions):
        say(wrapped(one_line(line), 2))
    say(f"report: {html}, {page}")
    return OK


_ACTIONS: dict[str, Callable[[argparse.Namespace, Say, Stage], int]] = {
    "run": _run,
    "status": _status,
    "resume": _resume,
    "extend": _extend,
    "report": _report,
    "rerun": _rerun,
}
