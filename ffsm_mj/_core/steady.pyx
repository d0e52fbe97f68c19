# cython: boundscheck=False, wraparound=False, cdivision=True
"""Shortcut through steady states, and their log columns: all contact points carry force, and all stick or all slide.

Points without friction press in either case. Or none carries force: bodies float side by side, as after a plastic impact. States are evaluated by the contact problem that the choice of modes finds
where a state is not steady.
"""

import numpy as np

from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.contact_models.persistent.clearance import LEVEL_M
from ffsm_mj.contact_models.persistent.exchange import robot_dofs, Shares
from ffsm_mj.contact_models.persistent.rule_columns import IMPULSE, NOTHING, RuleMode
from ffsm_mj.tolerances import DRIFT_M, DRIFT_M_S, FEATURE_BOUND_M, PROJECTED_GAP_M, PROJECTED_RATE_M_S, PROJECTED_SLIP_M_S

from cpython.bytes cimport PyBytes_FromStringAndSize
from libc.math cimport NAN, sqrt
from libc.string cimport memcpy, memset

from ffsm_mj._core.contacts cimport largest_ratio, state_under
from ffsm_mj._core.forces cimport patches_of
from ffsm_mj._core.memory cimport numbers, room
from ffsm_mj._core.rows cimport find_extremes, sum_up
from ffsm_mj._core.slip_layers cimport allows_step
from ffsm_mj._core.stages cimport StageInMemory
from ffsm_mj._core.stages import dip
from ffsm_mj._core.tick cimport SteadyForces


cdef double _CLOSED = RuleMode.CLOSED, _PRESSING = RuleMode.PRESSING, _STICKING = RuleMode.STICKING, _SLIDING = RuleMode.SLIDING
cdef const double[::1] _NOTHING = NOTHING
cdef Py_ssize_t COLUMNS = IMPULSE
cdef enum:
    MODE = 0  # columns of a rule
    PAIRS = 1
    POINTS = 2
    SIZE = 3
    FORCE = 4
    CENTRE = 7
    USE = 4  # of those of friction
    SPEED = 5
    OF_FRICTION = 6
    SLIP = 6
    HEAT = 7
    START = 0  # of a pair: first of its points, end; rows of its rule, with friction or -1; first group of points, end
    STOP = 1
    ROW = 2
    FRICTION_ROW = 3
    GROUP = 4
    LAST_GROUP = 5


cdef inline double norm(const double* v) noexcept nogil:
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


