# cython: boundscheck=False, wraparound=False, cdivision=True
"""Steps of a motion: free of applied forces, and under them, by Runge-Kutta methods of order four.

Free steps are those of mj_step and mj_forward with one exception: mj_step begins with the position, velocity and constraint
stages of the initial state, which the last mj_forward has already computed. RK4 without an active constraint reuses them; all
other steps call mj_step.

Applied forces are evaluated in every stage. MuJoCo's callbacks would be too, but are global to the process. A step under
them is explicit (the classical method), or implicit where a force is stiff in the velocities
(:mod:`ffsm_mj.dynamics.implicit_stages`). Rotations are integrated as the rotation vector since the start of the step
(Runge-Kutta-Munthe-Kaas), which keeps the order on the rotation group.
"""

import mujoco
import numpy as np

from ffsm_mj.dynamics.implicit_stages import IMPLICIT_WEIGHTS, ImplicitStep, PLACES
from ffsm_mj.dynamics.rigid_body import rotation_dofs
from ffsm_mj.tolerances import EPSILON

from libc.math cimport fabs, INFINITY, isfinite, sqrt
from libc.string cimport memcpy, memset

from ffsm_mj._core.fields cimport FieldForces
from ffsm_mj._core.functions cimport address, mj, mjData, mjModel, mjSTAGE_VEL


WHOLE_STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)
"""State that MuJoCo needs to repeat a step bit by bit. A plain int, as enum lookup in the bindings is slow."""
BOUND_MARGIN = 1.1
"""Safety factor: the energy inside a step may exceed that at its ends."""
WEIGHTS = np.array((1.0, 2.0, 2.0, 1.0)) / 6.0
"""Quadrature weights of the four stages of an explicit step."""
cdef double _BOUND_MARGIN = BOUND_MARGIN
cdef double[3] _PLACES = PLACES, _IMPLICIT_WEIGHTS = IMPLICIT_WEIGHTS
# Largest number of iterations of an implicit step; 3 or 4 reach rounding. They end at changes of the increments below the first
# share of 1 + the largest rate, or below the second one if they do not get smaller.
cdef int PASSES = 30
cdef double SETTLED = 2.0 * EPSILON, NEARLY = 1e-10
cdef int _WHOLE_STATE = WHOLE_STATE


cdef class FreeStepper:
    """Integrates steps and accumulates the motion bound, the integral of sqrt(2 T) dt."""

    def __init__(self, model, data, double[::1] state not None, double[::1] momentum not None):
        if len(state) != mujoco.mj_stateSize(model, WHOLE_STATE) or len(momentum) != model.nv:
            raise ValueError(f"a state of {len(state)} and a momentum of {len(momentum)} numbers do not fit the model")
        self.m, self.d, self.model, self.data = <const mjModel*>address(model), <mjData*>address(data), model, data
        self.state, self.momentum, self.rates = state, momentum, data.qvel
        self.runge_kutta = model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
        self.clear(INFINITY)

    def clear(self, double event_bound):
        """Reset the motion bound at the state in ``data``."""
        self.motion_bound, self.last_increment, self.event_bound = 0.0, 0.0, event_bound
        self.energy = self.kinetic()
        self.unconstrained = self.data.nefc == 0

    cpdef bint step(self, double duration_s) except? -1:
        """Integrate for the model's time step; returns whether no event is possible."""
        before = self.bands.values() if self.bands is not None else None
        # The path within the step starts here: an event is located by shorter steps from this state, bit for bit the same.
        mj.getState(self.m, self.d, &self.state[0], _WHOLE_STATE)
        if self.runge_kutta and self.unconstrained:
            # mj_step begins with these checks. They stay, as a state that is not finite must be reset or reported likewise.
            mj.checkPos(self.m, self.d)
            mj.checkVel(self.m, self.d)
            mj.forwardSkip(self.m, self.d, mjSTAGE_VEL, 1)
            mj.checkAcc(self.m, self.d)
            mj.RungeKutta(self.m, self.d, 4)
        else:
            mj.step(self.m, self.d)
        mj.forward(self.m, self.d)
        # Evaluated here, not when it is needed: collision detection in between discards the constraints.
        self.unconstrained = self.data.nefc == 0
        self.kinked = self.bands is not None and self.bands.are_passed(before)
        return self.add(duration_s)

    def account(self, double duration_s):
        """Add a finished step to the motion bound; derived quantities must be current."""
        return self.add(duration_s)

    cdef bint add(self, double duration_s) noexcept:
        cdef double before = self.energy
        self.energy = self.kinetic()
        # The energy inside the step is not known: the larger one of both ends stands for it, with a margin.
        self.last_increment = _BOUND_MARGIN * duration_s * sqrt(2.0 * fabs(before if before > self.energy else self.energy))
        self.motion_bound += self.last_increment
        return self.motion_bound < self.event_bound

    cdef double kinetic(self) noexcept:
        cdef double twice = 0.0
        cdef Py_ssize_t i
        mj.mulM(self.m, self.d, &self.momentum[0], &self.rates[0])
        for i in range(self.rates.shape[0]):
            twice += self.momentum[i] * self.rates[i]
        return 0.5 * twice


