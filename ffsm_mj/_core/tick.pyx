# cython: boundscheck=False, wraparound=False
"""What every control tick and every step need: copies of live arrays into a row, limits of efforts, and their work."""

import numpy as np

from libc.math cimport floor, isfinite, isnan, NAN
from libc.stdlib cimport calloc, free
from libc.string cimport memcpy

from ffsm_mj._core.functions cimport address, mj, mjData, mjModel, mjOBJ_SITE


cdef class OnSample:
    """What is to be done at a sample before anything is copied."""

    def __call__(self, double time_s):
        """Do it at a time, s."""
        self.sample(time_s)

    cdef int sample(self, double time_s) except -1:
        raise NotImplementedError


cdef class Clock(OnSample):
    """Writes the time into an array, (1,)."""

    cdef double[::1] time

    def __init__(self, double[::1] time not None):
        self.time = time

    cdef int sample(self, double time_s) except -1:
        self.time[0] = time_s
        return 0


cdef class Maxima(OnSample):
    """Passes on the largest values since the sample before, and begins again at zero."""

    cdef double[::1] since, logged

    def __init__(self, double[::1] since not None, double[::1] logged not None):
        if len(since) != len(logged):
            raise ValueError(f"{len(since)} values for an array of {len(logged)}")
        self.since, self.logged = since, logged

    cdef int sample(self, double time_s) except -1:
        cdef Py_ssize_t i
        for i in range(self.since.shape[0]):
            self.logged[i], self.since[i] = self.since[i], 0.0
        return 0


cdef class ServoSample(OnSample):
    """Writes the forces of servos before and after the limits of their model files, under the current controls."""

    cdef const mjModel* m
    cdef const mjModel* unlimited
    cdef mjData* d
    cdef const Py_ssize_t[::1] servos
    cdef const double[::1] gear
    cdef const double[:, ::1] ranges
    cdef double[::1] force
    cdef double[:, ::1] forces
    cdef object keep

    def __init__(self, model, unlimited, data, const Py_ssize_t[::1] servos not None, gear, ranges, forces):
        """Bind to the system.

        Args:
            model: MuJoCo model.
            unlimited: The same without limits of forces; None: the model has none.
            data: Its data, derived quantities current at each sample.
            servos: Ids of the servos, (n,).
            gear: Force at the joint or along the tendon per force of each, (n,).
            ranges: Least and greatest force that its joint allows, (n, 2).
            forces: Receives the forces before and after the limits, (n, 2).
        """
        if not len(servos) == len(gear) == len(ranges) == len(forces):
            raise ValueError(f"{len(servos)} servos, {len(gear)} gears, {len(ranges)} ranges and {len(forces)} forces")
        self.m, self.d, self.keep = <const mjModel*>address(model), <mjData*>address(data), (model, unlimited, data)
        self.unlimited = <const mjModel*>address(unlimited) if unlimited is not None else NULL
        self.servos, self.gear, self.ranges, self.forces = servos, gear, ranges, forces
        self.force = data.actuator_force

    cdef int sample(self, double time_s) except -1:
        cdef Py_ssize_t i, n = self.servos.shape[0]
        # MuJoCo clamps in the same call: only a model without limits gives the force before the clamp.
        if self.unlimited != NULL:
            mj.fwdActuation(self.unlimited, self.d)
            for i in range(n):
                self.forces[i, 0] = self.force[self.servos[i]] * self.gear[i]
        mj.fwdActuation(self.m, self.d)
        for i in range(n):
            # The limit of a joint is on the sum of what acts on it: the same where a servo is alone.
            self.forces[i, 1] = min(max(self.force[self.servos[i]] * self.gear[i], self.ranges[i, 0]), self.ranges[i, 1])
            if self.unlimited == NULL:
                self.forces[i, 0] = self.forces[i, 1]
        return 0


cdef double ROUNDING = 1e-9  # relative, of the time of a sample


