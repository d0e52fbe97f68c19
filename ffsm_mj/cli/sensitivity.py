"""Options and implementation of ``ffsm sensitivity``, and the sentences that ``ffsm run`` adds to its report."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from ffsm_mj.cli.exit_codes import OK, RUN_FAILED
from ffsm_mj.cli.standard_streams import Output, complain
from ffsm_mj.errors import InputError

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
    from ffsm_mj.experiments.sensitivity import of_prepared
    from ffsm_mj.experiments.uncertainty import uncertain_parameters

    wrt = dict(map(_standard_deviation, options.wrt))
    with output.progress() as stage:
        stage(f"compile {options.scenario}")
        prepared = prepare(options.scenario, options.overrides)
        uncertain_parameters(prepared, wrt)
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


_UNITS = {"": 1.0, "mm": 1e-3, "um": 1e-6, "mrad": 1e-3, "deg": math.pi / 180.0}
_NUMBER = re.compile(r"(.+)=\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(mm|um|mrad|deg|)\s*")


def _standard_deviation(text: str) -> tuple[str, float]:
    """Key and standard deviation, in SI units, of an argument ``KEY=NUMBER`` with or without a unit.

    Raises:
        InputError: It is not written so.
    """
    match = _NUMBER.fullmatch(text)
    if match is None:
        raise InputError(f"--wrt {text}: should be KEY=NUMBER, the number in SI units or with mm, um, mrad or deg")
    return match[1], float(match[2]) * _UNITS[match[3]]


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