cdef class RuleColumns:
    """Columns of the rules of pairs all of whose points carry force, and all stick or all slide, or none of them does."""

    def __init__(self, by_pair, shares, tables):
        """Find the points, groups of points and rows of each pair."""
        cdef Py_ssize_t at = 0, i
        groups = {pair: places for pair, places, _ in shares.pairs}
        self.values, rows, self.friction_values, friction_rows, self.work_J = tables
        self.parts = np.empty((len(by_pair), 6), dtype=np.intp)
        for i, (pair, memory) in enumerate(by_pair.items()):
            self.parts[i, START], at = at, at + <Py_ssize_t>len(memory)
            self.parts[i, STOP], self.parts[i, ROW] = at, rows[pair.rule]
            self.parts[i, FRICTION_ROW] = friction_rows[pair.rule] if pair.mu > 0.0 else -1
            self.parts[i, GROUP], self.parts[i, LAST_GROUP] = min(groups[pair]), max(groups[pair]) + 1

    cdef int write(
        self,
        list groups,
        const double* axes,
        const double* normal_forces,
        const double* forces,
        const double* use,
        const double* speeds,
    ) except -1:
        """Write all columns but the impulses.

        Args:
            groups: The points at the state.
            axes: Normal and tangents of each point.
            normal_forces: Normal force of each point, N.
            forces: Forces (n, t1, t2) of each point, N.
            use: Share of the friction limit of each point.
            speeds: Slip speed of each point, m/s; NULL: none slides.
        """
        cdef Py_ssize_t i
        cdef double[9] out
        self.clear()
        self.mode = _STICKING if speeds == NULL else _SLIDING
        for i in range(self.parts.shape[0]):
            memset(out, 0, sizeof(out))
            sum_up(groups, self.parts[i, START], self.parts[i, STOP], normal_forces, out)
            if self.parts[i, FRICTION_ROW] >= 0:
                self.add_friction(i, axes, forces, use, speeds, out)
            self.add_pair(i, out)
        self.finish()
        return 0

    cdef int write_idle(self) except -1:
        """The same where no point carries force: there is no centre of pressure."""
        cdef Py_ssize_t i
        cdef int j
        cdef double[9] out
        self.clear()
        memset(out, 0, sizeof(out))
        for j in range(3, 6):
            out[j] = NAN
        for i in range(self.parts.shape[0]):
            self.add_pair(i, out)
            self.values[self.parts[i, ROW], MODE] = _CLOSED
        self.finish()
        return 0

    cdef void clear(self) noexcept:
        """Begin without pairs."""
        cdef Py_ssize_t row
        for row in range(self.values.shape[0]):
            self.values[row, PAIRS] = 0.0
        for row in range(self.friction_values.shape[0]):
            memset(&self.friction_values[row, 0], 0, OF_FRICTION * sizeof(double))

    cdef void finish(self) noexcept:
        """Divide the centres of several pairs by the sum of their weights; rules without a pair have the columns of these."""
        cdef Py_ssize_t row
        cdef double* values
        cdef int j
        for row in range(self.values.shape[0]):
            values = &self.values[row, 0]
            if values[PAIRS] == 0.0:
                memcpy(values, &_NOTHING[0], COLUMNS * sizeof(double))
            elif values[PAIRS] > 1.0:
                for j in range(3):
                    values[CENTRE + j] /= values[SIZE]

    cdef void add_pair(self, Py_ssize_t i, const double* out) noexcept:
        """Add a pair, with its force and centre, to its rule: of several, centres are weighted by the sizes of the forces."""
        cdef double* values = &self.values[self.parts[i, ROW], 0]
        cdef Py_ssize_t points = self.parts[i, STOP] - self.parts[i, START]
        cdef double size = norm(out)
        cdef int j
        if values[PAIRS] == 0.0:
            values[MODE] = self.mode if self.parts[i, FRICTION_ROW] >= 0 else _PRESSING
            values[PAIRS], values[POINTS], values[SIZE] = 1.0, points, size
            memcpy(values + FORCE, out, 6 * sizeof(double))
            return
        for j in range(3):
            if values[PAIRS] == 1.0:
                # The first pair was stored with its own centre; a weighted mean begins where a second one joins.
                values[CENTRE + j] *= values[SIZE]
            values[FORCE + j] += out[j]
            values[CENTRE + j] += size * out[3 + j]
        values[PAIRS], values[POINTS], values[SIZE] = values[PAIRS] + 1.0, values[POINTS] + points, values[SIZE] + size

    cdef void add_friction(
        self, Py_ssize_t i, const double* axes, const double* forces, const double* use, const double* speeds, double* out
    ) noexcept:
        """Add a pair to the columns of friction of its rule, and its friction to the force."""
        cdef double* values = &self.friction_values[self.parts[i, FRICTION_ROW], 0]
        cdef double[3] across
        cdef Py_ssize_t p
        cdef int j
        across[0] = across[1] = across[2] = 0.0
        for p in range(self.parts[i, START], self.parts[i, STOP]):
            values[USE] = max(values[USE], use[p])
            if speeds != NULL:
                values[SPEED] = max(values[SPEED], speeds[p])
            for j in range(3):
                across[j] += forces[3 * p + 1] * axes[9 * p + 3 + j] + forces[3 * p + 2] * axes[9 * p + 6 + j]
        values[0] += norm(across)
        for j in range(3):
            values[1 + j] += across[j]
            out[j] += across[j]

    cdef double add_slide(self, double part, StageInMemory stage) noexcept:
        """Add slip and heat of a stage, with its weight, to the columns of friction; returns the heat, J."""
        cdef Py_ssize_t i, p, row
        cdef double largest, total = 0.0
        for row in range(self.friction_values.shape[0]):
            largest = 0.0
            for i in range(self.parts.shape[0]):
                if self.parts[i, FRICTION_ROW] != row:
                    continue
                for p in range(self.parts[i, START], self.parts[i, STOP]):
                    self.friction_values[row, HEAT] += part * stage.heats[p]
                    total += part * stage.heats[p]
                    # The slip of a rule is that of its fastest point at each stage: a sum would depend on how many points
                    # there are.
                    largest = max(largest, stage.speeds[p])
            self.friction_values[row, SLIP] += part * largest
        return total

    cdef void add_impulses(self, double part, const double* wrenches) noexcept:
        """Add the sizes of the resultants of all pairs in a stage, with its weight, to the impulses of their rules."""
        cdef Py_ssize_t i, g
        cdef double[3] force
        cdef int j
        for i in range(self.parts.shape[0]):
            force[0] = force[1] = force[2] = 0.0
            for g in range(self.parts[i, GROUP], self.parts[i, LAST_GROUP]):
                for j in range(3):
                    force[j] += wrenches[6 * g + j]
            self.values[self.parts[i, ROW], COLUMNS] += part * norm(force)


