# cython: boundscheck=False, wraparound=False, cdivision=True
"""Contact forces in the stages of a step: the smooth forces, a stage in one block of memory, and integrals over a step."""

cimport cython

from typing import NamedTuple

import numpy as np

from ffsm_mj.balance.exchange import Exchange

from cpython.bytes cimport PyBytes_FromStringAndSize
from libc.math cimport hypot, sqrt
from libc.string cimport memcmp, memcpy, memset

from ffsm_mj._core.functions cimport address, mj, mjData, mjModel
from ffsm_mj._core.memory cimport numbers, zeros
from ffsm_mj._core.rows cimport RowMemory


class Slide(NamedTuple):
    """Points of which at least one slides with friction: heat at each, W, and slip speed of each sliding one, m/s, (k,)."""

    heat: object
    speeds: object


cdef bytes copied(double[::1] values):
    """A token: a new object that a saved state can hold."""
    return PyBytes_FromStringAndSize(<char*>&values[0], values.shape[0] * <Py_ssize_t>sizeof(double))


cdef bint same(double[::1] values, double[::1] last) noexcept:
    """Whether values are the last ones; those become the last ones."""
    cdef size_t size = values.shape[0] * sizeof(double)
    # Bit by bit: a comparison with a tolerance would give a state the forces of another one, and a replay other ones than
    # the run.
    if not size or memcmp(&values[0], &last[0], size) == 0:
        return True
    memcpy(&last[0], &values[0], size)
    return False


cdef class Smooth:
    """State and smooth forces of a motion."""

    def __init__(self, motion, seen):
        data = motion.data
        self.seen = seen
        self.motion, self.m, self.d = motion, <const mjModel*>address(motion.model), <mjData*>address(data)
        self.qpos, self.qvel, self.ctrl, self.data_ctrl = data.qpos, data.qvel, seen.ctrl, data.ctrl
        self.passive, self.bias, self.actuator = data.qfrc_passive, data.qfrc_bias, data.qfrc_actuator
        self.follows, self.act = data is not seen, data.act
        # No state is the last one yet: NaN has many bit patterns, and the efforts of a run are not this one.
        self.last_qpos, self.last_qvel, self.last_ctrl, self.last_pushes, self.last_act = (
            np.full(len(values), np.nan) for values in (data.qpos, data.qvel, seen.ctrl, data.qvel, data.act)
        )
        self.last_kinematics, self.last_load = copied(self.qpos), copied(self.qvel)

    cpdef object kinematics(self):
        """Token of the current positions and velocities: the same object while they are the same bit by bit."""
        cdef bint stays = same(self.qpos, self.last_qpos)
        # Both are compared in any case, as the comparison keeps the present values.
        if not same(self.qvel, self.last_qvel) or not stays:
            self.last_kinematics = copied(self.qpos)
        return self.last_kinematics

    cpdef object load(self, double[::1] pushes):
        """The same of the current efforts and activations, and of applied forces, (nv,)."""
        cdef bint stays = same(self.ctrl, self.last_ctrl)
        stays = same(self.act, self.last_act) and stays
        if not same(pushes, self.last_pushes) or not stays:
            self.last_load = copied(pushes)
        return self.last_load

    cpdef object state(self, double[::1] pushes):
        """The same of the positions, velocities, efforts and applied forces."""
        kinematics, load = self.kinematics(), self.load(pushes)
        if self.last_state is None or self.last_state[0] is not kinematics or self.last_state[1] is not load:
            self.last_state = kinematics, load
        return self.last_state

    cpdef object force(self, double[::1] pushes):
        """Generalised forces less the bias, including applied forces ``pushes``, (nv,); positions and velocities current."""
        total = np.empty(self.qvel.shape[0])
        cdef double[::1] force = total
        if force.shape[0]:
            self.write_force(&pushes[0], &force[0])
        return total

    cdef void write_force(self, const double* pushes, double* force) noexcept:
        cdef Py_ssize_t i
        if self.follows:
            self.data_ctrl[:] = self.ctrl
        # Efforts may have been decided since the last stage; all other forces are those of the state.
        mj.fwdActuation(self.m, self.d)
        for i in range(self.qvel.shape[0]):
            force[i] = self.passive[i] - self.bias[i] + self.actuator[i] + pushes[i]


