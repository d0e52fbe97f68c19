"""Shortcut through steady states: all contact points carry force and none slides, as in the state before."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact_models.persistent.exchange import Shares, StageSums, TwistStage, robot_dofs
from ffsm_mj.contact_models.persistent.holds.held_state import HeldState
from ffsm_mj.contact_models.persistent.steady_columns import RuleColumns, RuleTables
from ffsm_mj.dynamics.forced_stepper import WEIGHTS
from ffsm_mj.model.system import System
from ffsm_mj.tolerances import (
    DRIFT_M,
    DRIFT_M_S,
    FEATURE_BOUND_M,
    PROJECTED_GAP_M,
    PROJECTED_RATE_M_S,
    PROJECTED_SLIP_M_S,
)

if TYPE_CHECKING:
    from ffsm_mj.contact_models.persistent.active_set import ActiveContactSet

_STEP = slice(-1 - len(WEIGHTS), -1)
"""Stages of an explicit step; the last one of all is at its end."""


class SteadyContacts:
    """Closed contacts of which all points carry force and none slides, as most of the time.

    A state that is recognised as steady says all that follows from it: no contact begins, ends or changes, and the forces
    are those that hold all points. Any other state is left to the choice of the active set and of the modes, which gives the
    same results; so is one in which a margin is within rounding.

    Attributes:
        lowest: Smallest gap in the state that was found steady last, m.
    """

    lowest = 0.0

    def __init__(self, closed: ActiveContactSet, system: System) -> None:
        """Store the closed contacts of a system."""
        self._closed, self._system = closed, system
        self._tables: RuleTables
        self._taken: tuple[object, object, int] | None = None
        self._held: HeldState | None = None
        self._state: tuple[object, object] | None = None
        self._is_steady = False

    def report_to(self, tables: RuleTables) -> None:
        """Set the tables of :meth:`write` and :meth:`exchange`."""
        self._tables = tables

    def _may_be(self) -> bool:
        """Whether the closed contacts may be steady; takes them over if they have changed."""
        closed, taken = self._closed, self._taken
        now = closed.contact_points, closed.pressing, closed.modes.generation
        if taken is None or taken[0] is not now[0] or taken[1] is not now[1] or taken[2] != now[2]:
            self._taken, self._state, self._held = now, None, None
            if closed.may_be_steady:
                self._take()
        return self._held is not None

    def _take(self) -> None:
        closed, solver, motion = self._closed, self._closed.solver, self._closed.motion
        points, friction = closed.contact_points, closed.has_friction
        self._modes = closed.modes.of(points) if friction else None
        if self._modes is not None and not self._modes.all_stick:
            return
        self._held = HeldState.of(motion, closed.data, points, self._modes)
        self._inside = solver.stage_forces(points, friction=friction)
        self._shares, self._robot = Shares.of(self._system, points, motion.grasped_bodies), robot_dofs(self._system, motion)
        by_pair = {pair: own for pair, own in closed.by_pair.items() if isinstance(pair, ContactPair)}
        self._columns = RuleColumns(by_pair, self._tables)

    def _known(self) -> HeldState | None:
        """The state in ``data`` under its efforts, if it is steady."""
        closed, modes = self._closed, self._closed.modes
        held = self._held if self._may_be() else None
        if held is None:
            return None
        if closed.has_friction and (modes.released or modes.struck or modes.stops or modes.beginning):
            return None
        solver = closed.solver
        state = solver.smooth.state(solver.other_forces)
        if state is not self._state:
            self._is_steady = self._evaluate(held, None if self._state is None else self._state[0], state[0])
            self._state = state
            if self._is_steady:
                self.lowest = held.extremes.lowest
        return held if self._is_steady else None

    def _evaluate(self, held: HeldState, last: object, place: object) -> bool:
        closed, solver = self._closed, self._closed.solver
        if place is not last:
            held.move()
            if last is None and self._modes is not None:
                self._inside.begin(held.points)
        inside, gap, rate, _ = held.extremes
        if inside < -FEATURE_BOUND_M or gap > DRIFT_M or rate > DRIFT_M_S:
            return False
        if not held.carries(solver.smooth.force(solver.other_forces)):
            return False
        if self._modes is not None and held.largest_speed > self._modes.drift_m_s:
            return False
        return closed.clearance.least(place, gap, closed.gaps_of) >= 0.0

    def is_now(self) -> bool:
        """Whether the state in ``data`` under its efforts is steady: nothing changes, and no gap has drifted too far."""
        return self._known() is not None

    def goes_on(self) -> bool:
        """Begin a step with the contacts and modes of the step before, if the state is steady; returns whether it is.

        False where drift must be projected out.
        """
        held, closed = self._known(), self._closed
        if held is None or held.extremes.gap > PROJECTED_GAP_M or held.extremes.rate > PROJECTED_RATE_M_S:
            return False
        if self._modes is not None and (
            held.largest_speed > PROJECTED_SLIP_M_S or not closed.modes.keep_still(closed.contact_points, self._modes.kinds)
        ):
            return False
        closed.begin_steady_step()
        return True

    def write(self) -> bool:
        """Write the columns of all contact rules, if the state is steady; returns whether it is."""
        held = self._known()
        if held is not None:
            self._columns.write(held.loads())
        return held is not None

    def push(self, data: Any) -> None:
        """Add the contact forces to ``data.qfrc_applied``, which holds all other applied forces."""
        closed, flight, applied = self._closed, self._closed.motion.forced, data.qfrc_applied
        if flight is not None and flight.inside and self._held is not None:  # of the start of the step
            closed.stages.append(self._inside.add(applied))
            return
        if flight is None or flight.inside or flight.implicit:
            closed.push(data)
            return
        closed.solver.other_forces = applied.copy()
        held = self._known()
        if held is None:
            closed.push(data)
            return
        stage, generalised = held.stage()
        applied += generalised
        closed.stages.append(stage)

    def exchange(self, duration_s: float) -> Exchange | None:
        """Energy and momentum exchanged in a (sub-)step, if the state at its end is steady; adds impulses and work."""
        stages = self._closed.stages[_STEP]
        if self._known() is None or len(stages) < len(WEIGHTS) or not all(isinstance(each, TwistStage) for each in stages):
            return None
        sums = StageSums(stages, duration_s * WEIGHTS)
        self._columns.add_impulses(sums.sizes)
        if self._modes is not None:
            self._tables.work_J[0] += sums.total
        return sums.exchange(*self._shares.of_groups, self._robot)
