"""``docs/appendix-a.md``: (35) and (36) from our model with the printed coefficients beside, and their solution two ways."""

from __future__ import annotations

from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.impact import Contact, resolve, solve_paper_system
from ffsm_mj.model.system import System
from ffsm_mj.report.text_table import markdown_table
from ffsm_mj.reproduction.appendix import (
    PRINTED_ENERGY,
    PRINTED_MOMENTUM,
    PRINTED_TERMS,
    energy_terms,
    momentum_row,
    solve_printed,
)
from ffsm_mj.reproduction.markdown import decimals_for, filled, fixed
from ffsm_mj.reproduction.measure import slope, tip_state
from ffsm_mj.reproduction.threshold import threshold_impact

_UNKNOWNS = ("I_e,n, N s", "object x, m/s", "object y, m/s", "object yaw, rad/s")
_RATES = ("base x", "base y", "base yaw", "joint 1", "joint 2", "joint 3")
_PRINTED_35 = (
    ("0.12", "-0.012"),
    ("-0.073", "-7.5e-3"),
    ("-0.012", "-0.031"),
    ("0.013", "-1.4e-4"),
    ("-0.27", "-0.14"),
    ("0.55", "0.37"),
)
_PRINTED_SOLUTION = ("-1.2226", "-0.2445", "0", "0.2682", "0.1354", "-0.0641", "0.0258", "0.0133", "-0.1059", "0.0979")
_PRINTED_Y = -0.3172


def appendix_page() -> str:
    """The page."""
    _, system, data, _ = threshold_impact("baseline")
    ours = _both_ways(system, data, float(tip_state(system, data)[0][1]))
    printed = _both_ways(system, data, _PRINTED_Y)
    return filled(
        "appendix-a.md",
        {
            "equation_35": _equation_35(system, data),
            "momentum": _momentum(system, data),
            "energy": _energy(system, data),
            "solution": _solution(*ours, *printed),
            "agreement": _agreement(ours, printed),
        },
    )


def _equation_35(system: System, data: Any) -> str:
    factors = slope(system, data)
    rows = (
        [name, constant, fixed(v, 5), factor, fixed(s, 6)]
        for name, (constant, factor), v, s in zip(_RATES, _PRINTED_35, data.qvel[:6], factors, strict=True)
    )
    return markdown_table(["rate", "constant, paper", "ours", "factor of I, paper", "ours"], rows)


def _momentum(system: System, data: Any) -> str:
    ours = momentum_row(system, data)
    return markdown_table(
        ["coefficient of", "paper", "ours"], ([key, f"{v:g}", fixed(ours[key], 4)] for key, v in PRINTED_MOMENTUM.items())
    )


def _energy(system: System, data: Any) -> str:
    rows = [
        [p.name, f"{p.factor:g}", fixed(o.factor, 4), f"{p.slope:g}", _like(o.slope), f"{p.constant:g}", _like(o.constant)]
        for p, o in zip(PRINTED_TERMS, energy_terms(system, data), strict=True)
    ]
    before = sum(term.factor * term.constant**2 for term in energy_terms(system, data))
    total = ["energy before, J", "", "", "", "", f"{PRINTED_ENERGY:g}", _like(before)]
    head = ["square", "factor, paper", "ours", "slope, paper", "ours", "constant, paper", "ours"]
    return markdown_table(head, [*rows, total])


def _like(value: float) -> str:
    """Two digits more than the paper gives."""
    return fixed(value, min(decimals_for(value, 4), 7))


def _solution(*columns: FloatArray) -> str:
    rounded = solve_printed()
    first = [fixed(rounded[0], 4), fixed(rounded[1], 4), "0", fixed(rounded[2], 4), *[""] * 6]
    names = [*_UNKNOWNS, *(f"{name} after, {'m/s' if i < 2 else 'rad/s'}" for i, name in enumerate(_RATES))]
    texts = [[fixed(x, 6) for x in column] for column in columns]
    head = ["", "paper", "(36) as printed", "paper's route", "ours", "paper's route, y printed", "ours, y printed"]
    rows = ([name, *cells] for name, *cells in zip(names, _PRINTED_SOLUTION, first, *texts, strict=True))
    return markdown_table(head, rows)


def _agreement(*pairs: tuple[FloatArray, FloatArray]) -> str:
    """A power of ten above the largest difference, with room for another machine's rounding."""
    worst = max(float(np.abs(a - b).max()) for a, b in pairs)
    return f"{max(10.0 ** np.ceil(np.log10(max(worst, 1e-15)) + 1.0), 1e-12):.0e}"


def _both_ways(system: System, data: Any, y: float) -> tuple[FloatArray, FloatArray]:
    """I_e,n, the object's rates and the robot's, by the paper's route and by ours."""
    bodies = system.index("body", "payload"), system.index("body", "box")
    contact = Contact(*bodies, np.array([4.0, y, 0.0]), np.array([-1.0, 0.0, 0.0]))
    paper = solve_paper_system(system, data, contact)
    impact = resolve(system.mj, data, [contact])
    ours = -impact.impulses[0], *impact.after.qvel[6:], *impact.after.qvel[:6]
    return np.array([-paper.impulse, *paper.object_qvel, *paper.robot_qvel]), np.array(ours)
