"""Implementation of ``ffsm study``."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from ffsm_mj.campaign.execution.driver import EngineLostError
from ffsm_mj.campaign.execution.file_metrics import read_metrics
from ffsm_mj.campaign.script_classes import NO_CLASSES, ScriptClasses
from ffsm_mj.cli.batch_progress import BatchProgress
from ffsm_mj.cli.campaign import say_status
from ffsm_mj.cli.display import Say, Stage, display
from ffsm_mj.cli.exit_codes import OK, RUN_FAILED
from ffsm_mj.cli.standard_streams import Output, complain
from ffsm_mj.errors import InputError, one_line, working_on
from ffsm_mj.invocation import command
from ffsm_mj.report.text_table import listed, wrapped
from ffsm_mj.studies.plan import load_study
from ffsm_mj.studies.shipped import STUDIES
from ffsm_mj.studies.study import Study


def study(options: argparse.Namespace, output: Output) -> int:
    """Perform the action; returns the exit code.

    Raises:
        InputError: The study file or the folder is invalid, or the settings differ.
    """
    with (
        display(output) as (say, shown),
        working_on(options.folder if "folder" in options else options.study or "study"),
    ):
        return _ACTIONS[options.action](options, say, shown.stage)


def _run(options: argparse.Namespace, say: Say, stage: Stage) -> int:
    if options.list:
        say(listed(STUDIES.described()))
        return OK
    if options.study is None:
        raise InputError(f"ffsm study run: name a study file; '{command('study', 'run', '--list')}' shows the shipped ones")
    stage("sample and validate the runs", "")
    own = ScriptClasses(metrics=read_metrics(Path(options.metrics))) if options.metrics else NO_CLASSES
    plan = load_study(options.study, options.overrides, own)
    for name, reason in plan.not_applicable.items():
        say(f"not applicable: {name}: {reason}")
    out = Path(options.out) if options.out else Path("logs") / f"study-{plan.config.study}"
    return _make(Study.begin(plan, out), options, say, stage)


def _resume(options: argparse.Namespace, say: Say, stage: Stage) -> int:
    return _make(Study.open(options.folder, metrics=options.metrics or {}), options, say, stage)


def _make(found: Study, options: argparse.Namespace, say: Say, stage: Stage) -> int:
    """Execute the remaining runs."""
    name = found.config.study
    report = stage(name, "runs") or BatchProgress(name)
    try:
        found.run(workers=options.workers, dask=options.dask or "", retry=getattr(options, "retry", ()), report=report)
    except EngineLostError as error:
        complain(str(error))
        return RUN_FAILED
    except KeyboardInterrupt:
        _say_results(found, say)
        say(f"continue: {_continuation(found, options)}")
        raise
    _say_results(found, say)
    say(f"report: {command('study', 'report', found.folder.path)}")
    return OK


def _continuation(found: Study, options: argparse.Namespace) -> str:
    """Command that runs what is left."""
    if options.metrics:
        return command("study", "resume", found.folder.path, "--metrics", options.metrics)
    if found.config.metrics_file is not None:  # relative to the study file
        return command("study", "run", options.study, "--out", found.folder.path)
    return command("study", "resume", found.folder.path)


def _status(options: argparse.Namespace, say: Say, _: Stage) -> int:
    _say_results(Study.open(options.folder), say)
    return OK


def _rerun(options: argparse.Namespace, say: Say, stage: Stage) -> int:
    found, code = Study.open(options.folder, metrics=options.metrics or {}), OK
    for index in options.index:
        stage(f"run {index} of {options.variant}", "")
        again = found.rerun(options.variant, index)
        say(f"{found.campaigns[options.variant].folder.rerun(index)}: {again.verdict}")
        code = RUN_FAILED if again.differences else code
    return code


def _report(options: argparse.Namespace, say: Say, stage: Stage) -> int:
    from ffsm_mj.studies.report import write_study_report

    found = Study.open(options.folder)
    stage(f"report of {found.config.study}", "")
    html, page, *_ = write_study_report(found, Path(options.page) if options.page else None)
    _say_results(found, say)
    say(f"report: {html}, {page}")
    return OK


def _say_results(found: Study, say: Say) -> None:
    for status in found.status().values():
        say_status(status, say)
    for sentence in found.sentences():
        say(wrapped(one_line(sentence), 2))


_ACTIONS: dict[str, Callable[[argparse.Namespace, Say, Stage], int]] = {
    "run": _run,
    "status": _status,
    "resume": _resume,
    "report": _report,
    "rerun": _rerun,
}
