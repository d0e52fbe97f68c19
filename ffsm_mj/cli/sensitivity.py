"""Options and implementation of ``ffsm sensitivity``, and the sentences that ``ffsm run`` adds to its report."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from ffsm_mj.cli.exit_codes import OK, RUN_FAILED
from ffsm_mj.cli.standard_streams import Output, complain

if TYPE_CHECKING:
    from ffsm_mj.analysis.run import Run
    from ffsm_mj.assembly.prepare import PreparedRun
    from ffsm_mj.experiments.uncertainty import Sensitivity
    from ffsm_mj.log.run_folder import RunFolder


def sensitivity(options: argparse.Namespace, output: Output) -> int:
    """Run a scenario, repeat it at both sides of each uncertain key, and print what changes; returns the exit code.

    Raises:
        InputError: The scenario or a name is wrong, or a derivative does not exist.
    """
    from ffsm_mj.assembly.prepare import prepare
    from ffsm_mj.experiments.sensitivity import checked_parameters, of_prepared
    from ffsm_mj.experiments.uncertainty import standard_deviations

    wrt = standard_deviations(options.wrt)
    with output.progress() as stage:
        prepared = prepare(options.scenario, options.overrides)
        checked_parameters(prepared, wrt)
        nominal = prepared.run(report=stage(prepared.scenario.name, "s", prepared.scenario.duration_s))
        if nominal.outcome != "completed":
            complain(f"{nominal.outcome}: {nominal.message}")
            return RUN_FAILED
        report = stage("sensitivity", "runs")
        result = of_prepared(prepared, nominal, options.of, wrt, "exact" if options.exact else "secant", report)
    for sentence in result.sentences():
        output.say(sentence)
    if options.out:
        output.say(f"{options.out}: {_write(result, Path(options.out))}")
    return OK


def of_run(prepared: PreparedRun, run: Run, folder: RunFolder, output: Output) -> Iterable[str]:
    """Sentences on the ``uncertainties`` of a scenario, also written into the run folder, as a table and in its summary."""
    if not prepared.scenario.uncertainties or run.outcome != "completed":
        return []
    from ffsm_mj.experiments.sensitivity import of_prepared
    from ffsm_mj.log.run_folder import SENSITIVITY
    from ffsm_mj.report.verification_report import SENSITIVITY_KEY

    with output.progress() as stage:
        result = of_prepared(prepared, run, report=stage("sensitivity", "runs"))
    _write(result, folder.path / SENSITIVITY)
    folder.add_to_summary({SENSITIVITY_KEY: result.data()})
    return result.sentences()


def _write(sensitivity: Sensitivity, path: Path) -> str:
    """Write the table; returns a line that describes the output."""
    from ffsm_mj.report.export import to_arrow, write_arrow

    form = "parquet" if path.suffix.lower() == ".parquet" else "csv"
    return write_arrow(iter([to_arrow(sensitivity.table)]), path, form)
