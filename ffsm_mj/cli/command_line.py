"""The argument parser: options of each command, and which options depend on others."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import cache
from typing import Any, NoReturn

from ffsm_mj.cli.argument_values import (
    address,
    at_least_one,
    frame_rate,
    instant,
    outcomes,
    positive,
    seconds_or_off,
    tolerance,
    whole,
)
from ffsm_mj.cli.exit_codes import exit_codes
from ffsm_mj.errors import InputError, unknown_name
from ffsm_mj.invocation import command
from ffsm_mj.similar_names import did_you_mean

COMMANDS = {
    "run": "simulate a scenario and write its run folder",
    "check": "validate a scenario or a campaign without running it",
    "analyze": "replay logs and recompute the checks of their runs",
    "export": "export a run's tables, or an animation of its motion",
    "view": "open a run, or a scenario as it starts, in the Rerun viewer",
    "impact-map": "map what an impact does over the configurations of the arm that reach its contact",
    "sensitivity": "print what uncertain numbers of a scenario change in its results",
    "fit": "fit restitution and friction of a scenario's contact rules to recorded motions",
    "campaign": "run a scenario, or variants of it, many times with dispersed parameters, and report the results",
    "validate": "compute published cases and closed forms and compare every number with ours",
    "fmu": "write a scenario as a functional mock-up unit (FMI 2.0) for co-simulation",
    "schema": "print the JSON Schema of scenario or campaign files",
    "new": "generate a scenario and a scene model from a robot's MJCF or URDF file, or from a logged state",
    "new-law": "generate a Python package with a control law of your own",
    "completion": "print a shell completion script for commands, options, scenarios and their keys",
}
_SUCCESSORS = {"reproduce": ("validate", "seed-paper"), "study": ("campaign",)}
"""Commands of earlier versions, and what does their work."""
_NEW_OPTIONS = {"--study": "--campaign"}
"""Options of earlier versions: what they are now."""
SHELLS = ("bash", "zsh", "fish")
_EXPORTS = {
    "csv": "export a table as CSV, with units in the column names",
    "parquet": "export a table as Parquet, with units and descriptions as column metadata",
    "gif": "export the motion as an animated GIF",
    "mp4": "export the motion as a video (needs the extra 'mp4')",
    "html": "export a page for a browser: scene, plots, checks (needs the extra 'html')",
}


_WORKS_WITH: dict[str, dict[str, tuple[str, ...]]] = {
    "run": {"--viewer": ("--live",), "--force": ("--out",)},
    "export": {"--table": ("--csv", "--parquet"), "--fps": ("--gif", "--mp4"), "--speed": ("--gif", "--mp4")},
    "validate": {"--long": ("--check", "--data")},
    "new": dict.fromkeys(("--target", "--target-mass", "--grapple"), ("--wheels", "--thrusters")),
}
"""Options by command and option of which at least one must be given for the option to have an effect."""


_CAMPAIGN_ACTIONS = {
    "run": "run a campaign, or continue the one in its folder, and print its results",
    "status": "print the progress of a campaign",
    "resume": "run what has no result yet",
    "extend": "enlarge a design of random or Sobol samples, and run the new samples",
    "report": "write tables, figures and a page for a campaign, and print a summary",
    "rerun": "repeat runs of a campaign, write their logs and compare them with the recorded results",
}


class HelpRequest(Exception):
    """Help was requested; carries its text."""


class _Formatter(argparse.HelpFormatter):
    """Help with room for the names of commands: argparse does not count how far their list is indented."""

    def add_argument(self, action: argparse.Action) -> None:
        """Make room for an argument, of commands with their indentation."""
        super().add_argument(action)
        if isinstance(action, argparse._SubParsersAction):  # neither is public
            self._action_max_length += self._indent_increment


class _Parser(argparse.ArgumentParser):
    def __init__(self, **options: Any) -> None:
        super().__init__(**{"formatter_class": _Formatter, **options})

    def print_help(self, _: object = None) -> NoReturn:
        """Raise ``HelpRequest``: the caller prints, since argparse does not report a failure to print."""
        raise HelpRequest(self.format_help().rstrip())

    def error(self, message: str) -> NoReturn:
        """Report the error in one line, as for any other invalid input."""
        raise InputError(f"{self.prog}: {message}")


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """Parse the arguments; ``command`` is the name of the command, or None.

    Raises:
        InputError: An unknown command or option, an invalid value, or an option that has no effect here.
        HelpRequest: Help was requested.
    """
    if arguments and arguments[0] in _SUCCESSORS:
        raise InputError(f"ffsm: unknown command {arguments[0]!r}; use '{command(*_SUCCESSORS[arguments[0]])}'")
    if arguments and not arguments[0].startswith("-") and arguments[0] not in COMMANDS:
        raise InputError(f"ffsm: {unknown_name('command', arguments[0], COMMANDS)}")
    options, extra = parser().parse_known_args(arguments)
    if extra:
        words = [options.command, *([options.action] if "action" in options else [])] if options.command else []
        meant = did_you_mean(extra[0], _option_strings(words)) if extra[0].startswith("-") else ""
        meant = f", now {_NEW_OPTIONS[extra[0]]!r}" if extra[0] in _NEW_OPTIONS else meant
        help_command = command(*words, "--help")
        raise InputError(f"{' '.join(['ffsm', *words])}: unexpected argument {extra[0]!r}{meant}; see '{help_command}'")
    _refuse_idle(options)
    return options


def _option_strings(words: Sequence[str]) -> list[str]:
    """Options of a command or of its action."""
    of = parser()
    for word in words:
        (below,) = (action for action in of._actions if isinstance(action, argparse._SubParsersAction))  # not public
        of = below.choices[word]
    return [name for action in of._actions for name in action.option_strings]


def _refuse_idle(options: argparse.Namespace) -> None:
    """Refuse options that would be ignored.

    Raises:
        InputError: An option has no effect in combination with the others.
    """
    stated = {name: value for name, value in vars(options).items() if value not in (None, False, [])}
    if options.version and options.command:
        raise InputError(f"ffsm: --version has no effect with the command {options.command}")
    if "list" in stated:
        idle = [_as_written(name, value) for name, value in stated.items() if name not in ("command", "action", "list")]
        if idle:
            command = " ".join(stated[part] for part in ("command", "action") if part in stated)
            raise InputError(f"ffsm {command}: {idle[0]} has no effect with --list")
    words = {_as_written(name, value) for name, value in stated.items()}
    for option, others in _WORKS_WITH.get(options.command, {}).items():
        if option in words and not words & set(others):
            raise InputError(f"ffsm {options.command}: {option} has no effect without {' or '.join(others)}")


def _as_written(name: str, value: Any) -> str:
    """An argument as written on the command line."""
    return {"form": f"--{value}", "overrides": "-s", "scenario": str(value)}.get(name, f"--{name.replace('_', '-')}")


@cache
def parser() -> argparse.ArgumentParser:
    """Parser of the whole command line, built once per process."""
    root = _Parser(
        prog="ffsm", description="Exact impacts for free-floating space manipulators, on MuJoCo.", epilog=exit_codes()
    )
    root.add_argument("--version", action="store_true", help="print the version and exit")
    commands = root.add_subparsers(title="commands", metavar="COMMAND", dest="command")
    parsers = {
        name: commands.add_parser(name, help=text, description=f"{text[0].upper()}{text[1:]}.", epilog=exit_codes(name))
        for name, text in COMMANDS.items()
    }
    _describe_run(parsers["run"])
    parsers["check"].add_argument(
        "scenario",
        help="a scenario or campaign file, a run folder, or the name of a shipped scenario or campaign",
    )
    _add_overrides(parsers["check"])
    _describe_analyze(parsers["analyze"])
    _describe_export(parsers["export"])
    _describe_view(parsers["view"])
    _describe_new(parsers["new"])
    _describe_campaign(parsers["campaign"])
    _describe_impact_map(parsers["impact-map"])
    _describe_sensitivity(parsers["sensitivity"])
    _describe_fit(parsers["fit"])
    law = parsers["new-law"]
    law.add_argument(
        "name", help="kind of the law, also name of the folder and module: lower-case letters, digits, underscores"
    )
    law.add_argument("--out", metavar="DIR", default=".", help="parent folder of the package (default: current folder)")
    _describe_validate(parsers["validate"])
    parsers["fmu"].add_argument("scenario", help="a scenario file, a run folder, or the name of a shipped scenario")
    _add_overrides(parsers["fmu"])
    parsers["fmu"].add_argument("--out", metavar="FILE", help="output file (default: NAME.fmu, after the scenario)")
    parsers["schema"].add_argument("--campaign", action="store_true", help="print the schema of campaign files")
    parsers["completion"].add_argument("--keys", nargs=argparse.REMAINDER, metavar="WORD", help=argparse.SUPPRESS)
    parsers["completion"].add_argument(
        "shell", nargs="?", choices=SHELLS, help='e.g. eval "$(ffsm completion bash)"; fish: ffsm completion fish | source'
    )
    return root


def _describe_run(run: argparse.ArgumentParser) -> None:
    run.add_argument("scenario", nargs="?", help="a scenario file, a run folder, or the name of a shipped one (see --list)")
    run.add_argument("--list", action="store_true", help="list the shipped scenarios and exit")
    _add_overrides(run)
    run.add_argument(
        "--from",
        dest="from_s",
        type=float,
        metavar="TIME",
        help="go on from this instant of a run, s: scenario is its folder, overrides change its settings there",
    )
    run.add_argument("--out", metavar="DIR", help="run folder (default: logs/<scenario>-<UTC time>)")
    run.add_argument("--force", action="store_true", help="replace a run that DIR already holds")
    run.add_argument("--no-rerun", action="store_true", help="do not write a recording for the Rerun viewer")
    run.add_argument("--allow-failed-checks", action="store_true", help="exit 0 even if a check fails")
    _add_truncation(run)
    run.add_argument(
        "--realtime",
        nargs="?",
        const=1.0,
        type=positive,
        metavar="FACTOR",
        help="wait for the clock: FACTOR simulated seconds per second (default: 1)",
    )
    run.add_argument("--live", action="store_true", help="stream the run to a Rerun viewer, which is opened if necessary")
    run.add_argument("--viewer", metavar="HOST:PORT", help="address of the viewer for --live (default: 127.0.0.1:9876)")


def _describe_analyze(analyze: argparse.ArgumentParser) -> None:
    _add_run(analyze, several=True)
    analyze.add_argument(
        "--tolerance",
        type=tolerance,
        action="append",
        default=[],
        metavar="[CHECK=]TOL",
        help="a check passes if its residual is at most TOL * (1 + scale) in SI units (default: 1e-9); for all "
        "checks, or for one, e.g. --tolerance 'linear momentum=1e-10'",
    )
    _add_truncation(analyze)
    analyze.add_argument("--json", action="store_true", help="print summary and checks as JSON; a list for several runs")
    analyze.add_argument(
        "--compare", action="store_true", help="print the differences between the first run and each other run"
    )
    analyze.add_argument(
        "--plots", metavar="DIR", help="write figures as SVG and PNG, with one subfolder per run if several are given"
    )
    analyze.add_argument(
        "--traceback", action="store_true", help="print the traceback of a run that ended with internal_error"
    )


def _describe_export(export: argparse.ArgumentParser) -> None:
    _add_run(export)
    forms = export.add_mutually_exclusive_group(required=True)
    for form, text in _EXPORTS.items():
        forms.add_argument(f"--{form}", dest="form", action="store_const", const=form, help=text)
    export.add_argument(
        "--table",
        metavar="TABLE",
        help="table for --csv or --parquet: samples (default), checks, or records of a kind (impacts, phases, ...)",
    )
    export.add_argument("--fps", type=frame_rate, help="frames per second, up to 50 (default: 20)")
    export.add_argument(
        "--speed", type=positive, metavar="X", help="playback speed relative to real time (default: at most 12 s of video)"
    )
    export.add_argument("--out", metavar="FILE", help="output file (default: beside the log)")


def _describe_new(new: argparse.ArgumentParser) -> None:
    new.add_argument(
        "name", metavar="scenario", help="name of the scenario and of its files: letters, digits, '.', '_' and '-'"
    )
    new.add_argument(
        "--robot",
        metavar="FILE",
        help="MJCF or URDF file of a manipulator or of a floating robot; with --scene the root body of the robot in it",
    )
    new.add_argument(
        "--menagerie",
        metavar="NAME",
        help="robot of MuJoCo Menagerie in place of --robot: NAME, or NAME/FILE; its files are copied to a folder NAME "
        "(needs the package mujoco-menagerie)",
    )
    new.add_argument(
        "--scene", metavar="FILE", help="MJCF file with robot, objects and surroundings, whose robot is --robot BODY"
    )
    new.add_argument(
        "--from",
        dest="state",
        type=instant,
        metavar="RUN@TIME",
        help="a scenario that begins at the state of a run folder at a time in s, in numbers to change or disperse",
    )
    new.add_argument(
        "--base",
        choices=("none",),
        help="'none': no base is added, and the root of a URDF floats, as of a spacecraft with an arm",
    )
    new.add_argument(
        "--base-mass",
        "--bus-mass",
        type=positive,
        metavar="KG",
        help="mass of the base to mount a manipulator on (default: five times the mass of the manipulator; with --wheels or "
        "--thrusters 500, wheels included)",
    )
    new.add_argument(
        "--base-size",
        "--bus-size",
        type=positive,
        nargs="+",
        metavar="M",
        help="edge of the base, or its three edges x y z, m (default: those of a cube of 250 kg/m^3)",
    )
    new.add_argument(
        "--wheels",
        type=whole,
        metavar="N",
        help="a spacecraft with N reaction wheels on the base, 3 (along the axes), 4 (a pyramid) to 12 (on a cone), and a "
        "mission that ends in a capture (default with --thrusters: 4)",
    )
    new.add_argument(
        "--thrusters",
        type=whole,
        metavar="N",
        help="and with N thrusters: 6, 8, 12, 16 or 24 (default with --wheels: 12)",
    )
    new.add_argument(
        "--target",
        metavar="FILE",
        help="MJCF, URDF or mesh (.stl, .obj, .msh) of what is captured (default: a cuboid)",
    )
    new.add_argument("--target-mass", type=positive, metavar="KG", help="of a mesh or cuboid (default: a fifth of the base)")
    new.add_argument(
        "--grapple",
        metavar="SITE",
        help="site of the target to grasp it at (default: in front of one of its faces)",
    )
    new.add_argument("--root", metavar="BODY", default="", help="root body of the robot, if the file has several trees")
    new.add_argument(
        "--tip", metavar="NAME", default="", help="site or body at the end of the arm (default: found automatically)"
    )
    new.add_argument(
        "--package-path",
        metavar="DIR",
        action="append",
        default=[],
        help="folder to search for package://NAME/... of a URDF, after the parent folders of the file; may be repeated",
    )
    new.add_argument(
        "--decompose",
        nargs="?",
        const="planes",
        choices=("planes", "coacd"),
        help="make convex pieces of meshes that are not convex: 'planes' (default), exact by their face planes, or 'coacd'",
    )
    new.add_argument("--out", metavar="DIR", default=".", help="output folder (default: current folder)")


def _describe_view(view: argparse.ArgumentParser) -> None:
    view.add_argument(
        "scene",
        nargs="?",
        default="logs/latest",
        help="run folder or .mcap file (default: logs/latest); else a scenario file or the name of a shipped scenario, "
        "shown at t = 0 with frames of sites, targets, reach and contacts",
    )
    _add_overrides(view)
    view.add_argument("--save", metavar="FILE", help="write the recording (.rrd) instead of opening the viewer")
    view.add_argument(
        "--listen",
        type=address,
        metavar="ADDRESS",
        default="127.0.0.1",
        help="address on which the viewer accepts data of other programs (default: 127.0.0.1, this machine only)",
    )


def _describe_validate(validate: argparse.ArgumentParser) -> None:
    validate.add_argument(
        "cases",
        nargs="*",
        metavar="CASE",
        help="names of cases, 'seed-paper', or a group of measured impacts, with --data (default: all cases; see the page)",
    )
    pages = validate.add_mutually_exclusive_group()
    pages.add_argument(
        "--page",
        metavar="DIR",
        nargs="?",
        const="docs",
        help="write the pages of all cases, or of 'seed-paper', to DIR (default: docs)",
    )
    pages.add_argument(
        "--check", metavar="DIR", nargs="?", const="docs", help="exit 1 if the pages in DIR (default: docs) are stale"
    )
    validate.add_argument(
        "--long",
        action="store_true",
        help="with --check: all runs of the seed paper's page, with step-size studies, long runs; with --data: more tosses",
    )
    validate.add_argument(
        "--data",
        metavar="DIR",
        help="copy of the repository whose data measured-ellipse, measured-cube or measured-sphere reads",
    )


def _add_overrides(to: argparse.ArgumentParser) -> None:
    to.add_argument(
        "-s",
        dest="overrides",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="override a key by a YAML value, e.g. -s duration_s=5 -s task.target_m='[3, 0.5]' -s phases.1.for_s=4.6",
    )


def _add_truncation(to: argparse.ArgumentParser) -> None:
    to.add_argument(
        "--truncation",
        type=seconds_or_off,
        metavar="SECONDS|off",
        help="if checks fail, find out whether by the truncation of the step alone, for at most SECONDS (default: the time "
        "of the run itself, 20 s at least); Ctrl-C ends only that",
    )


def _add_run(to: argparse.ArgumentParser, *, several: bool = False) -> None:
    text = "run folder or .mcap file (default: logs/latest)"
    if several:
        to.add_argument("runs", nargs="*", metavar="run", default=["logs/latest"], help=text)
    else:
        to.add_argument("run", nargs="?", default="logs/latest", help=text)


_VECTORS = {
    "--point": "another contact point at that instant, world axes, m",
    "--normal": "another normal there, from the robot to the object",
}


def _describe_impact_map(of: argparse.ArgumentParser) -> None:
    of.add_argument("scenario", help="a scenario file, a run folder, or the name of a shipped scenario")
    _add_overrides(of)
    of.add_argument("--impact", type=int, default=1, metavar="N", help="which impact of the run, from 1 (default: 1)")
    for name, text in _VECTORS.items():
        of.add_argument(name, nargs=3, type=float, metavar=("X", "Y", "Z"), help=text)
    of.add_argument(
        "--hold",
        choices=("com", "base", "nothing"),
        default="com",
        help="what of a floating base is kept: the robot's centre of mass (default), the pose of the base, or nothing",
    )
    goal = of.add_mutually_exclusive_group()
    goal.add_argument(
        "--minimize", metavar="EFFECT", default="impulse_N_s", help="effect to make small (default: impulse_N_s)"
    )
    goal.add_argument("--maximize", metavar="EFFECT", help="effect to make large")
    of.add_argument(
        "--bounds", action="append", default=[], metavar="JOINT=LOW:HIGH", help="a narrower range of a joint, rad or m"
    )
    of.add_argument("--samples", type=int, default=400, metavar="N", help="configurations to draw (default: 400)")
    of.add_argument("--starts", type=int, default=8, metavar="N", help="optimisations from the best of them (default: 8)")
    of.add_argument("--seed", type=int, default=0, metavar="N", help="seed of the samples (default: 0)")
    of.add_argument("--allow-overlaps", action="store_true", help="let the best configuration have overlapping geoms")
    of.add_argument("--axes", nargs=2, metavar="COLUMN", default=("", ""), help="columns of the table to draw it over")
    of.add_argument("--out", metavar="DIR", help="output folder (default: logs/<scenario>-impact-map, replaced)")


def _describe_sensitivity(of: argparse.ArgumentParser) -> None:
    of.add_argument("scenario", help="a scenario file, a run folder, or the name of a shipped scenario")
    _add_overrides(of)
    of.add_argument(
        "--of",
        action="append",
        default=[],
        metavar="QUANTITY",
        help="number of summary.json, e.g. impacts.0.impulse_N_s (default: first impact and final error of the tip)",
    )
    of.add_argument(
        "--wrt",
        action="append",
        default=[],
        metavar="KEY=SIGMA",
        help="an uncertain key and its standard deviation, in SI units or with mm, um, mrad, deg: "
        "initial.joints.object/y=1mm (default: 'uncertainties' of the scenario)",
    )
    of.add_argument("--exact", action="store_true", help="derivatives, where they exist, in place of runs")
    of.add_argument("--out", metavar="FILE", help="also write the table as CSV or, with the suffix .parquet, as Parquet")


def _describe_fit(of: argparse.ArgumentParser) -> None:
    of.add_argument(
        "data", nargs="+", help="CSV or Parquet files of poses or velocities of bodies, with units in the column names"
    )
    of.add_argument(
        "--scenario",
        metavar="FILE",
        required=True,
        help="a scenario file, or the name of a shipped one: masses, shapes, contact rules and the impact law",
    )
    _add_overrides(of)
    of.add_argument(
        "--use",
        choices=("poses", "velocities"),
        help="poses: fit the flights between impacts; velocities: take the rows before and after (default: velocities if "
        "there are columns of them)",
    )
    of.add_argument("--run-column", metavar="COLUMN", help="column that tells runs in one file apart (default: run)")
    of.add_argument(
        "--reach",
        type=positive,
        metavar="M",
        help="bodies touch if their recorded gap or overlap is at most this, m (default: 0.005)",
    )
    of.add_argument("--out", metavar="DIR", help="output folder (default: logs/<scenario>-fit, replaced)")


def _describe_campaign(of: argparse.ArgumentParser) -> None:
    actions = of.add_subparsers(title="actions", metavar="ACTION", dest="action", required=True)
    parsers = {
        name: actions.add_parser(
            name, help=text, description=f"{text[0].upper()}{text[1:]}.", epilog=exit_codes(f"campaign {name}")
        )
        for name, text in _CAMPAIGN_ACTIONS.items()
    }
    run = parsers["run"]
    run.add_argument("campaign", nargs="?", help="a campaign file, or the name of a shipped one (see --list)")
    run.add_argument("--list", action="store_true", help="list the shipped campaigns and exit")
    run.add_argument("--out", metavar="DIR", help="campaign folder (default: logs/campaign-<name>)")
    _add_overrides(run)
    for name in ("status", "resume", "extend", "report", "rerun"):
        parsers[name].add_argument("folder", metavar="DIR", help="campaign folder")
    parsers["extend"].add_argument("n", type=whole, help="new total number of samples; a power of 2 for a Sobol design")
    parsers["rerun"].add_argument("index", type=whole, nargs="+", help="indices of the runs, from 0")
    parsers["report"].add_argument(
        "--page",
        metavar="FILE",
        help="Markdown file; figures go to figures/ beside it (default: report.md in DIR, beside report.html)",
    )
    parsers["rerun"].add_argument("--variant", metavar="NAME", default="", help="variant of the runs")
    parsers["resume"].add_argument(
        "--retry",
        type=outcomes,
        default=(),
        metavar="OUTCOMES",
        help="also repeat runs with these outcomes: error, crashed, timeout; separate several by commas",
    )
    for name in ("run", "resume", "extend", "rerun"):
        parsers[name].add_argument(
            "--metrics", metavar="FILE", help="Python file, which is executed: each of its functions of a run is a metric"
        )
    for name in ("run", "resume", "extend"):
        _add_engine(parsers[name])


def _add_engine(to: argparse.ArgumentParser) -> None:
    """Add the options of where runs are executed."""
    where = to.add_mutually_exclusive_group()
    where.add_argument(
        "--workers", type=at_least_one, metavar="N", help="number of worker processes (default: one per processor)"
    )
    where.add_argument(
        "--dask",
        metavar="ADDRESS",
        help="address of a Dask scheduler, e.g. tcp://host:8786",
    )
