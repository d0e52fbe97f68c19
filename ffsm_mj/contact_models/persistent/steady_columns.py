"""Log columns of contact rules in steady states: all points of their closed pairs carry force, and none slides."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.features.body_motion import Vector, scaled
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact_models.persistent.friction.report import SLIP
from ffsm_mj.contact_models.persistent.rows import ContactPoint
from ffsm_mj.contact_models.persistent.rule_columns import IMPULSE, NOTHING, PRESSING, STICKING


class RuleTables(NamedTuple):
    """Tables of the log columns of contact rules.

    Attributes:
        values: Columns of each rule, see ``rule_columns.py``, (n, columns).
        rows: Row of each rule.
        friction_values: The same of the rules with friction, see ``friction/report.py``.
        friction_rows: Row of each of them.
        work_J: Work of the forces of contacts with friction, (1,).
    """

    values: FloatArray
    rows: dict[str, int]
    friction_values: FloatArray
    friction_rows: dict[str, int]
    work_J: FloatArray


class PairLoad(NamedTuple):
    """Resultant of the contact forces of a pair.

    Attributes:
        force: Force on geom b, world axes, N.
        centre: Centre of pressure, m.
        friction: Tangential part of the force, N.
        use: Share of the friction limit that its points use.
    """

    force: Vector
    centre: Vector
    friction: Vector
    use: float


class RuleColumns:
    """Columns of the rules of some pairs, all of whose points carry force, and none of which slides."""

    def __init__(self, by_pair: Mapping[ContactPair, Sequence[ContactPoint]], tables: RuleTables) -> None:
        """Find the rows and pairs of each rule."""
        self._tables, self._rows = tables, [tables.rows[pair.rule] for pair in by_pair]
        members: dict[str, list[int]] = {}
        for i, pair in enumerate(by_pair):
            members.setdefault(pair.rule, []).append(i)
        points = list(map(len, by_pair.values()))
        self._rules = [
            (tables.rows[rule], tables.friction_rows.get(rule), sum(points[i] for i in own), own)
            for rule, own in members.items()
        ]
        self._others = len(members) < len(tables.rows)

    def write(self, loads: Sequence[PairLoad]) -> None:
        """Write all columns but the impulses, with the load of each pair."""
        values, friction_values = self._tables.values, self._tables.friction_values
        if self._others:
            values[:, :IMPULSE], friction_values[:, :SLIP] = NOTHING[:IMPULSE], 0.0
        for row, friction_row, points, members in self._rules:
            own = [loads[i] for i in members]
            mode = PRESSING if friction_row is None else STICKING
            values[row, :IMPULSE] = mode, len(own), points, *_resultant(own)
            if friction_row is not None:
                sizes = sum(math.hypot(*each.friction) for each in own)
                across = _total([each.friction for each in own])
                friction_values[friction_row, :SLIP] = sizes, *across, max(each.use for each in own), 0.0

    def add_impulses(self, impulses: Sequence[float]) -> None:
        """Add the impulse of each pair, N s."""
        for row, impulse in zip(self._rows, impulses, strict=True):
            self._tables.values[row, IMPULSE] += impulse


def _resultant(loads: Sequence[PairLoad]) -> tuple[float, ...]:
    """Sum of the sizes of the forces, sum of the forces, and centre: of several, weighted by the sizes."""
    if len(loads) == 1:
        return math.hypot(*loads[0].force), *loads[0].force, *loads[0].centre
    sizes = [math.hypot(*load.force) for load in loads]
    total = sum(sizes)
    force = _total([load.force for load in loads])
    centre = _total([scaled(size / total, load.centre) for size, load in zip(sizes, loads, strict=True)])
    return total, *force, *centre


def _total(vectors: Sequence[Vector]) -> Vector:
    x, y, z = map(sum, zip(*vectors, strict=True))
    return x, y, z
