# cython: boundscheck=False, wraparound=False, cdivision=True
"""The contact problem at one state, and contact forces in the stages of a step.

States inside a step are evaluated once. Points over faces and joint limits are evaluated in memory that is used again from
stage to stage; others one by one.
"""

cimport cython

import numpy as np

from ffsm_mj.contact_models.persistent.friction.choice import OPENS
from ffsm_mj.contact_models.persistent.friction.cones import ON_CONE
from ffsm_mj.contact_models.persistent.friction.problem import ActiveRows
from ffsm_mj.contact_models.persistent.friction.internal_forces import FRICTION_ROUNDING
from ffsm_mj.contact_models.persistent.friction.problem import FrictionProblem
from ffsm_mj.contact_models.persistent.friction.problem import Solution
from ffsm_mj.contact_models.persistent.friction.problem import stage_of
from ffsm_mj.tolerances import CANCELLED, RANK, RATE

from libc.math cimport atan2, cos, fabs, hypot, INFINITY, sin, sqrt
from libc.string cimport memcpy, memset

from ffsm_mj._core.forces cimport ActiveForces, of_rows, patches_of
from ffsm_mj._core.memory cimport numbers, room
from ffsm_mj._core.rows cimport RowMemory, write_rounding
from ffsm_mj._core.stages cimport empty_stage, finish_stage, generalise, Smooth, StageInMemory


cdef double _RATE = RATE, _ON_CONE = ON_CONE, _FRICTION_ROUNDING = FRICTION_ROUNDING, _CANCELLED = CANCELLED, _RANK = RANK
cdef double _OPENS = OPENS


# Points slide on, without a decision on the modes, above this many times the speeds at which they stop and the rounding of
# slips: far above the speeds at which the choice of modes treats points that slow down (modes.py).
cdef double _AWAY = 1e4


cdef bint presses_alone(modes, RowMemory memory) except -1:
    """Whether a single point without friction presses, and something can move along its normal: one row is held."""
    # Without an inverse mass nothing moves along the normal: a division by it would give a force without bound.
    return memory.points == 1 and not memory.rubs[0] and modes.all_stick and memory.inverse_mass(0) > _CANCELLED


cdef object structure_of(modes, RowMemory memory):
    """The rows held in the modes of a step: as at the first of its states that needs them."""
    structure = modes.structures.get(modes.key)
    if structure is None:
        structure = modes.kept.get(modes.key)
        # The same rows as in the step before, and so the same object: what is made for it is used again.
        # ``keeps_rows`` knows the rows of points that all stick; with sliding ones others are held.
        if structure is None or not (modes.all_stick and keeps_rows(memory, structure)):
            structure = ActiveRows.of(FrictionProblem(memory.array("G"), np.empty(memory.rows), modes.mu), modes.kinds)
        modes.structures[modes.key] = modes.kept[modes.key] = structure
    return structure


cdef bint keeps_rows(RowMemory memory, structure) except -1:
    """Whether the rows held are those along which a force can move anything; of points that all stick, see ``active_rows``."""
    cdef const Py_ssize_t[::1] rows = structure.rows
    cdef const double* G = memory.delassus()
    cdef Py_ssize_t i, at = 0, m = memory.rows
    cdef double largest = 1.0
    for i in range(m):
        largest = max(largest, G[i * (m + 1)])
    for i in range(m):
        # The square of a row of zeros, as of a tangent in which a planar mechanism cannot move: rounding relative to the
        # largest.
        if G[i * (m + 1)] > _CANCELLED * largest:
            if at == rows.shape[0] or rows[at] != i:
                return False
            at += 1
    return at == rows.shape[0]


cdef bint slips_along_a_line(const double* G, Py_ssize_t m, Py_ssize_t p, double* largest) noexcept:
    """Whether the tangent rows of a point have rank one in G, (m, m), as in a planar mechanism; their largest eigenvalue."""
    cdef const double* row = G + (3 * p + 1) * (m + 1)
    cdef double a = row[0], b = row[1], c = row[m + 1]
    largest[0] = 0.5 * (a + c) + hypot(0.5 * (a - c), b)
    # Determinant over the squared largest eigenvalue: the ratio of both eigenvalues, which is zero for rank one.
    return a * c - b * b <= _RANK * largest[0] * largest[0]


