"""The command line as words: what each command takes, and which options have an effect together."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import cache
from ipaddress import ip_address
from typing import Any, NoReturn

from ffsm_mj.cli.campaign_words import describe_campaign
from ffsm_mj.cli.exit_codes import EXIT_CODES
from ffsm_mj.errors import InputError, unknown_name
from ffsm_mj.report.frame_rate import MOST_FRAMES_PER_SECOND

COMMANDS = {
    "run": "simulate a scenario and write its run folder",
    "check": "validate a scenario or a campaign without running it",
    "analyze": "verify conservation from the logs of runs alone",
    "export": "write a run's tables or an animation of its motion for other tools",
    "view": "open a run in the Rerun viewer",
    "campaign": "run a scenario many times with dispersed values, and report what came of it",
    "reproduce": "run the paper's case study and write every printed number beside ours",
    "schema": "print the JSON Schema of scenario files, or of campaign files",
    "new": "write a scenario, and a model around a robot's file, to start from",
    "new-law": "write a package with a control law of your own to start from",
    "completion": "print the script by which a shell completes commands, options and scenarios",
}
SHELLS = ("bash", "zsh", "fish")
_EXPORTS = {
    "csv": "a table as CSV, units in the column names",
    "parquet": "a table as Parquet, units and descriptions as metadata of the columns",
    "gif": "the motion as an animated GIF",
    "mp4": "the motion as a film (needs the extra 'mp4')",
    "html": "one page for a browser: scene, plots, verdicts (needs the extra 'html')",
}
_WORKS_WITH: dict[str, dict[str, tuple[str, ...]]] = {
    "run": {"--viewer": ("--live",), "--force": ("--out",)},
    "export": {"--table": ("--csv", "--parquet"), "--fps": ("--gif", "--mp4"), "--speed": ("--gif", "--mp4")},
}
"""By command and option: it does something only where one of these is given."""


class HelpRequest(Exception):
    """Help is what was asked for; carries its text."""


class _Parser(argparse.ArgumentParser):
    def print_help(self, _: object = None) -> NoReturn:
        """Leave it to the caller to print: argparse does not tell that it could not."""
        raise HelpRequest(self.format_help().rstrip())

    def error(self, message: str) -> NoReturn:
        """One line like every other fault of the input."""
        raise InputError(f"{self.prog}: {message}")


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """What is asked for; ``command`` is the name of the command, or None.

    Raises:
        InputError: An unknown command or option, a value that is none, or an option that has no effect here.
        HelpAsked: Help was asked for.
    """
    if arguments and not arguments[0].startswith("-") and arguments[0] not in COMMANDS:
        raise InputError(f"ffsm: {unknown_name('command', arguments[0], COMMANDS)}")
    options, extra = parser().parse_known_args(arguments)
    if extra:
        command = f"ffsm {options.command}" if options.command else "ffsm"
        raise InputError(f"{command}: unexpected {extra[0]!r}; '{command} --help' says what it takes")
    _refuse_idle(options)
    return options


@cache
def parser() -> argparse.ArgumentParser:
    """The parser of the whole command line, built once in a process."""
    root = _Parser(
        prog="ffsm", description="Exact impacts for free-floating space manipulators, on MuJoCo.", epilog=EXIT_CODES
    )
    root.add_argument("--version", action="store_true", help="print the version and exit")
    commands = root.add_subparsers(title="commands", metavar="COMMAND", dest="command")
    parsers = {
        name: commands.add_parser(name, help=text, description=f"{text[0].upper()}{text[1:]}.", epilog=EXIT_CODES)
        for name, text in COMMANDS.items()
    }
    _describe_run(parsers["run"])
    parsers["check"].add_argument(
        "scenario", help="a scenario file, a run folder, a campaign file, or the name of a shipped scenario or campaign"
    )
    _add_overrides(parsers["check"])
    _describe_analyze(parsers["analyze"])
    _describe_export(parsers["export"])
    _describe_view(parsers["view"])
    _describe_new(parsers["new"])
    describe_campaign(parsers["campaign"], _add_overrides)
    law = parsers["new-law"]
    law.add_argument("name", help="its kind, and the name of its folder and module: lower-case letters, digits, underscores")
    law.add_argument("--out", metavar="DIR", default=".", help="folder to make it in (default: here)")
    again = parsers["reproduce"]
    again.add_argument("--out", metavar="DIR", default="docs", help="folder of the pages (default: docs)")
    again.add_argument(
        "--check", action="store_true", help="write nothing; run each scenario once, exit 1 if the pages in DIR are stale"
    )
    again.add_argument(
        "--long", action="store_true", help="with --check: every run of the report, step sizes and long ones too"
    )
    parsers["schema"].add_argument("--campaign", action="store_true", help="of campaign files")
    parsers["completion"].add_argument(
        "shell", choices=SHELLS, help='e.g. eval "$(ffsm completion bash)"; fish: ffsm completion fish | source'
    )
    return root


def _describe_run(run: argparse.ArgumentParser) -> None:
    run.add_argument("scenario", nargs="?", help="a scenario file, a run folder, or the name of a shipped one (see --list)")
    run.add_argument("--list", action="store_true", help="list the shipped scenarios and exit")
    _add_overrides(run)
    run.add_argument("--out", metavar="DIR", help="run folder (default: logs/<scenario>-<UTC time>)")
    run.add_argument("--force", action="store_true", help="replace a run that DIR already holds")
    run.add_argument("--no-rerun", action="store_true", help="write no recording for the Rerun viewer")
    run.add_argument("--allow-failed-checks", action="store_true", help="exit 0 also where a check fails")
    run.add_argument("--live", action="store_true", help="show the run while it goes, in a Rerun viewer (opened if need be)")
    run.add_argument("--viewer", metavar="HOST:PORT", help="where --live finds the viewer (default: 127.0.0.1:9876)")


def _describe_analyze(analyze: argparse.ArgumentParser) -> None:
    _add_run(analyze, several=True)
    analyze.add_argument(
        "--tolerance",
        type=_tolerance,
        action="append",
        default=[],
        metavar="[LAW=]TOL",
        help="a check passes while its residual is at most TOL * (1 + scale), SI units (default: 1e-9); for all "
        "checks, or for "
        "one, e.g. --tolerance 'linear momentum=1e-10'",
    )
    analyze.add_argument("--json", action="store_true", help="print summary and checks as JSON; a list for several runs")
    analyze.add_argument("--compare", action="store_true", help="say what differs between the first run and each other one")
    analyze.add_argument("--plots", metavar="DIR", help="write figures as SVG and PNG; a folder for each of several runs")
    analyze.add_argument(
        "--traceback", action="store_true", help="print the traceback of a run that ended by internal_error"
    )


def _describe_export(export: argparse.ArgumentParser) -> None:
    _add_run(export)
    forms = export.add_mutually_exclusive_group(required=True)
    for form, text in _EXPORTS.items():
        forms.add_argument(f"--{form}", dest="form", action="store_const", const=form, help=text)
    export.add_argument(
        "--table",
        metavar="TABLE",
        help="samples (default), checks, or a kind of record (impacts, phases, ...), for --csv and --parquet",
    )
    export.add_argument("--fps", type=_frame_rate, help="frames per second, up to 50 (default: 20)")
    export.add_argument(
        "--speed", type=_positive, metavar="X", help="times real time (default: so that it lasts 12 s at most)"
    )
    export.add_argument("--out", metavar="FILE", help="where to write (default: beside the log)")


def _describe_new(new: argparse.ArgumentParser) -> None:
    new.add_argument("name", metavar="scenario", help="its name, and that of its files: letters, digits, '.', '_' and '-'")
    new.add_argument("--robot", metavar="FILE", required=True, help="MJCF or URDF of an arm, or of a robot that floats")
    new.add_argument(
        "--base-mass",
        type=_positive,
        metavar="KG",
        help="mass of the base that an arm is put on (default: five times its own)",
    )
    new.add_argument(
        "--root", metavar="BODY", default="", help="body that the robot hangs on, where the file has several trees"
    )
    new.add_argument("--tip", metavar="NAME", default="", help="site or body at the arm's end (default: found)")
    new.add_argument(
        "--package-path",
        metavar="DIR",
        action="append",
        default=[],
        help="folder of the packages of a URDF's package://NAME/..., after those above it; may be repeated",
    )
    new.add_argument("--out", metavar="DIR", default=".", help="folder to write to (default: here)")


def _describe_view(view: argparse.ArgumentParser) -> None:
    _add_run(view)
    view.add_argument(
        "--listen",
        type=_address,
        metavar="ADDRESS",
        default="127.0.0.1",
        help="address that the viewer takes data of other programs on (default: 127.0.0.1, this machine only)",
    )


def _address(text: str) -> str:
    try:
        return str(ip_address(text))
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text} is no IP address, e.g. 192.168.0.5, or 0.0.0.0 for all") from error


def _add_overrides(to: argparse.ArgumentParser) -> None:
    to.add_argument(
        "-s",
        dest="overrides",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="override a key, value in YAML, e.g. -s duration_s=5 -s task.target_m='[3, 0.5]' -s phases.1.for_s=4.6",
    )


def _add_run(to: argparse.ArgumentParser, *, several: bool = False) -> None:
    text = "run folder or .mcap file (default: logs/latest)"
    if several:
        to.add_argument("runs", nargs="*", metavar="run", default=["logs/latest"], help=text)
    else:
        to.add_argument("run", nargs="?", default="logs/latest", help=text)


def _refuse_idle(options: argparse.Namespace) -> None:
    """Refuse what would be ignored.

    Raises:
        InputError: An option has no effect beside the others.
    """
    given = {name: value for name, value in vars(options).items() if value not in (None, False, [])}
    if options.version and options.command:
        raise InputError(f"ffsm: --version has no effect with the command {options.command}")
    if "list" in given:
        idle = [_as_written(name, value) for name, value in given.items() if name not in ("command", "action", "list")]
        if idle:
            command = " ".join(given[part] for part in ("command", "action") if part in given)
            raise InputError(f"ffsm {command}: {idle[0]} has no effect with --list")
    words = {_as_written(name, value) for name, value in given.items()}
    for option, others in _WORKS_WITH.get(options.command, {}).items():
        if option in words and not words & set(others):
            raise InputError(f"ffsm {options.command}: {option} has no effect without {' or '.join(others)}")


def _as_written(name: str, value: Any) -> str:
    """An argument as it stands on the command line."""
    return {"form": f"--{value}", "overrides": "-s", "scenario": str(value)}.get(name, f"--{name.replace('_', '-')}")


def _tolerance(text: str) -> tuple[str, float]:
    """A law's name, empty for all laws, and its tolerance."""
    name, _, value = text.rpartition("=")
    return name.replace("_", " ").strip(), _positive(value)


def _frame_rate(text: str) -> float:
    if _positive(text) > MOST_FRAMES_PER_SECOND:
        raise argparse.ArgumentTypeError(f"{text} is more than {MOST_FRAMES_PER_SECOND} frames per second")
    return float(text)


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not a positive number")
    return value
