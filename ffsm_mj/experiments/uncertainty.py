"""Quantities of a run, uncertain numbers of its scenario, and how the ones change with the others."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np

from ffsm_mj.analysis.run import Run
from ffsm_mj.analysis.tables import Table
from ffsm_mj.arrays import FloatArray
from ffsm_mj.assembly.prepare import PreparedRun
from ffsm_mj.errors import Faults, InputError
from ffsm_mj.experiments.bindings import Target, Targets
from ffsm_mj.experiments.design import ValueOperation
from ffsm_mj.experiments.metrics import fault_of, value_at

_IMPACT = re.compile(r"impacts\.(\d+)\.(\w+)")
_WORDS = {
    "impulse_N_s": ("the impulse of impact {n}", "N s", True),
    "time_s": ("the time of impact {n}", "s", False),
    "approach_speed_m_s": ("the approach speed of impact {n}", "m/s", True),
}
_TIP = {
    "tip.final_error_m": ("the final error of the tip", "m"),
    "tip.min_error_m": ("the smallest error of the tip", "m"),
    "grasps.0.time_s": ("the closing time of grasp 1", "s"),
    "grasps.0.loss_J": ("the loss of grasp 1", "J"),
}


@dataclass(frozen=True)
class Quantity:
    """A number of a run.

    Attributes:
        name: Name in the summary: ``impacts.0.impulse_N_s``.
        words: The same in words.
        unit: Its unit, if known.
        relative: Whether its changes are told in per cent.
    """

    name: str
    words: str
    unit: str
    relative: bool

    @classmethod
    def named(cls, name: str) -> Quantity:
        """The quantity of a name.

        Raises:
            InputError: No run has such a quantity.
        """
        if (fault := fault_of(name, ())) is not None and not name.startswith("effort."):
            raise InputError(f"--of {name}: {fault}")
        match = _IMPACT.fullmatch(name)
        if match and match.group(2) in _WORDS:
            words, unit, relative = _WORDS[match.group(2)]
            return cls(name, words.format(n=int(match.group(1)) + 1), unit, relative)
        words, unit = _TIP.get(name, (name, ""))
        return cls(name, words, unit, relative=False)


def default_quantities(run: Run) -> tuple[str, ...]:
    """Impulse and time of the first impact, and the final error of the tip, as far as the run has them."""
    summary = run.summary()
    names = ("impacts.0.impulse_N_s", "impacts.0.time_s") if summary["impacts"] else ()
    return (*names, "tip.final_error_m") if summary["tip"] is not None else names


def values(run: Run, of: Sequence[Quantity]) -> FloatArray:
    """Quantities of a run, (n,); NaN for those that it has not, or that are no numbers."""
    summary = run.summary()
    numbers = [value_at(summary, quantity.name) for quantity in of]
    return np.array([float(value) if isinstance(value, int | float) else math.nan for value in numbers])


def impacts(run: Run) -> tuple[tuple[str, ...], ...]:
    """Pairs of each impact of a run, in order."""
    by_event: dict[int, list[str]] = {}
    for record in run.impacts:
        by_event.setdefault(record.event, []).append(record.pair)
    return tuple(tuple(sorted(pairs)) for pairs in by_event.values())


_JOINT_UNITS = {("hinge", "joints"): "rad", ("slide", "joints"): "m", ("hinge", "rates"): "rad/s", ("slide", "rates"): "m/s"}
_KEY_UNIT = re.compile(r"_(m|kg|s|rad|N|N_m|rad_s|m_s|Hz|kg_m2)(\.\d+)?$")
_SMALL = {"m": ("mm", 1e-3), "rad": ("mrad", 1e-3), "m/s": ("mm/s", 1e-3), "rad/s": ("mrad/s", 1e-3), "kg": ("g", 1e-3)}
"""Units in which small values read well, by unit."""
_MOST_SMALL = 0.1
"""Below this in the unit of the key a value is written in the smaller one: 99 mm, 0.1 m."""


@dataclass(frozen=True)
class Parameter:
    """A number of a scenario that is uncertain.

    Attributes:
        key: Dotted key as given.
        sigma: Standard deviation, in the unit of the value.
        unit: Unit of the value; empty if it has none or is not known.
        target: The value in the scenario.
    """

    key: str
    sigma: float
    unit: str
    target: Target

    @property
    def nominal(self) -> float:
        """The number in the scenario."""
        return float(self.target.current)

    def override(self, offset: float) -> str:
        """The number with an offset, as an override of the scenario."""
        value = ValueOperation("offset", (0,), at=self.target.at).applied(self.target.value, (offset,))
        return f"{self.target.key}={json.dumps(value)}"

    @property
    def size(self) -> str:
        """The standard deviation with its unit: ``1 mm``."""
        return in_words(self.sigma, self.unit)


def uncertain_parameters(prepared: PreparedRun, wrt: Mapping[str, float] = MappingProxyType({})) -> tuple[Parameter, ...]:
    """The uncertain numbers of a scenario.

    Args:
        prepared: The scenario.
        wrt: Standard deviation by dotted key; none: those that the scenario states.

    Raises:
        InputError: No such key, or not a number, or no positive standard deviation; one line each.
    """
    targets, uncertain, faults = Targets(prepared), list[Parameter](), Faults()
    for key, sigma in (wrt or prepared.scenario.uncertainties).items():
        with faults.below("uncertainties", key):
            uncertain.append(_parameter(prepared, targets, key, sigma))
    if faults.collected and wrt:
        raise InputError([f"{fault.path[1]}: {fault.message}" for fault in faults.collected])
    if faults.collected:
        raise prepared.source.located(faults.collected)
    return tuple(uncertain)


def _parameter(prepared: PreparedRun, targets: Targets, key: str, sigma: float) -> Parameter:
    """One uncertain number.

    Raises:
        LookupError: No such key, or not one number.
    """
    matches = targets.find(key)
    if len(matches) != 1:
        raise LookupError(f"names {len(matches)} values; name one number")
    (target,) = matches
    value = None if target.span is not None else target.current
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise LookupError("is not one number; of a list or a free joint name a position: KEY.0")
    if not 0.0 < sigma < float("inf"):
        raise LookupError(f"the standard deviation is {sigma:g}; it must be positive and finite")
    return Parameter(key, float(sigma), _unit(prepared, key, target), target)


def _unit(prepared: PreparedRun, key: str, target: Target) -> str:
    """Unit of a value, from the joint or from the end of the key."""
    part, *rest = key.split(".")
    if part == "initial" and rest:
        joint = prepared.system.joint(target.key.split(".", 2)[2])
        if joint.kind in ("hinge", "slide"):
            return _JOINT_UNITS[joint.kind, rest[0]]
        first = joint.kind == "free" and target.at[0] < 3
        return {"joints": "m", "rates": "m/s"}[rest[0]] if first else {"joints": "", "rates": "rad/s"}[rest[0]]
    match = _KEY_UNIT.search(key)
    return match.group(1).replace("_", "/" if match.group(1) in ("rad_s", "m_s") else " ") if match else ""


def in_words(value: float, unit: str) -> str:
    """A number with its unit, small lengths in mm and so on."""
    if unit in _SMALL and abs(value) < _MOST_SMALL:
        name, size = _SMALL[unit]
        return f"{value / size:.4g} {name}"
    return f"{value:.4g} {unit}".rstrip()


_ROUNDING = 1e-12
"""Quantities that differ by less than this share are the same."""
_CURVED = 0.5
"""A value at the scenario that lies off the middle of its neighbours by more than this share of their half-distance."""


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """How quantities change with parameters. Rows of arrays are quantities, columns parameters.

    Attributes:
        kind: ``secant``: differences of runs; ``exact``: derivatives.
        of: The quantities.
        wrt: The parameters.
        nominal: Quantities of the run, (n,); NaN if it has none.
        low: Quantities at minus one standard deviation, (n, m); NaN where there is no such run or no such quantity.
        high: Quantities at plus one, (n, m).
        derivative: Change of each quantity per unit of each parameter, (n, m): the slope of the secant, on one side if only
            one run exists.
        same_impacts: Whether the runs at both sides have the impacts of the run, pair by pair, (m,).
        sides: ``both``, ``minus`` or ``plus``: on which sides the scenario allows the parameter, (m,).
    """

    kind: str
    of: tuple[Quantity, ...]
    wrt: tuple[Parameter, ...]
    nominal: FloatArray
    low: FloatArray
    high: FloatArray
    derivative: FloatArray
    same_impacts: tuple[bool, ...]
    sides: tuple[str, ...]

    @cached_property
    def covariance(self) -> FloatArray:
        """Covariance of the quantities to first order, for independent parameters, (n, n)."""
        scaled = self.derivative * np.array([parameter.sigma for parameter in self.wrt])
        return np.asarray(scaled @ scaled.T)

    @property
    def std(self) -> FloatArray:
        """Standard deviation of each quantity to first order, (n,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @cached_property
    def table(self) -> Table:
        """One row per quantity and parameter."""
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
        """One sentence per quantity and parameter."""
        for k, parameter in enumerate(self.wrt):
            for i, quantity in enumerate(self.of):
                yield self._sentence(i, k, quantity, parameter)

    def _sentence(self, i: int, k: int, quantity: Quantity, parameter: Parameter) -> str:
        what = f"{parameter.size} in {parameter.key}"
        if self.kind == "exact":
            if self.derivative[i, k] == 0.0:
                return f"{what} does not change {quantity.words}"
            change = abs(self.derivative[i, k]) * parameter.sigma
            return f"{what} changes {quantity.words} by {self._share(i, change)}"
        ends = [value for value in (self.low[i, k], self.nominal[i], self.high[i, k]) if np.isfinite(value)]
        if not np.isfinite(self.nominal[i]) or len(ends) < 2:
            return f"{what}: {quantity.words} does not exist in every run"
        half = 0.5 * (self.high[i, k] - self.low[i, k])
        change = abs(half) if self.sides[k] == "both" else max(ends) - min(ends)
        if not np.isfinite(change):
            return f"{what}: {quantity.words} does not exist in every run"
        if max(ends) - min(ends) <= _ROUNDING * max(map(abs, ends)):
            return f"{what} does not change {quantity.words}"
        text = f"{what} changes {quantity.words} by {self._share(i, change)}"
        text += f": {min(ends):.7g} to {max(ends):.7g} {quantity.unit}".rstrip()
        notes = [] if self.same_impacts[k] else ["other impacts occur within it"]
        notes += [] if self.sides[k] == "both" else [f"the scenario allows {self.sides[k]} alone"]
        curved = (
            self.sides[k] == "both" and abs(self.nominal[i] - 0.5 * (self.low[i, k] + self.high[i, k])) > _CURVED * change
        )
        notes += ["not proportional"] if curved else []
        return text + (f" ({'; '.join(notes)})" if notes else "")

    def _share(self, i: int, change: float) -> str:
        """A change in per cent of the quantity, or in its unit."""
        nominal = abs(self.nominal[i])
        if self.of[i].relative and nominal > 0.0:
            return f"{100.0 * change / nominal:.3g} %"
        return f"{change:.3g} {self.of[i].unit}".rstrip()


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not np.isfinite(value) else value


_MEANINGS = {
    "of": "quantity",
    "wrt": "uncertain key of the scenario",
    "sigma": "its standard deviation",
    "nominal": "quantity of the run",
    "at_minus_sigma": "quantity at minus one standard deviation",
    "at_plus_sigma": "quantity at plus one standard deviation",
    "derivative": "change of the quantity per unit of the key",
    "same_impacts": "whether both runs have the impacts of the run",
    "sides": "both, or the side that the scenario allows",
}
