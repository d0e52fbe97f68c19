"""Implementation of ``ffsm campaign``."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from ffsm_mj.cli.exit_codes import OK, RUN_FAILED
from ffsm_mj.cli.progress import Stage, lines_of_runs
from ffsm_mj.cli.standard_streams import Output, complain
from ffsm_mj.errors import InputError, one_line, plural, working_on
from ffsm_mj.experiments.campaign import Campaign
from ffsm_mj.experiments.driver import NoWorkersLeftError
from ffsm_mj.experiments.folder import RERUNS
from ffsm_mj.experiments.metrics import NO_CLASSES, ScriptClasses, read_metrics
from ffsm_mj.experiments.planning import VariantsPlan, instabilities, load_campaign
from ffsm_mj.experiments.status import Status
from ffsm_mj.invocation import command
from ffsm_mj.report.terminal import listed
from ffsm_mj.verification.checks import TERMINAL_CHECKS


def campaign(options: argparse.Namespace, output: Output) -> int:
    """Perform the action; returns the exit code.

    Raises:
        InputError: The campaign file or the folder is invalid, or the settings differ.
    """
    with (
        output.progress() as stage,
        working_on(options.folder if "folder" in options else options.campaign or "campaign"),
    ):
        return _ACTIONS[options.action](options, output, stage)


def _run(options: argparse.Namespace, output: Output, stage: Stage) -> int:
    from ffsm_mj.experiments.file import described_campaigns

    if options.list:
        output.say(listed(described_campaigns()))
        return OK
    if options.campaign is None:
        raise InputError(
            f"ffsm campaign run: name a campaign file; '{command('campaign', 'run', '--list')}' shows the shipped ones"
        )
    stage("sample and validate the runs")
    classes = ScriptClasses(metrics=read_metrics(Path(options.metrics))) if options.metrics else NO_CLASSES
    plan = load_campaign(options.campaign, options.overrides, classes)
    if isinstance(plan, VariantsPlan):
        for name, reason in plan.not_applicable.items():
            output.say(f"not applicable: {name}: {reason}")
    for note in instabilities(plan):
        output.say(one_line(f"note: {note}"))
    out = Path(options.out) if options.out else Path("logs") / f"campaign-{plan.config.campaign}"
    return _make(Campaign.begin(plan, out), options, output, stage)


def _open(options: argparse.Namespace) -> Campaign:
    return Campaign.open(options.folder, metrics=options.metrics or {})


def _resume(options: argparse.Namespace, output: Output, stage: Stage) -> int:
    return _make(_open(options), options, output, stage)


def _extend(options: argparse.Namespace, output: Output, stage: Stage) -> int:
    campaign = _open(options)
    campaign.extend(options.n)
    return _make(campaign, options, output, stage)


def _make(campaign: Campaign, options: argparse.Namespace, output: Output, stage: Stage) -> int:
    """Execute the remaining runs, then write the logs that the campaign file asks for."""
    name, folder = campaign.config.campaign, campaign.folder.path
    before = campaign.status()
    if before.left:
        of = f" of {before.runs}" if before.done else ""
        output.say(f"{name}: {plural(before.left, 'run')}{of} to do{_of_variants(before)}")
    report = stage(name, "runs") or lines_of_runs(name, complain)
    try:
        status = campaign.run(
            workers=options.workers, dask=options.dask or "", retry=getattr(options, "retry", ()), report=report
        )
    except NoWorkersLeftError as error:
        complain(str(error))
        return RUN_FAILED
    except KeyboardInterrupt:
        _say_status(campaign.status(), output)
        output.command(_continuation(campaign, options), "continue: ")
        raise
    _say_results(campaign, status, output)
    if status.stopped:
        complain(f"{status.stopped}; {_how_to_continue(options, folder)}")
        return RUN_FAILED
    if status.enough:
        output.say(f"ended early: {status.enough}")
    codes = [_write_logs(part, output, stage) for part in campaign.variants.values() or [campaign]]
    output.command(command("campaign", "report", folder), "report: ")
    which = ["--variant", next(iter(campaign.variants))] if campaign.variants else []
    output.command(command("campaign", "rerun", folder, 0, *which), "repeat a run and write its log: ")
    return max(codes)


def _of_variants(status: Status) -> str:
    return f", of {plural(len(status.variants), 'variant')}" if status.variants else ""


def _continuation(campaign: Campaign, options: argparse.Namespace) -> str:
    """Command that runs what is left."""
    if options.metrics:
        return command("campaign", "resume", campaign.folder.path, "--metrics", options.metrics)
    if options.action == "run" and campaign.folder.record().metrics_file:  # a path relative to the campaign file
        return command("campaign", "run", options.campaign, "--out", campaign.folder.path)
    return command("campaign", "resume", campaign.folder.path)


def _how_to_continue(options: argparse.Namespace, folder: Path) -> str:
    """How to continue a campaign that was stopped because runs fail."""
    if options.action != "run":
        return "to continue anyway, run it again with its file and '-s limits.max_failed=1'"
    overrides = [word for change in (*options.overrides, "limits.max_failed=1") for word in ("-s", change)]
    metrics = ["--metrics", options.metrics] if options.metrics else []
    return f"to continue anyway: {command('campaign', 'run', options.campaign, '--out', folder, *metrics, *overrides)}"


def _write_logs(campaign: Campaign, output: Output, stage: Stage) -> int:
    """Repeat the runs whose logs the campaign file asks for; returns the exit code."""
    wanted = [index for index in campaign.logs_to_keep() if not campaign.folder.has_rerun(index)]
    if not wanted:
        return OK
    report, different = stage("write the logs to keep", "runs"), 0
    for done, index in enumerate(wanted, 1):
        again = campaign.rerun(index)
        if again.deviations:
            different += 1
            output.say(f"{campaign.folder.rerun(index)}: {again.verdict}")
        if report is not None:
            report(done, len(wanted))
    count = plural(len(wanted), "run")
    verdict = f"{different} of {count} differ from their rows" if different else f"{count}, which agree with their rows"
    output.say(f"logs kept: {campaign.folder.path / RERUNS} ({verdict})")
    return RUN_FAILED if different else OK


def _status(options: argparse.Namespace, output: Output, _: Stage) -> int:
    _say_status(Campaign.open(options.folder).status(), output)
    return OK


def _say_results(campaign: Campaign, status: Status, output: Output) -> None:
    """Print progress and what the results show."""
    _say_status(status, output)
    for line in campaign.sentences():
        output.say(one_line(line))


def _say_status(status: Status, output: Output) -> None:
    """Print the progress of a campaign, or of each of its variants."""
    if status.variants:
        for part in status.variants.values():
            _say_status(part, output)
        return
    outcomes = ", ".join(f"{count} {one_line(name)}" for name, count in status.outcomes.items())
    shown, failed = f" ({outcomes})" if outcomes else "", f", {status.failed} failed" if status.failed else ""
    output.say(f"{status.name}: {status.done} of {plural(status.runs, 'run')}{shown}{failed}")
    for message in status.messages:
        output.say(f"  {one_line(message)}")
    if status.failed > len(status.messages):
        output.say(f"  and {status.failed - len(status.messages)} more")
    for check in status.checks:
        runs = plural(check.runs, "run")
        worst = f"at worst {check.excess:.3g} times its tolerance, run {check.worst}"
        output.say(f"  check fails in {runs}: {one_line(check.name)}, {worst}")
        if check.name in {name for name, _ in TERMINAL_CHECKS.values()} and check.runs == status.done:
            # A law that leaves more than another is a result to compare, not a run that went wrong.
            bound = "the key 'terminal' of the scenario sets this bound, and runs that miss it are not compared"
            output.say(f"  {bound}; to compare them, give the campaign 'overrides: {{terminal: null}}' or a larger bound")


def _rerun(options: argparse.Namespace, output: Output, stage: Stage) -> int:
    campaign, code = _open(options), OK
    for index in options.index:
        stage(f"run {index}")
        again = campaign.rerun(index, options.variant)
        folder = campaign.folder.variant(options.variant) if options.variant else campaign.folder
        output.say(f"{folder.rerun(index)}: {again.verdict}")
        code = RUN_FAILED if again.deviations else code
    return code


def _report(options: argparse.Namespace, output: Output, stage: Stage) -> int:
    from ffsm_mj.experiments.report import write_report

    campaign = Campaign.open(options.folder)
    stage(f"report of {campaign.config.campaign}")
    html, page, *_ = write_report(campaign, Path(options.page) if options.page else None)
    _say_results(campaign, campaign.status(), output)
    output.say(f"report: {html}, {page}")
    return OK


_ACTIONS: dict[str, Callable[[argparse.Namespace, Output, Stage], int]] = {
    "run": _run,
    "status": _status,
    "resume": _resume,
    "extend": _extend,
    "report": _report,
    "rerun": _rerun,
}
