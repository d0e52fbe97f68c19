"""Implementation of ``ffsm fmu``: write a scenario as a functional mock-up unit."""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path

from ffsm_mj.cli.exit_codes import OK
from ffsm_mj.cli.standard_streams import Output
from ffsm_mj.errors import InputError, plural, working_on
from ffsm_mj.report.output_place import usable_file

_SUFFIX = ".fmu"


def fmu(options: argparse.Namespace, output: Output) -> int:
    """Write a unit of FMI 2.0; returns the exit code.

    Raises:
        InputError: The scenario or a model is wrong, or the file cannot be written.
        MissingPackageError: PythonFMU is not installed.
    """
    from ffsm_mj.assembly.prepare import Scenario
    from ffsm_mj.fmu.unit_file import write_unit

    with output.progress() as stage, working_on(options.scenario):
        stage(f"compile {options.scenario}")
        scenario = Scenario.load(options.scenario, options.overrides)
        file = Path(options.out or f"{scenario.prepared.scenario.name}{_SUFFIX}")
        if file.suffix != _SUFFIX:
            raise InputError(f"--out {file}: the name of a unit ends in {_SUFFIX}")
        usable_file(file)
        stage(f"write {file}")
        unit = write_unit(scenario, file)
    counts = Counter(port.causality for port in unit.ports)
    kinds = ", ".join(plural(counts[kind], kind) for kind in ("input", "output", "parameter"))
    output.say(f"{file}: FMI 2.0 co-simulation, {kinds}; steps are multiples of {unit.period_s:g} s")
    output.say("its host is a Python with ffsm-mj; the binaries of PythonFMU are for Linux and Windows on x86-64")
    return OK
