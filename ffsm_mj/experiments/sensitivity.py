"""Sensitivity of the quantities of a run to stated uncertainties of its scenario: whole runs, or derivatives."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from ffsm_mj.analysis.run import Run
from ffsm_mj.assembly.prepare import PreparedRun, prepare
from ffsm_mj.errors import InputError, unknown_name
from ffsm_mj.experiments.derivatives import exact
from ffsm_mj.experiments.uncertainty import (
    Parameter,
    Quantity,
    Sensitivity,
    default_quantities,
    impacts,
    uncertain_parameters,
    values,
)
from ffsm_mj.log.run_folder import SCENARIO

_SIDES = {(True, True): "both", (True, False): "minus", (False, True): "plus"}


def secant(
    prepared: PreparedRun,
    nominal: Run,
    of: Sequence[Quantity],
    wrt: Sequence[Parameter],
    report: Callable[[float, float], None] | None = None,
) -> Sensitivity:
    """Run a scenario with each parameter at minus and plus one standard deviation.

    Args:
        prepared: The scenario.
        nominal: Its run.
        of: Quantities.
        wrt: Parameters.
        report: Told (runs done, runs in all).

    Raises:
        InputError: The scenario allows a parameter on neither side.
    """
    at = values(nominal, of)
    low, high, slope = (np.full((len(of), len(wrt)), np.nan) for _ in range(3))
    same, sides = [], []
    for k, parameter in enumerate(wrt):
        runs: dict[int, Run] = {}
        refused = ""
        for j, sign in enumerate((-1, 1)):
            try:
                runs[sign] = _run(prepared, parameter, sign)
            except InputError as error:
                refused = error.lines[0]
            if report is not None:
                report(2 * k + j + 1, 2 * len(wrt))
        if not runs:
            raise InputError(f"{parameter.key}: the scenario allows neither minus nor plus {parameter.size}: {refused}")
        low[:, k], high[:, k] = (values(runs[s], of) if s in runs else np.nan for s in (-1, 1))
        ends = [low[:, k] if -1 in runs else at, high[:, k] if 1 in runs else at]
        slope[:, k] = (ends[1] - ends[0]) / (len(runs) * parameter.sigma)
        same.append(all(impacts(run) == impacts(nominal) for run in runs.values()))
        sides.append(_SIDES[-1 in runs, 1 in runs])
    return Sensitivity("secant", tuple(of), tuple(wrt), at, low, high, slope, tuple(same), tuple(sides))


def _run(prepared: PreparedRun, parameter: Parameter, sign: int) -> Run:
    """Run with a parameter displaced.

    Raises:
        InputError: The scenario does not allow the value.
    """
    return prepared.changed(prepared.source.overridden([parameter.override(sign * parameter.sigma)])).run()


Kind = Literal["secant", "exact"]
KINDS: tuple[Kind, ...] = ("secant", "exact")


def sensitivity(
    run: Run,
    of: Sequence[str] | str = (),
    wrt: Mapping[str, float] = MappingProxyType({}),
    kind: Kind = "secant",
    *,
    controllers: Mapping[str, Any] = MappingProxyType({}),
    estimators: Mapping[str, Any] = MappingProxyType({}),
    report: Callable[[float, float], None] | None = None,
) -> Sensitivity:
    """How quantities of a run change with uncertain numbers of its scenario; see docs/sensitivity.md.

    Args:
        run: The run, in memory or read from its log.
        of: Quantities, by their names in ``summary.json``: ``impacts.0.impulse_N_s``; of the first impact and of the tip
            if none is named.
        wrt: Standard deviation of each uncertain number, by dotted key of the scenario; its ``uncertainties`` if none is
            given.
        kind: ``secant``: two runs per number, at plus and minus one standard deviation; it refuses nothing. ``exact``: the
            derivative, where it exists.
        controllers: Control laws of the caller's own, see :func:`ffsm_mj.run`.
        estimators: Estimators of the caller's own.
        report: Called with the number of runs done and their total.

    Raises:
        InputError: An unknown name, or a derivative that does not exist.
    """
    if not run.complete or run.outcome != "completed":
        raise InputError(f"{run.name}: the run did not reach its end ({run.outcome}); no sensitivity is computed")
    with TemporaryDirectory(prefix="ffsm-") as folder:
        scenario = _written(run, Path(folder))
        prepared = prepare(scenario, (), controllers=controllers, estimators=estimators)
        return of_prepared(prepared, run, of, wrt, kind, report)


def of_prepared(
    prepared: PreparedRun,
    run: Run,
    of: Sequence[str] | str = (),
    wrt: Mapping[str, float] = MappingProxyType({}),
    kind: Kind = "secant",
    report: Callable[[float, float], None] | None = None,
) -> Sensitivity:
    """Sensitivity of the run of a prepared scenario; see :func:`sensitivity`.

    Raises:
        InputError: Nothing is uncertain, or a name is unknown.
    """
    if kind not in KINDS:
        raise InputError(f"kind: {unknown_name('kind', kind, KINDS)}")
    names = (of,) if isinstance(of, str) else tuple(of)
    quantities = tuple(map(Quantity.named, names or default_quantities(run)))
    parameters = uncertain_parameters(prepared, wrt)
    if not quantities:
        raise InputError(f"{run.name}: the run has no impact and no task: name a quantity")
    if not parameters:
        raise InputError(
            f"{run.name}: nothing is uncertain: name a key and its standard deviation, or state 'uncertainties'"
        )
    return (
        exact(prepared, run, quantities, parameters)
        if kind == "exact"
        else secant(prepared, run, quantities, parameters, report)
    )


def _written(run: Run, folder: Path) -> Path:
    """Write the scenario and the models of a run below a folder.

    Raises:
        InputError: A name in the log leads out of the folder.
    """
    for name, content in {**run.log.header.files, SCENARIO: run.log.header.scenario_yaml.encode()}.items():
        parts = PurePosixPath(name)
        if parts.is_absolute() or ".." in parts.parts or "\\" in name:
            raise InputError(f"{run.name}: the log has a file {name!r}, which is not below its folder")
        path = folder / parts
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return folder / SCENARIO
