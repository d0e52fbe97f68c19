"""Log columns of the contact rules with friction, beside those of all rules."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.persistent.contact_points import ContactPoint
from ffsm_mj.contact_models.persistent.exchange import Stage
from ffsm_mj.contact_models.persistent.friction.pair_friction import PairFriction
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.signals import CONTACT_WORK, SLIDING_HEAT, Signal, identifier
from ffsm_mj.state import Stateful

_SIGNALS = (
    ("friction_N", "N", "friction force of {}: sum of the tangential resultants of its pairs; 0 without force"),
    *((f"friction_{x}_N", "N", "resultant friction force of {} on its second side, world axes") for x in "xyz"),
    (
        "friction_use",
        "",
        "share of the friction limit, mu times the normal force, that {} uses: 1 while a point slides, 0 without force; "
        "while it sticks, it would also stick with mu times this share",
    ),
    ("slip_m_s", "m/s", "largest slip speed of the sliding contact points of {}; 0 if none slides"),
    ("slip_m", "m", "slip distance of {} since t = 0: time integral of its largest slip speed"),
    (SLIDING_HEAT.lstrip("_"), "J", "heat of sliding in persistent contact of {} since t = 0; without that of impacts"),
)
SLIP, _HEAT = len(_SIGNALS) - 2, len(_SIGNALS) - 1
_WORK = Signal(
    "balance",
    CONTACT_WORK,
    "J",
    "work of the forces of persistent contact on all bodies since t = 0, in steps with closed pairs with friction: minus "
    "the heat of sliding",
)


class FrictionReport(Stateful):
    """Writes the columns of the rules with friction.

    Attributes:
        columns: The columns.
        values: Their values, a row for each rule.
        rules: Row of each rule.
        work_J: Value of the column of the work of contact forces, (1,).
    """

    @dataclass
    class State:
        """Values of the columns: slip, heat and work are sums since t = 0."""

        values: FloatArray
        work_J: FloatArray

    def __init__(self, rules: Iterable[str]) -> None:
        """Start at rest.

        Args:
            rules: Names of the contact rules with mu > 0.
        """
        self.rules = {name: i for i, name in enumerate(rules)}
        self.values = np.zeros((len(self.rules), len(_SIGNALS)))
        signals = tuple(
            Signal("contact", f"{identifier(rule)}_{name}", unit, meaning.format(rule))
            for rule in self.rules
            for name, unit, meaning in _SIGNALS
        )
        self.work_J = np.zeros(1)
        self.columns = (
            Columns(signals, live=self.values.reshape(-1), resume=self._restore, at_state=self.values.flatten),
            Columns((_WORK,), live=self.work_J, resume=self._restore_work),
        )

    def _restore(self, logged: FloatArray) -> None:
        self.values[:] = logged.reshape(self.values.shape)

    def _restore_work(self, logged: FloatArray) -> None:
        self.work_J[:] = logged

    def write(self, by_rule: Mapping[str, Sequence[PairFriction]]) -> None:
        """Write the columns for the pairs that carry force, by rule."""
        self.values[:, :SLIP] = 0.0
        for rule, pairs in by_rule.items():
            sums = [0.0] * SLIP
            for pair in pairs:
                x, y, z = pair.force.tolist()
                sums[0] += math.hypot(x, y, z)
                sums[1] += x
                sums[2] += y
                sums[3] += z
                # Forces add up; what a rule has left until it slips is what its worst pair has left.
                sums[4], sums[5] = max(sums[4], pair.use), max(sums[5], pair.slip_speed)
            self.values[self.rules[rule], :SLIP] = sums

    def slip(self, rule: str) -> float:
        """Slip distance of a rule since t = 0, m."""
        return float(self.values[self.rules[rule], SLIP])

    def add_step(
        self,
        contact_points: Sequence[ContactPoint],
        stages: Sequence[Stage],
        weights_s: FloatArray,
        work_J: float,
    ) -> float:
        """Add slip, heat and work in a step.

        Args:
            contact_points: Contact points of the stages.
            stages: Stages of the step.
            weights_s: Their quadrature weights, s.
            work_J: Work of all contact forces in the step, J.

        Returns:
            Heat of all rules in the step, J.
        """
        total = 0.0
        self.work_J[0] += work_J
        for stage, weight in zip(stages, weights_s.tolist(), strict=True):
            if stage.slide is None:
                continue
            for contact, heat in zip(contact_points, stage.slide.heat.tolist(), strict=True):
                if contact.pair.mu > 0.0:
                    self.values[self.rules[contact.pair.rule], _HEAT] += weight * heat
                    total += weight * heat
            # In each stage the fastest point counts: the slip distance is the integral of the largest speed, not the largest
            # integral.
            largest: dict[str, float] = {}
            for contact, speed in zip(contact_points, stage.slide.speeds.tolist(), strict=True):
                if speed > largest.get(contact.pair.rule, 0.0):
                    largest[contact.pair.rule] = speed
            for rule, speed in largest.items():
                self.values[self.rules[rule], SLIP] += weight * speed
        return total
