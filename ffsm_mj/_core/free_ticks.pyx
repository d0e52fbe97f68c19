# cython: boundscheck=False, wraparound=False
"""Control ticks of a motion on which nothing acts but actuators, one after the other without Python, until something happens.

The parts are those of the loop (:mod:`ffsm_mj.simulation.loop`), and so is their order. What is not of the core is called
where the loop would call it: a control law in Python, balances of springs or thrusters, sensors, columns of a plug-in.
"""

from time import monotonic

from cpython.exc cimport PyErr_CheckSignals
from libc.math cimport isfinite

from ffsm_mj._core.functions cimport address, mj, mjData, mjModel
from ffsm_mj._core.steppers cimport FreeStepper
from ffsm_mj._core.tick cimport Limits, RowFiller, SteadyForces, StepWork, TickLaw
from ffsm_mj._core.travel cimport Travel


cdef class FreeTicks:
    """Takes control ticks, and counts them.

    Attributes:
        ticks: Control ticks begun since the start of the run.
        steps: Steps completed.
        line: Line of the next row in its block.
        evaluations: Evaluations of a law of the core since :meth:`begin`.
        law_s: Wall time that they took, s.
    """

    cdef readonly Py_ssize_t ticks, steps, line, evaluations
    cdef readonly double law_s
    cdef bint has_stepped
    cdef RowFiller rows
    cdef StepWork work
    cdef const mjModel* watched
    cdef mjData* d
    cdef object data, recorder, watched_model, look, count
    cdef dict overlaps
    cdef tuple after_step, travels
    cdef double step_s, bound_within
    cdef Py_ssize_t steps_per_tick

    def __init__(
        self,
        data,
        recorder,
        RowFiller rows not None,
        StepWork work not None,
        *,
        watched,
        dict overlaps not None,
        look,
        count,
        after_step,
        double step_s,
        Py_ssize_t steps_per_tick,
    ):
        self.data, self.d, self.recorder, self.rows, self.work = data, <mjData*>address(data), recorder, rows, work
        self.watched_model, self.watched = watched, NULL if watched is None else <const mjModel*>address(watched)
        self.overlaps, self.look, self.count, self.after_step = overlaps, look, count, tuple(after_step)
        self.step_s, self.steps_per_tick = step_s, steps_per_tick

    def begin(self, Py_ssize_t ticks, Py_ssize_t steps, Py_ssize_t line):
        """Begin at a control tick that is due."""
        self.ticks, self.steps, self.line, self.evaluations, self.law_s = ticks, steps, line, 0, 0.0
        self.has_stepped = False

    def pass_step(self):
        """Whether the last step was made and is not completed; the caller completes it."""
        has_stepped, self.has_stepped = self.has_stepped, False
        return has_stepped

    def take(
        self,
        move,
        FreeStepper stepper not None,
        SteadyForces forces,
        double event_bound,
        tuple travels not None,
        double bound_within,
        law,
        Limits limits,
        *,
        decide,
        interrupted,
        report,
        list warnings not None,
        Py_ssize_t ticks,
        Py_ssize_t lines,
        double until_s,
        double clock,
    ):
        """Take control ticks until an event is possible, or a limit is reached.

        Args:
            move: Makes a step of the motion of a given duration, where that is more than a step of the stepper, or None.
            stepper: Stepper of the motion.
            forces: All of its applied forces; None: there are none.
            event_bound: Motion bound from which other events are possible.
            travels: Motions of the coordinates.
            bound_within: The same bound while all these are within their reach.
            law: The law in charge, of the core; None: ``decide`` evaluates it.
            limits: Limits of its efforts.
            decide: Evaluates the controller at a time; returns whether that changes what the core may do.
            interrupted: Called at each step: raises if the run is to end. None: not called.
            report: Called with the time at each tick, or None.
            warnings: MuJoCo's warnings.
            ticks: Number of control ticks of the run.
            lines: Number of rows that fit into the block.
            until_s: Time from which another law may be in charge, s.
            clock: Monotonic time from which the log is to be flushed, s.
        """
        cdef TickLaw tick_law = law
        cdef bint changes = False
        self.travels, self.bound_within = travels, bound_within
        cdef double now, started, period_s = self.step_s * self.steps_per_tick
        while self.ticks < ticks and self.line + 1 < lines and self.excludes_events(stepper, event_bound):
            now, started = self.ticks * period_s, monotonic()
            # From here on the loop has to decide: a phase may end, or the log is to be written to disk.
            if now >= until_s or started >= clock:
                return
            # The core does not return to Python for many ticks: without this an interrupt would wait for them.
            PyErr_CheckSignals()
            if tick_law is None:
                self.ticks += 1
                self.count()
                try:
                    changes = decide(now)
                finally:
                    self.line = self.recorder.line  # it may have written an event, and the rows before it
            else:
                if not tick_law.command(limits):
                    return  # the loop evaluates it again, and says what is wrong
                self.ticks, self.evaluations = self.ticks + 1, self.evaluations + 1
                self.law_s += monotonic() - started
            self.record(now)
            if report is not None:
                self.count()
                report(now)
            if changes or not self.step(move, stepper, forces, event_bound, tick_law, interrupted, warnings):
                return

    cdef int record(self, double time_s) except -1:
        """Fill a row, and look for contacts that nothing handles."""
        self.rows.fill(self.line, time_s)
        self.line += 1
        # Bodies without a contact rule pass through each other: MuJoCo's detection finds such overlaps, which are reported.
        if self.watched != NULL:
            mj.collision(self.watched, self.d)
            if self.overlaps or self.data.ncon:
                self.count()
                try:
                    self.look(time_s)
                finally:
                    self.line = self.recorder.line
        return 0

    cdef bint excludes_events(self, FreeStepper stepper, double event_bound) except -1:
        """Whether the motion so far excludes every event but those of the applied forces."""
        # No gap can have closed with all the kinetic energy: nothing has to be computed.
        if stepper.motion_bound < event_bound:
            return True
        if not self.travels or not stepper.motion_bound < self.bound_within:
            return False
        for travel in self.travels:
            # Written so that NaN is not within reach.
            if not (<Travel>travel).length < (<Travel>travel).reach:
                return False
        return True

    cdef bint step(
        self,
        move,
        FreeStepper stepper,
        SteadyForces forces,
        double event_bound,
        TickLaw law,
        interrupted,
        list warnings,
    ) except -1:
        """Make the steps of a tick; returns whether they are complete."""
        cdef Py_ssize_t i
        cdef double[21] exchange
        for i in range(self.steps_per_tick):
            if interrupted is not None:
                interrupted()
            # Before the step: an event may be due at its start, or the forces are about to change.
            if not self.excludes_events(stepper, event_bound) or (forces is not None and not forces.goes_on(self.step_s)):
                return False
            self.work.open()
            if move is None:
                stepper.step(self.step_s)
            else:
                move(self.step_s)
            for travel in self.travels:
                (<Travel>travel).add(self.step_s)
            if (
                not self.excludes_events(stepper, event_bound)
                or stepper.kinked
                or len(warnings)
                or not isfinite(stepper.energy)
                or (law is not None and i + 1 == self.steps_per_tick and not law.arrives())
                or (forces is not None and not forces.exchange_into(self.step_s, exchange))
            ):
                # The step is made, but something in it is for the loop: it completes or repeats it.
                self.has_stepped = True
                return False
            self.work.close(self.step_s)
            if forces is not None:
                self.work.add(exchange, exchange + 3, exchange + 9)
            for account in self.after_step:
                account(self.step_s)
            self.steps += 1
            # A multiple of the step, not a sum, so that it does not accumulate rounding.
            self.data.time = self.steps * self.step_s
        return True
