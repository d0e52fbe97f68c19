"""Samples the sensors of a plant at their own times, inside steps too, and keeps what has arrived."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.fields.surroundings import Surroundings
from ffsm_mj.model.system import System
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.contact_forces import ActiveContact, Wrench
from ffsm_mj.sensing.group import SensorGroup, groups_of
from ffsm_mj.sensing.measured import Measured, Measurement, Shown, places_of
from ffsm_mj.sensing.reader import ImpulseReader, SensorReader
from ffsm_mj.sensing.sensor import Sensor
from ffsm_mj.sensing.signals import SensorColumns
from ffsm_mj.sensing.view import FieldOfView
from ffsm_mj.state import Stateful
from ffsm_mj.tolerances import SCHEDULED_S


class SensorSampler(Stateful):
    """Sensors of a plant, sampled while it moves.

    A sample is taken at its own time. At the end of a (sub-)step that is the state there, before any event; inside one the
    state is found as that of an event is, by integrating a shorter step from the same start. Nothing of the plant changes.

    Attributes:
        by_name: The sensors by full name.
        columns: Columns of the measurements.
    """

    @dataclass
    class State:
        """What groups of sensors remember, and the time, s."""

        groups: tuple[Any, ...]
        clock_s: float

    def __init__(
        self,
        sensors: Sequence[Sensor],
        system: System,
        data: Any,
        motion: Callable[[], Motion],
        wrenches: Callable[[], Sequence[Wrench]],
        contacts: Callable[[], Sequence[ActiveContact]],
        surroundings: Surroundings,
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
            wrenches: Forces of contact models on bodies at the state in ``data``.
            contacts: Closed contacts there.
            surroundings: What surrounds the scene.
            seed: Seed of the run's noise.
            time_step_s: Integration step, s.
            bodies_of: See :class:`~ffsm_mj.sensing.reader.SensorReader`.
        """
        self._sensors, self._system, self._data = tuple(sensors), system, data
        self.by_name = {sensor.name: sensor for sensor in sensors}
        self._current_motion, self._wrenches, self._contacts = motion, wrenches, contacts
        self._surroundings = surroundings
        self._motion: Motion | None = None
        self._impulses: ImpulseReader | None = None
        self._time_step_s, self._bodies_of = time_step_s, bodies_of
        self._groups = groups_of(sensors, seed)
        self._places = places_of(self._groups)
        self._newest: Shown = (None,) * len(self._groups)
        self._next_s, self._arrival_s, self._clock_s = math.inf, math.inf, 0.0
        self._shown = SensorColumns(self._sensors, self._groups)
        self.columns: tuple[Columns, ...] = (
            Columns(
                self._shown.signals, live=self._shown.values, on_sample=self._show, resume=lambda _: self._shown.forget()
            ),
        )

    def _forget(self, _logged: FloatArray) -> None:
        self._shown.forget()

    def _bind(self, motion: Motion) -> None:
        """Sample another motion from now on."""
        self._motion = motion
        groups = [group.sensors for group in self._groups]
        self._reader = SensorReader(groups, motion, self._bodies_of, self._surroundings)
        self._views = [tuple(self._views_of(group, motion.model)) for group in self._groups]
        self._backups = [(motion.model, motion.data, mujoco.MjData(motion.model))]
        if motion.data is not self._data:
            self._backups.append((self._system.mj, self._data, mujoco.MjData(self._system.mj)))

    def _views_of(self, group: SensorGroup, model: Any) -> Iterator[tuple[int, FieldOfView]]:
        """Fields of view of the sensors of a group that have one, by their place in it."""
        for k, sensor in enumerate(group.sensors):
            if sensor.field_of_view is not None:
                yield k, FieldOfView(model, sensor, self._system.resolve("site", sensor.field_of_view.site))

    def begin(self) -> None:
        """Begin a run at the state in ``data``, with the samples that are due there."""
        for group in self._groups:
            group.begin()
        self._begin(0.0)
        if self._next_s <= SCHEDULED_S:
            self._take()

    def set_state(self, state: Any) -> None:
        """Go on from a state."""
        super().set_state(state)
        self._shown.forget()
        for g, group in enumerate(self._groups):
            if group.shown is not None:
                self._shown.show(g, group.shown)
        self._newest = tuple([group.shown for group in self._groups])
        self._next_s = min(group.next_s for group in self._groups)
        self._arrival_s = min(group.arrival_s for group in self._groups)

    def begin_after_gap(self, time_s: float) -> None:
        """Begin at a time in a log: what was under way is not known; see :meth:`SensorSampler.take_over`."""
        for group in self._groups:
            group.begin_after_gap(time_s)
        self._begin(time_s)

    def _begin(self, time_s: float) -> None:
        self._clock_s = time_s
        self._next_s, self._arrival_s = min(group.next_s for group in self._groups), math.inf

    def take_over(self, logged: FloatArray, time_s: float) -> None:
        """Take over from a logged row, (number of signals,), what samples show that may be of before a gap."""
        self._show(time_s)
        for group in self._groups:
            for name in group.may_show_unknown(time_s):
                self._shown.take_over(name, logged)

    def elapse(self, duration_s: float) -> None:
        """Take the samples of a finished (sub-)step, whose end is the state in ``data``."""
        # Ends of steps are multiples of the step, as in the loop: sums of sub-steps differ from them by rounding.
        end_s, step_s = self._clock_s + duration_s, self._time_step_s
        grid_s = round(end_s / step_s) * step_s
        if abs(end_s - grid_s) < SCHEDULED_S * step_s:
            end_s = grid_s
        self._clock_s = end_s
        while self._next_s <= end_s + SCHEDULED_S:
            before_s = end_s - self._next_s
            if before_s <= SCHEDULED_S:
                self._take()
            else:
                self._take_inside(max(0.0, duration_s - before_s), duration_s)

    def _take(self) -> None:
        """Take all samples that are due now, at the state in ``data``."""
        motion, due_s = self._current_motion(), self._next_s + SCHEDULED_S
        if motion is not self._motion:
            self._bind(motion)
        groups, reader = self._groups, self._reader
        due = tuple([g for g, group in enumerate(groups) if group.next_s <= due_s])
        values = reader.read(due, self._wrenches, self._contacts)
        for g in due:
            hidden = [k for k, view in self._views[g] if not view.shows(motion.data)]
            groups[g].take(values[reader.parts[g]], hidden)
        self._next_s = min([group.next_s for group in groups])
        self._arrival_s = min([group.arrival_s for group in groups])

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
        motion.refresh_forces()  # records of an event at the end have the forces that were evaluated last

    def add_impulses(self, motion: Motion, jump: FloatArray, wrenches: Sequence[Wrench]) -> None:
        """Add what an event passes on through force and torque sensors.

        Args:
            motion: The motion that it ended: what was held before it moves with the hand in it.
            jump: Change of the velocities of the logged system, (nv,).
            wrenches: Impulses on its bodies, N s.
        """
        cells_by_group = [
            (group, cells) for group in self._groups if (cells := [sensor.name for sensor in group.sensors if sensor.sums])
        ]
        if not cells_by_group:
            return
        if self._impulses is None or self._impulses.motion is not motion:
            self._impulses = ImpulseReader(motion, [sensor for sensor in self._sensors if sensor.sums])
        through = self._impulses.read(jump, wrenches)
        for group, cells in cells_by_group:
            group.add_impulses(np.concatenate([through(name) for name in cells]))

    def measured(self, time_s: float) -> Mapping[str, Measurement]:
        """Newest sample of each sensor that has arrived at a time, by full name; evaluated where it is looked up."""
        if self._arrival_s <= time_s + SCHEDULED_S:
            self._show(time_s)
        return Measured(self._places, self._newest, time_s)

    def _show(self, time_s: float) -> None:
        """Let samples arrive, and update the columns."""
        if self._arrival_s > time_s + SCHEDULED_S:
            return
        for g, group in enumerate(self._groups):
            if group.arrive(time_s) and group.shown is not None:
                self._shown.show(g, group.shown)
        self._newest = tuple([group.shown for group in self._groups])  # observations before keep theirs
        self._arrival_s = min([group.arrival_s for group in self._groups])
