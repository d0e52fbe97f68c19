"""Implementation of ``ffsm validate measured-...``: impacts that others measured, from a user's copy of their data."""

from __future__ import annotations

import argparse
from pathlib import Path

from ffsm_mj.cli.exit_codes import CHECK_FAILED, OK
from ffsm_mj.cli.standard_streams import Output, complain
from ffsm_mj.errors import InputError, unknown_name
from ffsm_mj.validation.measured.groups import GROUPS, PAGE, in_words, not_run, write_page


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
