"""Options and implementation of ``ffsm impact-map``."""

from __future__ import annotations

import argparse
from pathlib import Path

from ffsm_mj.cli.exit_codes import OK
from ffsm_mj.cli.standard_streams import Output
from ffsm_mj.errors import InputError
from ffsm_mj.invocation import command


def impact_map(options: argparse.Namespace, output: Output) -> int:
    """Map an impact of a scenario, and write table, figure and best configuration; returns the exit code.

    Raises:
        InputError: The scenario has no such impact, or no configuration reaches the contact.
    """
    from ffsm_mj.experiments.impact_map.impact_map import impact_map as make_map
    from ffsm_mj.experiments.impact_map.output import BEST, jump_error, lines, save
    from ffsm_mj.scenario.shipped import scenario_path

    if options.seed < 0:
        raise InputError(f"--seed: {options.seed}, allowed are integers from 0")
    folder = Path(options.out) if options.out else Path("logs") / f"{scenario_path(options.scenario).stem}-impact-map"
    with output.progress() as stage:
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
            report=stage("impact map", "configurations"),
        )
        stage("files")
        files = save(mapped, options.scenario, folder, tuple(options.axes))
        kept = [text for text in options.overrides if not text.startswith("initial.")]
        apart = jump_error(mapped, folder / BEST, kept)
    for line in lines(mapped, options.hold):
        output.say(line)
    again = [word for text in kept for word in ("-s", text)]
    output.say(f"a run of the best configuration differs from the map by {apart:.2g} in the jump of velocities")
    output.say(f"files in {folder}: {', '.join(sorted(path.name for path in files))}")
    output.command(command("run", folder / BEST, *again), "run it: ")
    return OK


def _bound(text: str) -> tuple[str, tuple[float, float]]:
    """A range of a joint as given by ``--bounds``."""
    name, _, range_text = text.partition("=")
    try:
        low, high = map(float, range_text.split(":"))
    except ValueError:
        raise InputError(f"--bounds {text}: should be JOINT=LOW:HIGH") from None
    return name, (low, high)
