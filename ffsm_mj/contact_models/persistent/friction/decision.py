"""Choice of the friction modes at one state under given efforts, with the interface of the choice without friction."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from ffsm_mj.arrays import BoolArray, FloatArray, IntArray
from ffsm_mj.contact_models.persistent.friction.choice import ModeChoice, NoModesError, PointStates, Solution
from ffsm_mj.contact_models.persistent.friction.cone_shares import shares_in_cones
from ffsm_mj.contact_models.persistent.friction.modes import CLOSED, SLIDE, STICK, FrictionModes, Mode, sliding
from ffsm_mj.contact_models.persistent.friction.pair_state import FrictionOfPairs
from ffsm_mj.contact_models.persistent.friction.problem import FrictionProblem, unit_slips
from ffsm_mj.contact_models.persistent.rows import ContactPoint, FrictionalRows
from ffsm_mj.records.events import Outcome, RunEnded
from ffsm_mj.tolerances import ACCELERATION, ACCELERATION_M_S2, RATE

_OPENS = 10.0
"""A gap opens where a gap'' exceeds its rounding by this factor."""
_REVERSED_M_S = 1e-13
"""A slip against its direction by more than this is a reversal, not rounding."""


class FrictionalDecision:
    """Contact forces and modes at one state; computed on demand.

    Attributes:
        contact_points: All closed contact points.
        rows: Their states and rows.
        problem: Their problem of accelerations.
        slips: Slip velocities, world axes, m/s, (k, 3).
    """

    def __init__(
        self,
        contact_points: tuple[ContactPoint, ...],
        rows: FrictionalRows,
        force: FloatArray,
        qvel: FloatArray,
        modes: FrictionModes,
    ) -> None:
        """Set up the problem.

        Args:
            contact_points: Pairs and features.
            rows: Their rows.
            force: Generalised forces without the contact forces, less the bias, (nv,).
            qvel: Generalised velocity, (nv,).
            modes: Present modes.
        """
        self.contact_points, self.rows, self._modes = contact_points, rows, modes
        mu = np.array([contact.pair.mu for contact in contact_points])
        self.problem = FrictionProblem(rows.G, rows.response @ force + rows.gamma, mu, modes.structures)
        self._force, self._kinds = force, modes.kinds(contact_points)
        velocities = (rows.J @ qvel).reshape(-1, 3)
        self._u: FloatArray = velocities[:, 1:]
        self._straight = modes.straight(contact_points)
        self.slips: FloatArray = np.einsum("ki,kij->kj", self._u, rows.axes[:, 1:])
        self._speed_rounding = RATE * (1.0 + np.abs(rows.J * qvel).max(axis=1, initial=0.0).reshape(-1, 3).max(axis=1))

    @cached_property
    def rounding(self) -> FloatArray:
        """Rounding of the accelerations of each point, m/s^2, (k,): a share of the largest term."""
        rows = self.rows
        terms = np.maximum(np.abs(rows.response * self._force).max(axis=1, initial=0.0), np.abs(rows.gamma))
        return np.asarray(ACCELERATION_M_S2 + ACCELERATION * np.maximum(terms.reshape(-1, 3).max(axis=1), rows.scales))

    @cached_property
    def _choice(self) -> ModeChoice:
        slips = np.where(self._straight[:, None], self._speeds[:, None] * self._at_start, self._u)
        states = PointStates(slips, self._slides, self._kinds, self._at_start, self.rounding, self._modes.released)
        return ModeChoice(self.problem, states)

    @cached_property
    def _at_start(self) -> FloatArray:
        """Directions of slip at the start of the step along (t1, t2), (k, 2)."""
        return unit_slips(np.einsum("kij,kj->ki", self.rows.axes[:, 1:], self._modes.directions(self.contact_points)))

    @cached_property
    def _speeds(self) -> FloatArray:
        """Slip speeds, along the kept direction for points that go straight on to their stop, m/s, (k,)."""
        along = np.maximum(np.sum(self._u * self._at_start, axis=1), 0.0)
        return np.where(self._straight, along, np.hypot(self._u[:, 0], self._u[:, 1]))

    @cached_property
    def _slides(self) -> BoolArray:
        """Points that slip, (k,)."""
        stop_speeds = self._modes.stop_speeds(self.contact_points)
        slides = sliding(
            self._speeds, self._kinds, stop_speeds, self._speed_rounding, self._straight, struck=self._modes.struck
        )
        return slides & (self.problem.mu > 0.0)

    @cached_property
    def solution(self) -> Solution:
        """Modes chosen, and forces in them.

        Raises:
            RunEnded: No modes satisfy Coulomb's conditions, or none were found.
        """
        try:
            return self._choice.choose()
        except NoModesError:
            names = "; ".join(dict.fromkeys(str(contact.pair) for contact in self.contact_points))
            why = f"painleve: no friction modes satisfy Coulomb's conditions ({names})"
            raise RunEnded(Outcome.UNSUPPORTED_CONTACT, why) from None

    @property
    def kinds(self) -> IntArray:
        """Modes, (k,)."""
        return self.solution.kinds

    @property
    def modes(self) -> tuple[str, ...]:
        """Names of the modes: ``closed``, ``slide`` or ``stick``."""
        return tuple(Mode(kind).name.lower() for kind in self.kinds.tolist())

    @cached_property
    def _shared(self) -> FloatArray:
        """Forces (n, t1, t2) of all points, those of sticking points inside their cones, N, (k, 3)."""
        return shares_in_cones(self.problem, self.solution.forces, np.flatnonzero(self.kinds == STICK))

    @cached_property
    def forces(self) -> FloatArray:
        """Normal forces, N, (k,)."""
        return np.maximum(self._shared[:, 0], 0.0)

    @cached_property
    def friction(self) -> FloatArray:
        """Friction force on geom b of each point, world axes, N, (k, 3)."""
        return np.asarray(np.einsum("ki,kij->kj", self._shared[:, 1:], self.rows.axes[:, 1:]))

    @cached_property
    def of_pairs(self) -> FrictionOfPairs:
        """Friction of the pairs with mu > 0 that carry force."""
        return FrictionOfPairs(self.contact_points, self.problem, self.solution, self.friction, self.slips)

    @property
    def held_forces(self) -> FloatArray:
        """Normal forces in the stages of a step that starts here: the same."""
        return self.forces

    @property
    def pressing(self) -> list[int]:
        """Indices of the contact points that carry force: the active set."""
        return [int(i) for i in np.flatnonzero(self.kinds != CLOSED)]

    @cached_property
    def directions(self) -> FloatArray:
        """Directions of slip, world axes, (k, 3); zero for points that do not slide."""
        return np.asarray(np.einsum("ki,kij->kj", self.solution.directions, self.rows.axes[:, 1:]))

    def leaving(self) -> tuple[ContactPoint, ...]:
        """Contact points whose gap opens, in the order of ``contact_points``."""
        rates = zip(self.contact_points, self.solution.accelerations[:, 0].tolist(), self.rounding.tolist(), strict=True)
        return tuple(contact for contact, rate, rounding in rates if rate > _OPENS * rounding)

    def keep_modes(self) -> None:
        """Make the modes chosen those of the next step."""
        self._modes.set(self.contact_points, self.kinds, self.directions, self._speeds, self._slides)

    @cached_property
    def _in_present_modes(self) -> tuple[Solution, float]:
        """Solution in the modes of the step, and least slip of sliding points along their direction at its start, m/s."""
        slides = (self._kinds == SLIDE) & (self.problem.mu > 0.0)
        directions, forward = slip_directions(self.problem, self._u, self._at_start, slides, self._straight)
        return self._choice.evaluate(np.maximum(self._kinds, 0), directions), forward

    def validity_margin(self) -> float:
        """Margin by which the modes of the step are still valid; negative where they are not."""
        solution, forward = self._in_present_modes
        return min(solution.validity, forward + _REVERSED_M_S)

    @property
    def turning(self) -> BoolArray:
        """Points that slide and whose direction of slip may turn in the step that starts here, (k,)."""
        slides = (self.kinds == SLIDE) & (self.problem.mu > 0.0) & ~self.problem.lines
        return np.asarray(slides & ~self._modes.straight(self.contact_points))

    @property
    def releases(self) -> bool:
        """Whether sticking points are beyond the limit of friction in the modes of the step."""
        solution = self._in_present_modes[0]
        return solution.releases and not solution.valid


def slip_directions(
    problem: FrictionProblem, slips: FloatArray, at_start: FloatArray, slides: BoolArray, straight: BoolArray
) -> tuple[FloatArray, float]:
    """Directions of slip within a step: along the slip, with the sense that it had at the start of the step.

    A stage beyond the time at which a point stops then keeps the sense of its friction, and the slip along the direction at
    the start passes through zero smoothly.

    Args:
        problem: The contact problem, which knows the points that can slip along a line only.
        slips: Slip velocities along (t1, t2), m/s, (k, 2).
        at_start: Directions at the start of the step, (k, 2).
        slides: Points that slide, (k,).
        straight: Points that keep the direction, (k,).

    Returns:
        Unit directions, (k, 2), and the least slip along the direction at the start, m/s.
    """
    directions = np.zeros_like(slips)
    if not slides.any():
        return directions, np.inf
    forward = np.sum(slips * at_start, axis=1)
    unit = unit_slips(slips) * np.where(forward < 0.0, -1.0, 1.0)[:, None]
    unit = np.where((straight | ~np.any(unit != 0.0, axis=1))[:, None], at_start, unit)
    if problem.lines.any():
        axes = problem.line_directions()
        forth = axes * np.where(np.sum(axes * at_start, axis=1) < 0.0, -1.0, 1.0)[:, None]
        unit = np.where(problem.lines[:, None], forth, unit)
    directions[slides] = unit[slides]
    return directions, float(forward[slides].min())