@cython.no_gc  # no cycle contains it
cdef class StageInMemory:
    """Forces along the rows, (r,), their power by degree of freedom, (nv,), and wrenches on each group of points, (g, 6)."""

    @property
    def forces(self):
        """Normal forces, N, (k,)."""
        return np.frombuffer(self.block)[: self.count : 3]

    @property
    def power(self):
        """Power of the contact forces by degree of freedom, W, (nv,)."""
        return np.frombuffer(self.block)[self.count : self.count + self.nv]

    @property
    def wrenches(self):
        """Force, and moment about the world origin, on geom b of each group of points of one pair."""
        return np.frombuffer(self.block)[self.count + self.nv : self.count + self.nv + 6 * self.groups].reshape(-1, 6)

    @property
    def slide(self):
        """Heat and slip of the points; None where none slides with friction."""
        if not self.any_sliding:
            return None
        start, k = self.count + self.nv + 6 * self.groups, self.count // 3
        return Slide(*np.frombuffer(self.block)[start : start + 2 * k].reshape(2, k))

    cdef void write_slide(self, RowMemory memory, const unsigned char[::1] sliding) noexcept:
        """Write heat and slip of the points; their velocities are those of the rows."""
        cdef Py_ssize_t p
        cdef double u, v
        for p in range(memory.points):
            self.heats[p] = self.speeds[p] = 0.0
            if sliding[p]:
                u, v = memory.velocity(3 * p + 1), memory.velocity(3 * p + 2)
                # Friction opposes the slip, so its power is negative: what leaves the motion is heat.
                self.heats[p] = -(self.along[3 * p + 1] * u + self.along[3 * p + 2] * v)
                self.speeds[p] = hypot(u, v)


cdef StageInMemory new_stage(bytearray block, Py_ssize_t count, Py_ssize_t nv, Py_ssize_t groups, bint any_sliding):
    cdef StageInMemory stage = StageInMemory.__new__(StageInMemory)
    stage.block, stage.count, stage.nv, stage.groups = block, count, nv, groups
    stage.any_sliding, stage.along = any_sliding, numbers(block)
    stage.powers, stage.wrenches = stage.along + count, stage.along + count + nv
    stage.heats = stage.wrenches + 6 * groups
    stage.speeds = stage.heats + count // 3
    return stage


