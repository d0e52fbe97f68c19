"""Implementation of ``ffsm reproduce``: compare the printed numbers of the paper with computed ones."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from ffsm_mj.cli.exit_codes import CHECK_FAILED, OK
from ffsm_mj.cli.progress import progress
from ffsm_mj.cli.standard_streams import Output, complain
from ffsm_mj.report.output_place import usable_folder
from ffsm_mj.reproduction import committed_pages, stale_once
from ffsm_mj.reproduction import reproduce as reproduced

_COMMITTED, _WRITTEN = "docs", "logs/reproduction"
"""Folders of the pages to check, and of new ones: outside what a checkout has under version control."""


def reproduce(options: argparse.Namespace, output: Output) -> int:
    """Run the case study and write or check the report pages; returns the exit code.

    Raises:
        InputError: The folder cannot be used, or has no pages to check.
    """
    folder = Path(options.out or (_COMMITTED if options.check else _WRITTEN))
    if options.check:
        committed_pages(folder)
    else:
        usable_folder(folder)
    with progress() as shown:
        report = shown.stage("reproduce", "runs")
        once = options.check and not options.long
        again, stale = (None, stale_once(folder, report)) if once else (reproduced(report), [])
    if again is None:
        return _report_stale(folder, stale, output)
    output.say(again.text())
    if options.check:
        return _report_stale(folder, again.stale(folder), output)
    output.say(f"\nwritten: {', '.join(str(path) for path in again.write(folder))}")
    return OK


def _report_stale(folder: Path, stale: Sequence[str], output: Output) -> int:
    """Print the stale lines of the pages; returns the exit code."""
    for line in stale:
        complain(line)
    output.say(f"\n{folder}: {f'{len(stale)} lines are not current' if stale else 'every page is current'}")
    return CHECK_FAILED if stale else OK
