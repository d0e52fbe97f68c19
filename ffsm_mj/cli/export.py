"""Implementation of ``ffsm export``: tables, animations and pages of a run."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from ffsm_mj.analysis.run import Run, load_run
from ffsm_mj.cli.exit_codes import DAMAGED, OK
from ffsm_mj.cli.progress import Stage
from ffsm_mj.cli.standard_streams import Output, complain
from ffsm_mj.errors import InputError, working_on
from ffsm_mj.log.run_folder import find_log
from ffsm_mj.report.output_place import usable_file

_EXPORT_SUFFIX = {"csv": ".csv", "parquet": ".parquet", "gif": ".gif", "mp4": ".mp4", "html": ".html"}
_FILE_NAMES = {"gif": "motion", "mp4": "motion", "html": "run"}
"""Default names of files other than tables."""


# A log may hold any double; NumPy's warnings would not help.
@np.errstate(all="ignore")
def export(options: argparse.Namespace, output: Output) -> int:
    """Export a table, an animation or a page of a run.

    Returns:
        The exit code: DAMAGED, with one line on stderr, if data is missing from the log.

    Raises:
        InputError: The run cannot be read, there is no such table, or the file cannot be written.
        MissingPackageError: An optional package is not installed.
        OutputLostError: The file could not be written completely.
    """
    table = options.table or "samples"
    log = find_log(Path(options.run))
    suffix = _EXPORT_SUFFIX[options.form]
    out = Path(options.out) if options.out else log.with_name(_FILE_NAMES.get(options.form, table) + suffix)
    if out.suffix.lower() != suffix and (options.form in _FILE_NAMES or out.suffix.lower() in _EXPORT_SUFFIX.values()):
        raise InputError(f"--{options.form} writes {suffix}, but --out {out} has another suffix")
    usable_file(out)
    with output.progress() as stage, working_on(log):
        run = _export(log, table, out, options, output, stage)
    if run.note:
        output.say(f"note: {run.note}")
    if missing := run.missing:
        complain(f"{log}: {missing}")
        return DAMAGED
    return OK


def _export(log: Path, table: str, out: Path, options: argparse.Namespace, output: Output, stage: Stage) -> Run:
    stage(f"read {log}")
    run = load_run(log)
    if options.form == "html":
        from ffsm_mj.report.page import write_page

        stage(out.name)
        output.say(f"{out}: {write_page(run, out)}")
    elif options.form in _FILE_NAMES:
        from ffsm_mj.report.animation import write_animation

        report, rate = stage(out.name, "pictures"), options.fps or 20.0
        output.say(f"{out}: {write_animation(run, out, frames_per_second=rate, speed=options.speed, report=report)}")
    else:
        from ffsm_mj.report.export import write_table

        stage(out.name)
        output.say(f"{out}: {write_table(run, table, out, options.form)}")
    return run