cdef double directions_of_slip(
    RowMemory memory,
    const unsigned char[::1] sliding,
    const unsigned char[::1] straight,
    const double[:, ::1] starts,
    double* slips,
) except? -1.0:
    """Directions of slip along the tangents, (k, 2): see ``slip_directions`` in ``friction/problem.py``.

    Args:
        memory: Rows of the points.
        sliding: Points that slide, (k,).
        straight: Points that keep their direction, (k,).
        starts: Directions at the start of the step, world axes, (k, 3).
        slips: Receives the directions; those of other points are left as they are.

    Returns:
        Least slip along the direction at the start, m/s; infinite if no point slides.
    """
    cdef const double* G = memory.delassus()
    cdef const double* axes
    cdef Py_ssize_t p, at, m = memory.rows
    cdef double u, v, first, second, size, largest, angle, least = INFINITY
    for p in range(memory.points):
        if not sliding[p]:
            continue
        axes, at = memory.axes + 9 * p, (3 * p + 1) * (m + 1)
        first = axes[3] * starts[p, 0] + axes[4] * starts[p, 1] + axes[5] * starts[p, 2]
        second = axes[6] * starts[p, 0] + axes[7] * starts[p, 1] + axes[8] * starts[p, 2]
        size = hypot(first, second)
        if size > 0.0:
            first, second = first / size, second / size
        u, v = memory.velocity(3 * p + 1), memory.velocity(3 * p + 2)
        size, least = hypot(u, v), min(least, u * first + v * second)
        # The other direction cannot move, so slip along it is rounding: the axis of the ellipse of G is the direction,
        # whatever the slip is.
        if slips_along_a_line(G, m, p, &largest):
            angle = 0.5 * atan2(2.0 * G[at + 1], G[at] - G[at + m + 1])
            u, v, size = cos(angle), sin(angle), 1.0
        # Near its stop a point keeps its direction: the slip that is left turns ever faster, and RK4 would not resolve that
        # (modes.py).
        elif straight[p] or size == 0.0:
            u, v, size = first, second, 1.0
        # An axis has no sense, and a slip that has passed zero points backwards: friction keeps opposing the slip of the
        # start, until the stop is located.
        if u * first + v * second < 0.0:
            size = -size
        slips[2 * p], slips[2 * p + 1] = u / size, v / size
    return least


