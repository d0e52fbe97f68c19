"""Choice of the friction modes of all closed contact points at one state.

Several motions may solve the same problem of accelerations, so the choice follows a rule: modes that are still valid are
kept; otherwise all points without slip stick if forces inside their cones exist that hold them; otherwise Coulomb's
conditions are solved by Newton's method, with a small compliance that shares forces among redundant points. Where no point
has friction the problem is convex and is solved as such: the accelerations are unique, and the forces are of least norm.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ffsm_mj.arrays import BoolArray, FloatArray, IntArray
from ffsm_mj.cached_property import cached_property
from ffsm_mj.contact_models.impact.friction.coulomb import coulomb_forces, lemke
from ffsm_mj.contact_models.impact.laws import least_norm, project
from ffsm_mj.contact_models.persistent.friction.cones import ON_CONE, cone_depth, cone_margin
from ffsm_mj.contact_models.persistent.friction.internal_forces import internal_forces
from ffsm_mj.contact_models.persistent.friction.modes import CLOSED, SLIDE, STICK, unit_slips
from ffsm_mj.contact_models.persistent.friction.problem import FrictionProblem, Solution, StageEquation
from ffsm_mj.tolerances import RANK, SOLVED

_SLIPS, _SATURATED = 1e-7, 1e-6
"""A tangential acceleration above the first share of the largest one is slip; at the event from stick to slip, so is a
friction force within the second of its limit: the acceleration is zero there."""
_CORRECTIONS = 3
"""Corrections of modes per contact point before the choice fails."""
OPENS = 10.0
"""A gap opens where its second rate exceeds its rounding by this factor."""
_BEGINS, _GOES_ON = 1.0, 2.0
"""A point at rest sticks where friction at its limit would leave it an acceleration within its rounding times the first
number, and one that sticks already goes on to do so up to the second. Below, neither that it slips nor where to is known.
The two differ lest rounding of the excess, as by the way through a log, decides on the mode of each step anew."""


class NoModesError(Exception):
    """No modes satisfy Coulomb's conditions (Painleve's paradox), or none were found."""


class PointStates(NamedTuple):
    """What the choice of modes depends on besides the problem; k points.

    Attributes:
        slips: Slip velocities along (t1, t2), m/s, (k, 2).
        slipping: Points whose slip is not zero, (k,).
        kinds: Present modes, (k,); -1 for a point without one.
        directions: Present directions of slip, (k, 2).
        rounding: Rounding of the accelerations of each point, m/s^2, (k,).
        released: Whether sticking points have just reached the limit of friction: those at their limit slide.
    """

    slips: FloatArray
    slipping: BoolArray
    kinds: IntArray
    directions: FloatArray
    rounding: FloatArray
    released: bool

    @property
    def fit(self) -> bool:
        """Whether the present modes fit the slips: every point has a mode, and none that sticks slips."""
        known = min(self.kinds.tolist()) >= 0
        return known and not (self.slipping.any() and bool((self.slipping & (self.kinds == STICK)).any()))


class ModeChoice:
    """Evaluates and chooses modes for one problem."""

    def __init__(self, problem: FrictionProblem, states: PointStates) -> None:
        """Bind to a problem and the states of its points."""
        self._problem, self._states = problem, states
        self._still = ~states.slipping
        self._evaluated: dict[tuple[bytes, bytes], Solution] = {}

    @cached_property
    def _scale(self) -> float:
        """Largest acceleration without contact forces, m/s^2."""
        return float(np.sqrt(np.square(self._problem.b.reshape(-1, 3)).sum(axis=1).max(initial=0.0)))

    def choose(self) -> Solution:
        """Choose the modes.

        Raises:
            NoModesError: No modes are valid.
        """
        states = self._states
        if not states.released:
            # Several sets of modes may solve the problem: those that still hold are kept, as others would jump without a
            # cause.
            if states.fit:
                kept = self.evaluate(states.kinds, self._directions(states.kinds))
                if kept.valid:
                    return kept
            # At rest friction may have any size and direction inside its cone: what such forces can hold sticks.
            kinds = np.where(states.slipping | (self._problem.mu == 0.0), SLIDE, STICK)
            closed = self.evaluate(self._movable(kinds), self._directions(kinds))
            if closed.valid:
                return self._without_idle(closed)
            # A point that slides may be the one that does not press: the others then hold without it.
            opened = np.where(states.slipping, CLOSED, kinds)
            if (
                np.any(opened != kinds)
                and (solution := self.evaluate(self._movable(opened), self._directions(opened))).valid
            ):
                return self._without_idle(solution)
        return self._solved()

    @property
    def locked(self) -> IntArray:
        """Points whose gap closes by curvature although no force along the normal can change its rate, ascending.

        So where latches hold bodies by an axis through the contact point: they would roll over each other, in place.
        """
        problem = self._problem
        # A second rate within its rounding closes no gap: rounding alone would end runs of such mechanisms.
        closes = problem.b[::3] < -OPENS * self._states.rounding
        return np.flatnonzero(closes & ~problem.movable_normals)

    def _movable(self, kinds: IntArray) -> IntArray:
        """Modes with points that no normal force can move closed."""
        # With G_nn = 0 the force at a point does not follow from its acceleration; the linear problem would divide by
        # rounding.
        return np.where(self._problem.movable_normals, kinds, CLOSED)

    def _without_idle(self, solution: Solution) -> Solution:
        """The solution with points closed that carry no force, where that leaves all else as it is."""
        # A point without load is closed without force by definition (docs/friction.md). Taken for one that sticks, it would
        # have a record of slip at the first load that moves it, although nothing held it before.
        load = np.abs(solution.forces).max(axis=1) * self._problem.inverse_mass
        idle = (solution.kinds != CLOSED) & (load <= self._states.rounding)
        if not idle.any():
            return solution
        closed = self.evaluate(np.where(idle, CLOSED, solution.kinds), solution.directions)
        return closed if closed.valid else solution

    def _directions(self, kinds: IntArray) -> FloatArray:
        """Directions of slip: along the slip of a point that slides, the present one at a point that begins to."""
        states, mu = self._states, self._problem.mu
        if SLIDE not in kinds.tolist():
            return np.zeros_like(states.directions)
        # At rest u / |u| is 0 / 0: a point that begins to slide has the direction that was chosen where friction released
        # it.
        directions = np.where(states.slipping[:, None], unit_slips(states.slips), states.directions)
        return np.where(((kinds == SLIDE) & (mu > 0.0))[:, None], directions, 0.0)

    def evaluate(self, kinds: IntArray, directions: FloatArray) -> Solution:
        """Forces in given modes, and whether these are valid."""
        key = kinds.tobytes(), directions.tobytes()
        solution = self._evaluated.get(key)
        if solution is None:
            solution = self._evaluated[key] = self._evaluate(kinds, directions)
        return solution

    def _evaluate(self, kinds: IntArray, directions: FloatArray) -> Solution:
        problem, states = self._problem, self._states
        forces = problem.forces(kinds, directions)
        accelerations = (problem.b + problem.G.dot(forces.ravel())).reshape(-1, 3)
        least, to_limit = self._validity(kinds, directions, forces, accelerations), self.stick_margin(kinds, forces)
        # A point at rest in the sliding mode must accelerate along its direction: otherwise friction would drive its slip
        # instead of opposing it. At the event itself this acceleration is zero, hence the tolerance.
        if SLIDE in kinds.tolist() and (begins := (kinds == SLIDE) & self._still & (problem.mu > 0.0)).any():
            along = (
                np.sum(accelerations[:, 1:] * directions, axis=1)[begins] + _SLIPS * self._scale + states.rounding[begins]
            )
            least = min(least, float(along.min()))
        # Two margins: points stick a little beyond the limit, but the event is located at the limit itself. Where a load
        # grows at 0.05 N/s, the end of the excess comes 2e-8 s later (test_limit_of_friction.py).
        validity, exact = min(least, to_limit + self._excess(kinds)), min(least, to_limit)
        return Solution(kinds, directions, forces, accelerations, validity, exact, to_limit < min(0.0, least))

    def _validity(self, kinds: IntArray, directions: FloatArray, forces: FloatArray, accelerations: FloatArray) -> float:
        """Least margin of the conditions on normal forces and gaps, m/s^2."""
        problem, rounding = self._problem, OPENS * self._states.rounding
        present, least = set(kinds.tolist()), np.inf
        if SLIDE in present:
            # With D <= 0 sliding forces may exist beside an open contact, where gap'' > 0 without them: open is taken
            # (test_choice.py).
            if not problem.is_regular(kinds, directions):
                return -1.0 - self._scale  # finite, as localisation interpolates
            # As accelerations, of which the rounding is known; that of a force depends on how light the bodies are.
            least = float((forces[:, 0] * problem.inverse_mass + rounding)[kinds == SLIDE].min())
        if CLOSED in present:
            closed = kinds == CLOSED
            least = min(least, float((accelerations[:, 0] + rounding)[closed].min()))
            # A closed point whose gap the held ones keep at rest would carry a share of the load if it were held as they
            # are: where that share presses, the point belongs to those that carry force.
            shares = self._idle_shares(kinds, forces, accelerations)
            least = min(least, float((rounding - shares).min()))
        return least

    def _idle_shares(self, kinds: IntArray, forces: FloatArray, accelerations: FloatArray) -> FloatArray:
        """Loads that closed points at rest would have if they were held, as accelerations, m/s^2, (k,); others -inf."""
        problem, rounding = self._problem, OPENS * self._states.rounding
        idle = (kinds == CLOSED) & (np.abs(accelerations[:, 0]) <= rounding)
        if not idle.any():
            return np.full(len(kinds), -np.inf)
        return np.where(idle, problem.virtual_shares(kinds, forces) * problem.inverse_mass, -np.inf)

    def _excess(self, kinds: IntArray) -> float:
        """Acceleration beyond the limit of friction up to which points stick, m/s^2."""
        sticks, states = kinds == STICK, self._states
        if not sticks.any():
            return 0.0
        factor = _GOES_ON if (states.kinds[sticks] == STICK).all() else _BEGINS
        return factor * float(states.rounding[sticks].max())

    def stick_margin(self, kinds: IntArray, forces: FloatArray) -> float:
        """Margin of the sticking points to their friction cones, m/s^2: own forces, or others of the same effect."""
        problem, sticks = self._problem, (kinds == STICK).nonzero()[0]
        if not len(sticks):
            return np.inf
        sticking, mu = forces[sticks], problem.mu[sticks]
        inverse_masses: list[float] = problem.inverse_mass[sticks].tolist()
        margin = cone_depth(sticking, mu)
        rounding, inverse_mass = ON_CONE * float(np.abs(forces).max()), sum(inverse_masses) / len(inverse_masses)
        # Forces of redundant points are not unique: they stick if any shares of the same effect lie inside all cones.
        # The cone program costs more than fifty times the check of the points' own cones: only where that fails.
        if margin + rounding < 0.0 and problem.redundant(kinds):
            margin = cone_margin(sticking, internal_forces(problem, sticks), mu)
        # The mean inverse mass: with that of the worst point the margin would jump where another point becomes the worst.
        return (margin + rounding) * inverse_mass

    def _without_friction(self) -> Solution | None:
        """Modes of points none of which has friction: those press that unilateral springs would make press."""
        problem = self._problem
        pushes = pressing_without_friction(problem) * problem.inverse_mass > self._states.rounding
        solution = self.evaluate(np.where(pushes, SLIDE, CLOSED), np.zeros_like(self._states.directions))
        return solution if solution.valid else None

    def _solved(self) -> Solution:
        """Modes from a solution of Coulomb's conditions.

        Raises:
            NoModesError: There is none, or its modes are not valid.
        """
        # Without friction the accelerations are unique: no compliance needs to choose which of redundant points press.
        if not self._problem.mu.any() and (pressing := self._without_friction()) is not None:
            return pressing
        forces, residual = self._newton()
        # Beyond Painleve's paradox Coulomb's conditions may have no solution (Genot & Brogliato, Eur. J. Mech. A 18:653,
        # 1999).
        if residual > SOLVED:
            raise NoModesError
        kinds, directions = self._classified(forces)
        if not self._states.released:
            # The compliance in Newton's method leaves points a slip of rounding: those that can hold do.
            holding = np.where(self._still & (kinds == SLIDE) & (self._problem.mu > 0.0), STICK, kinds)
            if np.any(holding != kinds) and (closed := self.evaluate(holding, self._directions(holding))).valid:
                return closed
        solution = self._corrected(kinds, directions)
        # Lemke's matrix has one column for each normal force: the direction of every friction force must be known already.
        if solution is None and np.all((self._problem.mu == 0.0) | ~self._still):
            solution = self._complementary()
        if solution is None:
            raise NoModesError
        return solution

    def _complementary(self) -> Solution | None:
        """Modes of points that all slide: those that press, by Lemke's method for their normal forces.

        It finds a solution where the one that the compliance leads to is beyond Painleve's paradox, as where both edges on
        which two pads hold a box become lines with normals that are not quite opposite.
        """
        problem, directions = self._problem, self._directions(np.full(len(self._still), SLIDE))
        which = np.flatnonzero(problem.movable_normals)
        # A normal force brings its friction along: the matrix of the normals is not symmetric, which Lemke's method allows.
        along = np.column_stack((np.ones(len(which)), -problem.mu[which, None] * directions[which]))
        rows = problem.G[3 * which].reshape(len(which), -1, 3)[:, which]
        G, unit = np.einsum("ijc,jc->ij", rows, along), float(problem.inverse_mass[which].mean())
        # Scaled to entries of order one: Lemke's method tells pivots from rounding by an absolute bound (_ZERO in
        # coulomb.py).
        pushes = lemke(G / unit, problem.b[3 * which] / self._scale) * self._scale
        kinds = np.full(len(self._still), CLOSED)
        kinds[which[pushes > self._states.rounding[which]]] = SLIDE
        solution = self.evaluate(kinds, np.where((kinds == SLIDE)[:, None], directions, 0.0))
        return solution if solution.valid else None

    def _newton(self) -> tuple[FloatArray, float]:
        """Forces (n, t1, t2) that satisfy Coulomb's conditions with a small compliance, (k, 3), and their residual."""
        problem, states = self._problem, self._states
        which = np.flatnonzero(problem.movable_normals)
        forces = np.zeros((len(states.slipping), 3))
        if not len(which):
            return forces, 0.0
        rows = (3 * which[:, None] + np.arange(3)).ravel()
        # Coulomb's law fixes the direction of friction where a point slides; at rest it is part of the solution.
        slips = np.where(states.slipping[:, None], self._directions(np.full(len(states.slipping), SLIDE)), 0.0)
        G, b, mu = problem.G[np.ix_(rows, rows)], problem.b[rows], problem.mu[which]
        forces[which], residual = coulomb_forces(G, b, mu, slips[which])
        return forces, residual

    def _classified(self, forces: FloatArray) -> tuple[IntArray, FloatArray]:
        """Modes and directions of slip that a solution of Coulomb's conditions shows."""
        problem, states = self._problem, self._states
        accelerations = (problem.b + problem.G @ forces.ravel()).reshape(-1, 3)
        friction, limit = np.hypot(forces[:, 1], forces[:, 2]), problem.mu * forces[:, 0]
        # At the limit sticking and sliding both solve the problem: if the event did not decide, events of zero length would
        # repeat for ever (test_choice.py).
        share = _SATURATED if states.released else SOLVED
        saturated = friction >= limit * (1.0 - share)
        moves = np.hypot(accelerations[:, 1], accelerations[:, 2]) > _SLIPS * self._scale
        sticks = self._still & (problem.mu > 0.0) & ~(saturated & (moves | states.released))
        kinds = np.where(sticks, STICK, SLIDE)
        kinds = np.where(forces[:, 0] * problem.inverse_mass > states.rounding, kinds, CLOSED)
        directions = self._directions(kinds)
        begins = (kinds == SLIDE) & self._still & (problem.mu > 0.0)
        # The slip of a point at rest has no direction yet; friction at its limit is opposed to the one it is going to have.
        directions[begins] = -unit_slips(forces[begins, 1:])
        return kinds, self._along_acceleration(kinds, directions, begins & moves)

    def _along_acceleration(self, kinds: IntArray, directions: FloatArray, begins: BoolArray) -> FloatArray:
        """Directions of slip along the accelerations of points that begin to slide, with the shares of equal springs."""
        free = np.flatnonzero(begins & ~self._problem.lines)
        if not len(free):
            return directions
        # From rest (p = 0) with a weight of one the "slips" of the equation are accelerations.
        solved = StageEquation([self._problem], kinds, free, np.zeros((1, len(free), 2)), np.eye(1)).solve(directions[None])
        # Without such a direction that of the friction stays, which the shares of the compliance gave.
        return directions if solved is None else solved[1][0]

    def _corrected(self, kinds: IntArray, directions: FloatArray) -> Solution | None:
        """The solution in given modes, with modes corrected where they are not valid; None if none are found."""
        problem, states = self._problem, self._states
        for _ in range(_CORRECTIONS * len(kinds)):
            solution = self.evaluate(kinds, directions)
            if solution.valid:
                return solution
            kinds, directions = kinds.copy(), directions.copy()
            # As in an active-set method: a point that pulls opens, one that overlaps presses, one beyond its cone slides,
            # and one that would slide against its friction sticks.
            pulls = (kinds != CLOSED) & (solution.forces[:, 0] * problem.inverse_mass < -OPENS * states.rounding)
            overlaps = (kinds == CLOSED) & (solution.accelerations[:, 0] < -OPENS * states.rounding)
            slides = np.flatnonzero(kinds == SLIDE)
            regular = problem.is_regular(kinds, directions)
            if regular:  # else what presses as a share would pull
                # The compliance says up to 1e-8 of the load which redundant points press: one at the edge may be missing.
                overlaps |= self._idle_shares(kinds, solution.forces, solution.accelerations) > OPENS * states.rounding
            friction = np.hypot(solution.forces[:, 1], solution.forces[:, 2])
            over = (kinds == STICK) & ~pulls & (friction > problem.mu * solution.forces[:, 0])
            back = (kinds == SLIDE) & self._still & (problem.mu > 0.0) & ~pulls
            back &= np.sum(solution.accelerations[:, 1:] * directions, axis=1) < -_SLIPS * self._scale
            if not np.any(pulls | overlaps | over | back):
                if len(slides) <= 1 or regular:
                    return None  # no change at a single point would mend the modes, as beyond Painleve's paradox
                # Beyond that paradox of several points together, a body may tip over some of them: the least loaded opens.
                pulls[slides[np.argmin(solution.forces[slides, 0])]] = True
            kinds[pulls], kinds[overlaps & problem.movable_normals] = CLOSED, STICK
            # A point with a slip cannot stick; without friction the sliding mode is the one that presses.
            kinds[overlaps & (states.slipping | (problem.mu == 0.0)) & problem.movable_normals] = SLIDE
            kinds[over], kinds[back] = SLIDE, STICK
            # Friction that reaches its limit opposes the slip that begins; the acceleration is zero there, and its direction
            # rounding.
            directions[over] = -unit_slips(solution.forces[over, 1:])
            moving = states.slipping & (kinds == SLIDE)
            directions[moving] = self._directions(kinds)[moving]
            directions[kinds != SLIDE] = 0.0
        return None


def pressing_without_friction(problem: FrictionProblem, count: int | None = None) -> FloatArray:
    """Normal forces that keep all gaps closed or let them open if no point has friction, N, (k,): those of least norm.

    Those of the first ``count`` points alone, if it is given.

    The linear complementarity problem 0 <= lambda _|_ gap'' >= 0 (Featherstone, *Rigid Body Dynamics Algorithms*, ch. 11)
    has the form of a plastic impact, with A A^T = G and A w = gap'' without forces.
    """
    which, forces = np.flatnonzero(problem.movable_normals[:count]), np.zeros(len(problem.mu))
    if len(which):
        sizes, U = np.linalg.eigh(problem.G[np.ix_(3 * which, 3 * which)])
        # Rows of redundant points are dependent; divided by an eigenvalue of rounding their forces would have any size.
        positive = sizes > RANK * sizes[-1]
        A = U[:, positive] * np.sqrt(sizes[positive])
        forces[which] = least_norm(A, project(A, problem.b[3 * which] @ U[:, positive] / np.sqrt(sizes[positive])))
    return forces