cdef StageInMemory empty_stage(Py_ssize_t count, Py_ssize_t nv, Py_ssize_t groups, bint any_sliding):
    """A stage without forces."""
    size = count + nv + 6 * groups + (2 * (count // 3) if any_sliding else 0)
    return new_stage(zeros(size + 1), count, nv, groups, any_sliding)


cdef void generalise(const double* along, RowMemory memory, double* generalised) noexcept:
    """Generalised forces, (nv,), of forces along rows."""
    cdef Py_ssize_t i, d, nv = memory.nv
    cdef const double* J
    memset(generalised, 0, nv * sizeof(double))
    for i in range(memory.rows):
        # Tangents without friction carry nothing, and their rows are zeros.
        if along[i] != 0.0:
            J = memory.J + i * nv
            for d in range(nv):
                generalised[d] += along[i] * J[d]


cdef int finish_stage(StageInMemory stage, RowMemory memory, const double* qvel, const double* generalised) except -1:
    """Write power and wrenches of the forces of a stage."""
    cdef Py_ssize_t d
    for d in range(memory.nv):
        stage.powers[d] = generalised[d] * qvel[d]
    return memory.write_resultants(stage.along, stage.wrenches)


# A force falls below its bound where a parabola is predicted within this share of its depth above it: a tenth of its sag.
cdef double _NEAR = 0.025


cdef const double* along_rows(stage) except NULL:
    """Forces along the rows in a stage, which keeps them."""
    cdef const double[::1] along
    if isinstance(stage, StageInMemory):
        return (<StageInMemory>stage).along
    along = stage.along
    return &along[0]


cdef inline double inside(const double* force, double mu) noexcept nogil:
    """How far a force (n, t1, t2) is inside its bounds, N: a normal force pushes, of a point that sticks in its cone."""
    return force[0] - (hypot(force[1], force[2]) / mu if mu > 0.0 else 0.0)


def dip(list stages not None, const double[::1] stick_mu not None):
    """First share of a step of RK4 at which a force may be outside its bounds although it is inside at both ends; 0: none.

    The middle of the parabola through start, middle and end is the mean of both stages there. One errs by -h^2 a / 8, the
    other by as much with the other sign: the mean is exact to third order, in the positions as in the velocities.

    Args:
        stages: The stages of the step, and the evaluation at its end.
        stick_mu: Coefficients of friction of points that stick; zero at the others, (k,).
    """
    cdef const double* forces[5]
    cdef Py_ssize_t p
    cdef int s
    cdef double start, middle, end, bend, slope, first = 1.0
    # Only a step of RK4 has two stages in its middle; an implicit step is tested at its ends.
    if len(stages) != 5:
        return 0.0
    for s in range(5):
        forces[s] = along_rows(stages[s])
    for p in range(stick_mu.shape[0]):
        start, end = inside(forces[0] + 3 * p, stick_mu[p]), inside(forces[4] + 3 * p, stick_mu[p])
        # Out of bounds at an end: the event is found there.
        if start < 0.0 or end < 0.0:
            continue
        middle = 0.5 * (inside(forces[1] + 3 * p, stick_mu[p]) + inside(forces[2] + 3 * p, stick_mu[p]))
        bend, slope = 2.0 * (start + end) - 4.0 * middle, 4.0 * middle - 3.0 * start - end
        # A minimum inside the step, at or nearly below zero: the state there is looked at, as the parabola only predicts.
        if slope < 0.0 and slope + 2.0 * bend > 0.0 and start - 0.25 * slope * slope / bend < _NEAR * bend:
            first = min(first, -0.5 * slope / bend)
    return first if first < 1.0 else 0.0


cdef class StageSums:
    """Integrals over a step of the contact forces in its stages."""

    cdef readonly object work, impulses
    cdef readonly double total
    cdef readonly list sizes

    def __init__(self, stages, const double[::1] parts not None):
        cdef StageInMemory first = stages[0] if isinstance(stages[0], StageInMemory) else None
        cdef Py_ssize_t groups = first.groups if first is not None else len(stages[0].wrenches)
        cdef Py_ssize_t nv = first.nv if first is not None else len(stages[0].power)
        cdef Py_ssize_t s, i
        self.work, self.impulses, self.total = np.zeros(nv), np.zeros((groups, 6)), 0.0
        cdef double[::1] work = self.work
        cdef double[:, ::1] impulses = self.impulses
        cdef const double[::1] power
        cdef double[:, ::1] wrenches
        cdef StageInMemory stage
        self.sizes = [0.0] * groups
        for s in range(parts.shape[0]):
            # Stages of implicit steps, of loops and of other features are objects of Python with the same numbers.
            if isinstance(stages[s], StageInMemory):
                stage = stages[s]
                self.add(parts[s], stage.powers, &work[0], nv, stage.wrenches, &impulses[0, 0] if groups else NULL, groups)
            else:
                power, wrenches = stages[s].power, np.array(stages[s].wrenches, dtype=np.float64).reshape(-1, 6)
                self.add(
                    parts[s], &power[0], &work[0], nv, &wrenches[0, 0] if groups else NULL, &impulses[0, 0] if groups else NULL, groups
                )
        for i in range(nv):
            self.total += work[i]

    cdef int add(
        self,
        double part,
        const double* power,
        double* work,
        Py_ssize_t nv,
        const double* wrenches,
        double* impulses,
        Py_ssize_t groups,
    ) except -1:
        """Add a stage with its weight."""
        cdef Py_ssize_t i, g
        for i in range(nv):
            work[i] += part * power[i]
        for i in range(6 * groups):
            impulses[i] += part * wrenches[i]
        for g in range(groups):
            # The integral of the size: impulses of opposite forces within a step must not cancel in the log.
            self.sizes[g] += part * sqrt(
                wrenches[6 * g] * wrenches[6 * g]
                + wrenches[6 * g + 1] * wrenches[6 * g + 1]
                + wrenches[6 * g + 2] * wrenches[6 * g + 2]
            )
        return 0

    def exchange(self, const double[::1] from_robot not None, const double[:, ::1] outside not None, robot):
        """Energy and momentum exchanged between the subsystems."""
        cdef const double[::1] work = self.work
        cdef const double[:, ::1] impulses = self.impulses
        cdef Py_ssize_t i, g
        totals = np.zeros(21)
        cdef double[::1] sums = totals
        for i in range(<Py_ssize_t>robot.start, <Py_ssize_t>robot.stop):
            sums[1] += work[i]
        # What the robot does not gain the objects do: both add up to the total exactly.
        sums[0], sums[2] = self.total, self.total - sums[1]
        for g in range(impulses.shape[0]):
            for i in range(6):
                sums[3 + i] += from_robot[g] * impulses[g, i]
                sums[9 + i] += outside[0, g] * impulses[g, i]
                sums[15 + i] += outside[1, g] * impulses[g, i]
        return Exchange(totals[:3], totals[3:9], totals[9:].reshape(2, 6))
