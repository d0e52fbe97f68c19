"""Samples the sensors of a plant at their own times, inside steps too, and keeps what has arrived."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.model.system import System
from ffsm_mj.records.active_contact import ActiveContact
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.wrench import Wrench
from ffsm_mj.sensing.batch import Batch
from ffsm_mj.sensing.measurement import Measurement
from ffsm_mj.sensing.reader import SensorReader, apply_wrenches
from ffsm_mj.sensing.samples import SAME_TIME_S, Measured, Sample, Samples
from ffsm_mj.sensing.sensor import Sensor
from ffsm_mj.sensing.signals import SensorColumns
from ffsm_mj.sensing.view import FieldOfView


class SensorSampler:
    """Sensors of a plant, sampled while it moves.

    A sample is taken at its own time. At the end of a (sub-)step that is the state there, before any event; inside one the
    state is found as that of an event is, by integrating a shorter step from the same start. Nothing of the plant changes.

    Attributes:
        by_name: The sensors by full name.
        columns: Columns of the measurements.
    """

    def __init__(
        self,
        sensors: Sequence[Sensor],
        system: System,
        data: Any,
        motion: Callable[[], Motion],
        forces: Callable[[], tuple[Sequence[Wrench], Sequence[ActiveContact]]],
        *,
        seed: int,
        time_step_s: float,
        bodies_of: dict[str, tuple[int, int]],
    ) -> None:
        """Before the first sample.

        Args:
            sensors: The sensors.
            system: The logged system.
            data: Its data.
            motion: The current motion.
            forces: Forces of contact models on bodies, and closed contacts, at the state in ``data``.
            seed: Seed of the run's noise.
            time_step_s: Integration step, s.
            bodies_of: See :class:`~ffsm_mj.sensing.reader.SensorReader`.
        """
        self._sensors, self._system, self._data = tuple(sensors), system, data
        self.by_name = {sensor.name: sensor for sensor in sensors}
        self._current_motion, self._forces = motion, forces
        self._motion: Motion | None = None
        self._batches: dict[tuple[int, ...], Batch] = {}
        self._time_step_s, self._bodies_of = time_step_s, bodies_of
        self._samples = [Samples(sensor, seed) for sensor in sensors]
        self._newest: dict[str, Sample | int] = {sensor.name: sensor.size for sensor in sensors}
        self._next_s, self._arrival_s, self._clock_s = math.inf, math.inf, 0.0
        self._shown = SensorColumns(self._sensors)
        self.columns: tuple[Columns, ...] = (
            Columns(self._shown.signals, live=self._shown.values, on_sample=self._show, resume=self._shown.forget),
        )

    def _bind(self, motion: Motion) -> None:
        """Sample another motion from now on."""
        model = motion.model
        self._motion, self._reader = motion, SensorReader(self._sensors, motion, self._bodies_of)
        self._views: list[FieldOfView | None] = [
            None
            if each.field_of_view is None
            else FieldOfView(model, each, self._system.resolve("site", each.field_of_view.site))
            for each in self._sensors
        ]
        self._backups = [(motion.model, motion.data, mujoco.MjData(motion.model))]
        if motion.data is not self._data:
            self._backups.append((self._system.mj, self._data, mujoco.MjData(self._system.mj)))

    def begin(self) -> None:
        """Begin a run at the state in ``data``, with the samples that are due there."""
        for samples in self._samples:
            samples.begin()
        self._begin(0.0)
        if self._next_s <= SAME_TIME_S:
            self._take()

    def begin_after_gap(self, time_s: float) -> None:
        """Begin at a time in a log: what was under way is not known; see :meth:`SensorSampler.take_over`."""
        for samples in self._samples:
            samples.begin_after_gap(time_s)
        self._begin(time_s)

    def _begin(self, time_s: float) -> None:
        self._clock_s = time_s
        self._next_s, self._arrival_s = min(samples.next_s for samples in self._samples), math.inf

    def take_over(self, logged: FloatArray, time_s: float) -> None:
        """Take over from a logged row, (number of signals,), what samples show that may be of before a gap."""
        self._show(time_s)
        for i, samples in enumerate(self._samples):
            if samples.may_show_unknown(time_s):
                self._shown.take_over(i, logged)

    def elapse(self, duration_s: float) -> None:
        """Take the samples of a finished (sub-)step, whose end is the state in ``data``."""
        # Ends of steps are multiples of the step, as in the loop: sums of sub-steps differ from them by rounding.
        end_s = self._clock_s + duration_s
        grid_s = round(end_s / self._time_step_s) * self._time_step_s
        self._clock_s = grid_s if abs(end_s - grid_s) < SAME_TIME_S * self._time_step_s else end_s
        while self._next_s <= self._clock_s + SAME_TIME_S:
            before_s = self._clock_s - self._next_s
            if before_s <= SAME_TIME_S:
                self._take()
            else:
                self._take_inside(max(0.0, duration_s - before_s), duration_s)

    def _take(self) -> None:
        """Take all samples that are due now, at the state in ``data``."""
        motion, due_s = self._current_motion(), self._next_s + SAME_TIME_S
        if motion is not self._motion:
            self._bind(motion)
        values = self._reader.read(*self._forces())
        while due := tuple(i for i, samples in enumerate(self._samples) if samples.next_s <= due_s):
            self._take_batch(due, values, motion)
        self._next_s = min(samples.next_s for samples in self._samples)
        self._arrival_s = min(samples.arrival_s for samples in self._samples)

    def _take_batch(self, due: tuple[int, ...], values: FloatArray, motion: Motion) -> None:
        """Take one sample of each of these sensors."""
        batch = self._batches.get(due)
        if batch is None:
            batch = self._batches[due] = Batch([self._samples[i] for i in due], [self._reader.parts[i] for i in due])
        true = values[batch.places]
        measured = batch.measured(true)
        whole = not np.isnan(true).any()
        for i, samples, part in zip(due, batch.samples, batch.parts, strict=True):
            view = self._views[i]
            seen = (whole or not np.isnan(true[part]).any()) and (view is None or view.shows(motion.data))
            samples.take(true[part], measured[part], seen)

    def _take_inside(self, at_s: float, duration_s: float) -> None:
        """Take the samples that are due at a time in the last (sub-)step, and return to its end."""
        motion = self._current_motion()
        if motion is not self._motion:
            self._bind(motion)
        for model, data, backup in self._backups:
            mujoco.mj_copyData(backup, model, data)
        momenta = [momentum.copy() for momentum in motion.momenta]
        motion.path.at_s = math.nan
        try:
            motion.path.move_to(at_s)
            self._take()
        finally:
            for model, data, backup in self._backups:
                mujoco.mj_copyData(data, model, backup)
            for momentum, before in zip(motion.momenta, momenta, strict=True):
                momentum[:] = before
            motion.path.at_s = duration_s

    def add_impulses(self, motion: Motion, jump: FloatArray, wrenches: Sequence[Wrench]) -> None:
        """Add what an event passes on through force and torque sensors.

        Args:
            motion: The motion that it ended: what was held before it moves with the hand in it.
            jump: Change of the velocities of the logged system, (nv,).
            wrenches: Impulses on its bodies, N s.
        """
        found = [samples for samples in self._samples if samples.sensor.model.kind in ("force", "torque")]
        if found:
            values = impulses_through(motion, jump, wrenches)
            for samples in found:
                start = int(motion.model.sensor(samples.sensor.name).adr[0])
                samples.add_impulse(values[start : start + 3])

    def measured(self, time_s: float) -> Mapping[str, Measurement]:
        """Newest sample of each sensor that has arrived at a time, by full name; evaluated where it is looked up."""
        self._show(time_s)
        return Measured(self._newest, time_s)

    def _show(self, time_s: float) -> None:
        """Let samples arrive, and update the columns."""
        if self._arrival_s > time_s + SAME_TIME_S:
            return
        self._newest = self._newest.copy()  # observations before keep theirs
        for i, samples in enumerate(self._samples):
            if samples.arrival_s <= time_s + SAME_TIME_S and samples.arrive(time_s) and samples.shown is not None:
                self._newest[samples.sensor.name] = samples.shown
                self._shown.show(i, samples.shown)
        self._arrival_s = min(samples.arrival_s for samples in self._samples)


def impulses_through(motion: Motion, jump: FloatArray, wrenches: Sequence[Wrench]) -> FloatArray:
    """Values of all sensors in an impact: those of force and torque sensors are impulses, N s and N m s.

    Newton-Euler recursion is linear in accelerations and external forces where nothing moves and nothing weighs: with the
    jump of the velocities in place of accelerations, and impulses in place of forces, it gives the impulses between bodies.
    """
    model = motion.model
    still = mujoco.MjData(model)
    still.qpos[:] = motion.data.qpos
    gravity, flags = model.opt.gravity.copy(), model.opt.disableflags
    model.opt.gravity[:] = 0.0
    model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
    try:
        mujoco.mj_fwdPosition(model, still)
        mujoco.mj_fwdVelocity(model, still)
        for dof, own in enumerate(motion.dofs):
            if own >= 0:  # the object's base joint is gone while it is held
                still.qacc[own] = jump[dof]
        apply_wrenches(motion, still, wrenches)
        mujoco.mj_rnePostConstraint(model, still)
        mujoco.mj_sensorAcc(model, still)
        return np.array(still.sensordata)
    finally:
        model.opt.gravity[:], model.opt.disableflags = gravity, flags
