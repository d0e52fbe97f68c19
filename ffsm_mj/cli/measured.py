"""Measured impacts: ``ffsm fit``, of a user's recordings, and ``ffsm validate measured-...``, of others' data."""

from __future__ import annotations

import argparse
from pathlib import Path

from ffsm_mj.cli.exit_codes import CHECK_FAILED, OK
from ffsm_mj.cli.standard_streams import Output, complain
from ffsm_mj.errors import InputError, unknown_name
from ffsm_mj.validation.measured.groups import GROUPS, PAGE, in_words, not_run, write_page


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
        stage(f"compile {options.scenario}")
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


def validate_measured(options: argparse.Namespace, output: Output) -> int:
    """Compute a group and print it or write its section of the page, or say what the groups need; returns the exit code.

    Raises:
        InputError: Options or names do not go together, or the data cannot be read.
    """
    names = options.cases
    for name in names:
        if name not in GROUPS:
            raise InputError(
                f"ffsm validate: groups of measured impacts are computed alone; {unknown_name('group', name, tuple(GROUPS))}"
            )
    if options.check is not None:
        raise InputError(f"ffsm validate: --check leaves out measured impacts and {PAGE}, whose data are not shipped")
    if options.data is None:
        if options.page is not None:
            raise InputError(f"ffsm validate: --page needs --data here. {not_run(names[0])}")
        output.say("\n".join(f"{name}: {GROUPS[name].title}. {not_run(name)}" for name in names))
        return OK
    if len(names) != 1:
        raise InputError("ffsm validate: --data is a copy of one repository: name one group")
    (name,) = names
    with output.progress() as stage:
        report = GROUPS[name].report(Path(options.data), stage, options.long)
    output.say(in_words(name, report))
    for line in report.versions:
        complain(line)
    if options.page is not None:
        written = write_page(Path(options.page), name, report)
        output.say(f"\nwritten: {', '.join(map(str, written))}")
    return CHECK_FAILED if report.failures else OK