cdef class Periodically(OnSample):
    """Calls a function in the first sample, and whenever a multiple of a period has passed since the sample before.

    Whether one has is a function of both times alone, so that a log replay calls it at the same samples.

    Attributes:
        last_s: Time of the last sample, s; NaN before the first.
        is_resumed: Whether the values of the next sample are there already.
    """

    cdef public double last_s
    cdef public bint is_resumed
    cdef double period_s
    cdef object function

    def __init__(self, double period_s, function):
        self.period_s, self.function = period_s, function
        self.resume(False)

    def resume(self, bint with_values):
        """Begin at the next sample, whose values are there already if they were logged with it."""
        self.last_s, self.is_resumed = float("nan"), with_values

    cdef double periods(self, double time_s) noexcept:
        # A multiple of the period that is early by rounding counts as reached: else a run and its replay could sample
        # differently.
        return floor(time_s / self.period_s * (1.0 + ROUNDING) + ROUNDING)

    cdef int sample(self, double time_s) except -1:
        cdef bint due = isnan(self.last_s) or self.periods(time_s) > self.periods(self.last_s)
        due, self.is_resumed, self.last_s = due and not self.is_resumed, False, time_s
        if due:
            self.function()
        return 0


cdef class Sampler:
    """Samples live arrays, after a refresh of the quantities that MuJoCo does not keep current."""

    def __init__(self, model, data, *, int base=-1, int tip=-1):
        self.m, self.d, self.base, self.tip = <const mjModel*>address(model), <mjData*>address(data), base, tip
        self.jacp, self.jacr, self.twist = np.zeros((3, model.nv)), np.zeros((3, model.nv)), np.zeros(6)
        self.p, self.r, self.v = self.jacp, self.jacr, self.twist
        self.keep = model, data

    def __dealloc__(self):
        free(self.copies)

    def copy(self, copies):
        """Set what is copied: pairs of a live array and its table, one axis longer; lines of tables are contiguous.

        Raises:
            ValueError: An array is not of contiguous doubles, or does not fit into its table.
        """
        cdef size_t live_place, table_place
        cdef int i
        copies = tuple((live, table) for live, table in copies if live.size)
        for live, table in copies:
            line = table[0]
            both = live.dtype == table.dtype == np.float64 and live.flags.c_contiguous and line.flags.c_contiguous
            # Copies below are of bytes: another type or stride would be copied as rubbish, or past the end.
            if not both or live.shape != line.shape or not table.flags.writeable:
                raise ValueError(f"cannot copy {live.dtype} {live.shape} into lines of {table.dtype} {line.shape}")
        self.count = 0
        free(self.copies)
        self.copies = <Copy*>calloc(max(len(copies), 1), sizeof(Copy))
        if self.copies == NULL:
            raise MemoryError
        self.count, self.keep = len(copies), (self.keep[0], self.keep[1], copies)
        for i, (live, table) in enumerate(copies):
            live_place, table_place = live.ctypes.data, table.ctypes.data
            self.copies[i].live, self.copies[i].table = <const char*>live_place, <char*>table_place
            self.copies[i].size, self.copies[i].stride = live.nbytes, table.strides[0]
            self.copies[i].lines = len(table)

    cpdef int take(self, size_t line) except -1:
        """Refresh, and copy into a line of the tables.

        Raises:
            IndexError: A table has no such line.
        """
        cdef int i
        cdef Copy* one
        if self.base >= 0:
            # Steps do not need the momentum of the robot and the Jacobian of its base, so MuJoCo does not keep them current.
            mj.subtreeVel(self.m, self.d)
            mj.jacBody(self.m, self.d, &self.p[0, 0], &self.r[0, 0], self.base)
        if self.tip >= 0:
            mj.objectVelocity(self.m, self.d, mjOBJ_SITE, self.tip, &self.v[0], 0)
        for i in range(self.count):
            one = &self.copies[i]
            # memcpy asks nobody: a line too far would write into other memory.
            if line >= one.lines:
                raise IndexError(f"line {line} of a table of {one.lines}")
            memcpy(one.table + line * one.stride, one.live, one.size)
        return 0


cdef class Collect(OnSample):
    """Copies what a sampler copies into the first line of its tables."""

    cdef Sampler sampler

    def __init__(self, Sampler sampler not None):
        self.sampler = sampler

    cdef int sample(self, double time_s) except -1:
        self.sampler.take(0)
        return 0


