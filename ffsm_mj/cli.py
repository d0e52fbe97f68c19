"""``ffsm``: parsing, exit codes, nothing else. Every import that costs is made where it is needed."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

OK, VIOLATED, BAD_INPUT, RUN_FAILED, INTERRUPTED = 0, 1, 2, 3, 130
_MOST_FRAMES_PER_SECOND = 50
_EXIT_CODES = (
    f"exit codes: {OK} done, {VIOLATED} a law is violated (analyze) or a page is stale (reproduce --check), "
    f"{BAD_INPUT} bad input, {RUN_FAILED} the run failed (log kept), {INTERRUPTED} interrupted (log kept)"
)
_EXPORTS = {
    "csv": "a table as CSV, units in the column names",
    "parquet": "a table as Parquet, units and descriptions as metadata of the columns",
    "gif": "the motion as an animated GIF",
    "mp4": "the motion as a film (needs the extra 'mp4')",
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    options = _parser().parse_args(arguments)
    from ffsm_mj import one_blas_thread
    from ffsm_mj.errors import FfsmError, InputError, LogWriteError

    one_blas_thread()
    try:
        return int(options.command(options))
    except InputError as error:
        for line in error.lines:
            _complain(line)
    except LogWriteError as error:
        _complain(f"write_failed: {error}")
        return RUN_FAILED
    except FfsmError as error:
        _complain(str(error))
    except KeyboardInterrupt:
        _complain("interrupted")
        return INTERRUPTED
    return BAD_INPUT


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="ffsm", description="Exact impacts for free-floating space manipulators, on MuJoCo.", epilog=_EXIT_CODES
    )
    parser.add_argument("--version", action="store_true", help="print the version and exit")
    parser.set_defaults(command=lambda options: _version() if options.version else _usage(parser))
    commands = parser.add_subparsers(title="commands", metavar="COMMAND")

    run = _add(commands, "run", _run, "simulate a scenario and write its run folder")
    run.add_argument("scenario", nargs="?", help="a scenario file, or the name of a shipped one (see --list)")
    run.add_argument("--list", action="store_true", help="list the shipped scenarios and exit")
    _add_overrides(run)
    run.add_argument("--out", metavar="DIR", help="run folder (default: logs/<scenario>-<UTC time>)")
    run.add_argument("--force", action="store_true", help="replace a run that DIR already holds")
    run.add_argument("--no-rerun", action="store_true", help="write no recording for the Rerun viewer")
    run.add_argument("--live", action="store_true", help="show the run while it goes, in a Rerun viewer (opened if need be)")
    run.add_argument(
        "--viewer",
        default="127.0.0.1:9876",
        metavar="HOST:PORT",
        help="where --live finds the viewer (default: %(default)s)",
    )

    check = _add(commands, "check", _check, "validate a scenario without running it")
    check.add_argument("scenario", help="a scenario file, or the name of a shipped one")
    _add_overrides(check)

    analyze = _add(commands, "analyze", _analyze, "verify conservation from the logs of runs alone")
    _add_run(analyze, several=True)
    analyze.add_argument(
        "--tolerance",
        type=_tolerance,
        action="append",
        default=[],
        metavar="[LAW=]TOL",
        help="a law holds while its residual is at most TOL * (1 + scale), SI units (default: 1e-9); for all laws, or for "
        "one, e.g. --tolerance 'linear momentum=1e-10'",
    )
    analyze.add_argument("--json", action="store_true", help="print summary and laws as JSON; a list for several runs")
    analyze.add_argument("--compare", action="store_true", help="say what differs between the first run and each other one")
    analyze.add_argument("--plots", metavar="DIR", help="write figures as SVG and PNG; a folder for each of several runs")

    export = _add(commands, "export", _export, "write a run's tables or an animation of its motion for other tools")
    _add_run(export)
    forms = export.add_mutually_exclusive_group(required=True)
    for form, text in _EXPORTS.items():
        forms.add_argument(f"--{form}", dest="form", action="store_const", const=form, help=text)
    export.add_argument(
        "--table",
        default="samples",
        metavar="TABLE",
        help="samples (default), impacts, phases or laws, for --csv and --parquet",
    )
    export.add_argument("--fps", type=_frame_rate, default=20.0, help="frames per second, up to 50 (default: 20)")
    export.add_argument(
        "--speed", type=_positive, metavar="X", help="times real time (default: so that it lasts 12 s at most)"
    )
    export.add_argument("--out", metavar="FILE", help="where to write (default: beside the log)")

    view = _add(commands, "view", _view, "open a run in the Rerun viewer")
    _add_run(view)

    again = _add(commands, "reproduce", _reproduce, "run the paper's case study and write every printed number beside ours")
    again.add_argument("--out", metavar="DIR", default="docs", help="folder of the pages (default: docs)")
    again.add_argument("--check", action="store_true", help="write nothing; exit 1 if the pages in DIR are not current")

    _add(commands, "schema", _schema, "print the JSON Schema of scenario files")
    return parser


def _add(commands: Any, name: str, action: Callable[[argparse.Namespace], int], text: str) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(name, help=text, description=f"{text[0].upper()}{text[1:]}.")
    parser.set_defaults(command=action)
    return parser


def _add_overrides(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "-s",
        dest="overrides",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="override a key, value in YAML, e.g. -s duration_s=5 -s task.target_m='[3, 0.5]' -s phases.1.for_s=4.6",
    )


def _add_run(parser: argparse.ArgumentParser, *, several: bool = False) -> None:
    text = "run folder or .mcap file (default: logs/latest)"
    if several:
        parser.add_argument("runs", nargs="*", metavar="run", default=["logs/latest"], help=text)
    else:
        parser.add_argument("run", nargs="?", default="logs/latest", help=text)


def _tolerance(text: str) -> tuple[str, float]:
    """A law's name, empty for all laws, and its tolerance."""
    name, _, value = text.rpartition("=")
    return name.replace("_", " ").strip(), _positive(value)


