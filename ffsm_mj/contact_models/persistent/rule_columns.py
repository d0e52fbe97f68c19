"""Log columns of one contact rule: its mode, the resultants of its pairs with their centres of pressure, its impulse."""

from __future__ import annotations

import math
from collections.abc import Container, Sequence
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from ffsm_mj._core.rows import PointRows
from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.pairs import ContactPair, UnilateralConstraint
from ffsm_mj.contact_models.persistent.contact_points import ContactPoint
from ffsm_mj.records.signals import Layout, Signal, identifier


class RuleMode(IntEnum):
    """Contact modes of a rule in the log: with friction one with force is sticking or sliding instead of pressing."""

    OPEN = 0
    CLOSED = 1
    PRESSING = 2
    STICKING = 3
    SLIDING = 4

    @property
    def word(self) -> str:
        """The mode in words."""
        return self.name.lower()


_MODE = "contact state of {}: 0 open, 1 closed without force, 2 closed with force"
_FRICTION_MODE = "contact state of {}: 0 open, 1 closed without force, 3 sticking, 4 sliding at one or more points"
_PAIRS = "number of closed pairs of {}"
_SIGNALS = (
    ("pairs", "", _PAIRS),
    ("points", "", "number of contact points of {}"),
    ("force_N", "N", "contact force of {}, under the efforts of this row: sum of the resultants of its pairs; 0 if open"),
    *((f"force_{x}_N", "N", "resultant force of {} on its second side, world axes") for x in "xyz"),
    *((f"centre_{x}_m", "m", "centre of pressure of {}, world axes; NaN if no contact point carries force") for x in "xyz"),
    ("impulse_N_s", "N s", "time integral of the contact force of {} since t = 0"),
)
NOTHING = np.array([RuleMode.OPEN, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, math.nan, math.nan, math.nan, 0.0])
"""Columns of a rule without a closed pair."""
IMPULSE = len(NOTHING) - 1
"""Index of the impulse among the columns of a rule."""
_NOWHERE = [math.nan] * 3


class Resultant(NamedTuple):
    """Resultant contact force of a pair at one state.

    Attributes:
        force: Force on geom b, N, (3,).
        centre: Centre of pressure; mean of the contact points if none carries force, m, (3,).
        normal: Mean unit normal, (3,).
        contact_points: The contact points.
    """

    force: FloatArray
    centre: FloatArray
    normal: FloatArray
    contact_points: Sequence[ContactPoint] = ()

    @property
    def points(self) -> int:
        """Number of contact points."""
        return len(self.contact_points)

    @property
    def mode(self) -> str:
        """Their features."""
        return " + ".join(dict.fromkeys(contact.feature.name for contact in self.contact_points))

    @property
    def size(self) -> float:
        """Norm of the force, N."""
        return math.hypot(*self.force.tolist())


def resultant(
    contact_points: Sequence[ContactPoint],
    rows: PointRows,
    forces: FloatArray,
    part: slice,
    friction: FloatArray,
) -> Resultant:
    """Resultant over the contact points of one pair, of normal forces (k,) and friction forces (k, 3)."""
    return Resultant(*rows.resultant(part, forces, friction), contact_points[part])


def points_of(pair: UnilateralConstraint, contact_points: Sequence[ContactPoint]) -> slice:
    """The contact points of one pair, which are consecutive."""
    start = next((i for i, contact in enumerate(contact_points) if contact.pair is pair), 0)
    end = start
    while end < len(contact_points) and contact_points[end].pair is pair:
        end += 1
    return slice(start, end)


class RuleTables(NamedTuple):
    """Tables of the log columns of contact rules.

    Attributes:
        values: Columns of each rule, (n, columns).
        rows: Row of each rule.
        friction_values: The same of the rules with friction, see :mod:`.friction.report`.
        friction_rows: Row of each of them.
        work_J: Work of the forces of contacts with friction, (1,).
    """

    values: FloatArray
    rows: dict[str, int]
    friction_values: FloatArray
    friction_rows: dict[str, int]
    work_J: FloatArray


def signals_of(rule: str, *, friction: bool) -> tuple[Signal, ...]:
    """Signals of a rule, with friction or without."""
    named = (("mode", "", _FRICTION_MODE if friction else _MODE), *_SIGNALS)
    return tuple(
        Signal("contact", f"{identifier(rule)}_{name}", unit, meaning.format(rule)) for name, unit, meaning in named
    )


def pairs_columns(layout: Layout) -> dict[str, int]:
    """Column of the number of closed pairs, by rule; only its description has the name as it is."""
    text = _PAIRS.format("")
    columns = {signal.description: i for i, signal in enumerate(layout.signals) if signal.group == "contact"}
    return {meaning.removeprefix(text): i for meaning, i in columns.items() if meaning.startswith(text)}


def force_keys(rule: str) -> tuple[str, ...]:
    """Columns of the resultant force of a contact rule on its second side."""
    return tuple(f"contact.{identifier(rule)}_force_{x}_N" for x in "xyz")


def mode_key(rule: str) -> str:
    """Column of the contact mode of a rule."""
    return f"contact.{identifier(rule)}_mode"


def row_of(pairs: Sequence[tuple[ContactPair, Resultant]], pressing: Container[UnilateralConstraint]) -> tuple[float, ...]:
    """Columns of a rule with these closed pairs, except its impulse."""
    if len(pairs) == 1:
        ((pair, resultant),) = pairs
        force, carries = resultant.force.tolist(), pair in pressing
        centre = resultant.centre.tolist() if carries else _NOWHERE
        return RuleMode.PRESSING if carries else RuleMode.CLOSED, 1.0, resultant.points, math.hypot(*force), *force, *centre
    count = sum(resultant.points for _, resultant in pairs)
    carrying = [resultant for pair, resultant in pairs if pair in pressing]
    if not carrying:
        return RuleMode.CLOSED, len(pairs), count, 0.0, 0.0, 0.0, 0.0, *_NOWHERE
    sizes = np.array([resultant.size for resultant in carrying])
    # Forces of several pairs may oppose each other, as in a grip: the centre of their sum would be anywhere.
    total = float(sizes.sum())
    force = np.sum([resultant.force for resultant in carrying], axis=0)
    centre = (sizes @ np.array([resultant.centre for resultant in carrying]) / total).tolist()
    return RuleMode.PRESSING, len(pairs), count, total, *force.tolist(), *centre