cdef class RowFiller:
    """Fills a line of a block of rows."""

    def __init__(self, Sampler sampler not None, on_sample):
        self.sampler, self.on_sample = sampler, tuple(on_sample)

    cpdef int fill(self, size_t line, double time_s) except -1:
        """Do what is to be done at a sample, and copy; derived quantities must be current."""
        for callback in self.on_sample:
            if isinstance(callback, OnSample):
                (<OnSample>callback).sample(time_s)
            else:
                callback(time_s)
        return self.sampler.take(line)


cdef class StageWork:
    """Enters what the stages of each (sub-)step have integrated: work or impulse of actuators, or of external fields."""

    cdef const double[::1] done
    cdef double[::1] account

    def __init__(self, done, account):
        """Bind to what was done in the last (sub-)step, and to the account of the same shape that receives it."""
        if done.shape != account.shape or not (done.flags.c_contiguous and account.flags.c_contiguous):
            raise ValueError(f"an account of shape {account.shape} for values of shape {done.shape}")
        self.done, self.account = done.reshape(-1), account.reshape(-1)

    def open(self):
        """Begin a (sub-)step."""

    cpdef int close(self, double duration_s) except -1:
        """End the step."""
        cdef Py_ssize_t i
        for i in range(self.done.shape[0]):
            self.account[i] += self.done[i]
        return 0


cdef class StepWork:
    """Accumulates the work of actuators on joints over each (sub-)step, and has other parts accumulate theirs."""

    def __init__(
        self,
        data,
        const double[::1] on_joint,
        const double[::1] external,
        double[::1] account not None,
        double[::1] gained not None,
        double[::1] contact not None,
        double[::1] fixed not None,
        always=(),
        outside=(),
    ):
        if not len(data.ctrl) == len(on_joint) == len(external) or len(account) == 0:
            raise ValueError(f"{len(on_joint)} and {len(external)} flags and an account of {len(account)} do not fit the actuators")
        self.ctrl, self.length, self.force = data.ctrl, data.actuator_length, data.actuator_force
        self.on_joint, self.external, self.account = on_joint, external, account
        self.start, self.always, self.outside = data.actuator_length.copy(), tuple(always), tuple(outside)
        self.working = self.pushed = False
        if not len(gained) == 3 or not len(contact) == 6 or not len(fixed) == 12:
            raise ValueError(f"{len(gained)}, {len(contact)} and {len(fixed)} numbers for 3 energies and three impulses")
        self.gained, self.contact, self.fixed = gained, contact, fixed

    def enter(self, energy, contact, fixed):
        """Enter an exchange: energies of three subsystems, impulse of the robot on objects, impulses of fixed bodies, (2, 6)."""
        cdef double[::1] every = np.concatenate((energy, contact, np.ravel(fixed)), dtype=np.float64)
        if len(energy) != 3 or len(contact) != 6 or len(every) != 21:
            raise ValueError(f"an exchange of {len(energy)} energies, {len(contact)} numbers of contacts, {len(every)} in all")
        self.add(&every[0], &every[3], &every[9])

    cdef void add(self, const double* energy, const double* contact, const double* fixed) noexcept:
        cdef int i
        for i in range(3):
            self.gained[i] += energy[i]
        for i in range(6):
            self.contact[i] += contact[i]
        for i in range(12):
            self.fixed[i] += fixed[i]

    cpdef int open(self) except -1:
        """Begin a step: parts outside take part if an effort in it is external."""
        cdef Py_ssize_t i
        for part in self.always:
            if not isinstance(part, StageWork):
                part.open()
        self.working = self.pushed = False
        for i in range(self.ctrl.shape[0]):
            self.start[i] = self.length[i]
            # Actuators without effort do no work, and parts that only serve external ones need not be asked.
            if self.ctrl[i] != 0.0:
                self.working = True
                self.pushed = self.pushed or self.external[i] != 0.0
        if self.pushed:
            for part in self.outside:
                part.open()
        return 0

    cpdef int close(self, double duration_s) except -1:
        """End the step, after so many seconds, and add its work."""
        cdef Py_ssize_t i
        cdef double work = 0.0
        if self.working:
            for i in range(self.ctrl.shape[0]):
                # An effort that is constant over the step does work in proportion to the travel: exact, whatever the motion
                # in between is.
                work += self.force[i] * self.on_joint[i] * (self.length[i] - self.start[i])
            self.account[0] += work
        for part in self.always:
            if isinstance(part, StageWork):
                (<StageWork>part).close(duration_s)
            else:
                part.close(duration_s)
        if self.pushed:
            for part in self.outside:
                part.close(duration_s)
        return 0


