"""Options and implementation of ``ffsm impact-map``."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from ffsm_mj.cli.exit_codes import OK
from ffsm_mj.cli.progress import progress
from ffsm_mj.cli.standard_streams import Output
from ffsm_mj.errors import InputError
from ffsm_mj.invocation import command

_VECTORS = {
    "--point": "another contact point at that instant, world axes, m",
    "--normal": "another normal there, from the robot to the object",
}
_HOLDS = ("com", "base", "nothing")


def describe_impact_map(of: argparse.ArgumentParser, add_overrides: Callable[[argparse.ArgumentParser], None]) -> None:
    """Add the options to a parser."""
    of.add_argument("scenario", help="a scenario file, a run folder, or the name of a shipped scenario")
    add_overrides(of)
    of.add_argument("--impact", type=int, default=1, metavar="N", help="which impact of the run, from 1 (default: 1)")
    for name, text in _VECTORS.items():
        of.add_argument(name, nargs=3, type=float, metavar=("X", "Y", "Z"), help=text)
    of.add_argument(
        "--hold",
        choices=_HOLDS,
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


def impact_map(options: argparse.Namespace, output: Output) -> int:
    """Map an impact of a scenario, and write table, figure and best configuration; returns the exit code.

    Raises:
        InputError: The scenario has no such impact, or no configuration reaches the contact.
    """
    from ffsm_mj.experiments.impact_map.impact_map import impact_map as make_map
    from ffsm_mj.experiments.impact_map.output import BEST, difference, lines, save
    from ffsm_mj.report.text_table import wrapped
    from ffsm_mj.scenario.shipped import scenario_path

    if options.seed < 0:
        raise InputError(f"--seed: {options.seed}, allowed are integers from 0")
    folder = Path(options.out) if options.out else Path("logs") / f"{scenario_path(options.scenario).stem}-impact-map"
    with progress() as shown:
        mapped = make_map(
            options.scenario,
            options.overrides,
            impact=options.impact,
            point=options.point,
            normal=options.normal,
            hold=options.hold,
            objective=options.maximize or options.minimize,
            maximize=options.maximize is not None,
            bounds=dict(map(_bound, options.bounds)),
            samples=options.samples,
            starts=options.starts,
            seed=options.seed,
            allow_overlaps=options.allow_overlaps,
            report=shown.stage("impact map", "configurations"),
        )
        shown.stage("files")
        files = save(mapped, options.scenario, folder, tuple(options.axes))
        kept = [text for text in options.overrides if not text.startswith("initial.")]
        apart = difference(mapped, folder / BEST, kept)
    for line in lines(mapped, options.hold):
        output.say(line)
    again = [word for text in kept for word in ("-s", text)]
    output.say(f"a run of the best configuration differs from the map by {apart:.2g} in the jump of velocities")
    output.say(wrapped(f"files in {folder}: {', '.join(sorted(path.name for path in files))}", 2))
    output.say(f"run it: {command('run', folder / BEST, *again)}")
    return OK


def _bound(text: str) -> tuple[str, tuple[float, float]]:
    """A range of a joint as given by ``--bounds``."""
    name, _, given = text.partition("=")
    try:
        low, high = map(float, given.split(":"))
    except ValueError:
        raise InputError(f"--bounds {text}: should be JOINT=LOW:HIGH") from None
    return name, (low, high)
