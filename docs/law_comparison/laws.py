"""The control laws that are compared: two tuned parameters each, with ranges, and what is fixed by hand."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

Config = dict[str, Any]


@dataclass(frozen=True)
class Parameter:
    """A tuned parameter, log-uniform between two numbers.

    Attributes:
        name: Name, with its unit.
        low: Least value.
        high: Greatest value.
        default: Value without tuning.
    """

    name: str
    low: float
    high: float
    default: float

    def at(self, u: float) -> float:
        """Value at a coordinate of the unit cube, to four digits as in the campaign files."""
        return float(f"{self.low * (self.high / self.low) ** u:.4g}")


@dataclass(frozen=True)
class Law:
    """A control law with two tuned parameters.

    Attributes:
        name: Name of its variants.
        title: Name for tables.
        parameters: The two parameters.
        config: Controller of a scenario for values of the two, the number of coordinates of the output and that of joints.
        fixed: Third parameters, as text.
    """

    name: str
    title: str
    parameters: tuple[Parameter, Parameter]
    config: Callable[[float, float, int, int], Config]
    fixed: str

    @property
    def default(self) -> tuple[float, float]:
        """The two parameters without tuning."""
        first, second = self.parameters
        return first.default, second.default

    def at(self, point: tuple[float, float]) -> tuple[float, float]:
        """The two parameters at a point of the unit cube."""
        first, second = self.parameters
        return first.at(point[0]), second.at(point[1])


def _weights(kind: str, **more: Any) -> Callable[[float, float, int, int], Config]:
    """A law with weights: 1 on the position, one number on its rate, one on the torques."""

    def config(rate: float, torque: float, outputs: int, joints: int) -> Config:
        return {"kind": kind, "Q": [1.0] * outputs + [rate] * outputs, "R": [torque] * joints, **more}

    return config


def _computed_torque(w: float, ratio: float, outputs: int, joints: int) -> Config:
    gains = {"kp_1_s2": float(f"{w * w:.6g}"), "kd_1_s": float(f"{2.0 * ratio * w:.6g}")}
    return {"kind": "task_ct", "position": gains} | _damped(outputs, joints, 6.0)


def _transposed_jacobian(kp: float, kd: float, outputs: int, joints: int) -> Config:
    return {
        "kind": "task_tj",
        "position": {"kp_N_m": kp, "kd_N_s_m": kd},
        "joint_damping_N_m_s_rad": 6.0 if joints > outputs + 1 else 0.1,
    }


def _resolved_rate(k: float, servo: float, outputs: int, joints: int) -> Config:  # noqa: ARG001 (of all laws)
    return {"kind": "gjm_rate", "position": {"k_1_s": k, "max_speed_m_s": 0.5}, "servo_gain_1_s": servo}


def _damped(outputs: int, joints: int, damping: float, key: str = "joint_damping_N_m_s_rad") -> Config:
    """Damping of what the output does not feel, for an arm with many joints to spare."""
    return {key: damping} if joints > outputs + 1 else {}


def _osdre(rate: float, torque: float, outputs: int, joints: int) -> Config:
    return _weights("osdre")(rate, torque, outputs, joints) | _damped(outputs, joints, 6.0, "null_space_damping")


def _sdre(rate: float, torque: float, outputs: int, joints: int) -> Config:
    return _weights("lqr", refresh=True)(rate, torque, outputs, joints) | _damped(outputs, joints, 6.0)


_WEIGHTS = Parameter("weight of the rate, s^2", 0.05, 5.0, 0.5), Parameter("R, m^2/(N m)^2", 0.003, 3.0, 0.1)
_SPARE = "6 N m s/rad of damping on motions of the seven joints that do not move the tip"
LAWS = (
    Law("osdre", "OSDRE, `output_stack`", _WEIGHTS, _osdre, f"weight of the position 1; {_SPARE}"),
    Law("sdre", "classical SDRE", _WEIGHTS, _sdre, f"weight of the position 1; {_SPARE}"),
    Law(
        "computed_torque",
        "computed torque",
        (Parameter("w, 1/s", 0.2, 2.0, 0.5), Parameter("damping ratio", 0.5, 2.0, 1.0)),
        _computed_torque,
        f"`singular_mass_kg` 1000; {_SPARE}",
    ),
    Law(
        "transposed_jacobian",
        "transposed Jacobian",
        (Parameter("kp, N/m", 0.3, 30.0, 2.0), Parameter("kd, N s/m", 1.0, 100.0, 8.0)),
        _transposed_jacobian,
        "damping of the joints 0.1 N m s/rad, 6 with seven joints",
    ),
    Law(
        "resolved_rate",
        "resolved rate",
        (Parameter("k, 1/s", 0.1, 2.0, 0.5), Parameter("servo, 1/s", 2.0, 200.0, 50.0)),
        _resolved_rate,
        "`max_speed_m_s` 0.5, `least_singular_value` 0.1",
    ),
)
"""Laws in the order of all tables."""
MAIN = ("osdre", "sdre", "computed_torque")


def law_of(name: str) -> Law:
    """The law of a name."""
    return next(law for law in LAWS if law.name == name)


def shown(value: float) -> str:
    """A number with three digits."""
    return f"{value:.3g}" if math.isfinite(value) else "-"
