"""Sensitivity by whole runs: each parameter at minus and plus one standard deviation.

It refuses nothing: phases that end at ticks, thrusters that switch, impacts that do not happen are in the runs. Where an
outcome is a staircase of control ticks, a campaign sees the secant over a standard deviation, not the derivative.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ffsm_mj.analysis.run import Run
from ffsm_mj.assembly.prepare import PreparedRun
from ffsm_mj.errors import InputError
from ffsm_mj.sensitivities.outcomes import Outcome, impacts, values
from ffsm_mj.sensitivities.parameters import Parameter
from ffsm_mj.sensitivities.result import Sensitivity

_SIDES = {(True, True): "both", (True, False): "minus", (False, True): "plus"}


def secant(
    prepared: PreparedRun,
    nominal: Run,
    of: Sequence[Outcome],
    wrt: Sequence[Parameter],
    report: Callable[[float, float], None] | None = None,
) -> Sensitivity:
    """Run a scenario with each parameter at minus and plus one standard deviation.

    Args:
        prepared: The scenario.
        nominal: Its run.
        of: Outcomes.
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
