"""The fastest modes of joint springs and dampers, and the largest time step that resolves them."""

from __future__ import annotations

import math
from typing import Any

from ffsm_mj.dynamics.springs import FastestMode, JointSprings
from ffsm_mj.errors import Fault, ScenarioFaults
from ffsm_mj.model.actuators import has_servos
from ffsm_mj.model.system import System
from ffsm_mj.scenario.scenario import ScenarioConfig
from ffsm_mj.tolerances import DAMPER_STEP, MODE_STEP


def spring_lines(scenario: ScenarioConfig, system: System, data: Any) -> list[str]:
    """Lines of ``ffsm check`` on springs and dampers; none if there are none.

    Args:
        scenario: What is asked for.
        system: Robot and objects.
        data: Their state.
    """
    mode, decay = _fastest(system, data)
    lines, h = [], scenario.time_step_s
    if mode.rate > 0.0:
        taken = (h * mode.rate) ** 6 / 72.0
        lines.append(
            f"  joint springs: fastest mode {mode.rate:.4g} rad/s ({mode.rate / (2.0 * math.pi):.4g} Hz), mostly of joint "
            f"{_joint(system, mode)!r}; steps up to {rounded_down(MODE_STEP / mode.rate):g} s; "
            f"RK4 takes {taken:.1e} of its energy per step"
        )
    if decay.rate > 0.0:
        lines.append(
            f"  joint dampers: fastest decay {decay.rate:.4g} 1/s, mostly of joint {_joint(system, decay)!r}; "
            f"steps up to {rounded_down(DAMPER_STEP / decay.rate):g} s"
        )
    return lines


def refuse_coarse_steps(scenario: ScenarioConfig, system: System, data: Any) -> None:
    """Refuse a time step that does not resolve the springs and dampers, unless ``accuracy`` divides steps.

    Args:
        scenario: What is asked for.
        system: Robot and objects.
        data: Their state.

    Raises:
        ScenarioFaults: The step is too long at this state; path ``time_step_s``.
    """
    if scenario.accuracy is not None or has_servos(system.mj):  # with servos step-size control sees to it
        return
    h = scenario.time_step_s
    mode, decay = _fastest(system, data)
    faults = []
    for found, limit, what in (
        (mode, MODE_STEP, f"the spring of joint {{}} has a mode of {mode.rate:.4g} rad/s, h w ="),
        (decay, DAMPER_STEP, f"the damper of joint {{}} has a decay rate of {decay.rate:.4g} 1/s, h d / I ="),
    ):
        if h * found.rate > limit:
            text = what.format(repr(_joint(system, found)))
            most = rounded_down(limit / found.rate)
            faults.append(
                Fault(
                    f"{text} {h * found.rate:.3g}, more than {limit:g}; use at most {most:g}, or set 'accuracy'",
                    ("time_step_s",),
                )
            )
    if faults:
        raise ScenarioFaults(faults)


def _fastest(system: System, data: Any) -> tuple[FastestMode, FastestMode]:
    """Fastest oscillation of the springs and fastest decay of the dampers at a state."""
    return JointSprings(system.mj).fastest(system.mj, data)


def _joint(system: System, mode: FastestMode) -> str:
    return next(joint.name for joint in system.joints.values() if joint.dofs.start <= mode.dof < joint.dofs.stop)


def rounded_down(value: float) -> float:
    """Round a positive number down to three digits."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 2)
    return float(f"{math.floor(value / unit) * unit:.3g}")
