"""Appendix A of the paper rebuilt from our model: (35), (36) and what they give, beside the printed coefficients."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from scipy.optimize import brentq

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.rigid_body import momentum_matrix
from ffsm_mj.impact import Contact, resolve, solve_paper_system
from ffsm_mj.model.system import System
from ffsm_mj.report.markdown import markdown_table
from ffsm_mj.validation.cases.seed_paper.printed import PRINTED
from ffsm_mj.validation.cases.seed_paper.runs import slope, threshold_impact, tip_state
from ffsm_mj.validation.page import fixed, from_template, significant

APPENDIX_PAGE = "appendix-a.md"


@dataclass(frozen=True)
class Term:
    """One square of the energy equation: ``factor (slope I + constant)^2``, up to the sign inside the square."""

    name: str
    factor: float
    slope: float
    constant: float

    def turned(self) -> Term:
        """The same square with the slope positive, as the paper writes most."""
        sign = -1.0 if self.slope < 0.0 else 1.0
        return Term(self.name, self.factor, sign * self.slope, sign * self.constant)


PRINTED_TERMS = (
    Term("base x", 2.5, 0.012, -0.12),
    Term("base y", 2.5, 7.5e-3, 0.073),
    Term("base spin", 1.0, 0.031, 0.012),
    Term("link 1 x", 1.0, 0.022, -0.11),
    Term("link 1 y", 1.0, 0.04, 0.076),
    Term("link 1 spin", 0.33, 0.032, -6.7e-4),
    Term("link 2 x", 1.0, 0.08, 0.017),
    Term("link 2 y", 1.0, 0.085, 0.17),
    Term("link 2 spin", 0.33, 0.17, 0.27),
    Term("link 3 x", 1.0, 0.22, 0.23),
    Term("link 3 y", 1.0, 0.045, 0.15),
    Term("link 3 spin", 0.33, 0.2, 0.28),
    Term("payload x", 0.5, 0.29, 0.32),
    Term("payload y", 0.5, 0.14, 0.11),
)
PRINTED_ENERGY = 0.28
PRINTED_MOMENTUM = {"I_e,n": 0.32, "x_o": -2.5, "y_o": -18.0, "psi_o": -0.83}
"""The third row of (36), the angular momentum about the origin."""
_BODIES = ("base", "link_1", "link_2", "link_3", "payload")
_UNKNOWNS = ("I_e,n, N s", "object x, m/s", "object y, m/s", "object yaw, rad/s")
_RATES = ("base x", "base y", "base yaw", "joint 1", "joint 2", "joint 3")
_PRINTED = {number.key: number.text for number in PRINTED if number.scenario == "baseline"}
_PRINTED_Y = -0.3172


def energy_terms(system: System, data: Any) -> tuple[Term, ...]:
    """The squares of the robot's kinetic energy after an impulse I_e,n, body by body, as (36) has them."""
    model, rates = system.mj, np.zeros(system.mj.nv)
    rates[system.robot.dofs] = slope(system, data)
    terms = []
    for name in _BODIES:
        body = system.index("body", name)
        linear, angular = np.empty((3, model.nv)), np.empty((3, model.nv))
        mujoco.mj_jacBodyCom(model, data, linear, angular, body)
        title, mass, inertia = name.replace("_", " "), model.body_mass[body], model.body_inertia[body].max()
        rows = [(f"{title} x", mass, linear[0]), (f"{title} y", mass, linear[1])]
        rows += [(f"{title} spin", inertia, angular[2])] if name != "payload" else []  # a point mass does not spin
        terms += [Term(key, float(m) / 2, float(J @ rates), float(J @ data.qvel)).turned() for key, m, J in rows]
    return tuple(terms)


def momentum_row(system: System, data: Any) -> dict[str, float]:
    """Coefficients of the third row of (36), of I_e,n and of the object's x, y and yaw rates."""
    model, robot, target = system.mj, system.robot, system.objects[0]
    lost = -momentum_matrix(model, data, robot.root)[5, robot.dofs] @ slope(system, data)
    gained = momentum_matrix(model, data, target.root)[5, target.dofs]
    return dict(zip(PRINTED_MOMENTUM, (float(x) for x in (lost, *-gained)), strict=True))


def solve_printed() -> FloatArray:
    """I_e,n and the object's x and yaw rates from (36) with the coefficients as they are printed, in two digits."""

    def object_rates(impulse: float) -> tuple[float, float]:
        x_rate = impulse / 5.0
        return x_rate, (PRINTED_MOMENTUM["I_e,n"] * impulse + PRINTED_MOMENTUM["x_o"] * x_rate) / -PRINTED_MOMENTUM["psi_o"]

    def energy(impulse: float) -> float:
        x_rate, yaw_rate = object_rates(impulse)
        robot = sum(term.factor * (term.slope * impulse + term.constant) ** 2 for term in PRINTED_TERMS)
        return robot + 2.5 * x_rate**2 + 0.42 * yaw_rate**2 - PRINTED_ENERGY

    impulse = float(brentq(energy, -2.0, -0.5, xtol=1e-12))
    return np.array([impulse, *object_rates(impulse)])


def appendix_page() -> str:
    """``docs/appendix-a.md``: (35) and (36) from our model beside the printed coefficients, and their solution two ways."""
    _, system, data, _ = threshold_impact("baseline")
    ours = _both_ways(system, data, float(tip_state(system, data)[0][1]))
    printed = _both_ways(system, data, _PRINTED_Y)
    return from_template(
        APPENDIX_PAGE,
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
        [name, _PRINTED[f"before_{i}"], fixed(v, 5), _PRINTED[f"slope_{i}"], fixed(s, 6)]
        for i, (name, v, s) in enumerate(zip(_RATES, data.qvel[:6], factors, strict=True))
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
    return fixed(value, min(significant(value, 4), 7))


def _solution(*columns: FloatArray) -> str:
    rounded = solve_printed()
    first = [fixed(rounded[0], 4), fixed(rounded[1], 4), "0", fixed(rounded[2], 4), *[""] * 6]
    names = [*_UNKNOWNS, *(f"{name} after, {'m/s' if i < 2 else 'rad/s'}" for i, name in enumerate(_RATES))]
    texts = [[fixed(x, 6) for x in column] for column in columns]
    head = ["", "paper", "(36) as printed", "paper's route", "ours", "paper's route, y printed", "ours, y printed"]
    keys = ("impulse", "object_vx", "object_vy", "object_yaw_rate", *(f"after_{i}" for i in range(6)))
    rows = ([name, _PRINTED[key], *cells] for name, key, *cells in zip(names, keys, first, *texts, strict=True))
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
