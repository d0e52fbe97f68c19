"""Entry point of ``ffsm``: dispatch of commands and their exit codes. Slow imports are deferred to where they are used."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from textwrap import fill

from ffsm_mj.assembly.interrupts import raised
from ffsm_mj.cli.command_line import HelpRequest, parse, parser
from ffsm_mj.cli.exit_codes import BAD_INPUT, CHECK_FAILED, DAMAGED, INTERRUPTED, OK, OUTPUT_LOST, RUN_FAILED, TRUNCATED
from ffsm_mj.cli.progress import Progress, progress
from ffsm_mj.cli.quiet import quiet_libraries
from ffsm_mj.cli.standard_streams import Output, complain, secure

_VIEWER = "127.0.0.1:9876"
_SHOW_TRACEBACK = "FFSM_TRACEBACK"
"""Environment variable: unhandled exceptions are raised instead of reported in one line."""
_READERS = ("analyze", "export", "view", "campaign", "new")
"""Commands that read files of unknown origin."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    secure()
    output = Output()
    try:
        code = _perform(sys.argv[1:] if arguments is None else arguments, output)
    except Exception as error:
        if os.environ.get(_SHOW_TRACEBACK):
            raise
        code = _internal_error(error)
    if output.lost:
        complain(f"stdout: output is lost ({output.lost})")
        return code or OUTPUT_LOST
    return code


def _internal_error(error: Exception) -> int:
    """Report an unhandled exception in one line; Python's own exit code for it, 1, would mean a failed check here."""
    from ffsm_mj.errors import described, raised_at

    complain(f"internal_error: {described(error)}{raised_at(error)}; {_SHOW_TRACEBACK}=1 shows the traceback")
    return RUN_FAILED


def one_blas_thread() -> None:
    """Limit BLAS to one thread in this process and its children; must be called before numpy is imported.

    For runs from a user's own process see :mod:`ffsm_mj.assembly.blas_threads`.
    """
    for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(variable, "1")


def _perform(arguments: Sequence[str], output: Output) -> int:
    """Perform the command; report errors in one line per fault."""
    from ffsm_mj.errors import FfsmError, InputError, LogWriteError, OutputLostError

    one_blas_thread()
    try:
        with raised():
            options = parse(arguments)
            with quiet_libraries() if options.command in _READERS else nullcontext():
                return _COMMANDS[options.command](options, output)
    except HelpRequest as asked:
        output.say(str(asked))
        return OK
    except InputError as error:
        for line in error.lines:
            complain(line)
    except LogWriteError as error:
        complain(f"write_failed: {error}")
        return RUN_FAILED
    except OutputLostError as error:
        complain(str(error))
        return OUTPUT_LOST
    except FfsmError as error:
        complain(str(error))
    except OSError as error:  # a name that is too long, a folder that cannot be entered
        complain(": ".join(str(part) for part in (error.filename, error.strerror or error) if part))
    except KeyboardInterrupt:
        complain("interrupted")
        return INTERRUPTED
    return BAD_INPUT


def _usage(options: argparse.Namespace, output: Output) -> int:
    if not options.version:
        output.say(parser().format_help().rstrip())
        return OK
    from importlib.metadata import version

    output.say(f"ffsm-mj {version('ffsm-mj')}")
    return OK


