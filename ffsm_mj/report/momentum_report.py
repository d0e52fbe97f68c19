"""Angular momentum of a run as text: who had it before and after, and which actuator took it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from ffsm_mj.analysis.run import Run
from ffsm_mj.analysis.run_models import angular_momentum
from ffsm_mj.analysis.tables import MomentumRow, momentum_rows
from ffsm_mj.errors import first_few, one_line
from ffsm_mj.report.terminal import table

MOMENTUM_HEAD = ("angular momentum\nN m s", "before", "after", "change x", "change y", "change z")
_NEGLIGIBLE = 1e-12
"""N m s; an actuator that took less did nothing."""
_ACTUATORS = ("wheel", "external", "joint")
_WORDS = {"subsystem": "{}", "total": "total", "outside": "from outside"} | dict.fromkeys(_ACTUATORS, "taken by {}")
"""Names of rows by their kinds, in order; others are not shown."""


def momentum_line(run: Run) -> str:
    """One line on wheels and thrusters, those that took most first; empty for a run in which they took nothing."""
    momentum = angular_momentum(run)
    if momentum is None or not any(_took(change) for change in momentum["actuators"].values()):
        return ""
    took = {name: _norm(change["taken_N_m_s"]) for name, change in momentum["actuators"].items() if _took(change)}
    exchanged = first_few([f"{one_line(name)} {took[name]:.4g}" for name in sorted(took, key=lambda name: -took[name])])
    stack = momentum["stack_without_wheels_N_m_s"]
    if any(change["kind"] == "wheel" for change in momentum["actuators"].values()):
        rest = f", {stack:.4g} in the stack without its wheels"
    else:  # only a grasped object makes a stack of the robot
        rest = f", {stack:.4g} in the stack" if run.records.get("grasp_impulses") else ""
    return (
        f"angular momentum: {_norm(momentum['initial_N_m_s']):.4g} N m s at the start, "
        f"{_norm(momentum['final_N_m_s']):.4g} at the end{rest}; taken by {exchanged}; {momentum_residual(run)}"
    )


def momentum_residual(run: Run) -> str:
    """The residual of the sum."""
    momentum = angular_momentum(run)
    return "" if momentum is None else f"residual {momentum['residual_N_m_s']:.1e} N m s"


def momentum_table(run: Run) -> str:
    """Table by subsystem and actuator; empty for a run in which wheels and thrusters took nothing."""
    rows = momentum_cells(run)
    return f"{table(MOMENTUM_HEAD, rows)}\n  {momentum_residual(run)}" if rows else ""


def momentum_cells(run: Run) -> list[tuple[str, ...]]:
    """Rows of the table: subsystems, total, what came from outside, and what each actuator took."""
    rows = momentum_rows(angular_momentum(run)) if momentum_line(run) else []
    return [_cells(row) for kind in _WORDS for row in rows if row.kind == kind and not _is_idle(row)]


def _cells(row: MomentumRow) -> tuple[str, ...]:
    before, after = (f"{_norm(x):.4g}" if math.isfinite(_norm(x)) else "" for x in (row.before_N_m_s, row.after_N_m_s))
    return _WORDS[row.kind].format(row.name), before, after, *(f"{x:.4g}" for x in row.change_N_m_s)


def _is_idle(row: MomentumRow) -> bool:
    return row.kind in _ACTUATORS and _norm(row.change_N_m_s) <= _NEGLIGIBLE


def _took(actuator: Mapping[str, Any]) -> bool:
    return _norm(actuator["taken_N_m_s"]) > _NEGLIGIBLE


def _norm(vector: Sequence[float]) -> float:
    return math.hypot(*vector)
