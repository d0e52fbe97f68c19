"""Options and implementation of ``ffsm fit``."""

from __future__ import annotations

import argparse
from pathlib import Path

from ffsm_mj.cli.exit_codes import OK
from ffsm_mj.cli.standard_streams import Output


def fit(options: argparse.Namespace, output: Output) -> int:
    """Fit restitution and friction of the contact rules of a scenario to recordings; returns the exit code.

    Raises:
        InputError: A recording or the scenario is wrong, its frame is mirrored, or there are too few impacts.
    """
    from ffsm_mj.assembly.prepare import prepare
    from ffsm_mj.identification.output import lines, rule_lines, save
    from ffsm_mj.identification.rule_fits import REACH_M, fit_recordings
    from ffsm_mj.report.output_place import usable_folder
    from ffsm_mj.scenario.shipped import scenario_path

    folder = Path(options.out) if options.out else Path("logs") / f"{scenario_path(options.scenario).stem}-fit"
    with output.progress() as stage:
        prepared = prepare(options.scenario, options.overrides)
        usable_folder(folder)
        stage("fit")
        paths, reach_m = [Path(name) for name in options.data], options.reach or REACH_M
        fits = fit_recordings(paths, prepared, options.use, options.run_column, reach_m)
        files = save(fits, folder)
    for line in lines(fits):
        output.say(line)
    output.say(f"files in {folder}: {', '.join(sorted(path.name for path in files))}")
    output.say("for the scenario:")
    output.write("\n".join(rule_lines(fits)))
    return OK