cdef class ActuatorPower:
    """Power of the actuators at the stages of a step, and their work in the last step, by tree.

    A servo's force varies within a step, and limits of joints act on the sum of all forces on them: the work is the integral
    of qfrc_actuator . qvel by the weights of the stages.

    Attributes:
        work: Work in the last step, J, (number of trees,).
        kinked: Whether a force was at its limit at some stages of the last step, and within it at others.
    """

    cdef readonly object work, outside
    cdef readonly bint kinked
    cdef bint is_first
    cdef const Py_ssize_t[::1] limited, limited_dofs
    cdef const double[:, ::1] ranges, dof_ranges
    cdef int[::1] sides
    cdef double[::1] total, sums, forces, rates, force, velocity
    cdef const Py_ssize_t[::1] trees, apart, apart_trees

    def __init__(self, data, const Py_ssize_t[::1] trees not None, apart, double[::1] work not None, limits, outside=None):
        """Bind to data.

        Args:
            data: MuJoCo data of a motion.
            trees: Tree of each of its degrees of freedom, (nv,).
            apart: Ids of actuators whose work is entered elsewhere, and the tree of each, (2, n).
            work: Receives the work, J, (number of trees,).
            limits: Its :class:`~ffsm_mj.dynamics.actuators.ForceLimits`.
            outside: Its :class:`~ffsm_mj.dynamics.actuators.ExternalServos`, which are apart too; None without any.
        """
        self.outside = outside
        self.limited, self.ranges = limits.servos, limits.ranges
        self.limited_dofs, self.dof_ranges = limits.dofs, limits.dof_ranges
        self.sides = np.zeros(len(limits.servos) + len(limits.dofs), dtype=np.intc)
        if len(trees) != len(data.qvel):
            raise ValueError(f"{len(trees)} trees for {len(data.qvel)} degrees of freedom")
        self.work, self.total, self.sums, self.trees = work.base, work, np.zeros(len(work)), trees
        self.apart, self.apart_trees = np.ascontiguousarray(apart, dtype=np.intp)
        self.forces, self.rates = data.qfrc_actuator, data.qvel
        self.force, self.velocity = data.actuator_force, data.actuator_velocity

    cdef int clear(self) except -1:
        """Begin the sum over the stages of a step."""
        if self.outside is not None:
            self.outside.begin()
        memset(&self.sums[0], 0, self.sums.shape[0] * sizeof(double))
        self.is_first, self.kinked = True, False
        return 0

    cdef void look(self) noexcept:
        """Compare which forces are at their limits with those at the first stage."""
        cdef Py_ssize_t i, n = self.limited.shape[0]
        cdef int side
        cdef double value
        for i in range(self.sides.shape[0]):
            value = self.force[self.limited[i]] if i < n else self.forces[self.limited_dofs[i - n]]
            if i < n:
                # A force that reaches its limit has a kink in time, at which RK4 loses its order: the integrator ends the
                # step there.
                side = (value >= self.ranges[i, 1]) - (value <= self.ranges[i, 0])
            else:
                side = (value >= self.dof_ranges[i - n, 1]) - (value <= self.dof_ranges[i - n, 0])
            if self.is_first:
                self.sides[i] = side
            elif side != self.sides[i]:
                self.kinked = True
        self.is_first = False

    cpdef int add(self, double weight) except -1:
        """Add the power of a stage, whose forces and rates are in the data, with its weight."""
        cdef Py_ssize_t i, k
        for i in range(self.rates.shape[0]):
            self.sums[self.trees[i]] += weight * self.forces[i] * self.rates[i]
        for k in range(self.apart.shape[0]):
            i = self.apart[k]
            # Thrusters and servos from outside do external work: entered here too, it would count twice.
            self.sums[self.apart_trees[k]] -= weight * self.force[i] * self.velocity[i]
        if self.outside is not None:
            self.outside.add(weight)
        self.look()
        return 0

    cpdef int end(self, double duration_s) except -1:
        """End a step of a duration, over which the weights add up to 1."""
        cdef Py_ssize_t i
        for i in range(self.sums.shape[0]):
            self.total[i] = duration_s * self.sums[i]
        if self.outside is not None:
            self.outside.end(duration_s, self.work)
        return 0


