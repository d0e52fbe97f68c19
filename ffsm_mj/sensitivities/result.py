"""Sensitivity of outcomes to uncertain parameters: table, statistics to first order, and sentences."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ffsm_mj.analysis.tables import Table
from ffsm_mj.arrays import FloatArray
from ffsm_mj.sensitivities.outcomes import Outcome
from ffsm_mj.sensitivities.parameters import Parameter

_ROUNDING = 1e-12
"""Outcomes that differ by less than this share are the same."""
_CURVED = 0.5
"""A value at the scenario that lies off the middle of its neighbours by more than this share of their half-distance."""


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """How outcomes change with parameters. Rows of arrays are outcomes, columns parameters.

    Attributes:
        kind: ``secant``: differences of runs; ``exact``: derivatives.
        of: The outcomes.
        wrt: The parameters.
        nominal: Outcomes of the run, (n,); NaN if it has none.
        low: Outcomes at minus one standard deviation, (n, m); NaN where there is no such run or no such outcome.
        high: Outcomes at plus one, (n, m).
        derivative: Change of each outcome per unit of each parameter, (n, m): the slope of the secant, on one side if only
            one run exists.
        same_impacts: Whether the runs at both sides have the impacts of the run, pair by pair, (m,).
        sides: ``both``, ``minus`` or ``plus``: on which sides the scenario allows the parameter, (m,).
    """

    kind: str
    of: tuple[Outcome, ...]
    wrt: tuple[Parameter, ...]
    nominal: FloatArray
    low: FloatArray
    high: FloatArray
    derivative: FloatArray
    same_impacts: tuple[bool, ...]
    sides: tuple[str, ...]

    @cached_property
    def covariance(self) -> FloatArray:
        """Covariance of the outcomes to first order, for independent parameters, (n, n)."""
        scaled = self.derivative * np.array([each.sigma for each in self.wrt])
        return np.asarray(scaled @ scaled.T)

    @property
    def std(self) -> FloatArray:
        """Standard deviation of each outcome to first order, (n,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @cached_property
    def table(self) -> Table:
        """One row per outcome and parameter."""
        rows = [(i, k) for i in range(len(self.of)) for k in range(len(self.wrt))]
        columns: dict[str, Any] = {
            "of": [self.of[i].name for i, _ in rows],
            "wrt": [self.wrt[k].key for _, k in rows],
            "sigma": [self.wrt[k].sigma for _, k in rows],
            "nominal": [self.nominal[i] for i, _ in rows],
            "at_minus_sigma": [self.low[i, k] for i, k in rows],
            "at_plus_sigma": [self.high[i, k] for i, k in rows],
            "derivative": [self.derivative[i, k] for i, k in rows],
            "same_impacts": [self.same_impacts[k] for _, k in rows],
            "sides": [self.sides[k] for _, k in rows],
        }
        return Table(
            "sensitivity",
            {name: np.array(values) for name, values in columns.items()},
            dict.fromkeys(columns, ""),
            {name: _MEANINGS[name] for name in columns},
        )

    def data(self) -> dict[str, Any]:
        """``sensitivity`` of ``summary.json``: the rows of the table, null for what does not exist, and the sentences."""
        columns = {name: column.tolist() for name, column in self.table.columns.items()}
        rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
        return {
            "rows": [{name: _finite(value) for name, value in row.items()} for row in rows],
            "sentences": [*self.sentences()],
        }

    def sentences(self) -> Iterator[str]:
        """One sentence per outcome and parameter."""
        for k, parameter in enumerate(self.wrt):
            for i, outcome in enumerate(self.of):
                yield self._sentence(i, k, outcome, parameter)

    def _sentence(self, i: int, k: int, outcome: Outcome, parameter: Parameter) -> str:
        what = f"{parameter.size} in {parameter.key}"
        if self.kind == "exact":
            if self.derivative[i, k] == 0.0:
                return f"{what} does not change {outcome.words}"
            change = abs(self.derivative[i, k]) * parameter.sigma
            return f"{what} changes {outcome.words} by {self._share(i, change)}"
        ends = [value for value in (self.low[i, k], self.nominal[i], self.high[i, k]) if np.isfinite(value)]
        if not np.isfinite(self.nominal[i]) or len(ends) < 2:
            return f"{what}: {outcome.words} does not exist in every run"
        half = 0.5 * (self.high[i, k] - self.low[i, k])
        change = abs(half) if self.sides[k] == "both" else max(ends) - min(ends)
        if not np.isfinite(change):
            return f"{what}: {outcome.words} does not exist in every run"
        if max(ends) - min(ends) <= _ROUNDING * max(map(abs, ends)):
            return f"{what} does not change {outcome.words}"
        text = f"{what} changes {outcome.words} by {self._share(i, change)}"
        text += f": {min(ends):.7g} to {max(ends):.7g} {outcome.unit}".rstrip()
        notes = [] if self.same_impacts[k] else ["other impacts occur within it"]
        notes += [] if self.sides[k] == "both" else [f"the scenario allows {self.sides[k]} alone"]
        curved = (
            self.sides[k] == "both" and abs(self.nominal[i] - 0.5 * (self.low[i, k] + self.high[i, k])) > _CURVED * change
        )
        notes += ["not proportional"] if curved else []
        return text + (f" ({'; '.join(notes)})" if notes else "")

    def _share(self, i: int, change: float) -> str:
        """A change in per cent of the outcome, or in its unit."""
        nominal = abs(self.nominal[i])
        if self.of[i].relative and nominal > 0.0:
            return f"{100.0 * change / nominal:.3g} %"
        return f"{change:.3g} {self.of[i].unit}".rstrip()


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not np.isfinite(value) else value


_MEANINGS = {
    "of": "outcome",
    "wrt": "uncertain key of the scenario",
    "sigma": "its standard deviation",
    "nominal": "outcome of the run",
    "at_minus_sigma": "outcome at minus one standard deviation",
    "at_plus_sigma": "outcome at plus one standard deviation",
    "derivative": "change of the outcome per unit of the key",
    "same_impacts": "whether both runs have the impacts of the run",
    "sides": "both, or the side that the scenario allows",
}
