"""Decision at one state under given efforts: which contact points carry force, their friction modes, and their forces."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ffsm_mj.arrays import BoolArray, FloatArray, IntArray
from ffsm_mj.cached_property import cached_property
from ffsm_mj.contact_models.persistent.contact_points import ContactPoint
from ffsm_mj.contact_models.persistent.friction.choice import OPENS, ModeChoice, NoModesError, PointStates
from ffsm_mj.contact_models.persistent.friction.internal_forces import shares_in_cones
from ffsm_mj.contact_models.persistent.friction.modes import (
    CLOSED,
    SLIDE,
    STICK,
    FrictionModes,
    Layers,
    slipping_points,
    unit_slips,
)
from ffsm_mj.contact_models.persistent.friction.pair_friction import FrictionOfPairs
from ffsm_mj.contact_models.persistent.friction.problem import FrictionProblem, Solution, slip_directions
from ffsm_mj.records.events import Outcome, RunEnded

if TYPE_CHECKING:
    from ffsm_mj._core.contacts import ContactEvaluation

STIFF = 0.1
"""Settled points make a step implicit where its duration times their rate exceeds this. RK4 is stable up to 2.8, but beyond
this it errs by 1e-9 m/s just after a start of slip, when the step is as long as the time since then."""
DEVIATION_M_S = 1e-12
"""A smaller deviation is rounding."""
_ERROR_M_S, _LEAST, _MOST = 24e-12, 0.05, 1.0
"""Unsettled points make steps no longer than (first / deviation)^(1/5) over their rate, a number within the other two.