cdef void rotation_vector_rate(const double* turned, double* spin) noexcept:
    """Replace a body-frame angular velocity w by the rate of the rotation vector t: w + t x w / 2 + t x (t x w) / 12.

    The inverse of the exponential map's differential, truncated after second order: enough for a method of order four.
    """
    cdef double a = turned[0], b = turned[1], c = turned[2], x = spin[0], y = spin[1], z = spin[2]
    cdef double u = b * z - c * y, v = c * x - a * z, w = a * y - b * x, twelfth = 1.0 / 12.0
    spin[0] = x + 0.5 * u + twelfth * (b * w - c * v)
    spin[1] = y + 0.5 * v + twelfth * (c * u - a * w)
    spin[2] = z + 0.5 * w + twelfth * (a * v - b * u)


cdef class ForcedStepper(FreeStepper):
    """Integrates steps under forces that depend on the state: applied ones, and those of servos."""

    cdef public bint inside, solved
    cdef public int repeats
    cdef public object stage, stiff, activations
    cdef bint asked_implicit, has_active_rows
    cdef readonly object start_rates, rotations
    cdef readonly ActuatorPower power
    cdef public FieldForces field  # external fields, whose work and impulses the stages integrate; None without any
    cdef tuple pushes
    cdef object follow
    cdef double[::1] qpos, accelerations, applied, start_qpos, start_qvel
    cdef double[:, :, ::1] slopes  # of four stages: rates of rotation vectors and other coordinates, accelerations
    cdef double[::1] mean
    cdef object flat_slopes, flat_mean, residuals, acting
    cdef double[:, :, ::1] nodes, before, increments  # of an implicit step: the same of its three nodes
    cdef double[:, ::1] differences
    cdef Py_ssize_t[::1] turning

    def __init__(
        self,
        model,
        data,
        double[::1] state not None,
        double[::1] momentum not None,
        pushes,
        follow,
        ActuatorPower power=None,
    ):
        FreeStepper.__init__(self, model, data, state, momentum)
        self.power, self.solved = power, True
        self.pushes, self.follow, self.rotations = tuple(pushes), follow, rotation_dofs(model)
        self.turning = np.array([part.start for part in self.rotations], dtype=np.intp)
        self.qpos, self.accelerations, self.applied = data.qpos, data.qacc, data.qfrc_applied
        self.start_rates = np.empty(model.nv)
        self.start_qpos, self.start_qvel = np.empty(model.nq), self.start_rates
        self.flat_slopes, self.flat_mean = np.empty((4, 2 * model.nv)), np.empty(2 * model.nv)
        self.slopes, self.mean = self.flat_slopes.reshape(4, 2, -1), self.flat_mean
        self.nodes, self.before, self.increments = (np.empty((3, 2, model.nv)) for _ in range(3))
        self.residuals = np.empty((3, model.nv))
        self.differences = self.residuals

    @property
    def implicit(self):
        """Whether steps are implicit: always with stiff actuators, otherwise if it is set."""
        return self.asked_implicit or self.stiff is not None

    @implicit.setter
    def implicit(self, bint value):
        self.asked_implicit = value

    @property
    def weights(self):
        """Quadrature weights of the stages of a step."""
        return IMPLICIT_WEIGHTS if self.implicit else WEIGHTS

    def refresh(self):
        """Update forces and all derived quantities for the state in ``data``."""
        self.update()

    cdef int update(self) except -1:
        mj.fwdPosition(self.m, self.d)
        mj.fwdVelocity(self.m, self.d)
        return self.update_forces()

    cdef int update_forces(self) except -1:
        """The same if positions and velocities are current and only efforts may have changed."""
        if self.follow is not None:
            self.follow()
        # Forces of the stage before belong to another state; every source adds its own.
        memset(&self.applied[0], 0, self.applied.shape[0] * sizeof(double))
        # In the order of the contact models: a reactive one sees what those before it have added.
        for push in self.pushes:
            push(self.data)
        mj.forwardSkip(self.m, self.d, mjSTAGE_VEL, 1)
        return 0

    def integrate(self, double duration_s):
        """Integrate for a time; forces and derived quantities are current at its end."""
        self.update()
        self.integrate_step(duration_s)

    cdef int integrate_step(self, double duration_s) except -1:
        """The same if forces are current at the start."""
        cdef double start_s = self.d.time
        memcpy(&self.start_qpos[0], &self.qpos[0], self.qpos.shape[0] * sizeof(double))
        memcpy(&self.start_qvel[0], &self.rates[0], self.rates.shape[0] * sizeof(double))
        self.solved = True
        if self.asked_implicit or self.stiff is not None:
            self.solved = self.integrate_implicitly(start_s, duration_s)
        else:
            self.integrate_explicitly(start_s, duration_s)
        self.d.time = start_s + duration_s
        return self.update()

    cdef int integrate_explicitly(self, double start_s, double h) except -1:
        """Set the state at the end of a step, by the classical tableau."""
        cdef Py_ssize_t n = self.rates.shape[0]
        cdef double* slopes = &self.slopes[0, 0, 0]
        memcpy(slopes, &self.rates[0], n * sizeof(double))
        memcpy(slopes + n, &self.accelerations[0], n * sizeof(double))
        self.begin_work()
        # The quadrature of the work has the weights of the motion: its error is of the order of the step.
        self.add_work(1.0 / 6.0)
        if self.activations is not None:
            self.activations.begin(h)
            self.activations.add(1.0 / 6.0)
        # Inside a step the modes of contacts are kept: choosing them anew in each stage would make the method first order.
        self.d.time = start_s + 0.5 * h
        self.inside = True
        try:
            self.evaluate(0.5 * h, slopes, slopes + 2 * n)
            self.end_stage(1.0 / 3.0)
            self.evaluate(0.5 * h, slopes + 2 * n, slopes + 4 * n)
            self.end_stage(1.0 / 3.0)
            self.d.time = start_s + h
            self.evaluate(h, slopes + 4 * n, slopes + 6 * n)
            self.end_stage(1.0 / 6.0)
            self.end_work(h)
            if self.activations is not None:
                self.activations.end(h)
        finally:
            self.inside = False
        WEIGHTS.dot(self.flat_slopes, self.flat_mean)  # its order of summation is not ours to know
        self.set_state(h, &self.mean[0])
        return 0

    cdef bint integrate_implicitly(self, double start_s, double h) except -1:
        """Set the state at the end of an implicit step; returns whether its equations were solved."""
        cdef double change = INFINITY, last
        cdef int again, solved = True
        step = self.stage = ImplicitStep(h, self.start_rates)
        cdef const double[:, ::1] weights = step.weights
        self.begin_nodes(h)
        self.add_up(self.nodes, weights)
        try:
            for again in range(PASSES):
                last, change = change, self.evaluate_nodes(step, start_s, h, again > 0)
                solved = self.correct_nodes(step, h)
                change = max(change, self.end_pass(weights))
                # From a state that is not finite no pass comes back; the caller is told that the step has no solution.
                if not isfinite(change):
                    solved = False
                    break
                # At rounding changes do not get smaller. Above NEARLY the same means that the iteration does not converge.
                if change <= SETTLED or (change <= NEARLY and change >= 0.5 * last):  # rounding
                    break
            else:
                solved = False
        finally:
            self.stage, self.repeats = None, 0
        # The last node of Radau IIA is the end of the step: nothing is left to sum up.
        self.set_state(1.0, &self.increments[2, 0, 0])
        self.end_work(h)
        if self.activations is not None:
            self.activations.move_to_node(h, step.weights[2])
        return solved

    cdef int begin_nodes(self, double h) except -1:
        """Estimate rates and accelerations at the nodes, and prepare what actuators need."""
        cdef Py_ssize_t i, k
        self.has_active_rows = False
        for k in range(3):
            for i in range(self.rates.shape[0]):
                self.nodes[k, 0, i] = self.rates[i]
                # The accelerations at the start of a transient are none that last.
                self.nodes[k, 1, i] = self.accelerations[i] if self.stiff is None else 0.0
        if self.activations is not None:
            self.activations.begin(h, 3)
        if self.stiff is not None:
            self.stiff.update()
            self.acting = np.array((self.stiff.acting(),) * 3)
        return 0

    cdef double evaluate_nodes(self, step, double start_s, double h, bint again) except -1.0:
        """Replace the accelerations by those under the forces at the nodes; returns how much activations have changed."""
        cdef Py_ssize_t i, k
        cdef size_t size = self.nodes.shape[2] * sizeof(double)
        cdef double change = 0.0
        self.begin_work()
        memcpy(&self.before[0, 0, 0], &self.nodes[0, 0, 0], 6 * size)
        for k in range(3):
            # In later passes a stage replaces the one that was kept in its place, so that integrals count each node once.
            step.node, self.repeats = k, k - 3 if again else 0
            self.d.time = start_s + h * _PLACES[k]
            self.set_state(1.0, &self.increments[k, 0, 0])
            if self.activations is not None:
                self.activations.move_to_node(h * _PLACES[k], step.weights[k])
            self.update()
            memcpy(&self.nodes[k, 1, 0], &self.accelerations[0], size)
            self.add_work(_IMPLICIT_WEIGHTS[k])
            if self.activations is not None:
                change = max(change, h * self.activations.set_node(k))
            if self.stiff is not None:
                self.acting[k] = self.stiff.acting()
        return change

    cdef bint correct_nodes(self, step, double h) except -1:
        """Correct the accelerations by stiff forces, then by Newton's method; returns whether the former have a solution."""
        cdef Py_ssize_t i, k
        cdef bint solved = True
        cdef double[:, ::1] changes
        if step.stiff is not None:
            corrections = step.stiff.corrections(step, np.ascontiguousarray(self.nodes.base[:, 1]))
            solved = corrections is not None
            if solved:
                changes = corrections
                for k in range(3):
                    for i in range(self.rates.shape[0]):
                        self.nodes[k, 1, i] += changes[k, i]
            if self.stiff is not None and not self.has_active_rows:
                self.stiff.hold(*step.stiff.active_rows())
                self.has_active_rows = True
        if self.stiff is not None:
            for k in range(3):
                for i in range(self.rates.shape[0]):
                    # The residual includes what stiff friction has corrected already, so both corrections lead to one
                    # solution.
                    self.differences[k, i] = self.nodes[k, 1, i] - self.before[k, 1, i]
            changes = self.stiff.correction(h, self.residuals, self.acting)
            for k in range(3):
                for i in range(self.rates.shape[0]):
                    self.nodes[k, 1, i] = self.before[k, 1, i] + changes[k, i]
        return solved

    cdef double end_pass(self, const double[:, ::1] weights) except -1.0:
        """Set the rates by the accelerations; returns the largest change of the increments over 1 + the largest rate.

        It is not finite if one of them is not.
        """
        cdef Py_ssize_t i, j, k, n = self.rates.shape[0]
        cdef double total, largest = 0.0, fastest = 0.0, not_finite = 0.0
        for k in range(3):
            for i in range(n):
                total = 0.0
                for j in range(3):
                    total += weights[k, j] * self.nodes[j, 1, i]
                self.nodes[k, 0, i] = self.start_qvel[i] + total
                fastest = max(fastest, fabs(self.nodes[k, 0, i]))
            for j in range(self.turning.shape[0]):
                # Rates of rotation vectors, not angular velocities, are integrated: their sum is a rotation again
                # (Munthe-Kaas).
                rotation_vector_rate(&self.increments[k, 0, self.turning[j]], &self.nodes[k, 0, self.turning[j]])
        memcpy(&self.before[0, 0, 0], &self.increments[0, 0, 0], 6 * n * sizeof(double))
        self.add_up(self.nodes, weights)
        for k in range(3):
            for j in range(2):
                for i in range(n):
                    total = self.increments[k, j, i] - self.before[k, j, i]
                    # A maximum with NaN may forget it; zero times a number that is not finite is NaN, and its sum stays so.
                    largest, not_finite = max(largest, fabs(total)), not_finite + 0.0 * total
        return largest / (1.0 + fastest) + not_finite

    cdef void add_up(self, const double[:, :, ::1] slopes, const double[:, ::1] weights) noexcept:
        """Increments at the nodes from rates and accelerations there."""
        cdef Py_ssize_t i, j, k
        for k in range(3):
            for j in range(2):
                for i in range(self.rates.shape[0]):
                    self.increments[k, j, i] = (
                        weights[k, 0] * slopes[0, j, i] + weights[k, 1] * slopes[1, j, i] + weights[k, 2] * slopes[2, j, i]
                    )

    cdef int begin_work(self) except -1:
        """Begin the integrals over the stages: work of actuators, work and impulses of fields."""
        if self.power is not None:
            self.power.clear()
        if self.field is not None:
            self.field.begin()
        return 0

    cdef int add_work(self, double weight) except -1:
        """Add a stage to them with its weight."""
        if self.power is not None:
            self.power.add(weight)
        if self.field is not None:
            self.field.add(weight)
        return 0

    cdef int end_work(self, double duration_s) except -1:
        """End them with a step of a duration."""
        if self.power is not None:
            self.power.end(duration_s)
        if self.field is not None:
            self.field.end(duration_s)
        return 0

    cdef int end_stage(self, double weight) except -1:
        """Add power and rates of activations of a stage with its weight."""
        self.add_work(weight)
        if self.activations is not None:
            self.activations.add(weight)
        return 0

    cdef void set_state(self, double after_s, const double* slope) noexcept:
        """Set the state reached from the start of the step with constant rates and accelerations, (2, nv)."""
        cdef Py_ssize_t i, n = self.rates.shape[0]
        memcpy(&self.qpos[0], &self.start_qpos[0], self.qpos.shape[0] * sizeof(double))
        # From the start of the step in one rotation: quaternions stay unit, and the order is that of the method.
        mj.integratePos(self.m, &self.qpos[0], slope, after_s)
        for i in range(n):
            self.rates[i] = self.start_qvel[i] + after_s * slope[n + i]

    cdef int evaluate(self, double after_s, const double* slope, double* out) except -1:
        """Evaluate one stage: rates and accelerations at the state that given ones lead to, (2, nv) each."""
        cdef Py_ssize_t i, j, first, n = self.rates.shape[0]
        cdef double[3] turned
        self.set_state(after_s, slope)
        if self.activations is not None:
            self.activations.move_to(after_s)
        self.update()
        memcpy(out, &self.rates[0], n * sizeof(double))
        memcpy(out + n, &self.accelerations[0], n * sizeof(double))
        for j in range(self.turning.shape[0]):
            first = self.turning[j]
            for i in range(3):
                turned[i] = after_s * slope[first + i]
            rotation_vector_rate(turned, out + first)
        return 0

    cpdef bint step(self, double duration_s) except? -1:
        """Integrate for a time; returns whether the motion bound excludes any event."""
        before = self.bands.values() if self.bands is not None else None
        mj.getState(self.m, self.d, &self.state[0], _WHOLE_STATE)
        self.update_forces()
        self.integrate_step(duration_s)
        # RK4 loses its order at a kink: the integrator ends the step there (``_to_kink``).
        self.kinked = self.power is not None and self.power.kinked
        if self.activations is not None and not self.kinked:
            self.kinked = self.activations.is_kinked(duration_s)
        if self.bands is not None and not self.kinked:
            self.kinked = self.bands.are_passed(before)
        return self.add(duration_s)
