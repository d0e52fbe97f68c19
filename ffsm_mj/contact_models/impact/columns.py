"""Columns of impacts in the log: deepest overlap, heat of friction, smallest gap of each contact rule."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ffsm_mj._core.tick import Maxima, Periodically
from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.broad_phase import BroadPhase
from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.contact.normal import DISTANCE_LIMIT_M
from ffsm_mj.contact.pairs import ContactPair, UnilateralConstraint
from ffsm_mj.contact_models.interface import Scene
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.signals import FRICTION_HEAT, LIMIT_OVERRUN, OVERLAP, Signal, identifier
from ffsm_mj.state import Stateful, entries, fitting
from ffsm_mj.tolerances import DISTANCE_QUERY_M

_SINCE = "at the ends of the steps and sub-steps since the sample before"
_JOINTS = {"rad": "hinge", "m": "slide"}


class DeepestOverlap(Stateful):
    """Largest overlap of any pair, and overrun of any joint limit, at the ends of (sub-)steps since the sample before.

    Attributes:
        deepest: The numbers since the last sample: of geoms in m, then of hinges in rad and slides in m where there are any.
        columns: Its columns: the overlap, then the overrun of hinges and of slides where there are limited ones.
    """

    @dataclass
    class State:
        """The numbers since the last sample."""

        deepest: FloatArray

    def __init__(self, limits: Sequence[JointLimit] = ()) -> None:
        """Start without overlap.

        Args:
            limits: Limits of the run.
        """
        units = sorted({limit.unit for limit in limits}, reverse=True)
        self._column = {unit: k for k, unit in enumerate(units, start=1)}
        self.deepest, logged = np.zeros((2, 1 + len(units)))
        signals = (
            Signal("balance", OVERLAP, "m", f"deepest overlap of a pair of the contact rules {_SINCE}"),
            *(
                Signal(
                    "balance",
                    LIMIT_OVERRUN[unit],
                    unit,
                    f"largest travel of a {_JOINTS[unit]} joint past its limit {_SINCE}",
                )
                for unit in units
            ),
        )
        self.columns = (Columns(signals, live=logged, on_sample=Maxima(self.deepest, logged)),)

    def add(self, constraint: UnilateralConstraint, gap: float) -> None:
        """Update it with the gap of a pair in m, or of a joint limit in rad or m, at the end of a (sub-)step."""
        place = self._column[constraint.unit] if constraint.is_limit else 0
        self.deepest[place] = max(self.deepest[place], -gap)


_HEAT = Signal(
    "balance",
    FRICTION_HEAT,
    "J",
    "heat of friction since t = 0, of sliding in persistent contact and of impacts. Sliding: the sum of the columns of the "
    "rules. Impacts with friction: kinetic energy lost, less the loss by the work of the normal impulses, which restitution "
    "explains; for several contacts at one instant this split is a convention",
)


class FrictionHeat(Stateful):
    """Sum of the heat of friction of all pairs.

    Attributes:
        total_J: The sum, J, (1,).
        columns: Its column.
    """

    @dataclass
    class State:
        """The sum so far, J, (1,)."""

        total_J: FloatArray

    def __init__(self) -> None:
        """Start without heat."""
        self.total_J = np.zeros(1)
        self.columns = (Columns((_HEAT,), live=self.total_J, resume=self._resume),)

    def _resume(self, logged: FloatArray) -> None:
        self.total_J[:] = logged

    def add(self, heat_J: float) -> None:
        """Add the heat of an impact or of a (sub-)step."""
        self.total_J += heat_J


PERIOD_S = 0.02
"""The gaps are evaluated in the first sample and then once in this time: a rule may have hundreds of pairs."""
_MEANING = "smallest gap of the pairs of {}, negative when overlapping; evaluated every {:g} s and held in between"


class RuleGaps:
    """Evaluates the smallest gap of each rule.

    Attributes:
        columns: One column for each rule.
    """

    @dataclass
    class State:
        """The gaps evaluated last, and when the last sample was, s."""

        gaps: FloatArray
        last_s: float

    def get_state(self) -> State:
        """The gaps, and the time of the last sample."""
        return self.State(self._gaps.copy(), self._period.last_s)

    def set_state(self, state: Any) -> None:
        """Go on from a state."""
        values = entries(state, ("gaps", "last_s"), "RuleGaps")
        self._gaps[:] = fitting(values["gaps"], self._gaps.shape, "RuleGaps")
        # The next sample is not the one that these values were logged with: it evaluates the gaps once their period is over.
        self._period.last_s, self._period.is_resumed = values["last_s"], False

    def __init__(self, scene: Scene, pairs: Sequence[ContactPair]) -> None:
        """Group the pairs by rule."""
        self._model, self._data = scene.system.mj, scene.data
        rules: dict[str, list[ContactPair]] = {}
        for pair in pairs:
            rules.setdefault(pair.rule, []).append(pair)
        self._rules = [(group, BroadPhase(self._model, group)) for group in rules.values()]
        self._gaps = np.full(len(rules), math.nan)
        signals = tuple(
            Signal("contact", f"{identifier(rule)}_gap_m", "m", _MEANING.format(rule, PERIOD_S)) for rule in rules
        )
        self._period = Periodically(PERIOD_S, self._evaluate)
        self.columns = (Columns(signals, live=self._gaps, on_sample=self._period, resume=self._resume),) if rules else ()

    def _resume(self, logged: FloatArray) -> None:
        # The next sample is the one that these values were logged with; zeros stand for the start of a run.
        self._gaps[:] = logged
        self._period.resume(bool(logged.any()))

    def _evaluate(self) -> None:
        self._gaps[:] = [_smallest(*rule, self._model, self._data) for rule in self._rules]


def _smallest(pairs: Sequence[ContactPair], spheres: BroadPhase, model: Any, data: Any) -> float:
    """Smallest gap of some pairs: the nearest by their spheres first, until no sphere is nearer than a gap found.

    A query may be wrong by DISTANCE_QUERY_M: each pair that may be the nearest is evaluated to rounding.
    """
    if len(pairs) == 1:
        (pair,) = pairs
        gap = pair.gap(model, data, DISTANCE_LIMIT_M)
        # A query that finds nothing within its limit returns the limit: there are no witness points to refine.
        return pair.gap_to_rounding(model, data, gap) if gap < DISTANCE_LIMIT_M else DISTANCE_LIMIT_M
    bounds = spheres.gaps(data)
    gaps: list[tuple[float, ContactPair]] = []
    reach = DISTANCE_LIMIT_M
    for i in np.argsort(bounds).tolist():
        # The gap of enclosing spheres is a lower bound of that of their geoms: in ascending order no later pair can be
        # nearer.
        if bounds[i] >= reach:
            break
        gaps.append((pairs[i].gap(model, data, DISTANCE_LIMIT_M), pairs[i]))
        # Two queries may be off in opposite directions. Without the margin the wrong pair could count as the nearest.
        reach = min(reach, gaps[-1][0] + DISTANCE_QUERY_M)
    near = (pair.gap_to_rounding(model, data, gap) for gap, pair in gaps if gap <= reach and gap < DISTANCE_LIMIT_M)
    return min(near, default=DISTANCE_LIMIT_M)
