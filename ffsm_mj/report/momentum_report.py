"""Angular momentum of a run as text and HTML: who had it before and after, and which actuator took it."""

from __future__ import annotations

import html
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ffsm_mj.analysis.run import Run
from ffsm_mj.analysis.run_models import angular_momentum
from ffsm_mj.errors import one_line
from ffsm_mj.report.terminal import table

_HEAD = ("angular momentum\nN m s", "before", "after", "change x", "change y", "change z")
_NEGLIGIBLE = 1e-12
"""N m s; an actuator that took less did nothing."""


def momentum_line(run: Run) -> str:
    """One line on wheels and thrusters; empty for a run in which they took nothing."""
    found = angular_momentum(run)
    if found is None or not any(_took(each) for each in found["actuators"].values()):
        return ""
    taken = ", ".join(
        f"{one_line(name)} {_norm(each['taken_N_m_s']):.4g}" for name, each in found["actuators"].items() if _took(each)
    )
    rest = f"{found['stack_without_wheels_N_m_s']:.2g} in the stack without its wheels"
    return (
        f"angular momentum: {_norm(found['initial_N_m_s']):.4g} N m s at the start, "
        f"{_norm(found['final_N_m_s']):.4g} at the end, {rest}; taken by {taken}; residual {found['residual_N_m_s']:.1e}"
    )


def momentum_table(run: Run) -> str:
    """Table by subsystem and actuator; empty for a run in which wheels and thrusters took nothing."""
    if not momentum_line(run):
        return ""
    found = angular_momentum(run)
    assert found is not None
    return table(_HEAD, momentum_rows(found)) + f"\n  residual of the sum: {found['residual_N_m_s']:.1e} N m s"


def momentum_rows(found: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Rows of the table: subsystems, what came from outside, total, and what each actuator took."""
    rows = [
        _row(name, each["before_N_m_s"], each["after_N_m_s"], _difference(each))
        for name, each in found["subsystems"].items()
    ]
    rows.append(_row("total", found["initial_N_m_s"], found["final_N_m_s"], _change(found)))
    rows.append(("from outside", "", "", *_numbers(found["external_N_m_s"])))
    rows += [
        (f"taken by {name}", "", "", *_numbers(each["taken_N_m_s"]))
        for name, each in found["actuators"].items()
        if _took(each)
    ]
    return rows


def momentum_html(run: Run) -> str:
    """The table as a section of the page; empty for a run in which wheels and thrusters took nothing."""
    if not momentum_line(run):
        return ""
    found = angular_momentum(run)
    assert found is not None
    lines = "\n".join("".join(_cells(row)) for row in momentum_rows(found))
    head = "".join(f"<th>{html.escape(name.replace(chr(10), ', '))}</th>" for name in _HEAD)
    return (
        f'<h2>Angular momentum</h2>\n<div class="wide"><table><thead><tr>{head}</tr></thead>\n'
        f"<tbody>\n{lines}\n</tbody></table>"
        '</div>\n<p class="note">About the centre of mass of everything that moves; residual of the sum '
        f"{found['residual_N_m_s']:.1e} N m s.</p>"
    )


def _cells(row: Sequence[str]) -> Iterator[str]:
    yield "<tr>"
    yield from (f"<td>{html.escape(one_line(cell))}</td>" for cell in row)
    yield "</tr>"


def _took(actuator: Mapping[str, Any]) -> bool:
    return _norm(actuator["taken_N_m_s"]) > _NEGLIGIBLE


def _row(name: str, before: Sequence[float], after: Sequence[float], change: Sequence[float]) -> tuple[str, ...]:
    return name, f"{_norm(before):.4g}", f"{_norm(after):.4g}", *_numbers(change)


def _numbers(vector: Sequence[float]) -> tuple[str, ...]:
    return tuple(f"{x:.4g}" for x in vector)


def _difference(each: Mapping[str, Any]) -> list[float]:
    return [after - before for before, after in zip(each["before_N_m_s"], each["after_N_m_s"], strict=True)]


def _change(found: Mapping[str, Any]) -> list[float]:
    return [after - before for before, after in zip(found["initial_N_m_s"], found["final_N_m_s"], strict=True)]


def _norm(vector: Sequence[float]) -> float:
    return math.hypot(*vector)