@cython.no_gc  # no cycle contains it
cdef class ContactEvaluation:
    """What stages and decisions need of k contact points at one state."""

    def __init__(self, contact_points, rows, const double[::1] force not None, modes):
        self.set_up(contact_points, rows, rows.memory, modes)
        if self.memory.nv:
            memcpy(self.pushed, &force[0], self.memory.nv * sizeof(double))
        self.memory.accelerate(self.pushed, self.b)

    cdef int set_up(self, contact_points, rows, RowMemory memory, modes) except -1:
        self.contact_points, self.rows, self.memory, self.modes, self.mu = contact_points, rows, memory, modes, modes.mu
        self.block = room(2 * memory.rows + 4 * memory.points + memory.nv + 1)
        self.b = numbers(self.block)
        self.along = self.b + memory.rows
        self.roughness = self.along + memory.rows
        self.pushed = self.roughness + memory.points
        self.slips = self.pushed + memory.nv
        self.speeds = self.slips + 2 * memory.points
        return 0

    @property
    def force(self):
        """Generalised forces without the contact forces, less the bias, (nv,)."""
        at = 2 * self.memory.rows + self.memory.points
        return np.frombuffer(self.block)[at : at + self.memory.nv]

    @property
    def problem(self):
        """The problem of the accelerations of the points."""
        if self.kept_problem is None:
            rows, modes = self.rows, self.modes
            b = np.frombuffer(self.block)[: self.memory.rows]
            self.kept_problem = FrictionProblem(rows.G, b, modes.mu, modes.structures, rows.active)
        return self.kept_problem

    @property
    def rounding(self):
        """Rounding of the accelerations of each point, m/s^2, (k,)."""
        self.roundings()
        return np.frombuffer(self.block)[2 * self.memory.rows : 2 * self.memory.rows + self.memory.points]

    cdef double* roundings(self) except NULL:
        if not self.has_rounding:
            write_rounding(self.rows.groups, self.memory, self.pushed, self.roughness)
            self.has_rounding = True
        return self.roughness

    cdef ActiveForces active(self):
        """The linear problem in the present modes."""
        structure = structure_of(self.modes, self.memory)
        both = self.modes.key, structure.key
        active = self.rows.active.get(both)
        if active is None:
            active = self.rows.active[both] = of_rows(self.memory, structure)
        return active

    cdef double* present_forces(self) except NULL:
        """Forces (n, t1, t2) in the present modes, N, (k, 3)."""
        cdef ActiveForces active
        if not self.has_forces:
            memset(self.along, 0, self.memory.rows * sizeof(double))
            if presses_alone(self.modes, self.memory):
                self.along[0] = -self.b[0] / self.memory.inverse_mass(0)
            elif self.memory.points:
                active = self.active()
                if self.modes.any_sliding:
                    modes = self.modes
                    sliding, straight = modes.sliding.view(np.uint8), modes.straight.view(np.uint8)
                    self.forward = directions_of_slip(self.memory, sliding, straight, modes.directions, self.slips)
                    active.turn(self.slips)
                active.write_forces(self.b, self.along)
            self.has_forces = True
        return self.along

    cdef bint only_drifts(self) noexcept:
        """Whether no point slips by more than the drift of sticking points."""
        cdef Py_ssize_t p
        cdef double u, v, most = self.modes.drift_m_s
        for p in range(self.memory.points):
            if self.memory.rubs[p]:
                u, v = self.memory.velocity(3 * p + 1), self.memory.velocity(3 * p + 2)
                # Written so that NaN counts as slip: a step that has diverged must not be steady.
                if not u * u + v * v <= most * most:
                    return False
        return True

    cdef double largest_slip(self) noexcept:
        """Largest slip along a tangent, m/s."""
        cdef Py_ssize_t p
        cdef double most = 0.0
        for p in range(self.memory.points):
            if self.memory.rubs[p]:
                most = max(most, max(fabs(self.memory.velocity(3 * p + 1)), fabs(self.memory.velocity(3 * p + 2))))
        return most

    cdef bint slides_on(self) except -1:
        """Whether points that slide go on to: far from their stops and from a turn about, with normal forces that press."""
        cdef const double* forces
        cdef const double[::1] stop_speeds = self.modes.stop_speeds
        cdef const double* J
        cdef double largest
        cdef Py_ssize_t p, i, d
        for p in range(self.memory.points):
            largest, self.speeds[p] = 0.0, 0.0
            if not self.memory.rubs[p]:
                continue
            for i in range(3 * p, 3 * p + 3):
                J = self.memory.J + i * self.memory.nv
                for d in range(self.memory.nv):
                    largest = max(largest, fabs(J[d] * self.memory.qvel[d]))
            self.speeds[p] = hypot(self.memory.velocity(3 * p + 1), self.memory.velocity(3 * p + 2))
            # Near its stop the force of a sliding point changes within one step. There the choice of modes has to look.
            if not self.speeds[p] > _AWAY * max(stop_speeds[p], _RATE * (1.0 + largest)):
                return False
        forces = self.present_forces()
        for p in range(self.memory.points):
            # A contact cannot pull: a point with a negative normal force leaves, and the state is not steady.
            if not forces[3 * p] > 0.0 or (not self.memory.rubs[p] and not self.presses(p) >= 0.0):
                return False
        # The determinant of the linear problem has a sign; where it changes, at Painleve's limit, the normal force has no
        # solution.
        return self.forward > 0.0 and self.active().has_sign()

    cdef bint stays_idle(self) except -1:
        """Whether no point needs a force to stay closed, nor opens: all second rates of the gaps are rounding."""
        cdef double* rounding = self.roundings()
        cdef Py_ssize_t p
        for p in range(self.memory.points):
            # As the choice of modes says of points that are closed without force; NaN counts as beyond.
            if not fabs(self.b[3 * p]) <= _OPENS * rounding[p]:
                return False
        return True

    cdef double presses(self, Py_ssize_t p) except? -2.0:
        """Margin by which the normal force of a point exceeds its rounding, m/s^2."""
        return self.present_forces()[3 * p] * self.memory.inverse_mass(3 * p) - self.roundings()[p]

    cdef double margin(self) except? -2.0:
        """Least margin of the points to their own cones, m/s^2, if all stick and none slips; negative otherwise.

        Points without friction press instead: of them it is that of their normal forces.
        """
        if not self.has_margin:
            self.has_margin = True
            self.kept_margin = self.margin_of() if self.modes.all_stick and self.only_drifts() else -1.0
        return self.kept_margin

    cdef double margin_of(self) except? -2.0:
        cdef const double* forces = self.present_forces()
        cdef Py_ssize_t p
        cdef int j
        cdef double least = INFINITY, largest = 0.0, inertia = 0.0, pressing = INFINITY
        cdef Py_ssize_t sticking = 0
        for p in range(self.memory.points):
            if self.memory.rubs[p]:
                # Distance from the friction cone in N; times the inverse mass below it is an acceleration, in which rounding
                # is known.
                least = min(least, self.mu[p] * forces[0] - sqrt(forces[1] * forces[1] + forces[2] * forces[2]))
                inertia += self.memory.inverse_mass(3 * p)
                sticking += 1
            else:
                pressing = min(pressing, self.presses(p))
            for j in range(3):
                largest = max(largest, fabs(forces[j]))
            forces += 3
        if not sticking:
            return pressing
        inertia /= sticking
        # A point exactly on its cone may stick: without this allowance rounding would let it slip.
        return min(pressing, (least + _ON_CONE * largest) * inertia)

    def settled(self):
        """The solution if all points stick and may go on to do so: none slips, and each is inside its own cone.

        Those without friction press.
        """
        cdef double[:, ::1] accelerations
        cdef const double* G
        cdef const double* forces
        cdef Py_ssize_t i, j, m = self.memory.rows
        cdef double total, least = self.margin()
        if not least >= 0.0:
            return None
        rates, forces, G = np.empty((self.memory.points, 3)), self.present_forces(), self.memory.delassus()
        force_table, accelerations = np.frombuffer(self.block)[m : 2 * m].reshape(-1, 3), rates
        for i in range(m):
            total = self.b[i]
            for j in range(m):
                total += G[i * m + j] * forces[j]
            (&accelerations[0, 0])[i] = total
        return Solution(self.modes.kinds, self.modes.no_slips, force_table, rates, least, least, False)

    def limit_ratios(self, const double[:, :] forces not None):
        """Ratios of friction to its limit; infinite where a normal force pulls, zero where there is no friction."""
        cdef const double[:, ::1] contiguous = np.ascontiguousarray(forces)
        cdef Py_ssize_t p, n = forces.shape[0]
        cdef bytearray block = room(n + 1)
        cdef double* ratios = numbers(block)
        if n:
            largest_ratio(&contiguous[0, 0], self.mu, ratios)
        return [ratios[p] for p in range(n)]

    def present_stage(self):
        """A stage in the present modes, in which no point slides with friction, and the generalised forces, (nv,)."""
        generalised = np.empty(self.memory.nv)
        cdef double[::1] sums = generalised
        return self.stage_into(&sums[0]), generalised

    cdef StageInMemory stage_into(self, double* generalised):
        cdef RowMemory memory = self.memory
        cdef bint any_sliding = self.modes.any_sliding
        cdef StageInMemory stage = empty_stage(memory.rows, memory.nv, len(memory.counts), any_sliding)
        memcpy(stage.along, self.present_forces(), memory.rows * sizeof(double))
        generalise(stage.along, memory, generalised)
        finish_stage(stage, memory, memory.qvel, generalised)
        if any_sliding:
            stage.write_slide(memory, self.modes.sliding.view(np.uint8))
        return stage