A step of RK4 turns the deviation with an error of (h rate)^5 / 120: of 2e-13 m/s, in a layer of several steps the rounding
of slips."""
NEAR_STOP = 6.0
"""A step is divided where a point would stop within this many durations of the step."""
_STOP_SHARE = 0.5
"""Such a step takes at most this share of the time to the stop."""

_REACHED = OPENS - 1.0
"""A limit at which a gap is known to open is reached to one rounding of its second rate."""
_REVERSED_M_S = 1e-13
"""A slip against its direction by more than this is a reversal, not rounding."""


class Decision:
    """Contact forces and modes at one state.

    Each value is computed when it is first asked for, from the rows and forces of the state at the construction, wherever
    ``data`` is by then. It counts while :meth:`is_for` says so: until the points, their modes or what has happened to them
    change.

    Attributes:
        evaluation: All closed contact points at the state.
        contact_points: The points.
        rows: Their states and rows.
    """

    def __init__(self, evaluation: ContactEvaluation, modes: FrictionModes) -> None:
        """Store the points.

        Args:
            evaluation: All closed contact points at the state.
            modes: Present modes.
        """
        self.evaluation, self.contact_points, self.rows = evaluation, evaluation.contact_points, evaluation.rows
        self._modes, self._released, self._struck, self._stops = modes, modes.released, modes.struck, modes.stops

    def is_for(self, contact_points: tuple[ContactPoint, ...], modes: FrictionModes) -> bool:
        """Whether the decision is that of some points in some modes, after the same events; it may differ at one state."""
        if self.contact_points != contact_points or self.evaluation.modes is not modes.of(contact_points):
            return False
        return (self._released, self._struck, self._stops) == (modes.released, modes.struck, modes.stops)

    @property
    def problem(self) -> FrictionProblem:
        """The problem of the accelerations of the points."""
        return self.evaluation.problem

    @property
    def rounding(self) -> FloatArray:
        """Rounding of the accelerations of each point, m/s^2, (k,)."""
        return self.evaluation.rounding

    @cached_property
    def _settled(self) -> Solution | None:
        """The solution if all points stick, and go on to do so without redistributing their forces."""
        # At the limit of friction both modes solve the problem, and an impact leaves slips: forces inside the cones do not
        # tell the modes there (test_steady.py).
        return None if self._released or self._struck else self.evaluation.settled()

    @cached_property
    def _choice(self) -> ModeChoice:
        modes, slips = self.evaluation.modes, self.rows.slips
        # Near the stop the direction of the slip is rounding (_STRAIGHT in modes.py): only its size along the kept one
        # counts.
        if modes.any_straight:
            slips = np.where(modes.straight[:, None], self._speeds[:, None] * self._at_start, slips)
        states = PointStates(slips, self.slipping, modes.kinds, self._at_start, self.rounding, self._released)
        return ModeChoice(self.problem, states)

    @cached_property
    def _at_start(self) -> FloatArray:
        """Directions of slip at the start of the step along (t1, t2), (k, 2)."""
        return self.evaluation.modes.start_directions(self.rows.axes)

    @cached_property
    def _speeds(self) -> FloatArray:
        """Slip speeds, along the kept direction for points that go straight on to their stop, m/s, (k,)."""
        u, modes = self.rows.slips, self.evaluation.modes
        speeds: FloatArray = np.hypot(u[:, 0], u[:, 1])
        if not modes.any_straight:
            return speeds
        # Past its stop a point would slip backwards along the kept direction: it counts as stopped.
        return np.where(modes.straight, np.maximum(np.sum(u * self._at_start, axis=1), 0.0), speeds)

    @cached_property
    def slipping(self) -> BoolArray:
        """Points whose slip is not zero, (k,)."""
        modes = self.evaluation.modes
        # The answer of slipping_points() where all points stick and none exceeds the least bound on their drift.
        if not self._struck and max(self._speeds.tolist()) <= modes.drift_m_s:
            return modes.nowhere
        slipping = slipping_points(
            self._speeds,
            modes.sliding,
            modes.stop_speeds,
            self.rows.speed_rounding,
            modes.straight,
            modes.drifts,
            struck=self._struck,
            stops=self._stops,
            pairs=[points for _, points in modes.pairs],
        )
        return slipping & (modes.mu > 0.0)

    @cached_property
    def solution(self) -> Solution:
        """Modes chosen, and forces in them.

        Raises:
            RunEnded: No modes satisfy Coulomb's conditions, or none were found.
        """
        if self._settled is not None:
            return self._settled
        try:
            return self._choice.choose()
        except NoModesError:
            # A contact that latches roll in place has no solution either, but at no coefficient of friction: it is no
            # paradox (test_painleve.py).
            raise RunEnded(Outcome.UNSUPPORTED_CONTACT, self._locked() or self._without_modes()) from None

    def _locked(self) -> str:
        """Which point closes although nothing moves it along its normal; empty if none does."""
        if not len(locked := self._choice.locked):
            return ""
        which = int(locked[np.argmin(self.problem.b[3 * locked])])
        name, falls = self.contact_points[which].pair, self.problem.b[3 * which]
        why = "and no force along its normal moves it: latches hold it there"
        return f"locked: {name} closes, gap'' = {falls:.3g} m/s^2, {why}"

    def _without_modes(self) -> str:
        names = "; ".join(dict.fromkeys(str(contact.pair) for contact in self.contact_points))
        return f"painleve: no friction modes satisfy Coulomb's conditions ({names}){self._worst_slide()}"

    def _worst_slide(self) -> str:
        """What pushes the sliding point apart whose own normal force does so least; empty where none slides."""
        points = np.flatnonzero(self.slipping)
        if not len(points):
            return ""
        columns = self.problem.G.reshape(len(self.rows.axes), 3, -1, 3)[points, :, points][:, 0]
        apart = columns[:, 0] - self.evaluation.modes.mu[points] * np.sum(
            columns[:, 1:] * unit_slips(self.rows.slips[points]), axis=1
        )
        # Of its own force alone: several sliding points may have no solution together, although each has D > 0.
        least = int(np.argmin(apart))
        name, falls = self.contact_points[points[least]].pair, self.problem.b[3 * points[least]]
        return f"; sliding point of {name}: G_nn - mu G_nt = {apart[least]:.3g} 1/kg, gap'' without forces {falls:.3g} m/s^2"

    @property
    def kinds(self) -> IntArray:
        """Modes, (k,)."""
        return self.solution.kinds

    @cached_property
    def _shared(self) -> FloatArray:
        """Forces (n, t1, t2) of all points, those of sticking points inside their cones, N, (k, 3)."""
        if self._settled is not None:
            # Settled points are inside their own cones: no other share is needed.
            return self._settled.forces
        return shares_in_cones(self.problem, self.solution.forces, (self.kinds == STICK).nonzero()[0])

    @cached_property
    def forces(self) -> FloatArray:
        """Normal forces, N, (k,)."""
        # A valid normal force may pull by its rounding: logged forces do not.
        return np.maximum(self._shared[:, 0], 0.0)

    @cached_property
    def friction(self) -> FloatArray:
        """Friction force on geom b of each point, world axes, N, (k, 3)."""
        return self.rows.across(self._shared[:, 1:])

    @cached_property
    def of_pairs(self) -> FrictionOfPairs:
        """Friction of the pairs with mu > 0 that carry force."""
        return FrictionOfPairs(self.evaluation, self.solution, self.friction, self._modes.estimates)

    @property
    def pressing(self) -> list[int]:
        """Indices of the contact points that carry force: the active set."""
        return [i for i, kind in enumerate(self.kinds.tolist()) if kind != CLOSED]

    @cached_property
    def directions(self) -> FloatArray:
        """Directions of slip, world axes, (k, 3); zero for points that do not slide."""
        return self.rows.across(self.solution.directions)

    def leaving(self, *, reached: bool = False) -> tuple[ContactPoint, ...]:
        """Contact points whose gap opens, in the order of ``contact_points``.

        Args:
            reached: Whether points are known to open at this state: they are at the limit even if rounding puts them inside.
        """
        if self.is_settled:
            return ()
        opening = self.solution.accelerations[:, 0]
        if reached:  # up to the limit a point may pull, and counts as pressing: without its force it would open
            opening = np.maximum(opening, -self.solution.forces[:, 0] * self.problem.inverse_mass)
        # Within rounding a gap stays closed; otherwise contacts would end and begin again at every decision.
        limits = (_REACHED if reached else OPENS) * self.rounding
        rates = zip(self.contact_points, opening.tolist(), limits.tolist(), strict=True)
        return tuple([contact for contact, rate, limit in rates if rate > limit])

    def keep_modes(self) -> None:
        """Make the modes chosen those of the next step."""
        if not self._modes.keep_still(self.contact_points, self.kinds):
            pinned = self.problem.pinned(self.kinds)
            self._modes.set(self.contact_points, self.kinds, self.directions, self._speeds, self.slipping, pinned)

    @cached_property
    def _in_present_modes(self) -> tuple[Solution, float]:
        """Solution in the modes of the step, and least slip of sliding points along their direction at its start, m/s."""
        modes = self.evaluation.modes
        if self._settled is not None:
            return self._settled, np.inf
        # A point without a mode (UNKNOWN) is a new one, which carries no force in the modes of this step.
        if not modes.any_sliding:
            return self._choice.evaluate(np.maximum(modes.kinds, 0), modes.no_slips), np.inf
        directions, forward = slip_directions(self.problem, self.rows.slips, self._at_start, modes.sliding, modes.straight)
        return self._choice.evaluate(np.maximum(modes.kinds, 0), directions), forward

    def validity_margin(self, *, exact: bool = False) -> float:
        """Margin by which the modes of the step are still valid; negative where they are not, or where a point opens.

        Args:
            exact: Whether sticking points are valid up to the limit of friction only, at which they are released.
        """
        solution, forward = self._in_present_modes
        valid = min(solution.exact if exact else solution.validity, forward + _REVERSED_M_S)
        if self.is_settled or not (closed := solution.kinds == CLOSED).any():
            return valid
        # Points that open at the start of a step have been removed: those without force stay in touch within it.
        return min(valid, float((OPENS * self.rounding - solution.accelerations[:, 0])[closed].min()))

    @property
    def is_settled(self) -> bool:
        """Whether all points stick, and go on to do so without redistributing their forces: all carry force."""
        return self._settled is not None

    @property
    def turning(self) -> BoolArray:
        """Points that slide and whose direction of slip may turn in the step that starts here, (k,)."""
        sliding = (self.kinds == SLIDE) & (self.problem.mu > 0.0)
        if not sliding.any():
            return np.asarray(sliding)
        # On a line, or straight on to its stop, a slip has one direction: friction is smooth and explicit stages are stable.
        return np.asarray(sliding & ~self.problem.lines & ~self._modes.of(self.contact_points).straight)

    @property
    def changes_modes(self) -> bool:
        """Whether velocities or modes are others than in the step before."""
        return self._struck or self.evaluation.modes.kinds.tolist() != self.kinds.tolist()

    @property
    def in_present_modes(self) -> Solution:
        """Solution in the modes of the step."""
        return self._in_present_modes[0]

    def changed_by(self, forces: FloatArray) -> Decision:
        """The same modes with the forces changed by (n, t1, t2), N, (k, 3)."""
        other = Decision(self.evaluation, self._modes)
        # Forces of a settled decision are read from its settled solution, which would hide the change.
        other._settled, other.solution = None, self.solution._replace(forces=self.solution.forces + forces)
        return other

    @property
    def restarts(self) -> BoolArray:
        """Points that slide on in another direction: they stop, or their slip has turned by a right angle in the step, (k,).

        A step ends where the slip along its direction at the start is -_REVERSED_M_S. A log replay knows it to some 1e-14
        m/s, and finds it below zero, too.
        """
        modes = self.evaluation.modes
        turned = np.sum(self.rows.slips * self._at_start, axis=1) < 0.0
        return np.asarray(modes.sliding & (turned | ~self.slipping) & (self.kinds == SLIDE))

    @property
    def releases(self) -> bool:
        """Whether sticking points are beyond the limit of friction in the modes of the step."""
        return self._in_present_modes[0].releases


class StepRule(NamedTuple):
    """What limits a (sub-)step.

    Attributes:
        limit_s: Its longest duration, s.
        implicit: Whether its stages must be implicit.
        layers: Layers of the points that slide; None without any.
    """

    limit_s: float
    implicit: bool = False
    layers: Layers | None = None


def step_rule(decision: Decision, last: Layers | None, left_s: float, time_s: float, efforts: bytes) -> StepRule:
    """What limits a (sub-)step for the points that slide in two directions.

    Friction turns the slip u at the rate (k + |f|) / |u|, with k = mu N times the inverse mass and the slip acceleration f.
    A slip in a wrong direction, as rounding, an impact or a jump of the efforts leaves it, is thus turned within a layer of
    some |u| / k, within which steps must follow it. The component across the direction to which it turns, the deviation,
    falls with exp(-integral of k / |u| dt). Behind the layer, where none is left, the slip is as smooth as the forces, and
    only explicit stages would have to follow the rate.

    Its compiled twin for explicit steps of points that slide on is ``allows_step`` in ``_core/slip_layers.pyx``.

    Args:
        decision: Choice of modes at the start of the step.
        last: Layers at the start of the step before.
        left_s: Remaining time of the grid step, s.
        time_s: Time at the start of the step.
        efforts: Efforts in it, bit by bit.
    """
    # Only a slip that can turn is stiff: along a line friction is a constant times the normal force.
    if decision.is_settled or not (turns := decision.turning).any():
        return StepRule(left_s)
    problem, solution = decision.problem, decision.solution
    u, d = decision.rows.slips[turns], solution.directions[turns]
    f = solution.accelerations[turns, 1:]
    k = (problem.mu * np.maximum(solution.forces[:, 0], 0.0) * problem.tangent_inverse_mass)[turns]
    # A point that begins to slide has the direction to which friction turns it, and a slip of rounding.
    r = np.where(decision.slipping[turns], np.hypot(u[:, 0], u[:, 1]), 0.0)
    along, across = np.sum(d * f, axis=1), np.abs(d[:, 0] * f[:, 1] - d[:, 1] * f[:, 0])
    # Without load and slip acceleration nothing turns the slip: no deviation, and not 0 / 0.
    stiffness = np.maximum(k + np.abs(along), np.finfo(float).tiny)
    deviations = r * np.minimum(1.0, across / stiffness)
    points = tuple([point for point, may_turn in zip(decision.contact_points, turns.tolist(), strict=True) if may_turn])
    first, damping = deviations, np.zeros(len(points))
    # An impact, a change of modes or a jump of the efforts turns the direction to which friction leads: a new layer begins
    # (docs/derivations.md).
    if last is not None and last.points == points and last.efforts == efforts and not decision.changes_modes:
        # The layer goes on.
        # The larger slip of both ends gives the least damping: a layer is not taken as over too early.
        slips = np.maximum(np.maximum(r, last.speeds), np.finfo(float).tiny)
        first, damping = last.deviations, last.damping + last.strengths * (time_s - last.time_s) / slips
    layers = Layers(points, efforts, time_s, first, damping, r, k)
    # A direction that changes on and on stays behind: only what is left of the deviation at the start falls at the rate.
    left = np.minimum(deviations, first * np.exp(-damping))
    settled = left <= DEVIATION_M_S
    turning, limit = k + np.hypot(f[:, 0], f[:, 1]), left_s
    for speed, rate, deviation, brake, rests in zip(
        r.tolist(), turning.tolist(), left.tolist(), (-along).tolist(), settled.tolist(), strict=True
    ):
        # Inside a layer the turn is part of the motion: whole steps over it left a ball of 1e-8 m/s wrong by 1.4e-5 m/s.
        if not rests:
            # The error of RK4 is of fifth order in the step: its root bounds the share of the layer that a step may take.
            share = min(max((_ERROR_M_S / deviation) ** 0.2, _LEAST), _MOST)
            limit = min(limit, share * speed / rate)
        # Inner stages of RK4 are of low order, which 1 / |u| magnifies towards a stop: whole steps put that of a sphere
        # 1.4e-5 s late. Below a slip of rounding nothing is left to follow.
        if brake > 0.0 and DEVIATION_M_S < speed < NEAR_STOP * left_s * brake:
            limit = min(limit, _STOP_SHARE * speed / brake)
    # By the limit just determined: a step that another point's layer shortens may be explicit for those that have settled.
    return StepRule(limit, bool(np.any(settled & (limit * turning > STIFF * r))), layers)
