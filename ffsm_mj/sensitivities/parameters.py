"""Uncertain numbers of a scenario, by dotted key, each with its standard deviation."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ffsm_mj.assembly.prepare import PreparedRun
from ffsm_mj.campaign.plan.targets import Target, Targets
from ffsm_mj.campaign.plan.value_operations import ValueOperation
from ffsm_mj.errors import Fault, InputError, ScenarioFaults

_JOINT_UNITS = {("hinge", "joints"): "rad", ("slide", "joints"): "m", ("hinge", "rates"): "rad/s", ("slide", "rates"): "m/s"}
_KEY_UNIT = re.compile(r"_(m|kg|s|rad|N|N_m|rad_s|m_s|Hz|kg_m2)(\.\d+)?$")
_SMALL = {"m": ("mm", 1e-3), "rad": ("mrad", 1e-3), "m/s": ("mm/s", 1e-3), "rad/s": ("mrad/s", 1e-3), "kg": ("g", 1e-3)}
"""Units in which small values read well, by unit."""
_MOST_SMALL = 0.1


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


def parameters(prepared: PreparedRun, wrt: Mapping[str, float]) -> tuple[Parameter, ...]:
    """Find uncertain numbers in a scenario.

    Args:
        prepared: The scenario.
        wrt: Standard deviation by dotted key.

    Raises:
        ScenarioFaults: No such key, or not a number, or no positive standard deviation.
    """
    targets = Targets(prepared)
    found: list[Parameter] = []
    faults: list[Fault] = []
    for key, sigma in wrt.items():
        try:
            found.append(_parameter(prepared, targets, key, sigma))
        except LookupError as error:
            faults.append(Fault(str(error.args[0]), ("uncertainties", key)))
    if faults:
        raise ScenarioFaults(faults)
    return tuple(found)


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


def given(texts: list[str]) -> dict[str, float]:
    """Standard deviations written as ``KEY=NUMBER``, with one of the units mm, um, mrad, deg or none.

    Raises:
        InputError: One is not written so.
    """
    found: dict[str, float] = {}
    for text in texts:
        key, _, size = text.rpartition("=")
        match = re.fullmatch(r"\s*([-+.\deE]+)\s*(mm|um|mrad|deg|)\s*", size)
        try:
            number = float(match.group(1)) if match else None
        except ValueError:
            number = None
        if not key or number is None or match is None:
            raise InputError(f"--wrt {text}: should be KEY=NUMBER, the number in SI units or with mm, um, mrad or deg")
        found[key] = number * _UNITS[match.group(2)]
    return found


_UNITS: dict[str, Any] = {"": 1.0, "mm": 1e-3, "um": 1e-6, "mrad": 1e-3, "deg": 3.141592653589793 / 180.0}