cdef ContactEvaluation state_under(contact_points, rows, RowMemory memory, modes, Smooth smooth, const double* pushes):
    """The points under the smooth forces at the current state and applied forces, (nv,)."""
    cdef ContactEvaluation evaluation = ContactEvaluation.__new__(ContactEvaluation)
    evaluation.set_up(contact_points, rows, memory, modes)
    smooth.write_force(pushes, evaluation.pushed)
    memory.accelerate(evaluation.pushed, evaluation.b)
    return evaluation


cdef double largest_ratio(const double* forces, const double[::1] mu, double* ratios) noexcept:
    """Ratios of friction to its limit, see ``ContactEvaluation.limit_ratios``, and the largest of them."""
    cdef Py_ssize_t p
    cdef double friction, limit, rounding = 0.0, largest = 0.0
    for p in range(3 * mu.shape[0]):
        # Internal forces of redundant points cancel: their rounding is that of the largest force.
        rounding = max(rounding, _FRICTION_ROUNDING * fabs(forces[p]))
    for p in range(mu.shape[0]):
        friction = sqrt(forces[1] * forces[1] + forces[2] * forces[2])
        limit = mu[p] * forces[0]
        # Friction of rounding over a normal force of rounding would be any ratio.
        ratios[p] = 0.0 if friction <= rounding else friction / limit if limit > 0.0 else INFINITY
        largest, forces = max(largest, ratios[p]), forces + 3
    return largest