cdef class Limits:
    """Converts a command to efforts within their bounds, and to ``ctrl``."""

    def __init__(self, bounds, double[::1] effort, powered, double[::1] velocity, double[:, ::1] table, double[::1] ctrl):
        sizes = {len(x) for x in (effort, powered, velocity, table, ctrl, *vars(bounds).values())}
        if len(sizes) != 1 or table.shape[1] != 4:
            raise ValueError(f"arrays of {sorted(sizes)} actuators do not fit together")
        self.effort, self.powered, self.velocity = effort, powered.view(np.uint8), velocity
        self.table, self.ctrl = table, ctrl
        self.low, self.high, self.stall = bounds.low, bounds.high, bounds.stall
        self.slope, self.saturation, self.gear = bounds.slope, bounds.saturation, bounds.gear
        self.keeps = bounds.keeps.view(np.uint8)

    cpdef bint apply(self) except? -1:
        """Compute the table and ``ctrl``; returns False, with the commands only, if a powered effort is not finite."""
        cdef Py_ssize_t i, count = self.ctrl.shape[0]
        cdef double wanted, lower, upper, applied, drag, speed
        cdef bint finite = True
        for i in range(count):
            # A servo without a new command keeps its setpoint; a motor is off.
            wanted = self.effort[i] if self.powered[i] else self.table[i, 0] if self.keeps[i] else 0.0
            self.table[i, 0] = wanted
            finite = finite and isfinite(wanted)
        # MuJoCo would reset the state to that of the model file; the caller reports the actuator instead.
        if not finite:
            return False
        for i in range(count):
            # The torque-speed line shifts both bounds; without a slope they are constant.
            drag, speed = self.velocity[i] * self.slope[i], self.velocity[i] / self.gear[i]
            lower, upper = -self.stall[i] - drag, self.stall[i] - drag
            lower = self.low[i] if lower < self.low[i] else lower
            upper = self.high[i] if upper > self.high[i] else upper
            # A saturated wheel takes no more speed in its own sense: its motor can only brake it.
            lower = 0.0 if speed <= -self.saturation[i] else lower
            upper = 0.0 if speed >= self.saturation[i] else upper
            wanted = self.table[i, 0]
            applied = lower if wanted < lower else wanted
            applied = upper if applied > upper else applied
            # Bounds of a fast motor may exclude zero; without power no current flows, and no torque acts.
            applied = applied if self.powered[i] or self.keeps[i] else 0.0
            self.table[i, 1], self.table[i, 2], self.table[i, 3] = applied, lower, upper
            self.ctrl[i] = applied / self.gear[i]
        return True


cdef class SteadyForces:
    """Forces that act in steps of the core while nothing about them changes but their size."""

    cpdef bint goes_on(self, double left_s=NAN) except -1:
        """Begin a step of a duration in s, if nothing changes at the state in ``data``; returns whether it has begun."""
        raise NotImplementedError

    cdef bint exchange_into(self, double duration_s, double* sums) except -1:
        """End the step; energies, impulse of the robot, and impulses of fixed bodies, (21,); returns whether nothing changed."""
        raise NotImplementedError


cdef class TickLaw:
    """What commands efforts at control ticks that the core takes."""

    cdef bint command(self, Limits limits) except -1:
        """Command efforts at the state in ``data``, and apply them within limits; returns whether that is possible here."""
        raise NotImplementedError

    cdef bint arrives(self) except -1:
        """Whether the state at which the last step of a tick ends is that from which the next tick goes on."""
        return True