def _frame_rate(text: str) -> float:
    if _positive(text) > _MOST_FRAMES_PER_SECOND:
        raise argparse.ArgumentTypeError(f"{text} is more than {_MOST_FRAMES_PER_SECOND} frames per second")
    return float(text)


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not a positive number")
    return value


def _usage(parser: argparse.ArgumentParser) -> int:
    parser.print_help()
    return OK


def _version() -> int:
    from importlib.metadata import version

    _say(f"ffsm-mj {version('ffsm-mj')}")
    return OK


def _run(options: argparse.Namespace) -> int:
    if options.list:
        return _list()
    if options.scenario is None:
        _complain("ffsm run: name a scenario; 'ffsm run --list' shows the shipped ones")
        return BAD_INPUT
    from ffsm_mj.progress import progress
    from ffsm_mj.run_folder import default_folder, link_latest
    from ffsm_mj.runner import prepare

    prepared = prepare(options.scenario, options.overrides)
    folder = Path(options.out) if options.out else default_folder(prepared.scenario.name)
    live, rerun = options.viewer if options.live else None, False if options.no_rerun else None
    with progress() as shown:
        report = shown.stage(prepared.scenario.name, "s", prepared.scenario.duration_s)
        run = prepared.run(out=folder, force=options.force, rerun=rerun, live=live, report=report)
    if not options.out:
        link_latest(folder)
    from ffsm_mj.text_report import run_report

    _say(run_report(run))
    where = "" if not options.out else f" {folder}"
    _say(f"\nfiles in {folder}: {', '.join(sorted(p.name for p in folder.iterdir()))}")
    _say(f"look at it: ffsm view{where}   verify the log: ffsm analyze{where}")
    if run.outcome == "completed":
        return OK
    _complain(f"{run.outcome}: {run.message}")
    return INTERRUPTED if run.outcome == "interrupted" else RUN_FAILED


def _list() -> int:
    from ffsm_mj.shipped import scenario_names, scenario_path
    from ffsm_mj.yaml_source import read_yaml

    names = scenario_names()
    width = max(map(len, names))
    for name in names:
        _say(f"{name:{width}}  {read_yaml(scenario_path(name)).data.get('description', '')}")
    return OK


def _check(options: argparse.Namespace) -> int:
    from ffsm_mj.runner import prepare

    for line in prepare(options.scenario, options.overrides).describe():
        _say(line)
    return OK


def _analyze(options: argparse.Namespace) -> int:
    from ffsm_mj.analysis_commands import analyze

    return OK if analyze(options, _say) else VIOLATED


def _export(options: argparse.Namespace) -> int:
    from ffsm_mj.analysis_commands import export

    export(options, _say)
    return OK


def _view(options: argparse.Namespace) -> int:
    import tempfile

    from ffsm_mj.log.viewer import has_display
    from ffsm_mj.run_folder import RECORDING, find_log, finished_recording

    log = find_log(Path(options.run))
    recording = finished_recording(Path(options.run))
    if not has_display():
        _complain(f"no display to open the Rerun viewer on; {recording or log} shows on any machine that has one")
        return RUN_FAILED
    if recording is not None:
        return _open_viewer(recording)
    from ffsm_mj.analysis import load_run
    from ffsm_mj.recording import write_recording

    with tempfile.TemporaryDirectory(prefix="ffsm-") as folder:
        made = Path(folder) / RECORDING
        write_recording(load_run(log).log, made)
        return _open_viewer(made)


def _open_viewer(recording: Path) -> int:
    import subprocess

    from ffsm_mj.log.viewer import viewer_command

    if subprocess.call(viewer_command(str(recording))) == 0:
        return OK
    _complain("the Rerun viewer did not open; its own message is above")
    return RUN_FAILED


def _reproduce(options: argparse.Namespace) -> int:
    from ffsm_mj.progress import progress
    from ffsm_mj.reproduction import reproduce

    with progress() as shown:
        again = reproduce(shown.stage("reproduce", "runs"))
    _say(again.text())
    folder = Path(options.out)
    if not options.check:
        _say(f"\nwritten: {', '.join(str(path) for path in again.write(folder))}")
        return OK
    stale = again.stale(folder)
    for line in stale:
        _complain(line)
    _say(f"\n{folder}: {f'{len(stale)} lines are not current' if stale else 'every page is current'}")
    return VIOLATED if stale else OK


def _schema(_: argparse.Namespace) -> int:
    import json

    from ffsm_mj.scenario_schema import scenario_schema

    _say(json.dumps(scenario_schema(), indent=2))
    return OK


def _say(text: str) -> None:
    """Print; a reader that has gone away ends nothing."""
    try:
        print(text, flush=True)
    except OSError:
        # Python would complain again when it closes stdout at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


def _complain(text: str) -> None:
    try:
        print(text, file=sys.stderr, flush=True)
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)


if __name__ == "__main__":
    sys.exit(main())