cdef class StageForces:
    """Contact forces of some points in the modes of a step."""

    def __init__(self, smooth, evaluator, contact_points, modes):
        self.contact_points, self.modes = contact_points, modes
        self.smooth, self.evaluator = smooth, evaluator
        # What closed loops hold is taken out of the rows (``close_loops``), which needs them as a whole, one state at a
        # time.
        if self.smooth.motion.loops is None:
            self.states = self.evaluator.groups_in_memory()
        if self.states is None:
            return
        self.memory = self.evaluator.empty()
        self.force, self.b, self.sums = np.empty(self.memory.nv), np.empty(self.memory.rows), np.empty(self.memory.nv)
        self.patches = patches_of(self.evaluator) if modes.all_stick else None
        self.any_sliding = modes.any_sliding
        if self.any_sliding:
            self.sliding, self.straight = modes.sliding.view(np.uint8), modes.straight.view(np.uint8)
            self.directions, self.slips = modes.directions, np.zeros((self.memory.points, 2))

    def add(self, double[::1] applied not None):
        """Add the forces at the current state to the applied ones, (nv,), and return the stage."""
        return self.add_to(applied)

    cdef object add_to(self, double[::1] applied):
        cdef RowMemory memory = self.memory
        cdef StageInMemory stage
        cdef Py_ssize_t d
        if self.states is None:
            return self.add_one_by_one(applied)
        self.smooth.write_force(&applied[0], &self.force[0])
        self.evaluator.evaluate(self.states, memory)
        stage = empty_stage(memory.rows, memory.nv, len(memory.counts), self.any_sliding)
        # The effort grows with the cube of the rows: six for each pair of bodies here, instead of three for each point.
        if self.patches is not None and self.patches.prepare(self.states, memory):
            self.patches.solve(memory, &self.force[0], stage.along, &self.sums[0])
        else:
            self.hold_rows(stage)
        finish_stage(stage, memory, &self.evaluator.rates[0], &self.sums[0])
        if self.any_sliding:
            stage.write_slide(memory, self.sliding)
        for d in range(memory.nv):
            applied[d] += self.sums[d]
        return stage

    cdef object add_one_by_one(self, double[::1] applied):
        """The same of points that are not evaluated in memory."""
        cdef Py_ssize_t d
        cdef const double[::1] sums
        motion = self.smooth.motion
        force = self.smooth.force(applied.base)
        rows = self.evaluator.rows()
        if motion.loops is not None:
            rows.close_loops(motion.loops)
        stage, generalised = stage_of(ContactEvaluation(self.contact_points, rows, force, self.modes))
        sums = generalised
        for d in range(applied.shape[0]):
            applied[d] += sums[d]
        return stage

    cdef int hold_rows(self, StageInMemory stage) except -1:
        """Find the forces that hold the rows of all points, and the generalised forces."""
        cdef RowMemory memory = self.memory
        self.evaluator.combine(memory)
        memory.accelerate(&self.force[0], &self.b[0])
        memset(stage.along, 0, memory.rows * sizeof(double))
        if presses_alone(self.modes, memory):
            stage.along[0] = -self.b[0] / memory.inverse_mass(0)
            generalise(stage.along, memory, &self.sums[0])
            return 0
        self.hold()
        if self.any_sliding:
            directions_of_slip(memory, self.sliding, self.straight, self.directions, &self.slips[0, 0])
            self.active.turn(&self.slips[0, 0])
        self.active.write_forces(&self.b[0], stage.along)
        generalise(stage.along, memory, &self.sums[0])
        return 0

    cdef int hold(self) except -1:
        """Take the rows that are held in this step, as the start of the step determined them, and their matrix."""
        structure = structure_of(self.modes, self.memory)
        # The rows are those of the stage before: the matrix is put into the same memory. Others need one of another size.
        if structure is not self.structure:
            self.structure, self.active = structure, None
        if self.active is None:
            self.active = of_rows(self.memory, self.structure)
        else:
            self.active.take(self.memory.delassus())
        return 0