cdef double _DRIFT_M = DRIFT_M, _DRIFT_M_S = DRIFT_M_S, _FEATURE_BOUND_M = FEATURE_BOUND_M, _LEVEL_M = LEVEL_M
cdef double GAP_M = PROJECTED_GAP_M, RATE_M_S = PROJECTED_RATE_M_S, SLIP_M_S = PROJECTED_SLIP_M_S


cdef class SteadyContacts(SteadyForces):
    """Closed contacts of which all points carry force, and all with friction stick or all slide, or none carries force."""

    def __init__(self, closed, system):
        self.closed, self.modes, self.solver, self.system = closed, closed.modes, closed.solver, system
        self.generation = -1

    def report_to(self, tables):
        """Set the tables of :meth:`write` and :meth:`exchange`."""
        self.tables = tables

    def account_to(self, deepest, heat_J):
        """Set the arrays whose first numbers are the deepest overlap, m, and the heat of friction, J."""
        self.accounts = deepest, heat_J  # the arrays themselves: others write and read them too
        self.deepest, self.heat_J = deepest, heat_J

    cdef bint may_be(self) except -1:
        """Whether the closed contacts may be steady; takes them over if they have changed."""
        closed = self.closed
        if (
            closed.contact_points is not self.points
            or closed.pressing is not self.pressing
            or self.modes.generation != self.generation
        ):
            self.take()
        return self.possible

    cdef int take(self) except -1:
        closed, solver = self.closed, self.solver
        self.points, self.pressing, self.generation = closed.contact_points, closed.pressing, self.modes.generation
        self.kinematics, self.state, self.possible, self.sliding = None, None, False, False
        self.idle = not closed.pressing
        if not closed.may_be_steady:
            return 0
        self.point_modes = self.modes.of(self.points)
        self.sliding = self.point_modes.all_slide
        # With some points sliding and others sticking modes may change at any of them: such states are decided one by one.
        if not (self.point_modes.none_presses if self.idle else self.sliding or self.point_modes.all_stick):
            return 0
        self.mu = self.point_modes.mu
        self.patches = None if self.sliding or self.idle else patches_of(solver.evaluator(self.points))
        self.possible, motion = True, closed.motion
        self.smooth, self.evaluator = solver.smooth, solver.evaluator(self.points)
        self.inside, self.data = solver.stage_forces(self.points), motion.data
        self.applied, self.pushes = motion.data.qfrc_applied, np.zeros(motion.model.nv)
        self.other, self.sums, self.block = self.pushes, np.empty(motion.model.nv), room(2 * len(self.points))
        self.normal_forces = numbers(self.block)
        self.use = self.normal_forces + <Py_ssize_t>len(self.points)
        pairs = closed.clearance.pairs
        self.others, self.is_level = bool(pairs), closed.clearance.flat_pairs.issuperset(pairs)
        shares = Shares.of(self.system, self.points, motion.grasped_bodies)
        self.from_robot, self.outside = shares.of_groups
        robot = robot_dofs(self.system, motion)
        self.robot_start, self.robot_stop = robot.start, robot.stop
        self.columns, self.rubs = RuleColumns(closed.by_pair, shares, self.tables), bool(self.point_modes.pairs)
        return 0

    cpdef bint holds(self) except -1:
        """Whether the state in ``data`` under its efforts is steady: nothing changes, and no gap has drifted too far."""
        modes = self.modes
        # While forces are varied by rounding, those of a decision count, not those of a state that was steady without it.
        if self.is_varied or not self.may_be():
            return False
        # Any of these is a change of modes that is due: it needs the whole decision.
        if modes.released or modes.struck or modes.stops or modes.beginning or modes.replacing:
            return False
        pushes = self.solver.other_forces
        state = self.smooth.state(self.other if pushes is self.pushes else pushes)
        if state is not self.state:
            self.state, self.is_steady = state, False
            self.is_steady = self.evaluate(state[0], state[1], pushes)
            if self.is_steady:
                self.lowest = self.extremes[3]
        return self.is_steady

    cdef bint evaluate(self, kinematics, load, pushes) except -1:
        solver = self.solver
        cdef const double[::1] pushed = self.other
        # Rows follow from positions and velocities: under other efforts at the same state they are used again.
        if kinematics is not self.kinematics:
            self.find_rows(kinematics)
            find_extremes(self.groups, self.extremes)
        if pushes is not self.pushes:
            pushed = pushes
        self.evaluation = state_under(self.points, self.rows, self.memory, self.point_modes, self.smooth, &pushed[0])
        if self.is_reduced:
            self.patches.solve(self.memory, self.evaluation.pushed, self.evaluation.along, &self.sums[0])
            self.evaluation.has_forces = True
        solver.last_evaluation = kinematics, load, self.evaluation
        if not (
            # A point beyond its face, or a gap or rate that has drifted too far, is an event (tolerances.py).
            self.extremes[0] >= -_FEATURE_BOUND_M and self.extremes[1] <= _DRIFT_M and self.extremes[2] <= _DRIFT_M_S
        ):
            return False
        if self.idle:
            if not self.evaluation.stays_idle():
                return False
        elif self.sliding:
            if not self.evaluation.slides_on():
                return False
        # A force at its cone or a normal force that pulls: the choice of modes decides. NaN counts as outside.
        elif not self.evaluation.margin() >= 0.0:
            return False
        return self.touches_nowhere_else()

    cdef int find_rows(self, kinematics) except -1:
        """Find the rows of the points at the current positions and velocities, as the choice of modes keeps them."""
        cdef RowEvaluator evaluator = self.evaluator
        solver = self.solver
        known, self.is_reduced = solver.last_rows, False
        if known is None or known[1] is not kinematics or known[0] is not self.points:
            known = solver.last_rows = self.points, kinematics, evaluator.rows()
            self.is_reduced = self.patches is not None and self.patches.prepare(known[2].groups, known[2].memory)
        self.kinematics, self.rows = kinematics, known[2]
        self.memory, self.groups = self.rows.memory, self.rows.groups
        return 0

    cdef bint touches_nowhere_else(self) except -1:
        # On three corners of a flat patch two convex bodies are on either side of the face: nothing else of them overlaps
        # (clearance.py).
        if not self.others or (self.is_level and self.extremes[1] <= _LEVEL_M):
            return True
        return self.closed.clearance.least(self.kinematics, self.extremes[1], self.closed.gaps_of) >= 0.0

    cpdef bint goes_on(self, double left_s=NAN) except -1:
        """Begin a step with the contacts and modes of the step before, if the state is steady; returns whether it is.

        Args:
            left_s: Duration of the step, s; unknown: points that slide may allow a shorter one only.
        """
        # Drift above these is projected out at the start of a step, which changes the state: the general way does that.
        if not self.holds() or self.extremes[1] > GAP_M or self.extremes[2] > RATE_M_S:
            return False
        if self.sliding:
            if not self.slide_on(left_s):
                return False
        elif self.rubs and (
            # Sticking points creep by rounding and truncation; beyond this the creep is projected out too.
            (not self.idle and self.evaluation.largest_slip() > SLIP_M_S)
            or not self.modes.keep_still(self.points, self.point_modes.kinds)
        ):
            return False
        self.closed.begin_steady_step()
        return True

    cdef bint slide_on(self, double left_s) except -1:
        """Begin a step with points that slide, if they allow one of this duration; returns whether they do."""
        cdef double[:, ::1] along
        cdef const double* axes = self.memory.axes
        cdef const double* slips
        cdef Py_ssize_t p
        cdef int j
        # NaN, the only number that differs from itself, stands for a duration that is not known.
        if left_s != left_s or not allows_step(
            self.evaluation, self.modes, left_s, self.data.time, PyBytes_FromStringAndSize(
                <char*>&self.smooth.ctrl[0] if self.smooth.ctrl.shape[0] else NULL,
                self.smooth.ctrl.shape[0] * <Py_ssize_t>sizeof(double),
            )
        ):
            return False
        directions, slips = np.empty((self.memory.points, 3)), self.evaluation.slips
        along = directions
        for p in range(self.memory.points):
            for j in range(3):
                along[p, j] = slips[2 * p] * axes[9 * p + 3 + j] + slips[2 * p + 1] * axes[9 * p + 6 + j]
        speeds = [self.evaluation.speeds[p] for p in range(self.memory.points)]
        self.modes.slide_on(self.points, self.point_modes, directions, speeds)
        return True

    def push(self, data):
        """Add the contact forces to ``data.qfrc_applied``, which holds all other applied forces."""
        cdef StageInMemory stage
        cdef Py_ssize_t i, n
        closed, stepper = self.closed, self.closed.motion.forced_stepper
        # Stages of an implicit step are solved together with the forces, which this shortcut does not do.
        if data is not self.data or stepper.implicit or not self.may_be():
            closed.push(data)
            return
        if stepper.inside:
            if not self.idle:
                closed.stages.append(self.inside.add_to(self.applied))
            return
        n = self.applied.shape[0]
        memcpy(&self.other[0], &self.applied[0], n * sizeof(double))
        self.solver.other_forces = self.pushes
        if self.idle:
            return
        if not self.holds():
            closed.push(data)
            return
        stage = self.evaluation.stage_into(&self.sums[0])
        for i in range(n):
            self.applied[i] += self.sums[i]
        closed.stages.append(stage)

    def write(self):
        """Write the columns of all contact rules, if the state is steady; returns whether it is."""
        cdef const double* forces
        cdef const double* speeds
        cdef Py_ssize_t p, n
        if not self.holds():
            return False
        if self.idle:
            self.columns.write_idle()
            return True
        n = self.memory.points
        forces = self.evaluation.present_forces()
        for p in range(n):
            self.normal_forces[p] = max(forces[3 * p], 0.0)
            if self.sliding:
                self.use[p] = 1.0
        if not self.sliding and not largest_ratio(forces, self.mu, self.use) <= 1.0:
            return False  # shares of least use are to be found
        speeds = self.evaluation.speeds if self.sliding else NULL
        self.columns.write(self.groups, self.memory.axes, self.normal_forces, forces, self.use, speeds)
        return True

    def exchange(self, double duration_s):
        """Energy and momentum exchanged in a (sub-)step, if the state at its end is steady; adds impulses, work and overlap."""
        totals = np.empty(21)
        cdef double[::1] sums = totals
        if not self.exchange_into(duration_s, &sums[0]):
            return None
        return Exchange(totals[:3], totals[3:9], totals[9:].reshape(2, 6))

    cdef bint exchange_into(self, double duration_s, double* sums) except -1:
        """The same into energies, impulse of the robot, and impulses of fixed bodies, (21,); returns whether it is steady."""
        cdef list stages
        cdef StageInMemory stage
        cdef const double[::1] weights
        cdef double part, power, total = 0.0, memory = 0.0, heat_J = 0.0
        cdef const double* wrench
        cdef Py_ssize_t s, i, g, n, first
        if not self.holds():
            return False
        # A negative gap is an overlap: that at the end of the step counts, as in the general case.
        if self.idle:
            memset(sums, 0, 21 * sizeof(double))
            self.deepest[0] = max(self.deepest[0], -self.lowest)
            return True
        stages, weights = self.closed.stages, self.closed.motion.forced_stepper.weights
        n = weights.shape[0]
        first = len(stages) - 1 - n  # the last one of all is at the end of the step
        # Too few stages: the step was cut short, or began before the contacts were steady.
        if first < 0:
            return False
        # Steady at both ends is not steady in between: a force may dip through its bound and come back.
        if dip(stages[first:], self.point_modes.stick_mu) > 0.0:
            return False  # a force may have left its bounds within the step
        stages = stages[first : first + n]
        # Stages of other features are objects of Python: the general exchange sums them up.
        if not all([isinstance(candidate, StageInMemory) for candidate in stages]):
            return False
        if self.sliding and not all([(<StageInMemory>candidate).any_sliding for candidate in stages]):
            return False
        memset(sums, 0, 21 * sizeof(double))
        for s in range(n):
            stage, part = stages[s], duration_s * weights[s]
            for i in range(stage.nv):
                power = part * stage.powers[i]
                total += power
                if self.robot_start <= i < self.robot_stop:
                    memory += power
            for g in range(stage.groups):
                wrench = stage.wrenches + 6 * g
                for i in range(6):
                    sums[3 + i] += part * self.from_robot[g] * wrench[i]
                    sums[9 + i] += part * self.outside[0, g] * wrench[i]
                    sums[15 + i] += part * self.outside[1, g] * wrench[i]
            self.columns.add_impulses(part, stage.wrenches)
            if self.sliding:
                heat_J += self.columns.add_slide(part, stage)
        sums[0], sums[1], sums[2] = total, memory, total - memory
        if self.rubs:
            self.columns.work_J[0] += total
        self.heat_J[0] += heat_J
        self.deepest[0] = max(self.deepest[0], -self.lowest)
        return True