def _run(options: argparse.Namespace, output: Output) -> int:
    if options.list:
        return _list(output)
    if options.scenario is None:
        complain("ffsm run: name a scenario; 'ffsm run --list' shows the shipped ones")
        return BAD_INPUT
    from ffsm_mj.assembly.prepare import prepare
    from ffsm_mj.campaign.plan.shipped import is_campaign
    from ffsm_mj.errors import InputError
    from ffsm_mj.log.run_folder import RunFolder

    if is_campaign(options.scenario):
        raise InputError(f"{options.scenario}: is a campaign, not a scenario; use 'ffsm campaign run {options.scenario}'")
    prepared = prepare(options.scenario, options.overrides)
    scenario = prepared.scenario
    if options.out == "":
        complain("--out: an empty name; leave --out away for a folder in logs/")
        return BAD_INPUT
    folder = RunFolder(Path(options.out), force=options.force) if options.out else RunFolder.in_logs(scenario.name)
    live, rerun = (options.viewer or _VIEWER) if options.live else None, False if options.no_rerun else None
    with progress() as shown:
        report = shown.stage(scenario.name, "s", scenario.duration_s)
        run = prepared.run(folder=folder, rerun=rerun, live=live, report=report)
    if not options.out:
        folder.link_latest()
    from ffsm_mj.report.check_report import any_check_failed, fail_by_truncation, verdict
    from ffsm_mj.report.run_report import run_report
    from ffsm_mj.verification.checks import DEFAULT_TOLERANCE

    output.say(run_report(run))
    output.say(f"\nfiles in {folder.path}: {', '.join(sorted(p.name for p in folder.path.iterdir()))}")
    output.say(f"view: ffsm view {folder.path}   verify: ffsm analyze {folder.path}")
    if run.outcome != "completed":
        complain(f"{run.outcome}: {run.message}")
        return INTERRUPTED if run.outcome == "interrupted" else RUN_FAILED
    if any_check_failed(run, DEFAULT_TOLERANCE):
        complain(verdict(run, run.checks()))
        code = TRUNCATED if fail_by_truncation(run.checks()) else CHECK_FAILED
        return OK if options.allow_failed_checks else code
    return OK


def _list(output: Output) -> int:
    from ffsm_mj.report.text_table import terminal_width
    from ffsm_mj.scenario.shipped import scenario_names, scenario_path
    from ffsm_mj.scenario.source import read_yaml

    names = scenario_names()
    width, room = max(map(len, names)), terminal_width()
    for name in names:
        text = f"{name:{width}}  {read_yaml(scenario_path(name)).data.get('description', '')}"
        output.say(text if room is None else fill(text, max(room, width + 22), subsequent_indent=(width + 2) * " "))
    return OK


def _check(options: argparse.Namespace, output: Output) -> int:
    from ffsm_mj.assembly.prepare import prepare
    from ffsm_mj.campaign.plan.shipped import is_campaign

    if is_campaign(options.scenario):
        from ffsm_mj.campaign.plan.description import description
        from ffsm_mj.campaign.plan.loading import load_campaign

        plan = load_campaign(options.scenario, options.overrides)
        lines = description(plan, plan.design())
    else:
        lines = prepare(options.scenario, options.overrides).describe()
    for line in lines:
        output.say(line)
    return OK


def _analyze(options: argparse.Namespace, output: Output) -> int:
    from ffsm_mj.cli.commands import analyze

    with _showing(output) as (say, shown):
        return analyze(options, say, shown.stage)


def _export(options: argparse.Namespace, output: Output) -> int:
    from ffsm_mj.cli.commands import export

    with _showing(output) as (say, shown):
        missing = export(options, say, shown.stage)
    if not missing:
        return OK
    complain(missing)
    return DAMAGED


@contextmanager
def _showing(output: Output) -> Iterator[tuple[Callable[[str], None], Progress]]:
    """Progress, and a function that prints while progress is displayed."""
    with progress() as shown:

        def say(text: str) -> None:
            with shown.hidden():
                output.say(text)

        yield say, shown


def _campaign(options: argparse.Namespace, output: Output) -> int:
    from ffsm_mj.cli.campaign import campaign

    with _showing(output) as (say, shown):
        return campaign(options, say, shown.stage)


def _view(options: argparse.Namespace, _: Output) -> int:
    import tempfile

    from ffsm_mj.log.rerun.viewer import has_display
    from ffsm_mj.log.run_folder import RECORDING, find_log, finished_recording

    log = find_log(Path(options.run))
    recording = finished_recording(Path(options.run))
    if not has_display():
        complain(f"no display for the Rerun viewer; open {recording or log} on a machine that has one")
        return RUN_FAILED
    if recording is not None:
        return _open_viewer(recording, options.listen)
    from ffsm_mj.errors import working_on
    from ffsm_mj.log.rerun.from_log import write_recording
    from ffsm_mj.report.run import load_run

    with tempfile.TemporaryDirectory(prefix="ffsm-") as folder:
        made = Path(folder) / RECORDING
        with progress() as shown, working_on(log):
            shown.stage(f"recording of {log}")
            write_recording(load_run(log).log, made)
        return _open_viewer(made, options.listen)


def _open_viewer(recording: Path, listen: str) -> int:
    import subprocess

    from ffsm_mj.log.rerun.viewer import viewer_command

    if subprocess.call(viewer_command(str(recording.absolute()), listen=listen)) == 0:
        return OK
    complain("the Rerun viewer did not open; see its message above")
    return RUN_FAILED


def _reproduce(options: argparse.Namespace, output: Output) -> int:
    from ffsm_mj.report.output_place import usable_folder
    from ffsm_mj.reproduction import committed_pages, reproduce, stale_once

    folder = Path(options.out)
    if options.check:
        committed_pages(folder)
    else:
        usable_folder(folder)
    with progress() as shown:
        report = shown.stage("reproduce", "runs")
        once = options.check and not options.long
        again, stale = (None, stale_once(folder, report)) if once else (reproduce(report), [])
    if again is None:
        return _judged(folder, stale, output)
    output.say(again.text())
    if options.check:
        return _judged(folder, again.stale(folder), output)
    output.say(f"\nwritten: {', '.join(str(path) for path in again.write(folder))}")
    return OK


def _judged(folder: Path, stale: Sequence[str], output: Output) -> int:
    """Print the stale lines of the pages."""
    for line in stale:
        complain(line)
    output.say(f"\n{folder}: {f'{len(stale)} lines are not current' if stale else 'every page is current'}")
    return CHECK_FAILED if stale else OK


def _schema(options: argparse.Namespace, output: Output) -> int:
    import json

    from ffsm_mj.campaign.plan.schema import campaign_schema
    from ffsm_mj.scenario.schema import scenario_schema

    output.say(json.dumps(campaign_schema() if options.campaign else scenario_schema(), indent=2))
    return OK


def _new(options: argparse.Namespace, output: Output) -> int:
    from ffsm_mj.errors import working_on
    from ffsm_mj.templates.robot import TemplateRequest, write_scenario

    packages = tuple(map(Path, options.package_path))
    with progress() as shown, working_on(options.robot):
        shown.stage(f"compile {options.robot}")
        lines = write_scenario(
            TemplateRequest(
                name=options.name,
                robot=Path(options.robot),
                out=Path(options.out),
                base_mass=options.base_mass,
                root=options.root,
                tip=options.tip,
                packages=packages,
            )
        )
    for line in lines:
        output.say(line)
    return OK


def _new_law(options: argparse.Namespace, output: Output) -> int:
    from ffsm_mj.scenario.loading import controller_kinds
    from ffsm_mj.templates.law import write_law

    written = write_law(options.name, Path(options.out), controller_kinds())
    home = Path(options.out) / options.name
    output.say(f"files in {home}: {', '.join(written)}")
    output.say(f"try it: cd {home} && pip install -e . && ffsm run {options.name}.yaml && pytest")
    return OK


def _completion(options: argparse.Namespace, output: Output) -> int:
    from ffsm_mj.cli.completion import completion

    output.say(completion(options.shell))
    return OK


_COMMANDS: dict[str | None, Callable[[argparse.Namespace, Output], int]] = {
    None: _usage,
    "run": _run,
    "check": _check,
    "analyze": _analyze,
    "export": _export,
    "view": _view,
    "campaign": _campaign,
    "reproduce": _reproduce,
    "schema": _schema,
    "new": _new,
    "new-law": _new_law,
    "completion": _completion,
}


if __name__ == "__main__":
    sys.exit(main())
