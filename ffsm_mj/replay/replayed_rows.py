"""Rows of a log as a replay needs them: states and efforts to start from, and columns to compare."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np

from ffsm_mj.actuation.actuation import Actuation
from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.dynamics.rigid_body import with_signs_of
from ffsm_mj.errors import InputError
from ffsm_mj.log.recorder import RECORDED_ROWS
from ffsm_mj.records.columns import Columns, Row, same_names
from ffsm_mj.records.signals import Layout, coordinate_keys, rate_keys
from ffsm_mj.simulation.plant import Plant
from ffsm_mj.simulation.rows import RowWriter
from ffsm_mj.verification.agreement import Agreement, scales

_Parts: TypeAlias = Sequence[tuple[Callable[[], FloatArray], IntArray]]
"""Values of the columns of some parts, and their places in a row."""
_COPIED = ("estimate", "controller", "phase", "clock")
"""Groups of columns that are copied from the log."""


class LoggedRows:
    """A block of rows, split into states and efforts.

    Attributes:
        rows: The rows, (n, number of signals).
        times: Times, s, (n,).
        states: Coordinates and rates, (n, nq + nv).
        asked: Commanded efforts and setpoints, (n, nu).
        applied: Applied ones, (n, nu).
        ctrl: MuJoCo's controls for them, (n, nu).
        powered: Whether each actuator is powered, (n, nu).
    """

    def __init__(self, rows: FloatArray, states: FloatArray, layout: Layout, actuation: Actuation) -> None:
        """Split a block of rows."""
        self.rows, self.times, self.states = rows, rows[:, layout.time], states
        # A log may have NaN where an effort was none: it disagrees in its column, and must not end the integration.
        efforts = (np.nan_to_num(rows[:, layout.places(actuation.keys[what])]) for what in ("command", "applied"))
        self.asked, self.applied = map(np.ascontiguousarray, efforts)
        self.ctrl = self.applied / actuation.gear
        # A motor without power has neither a command nor an applied effort; a servo always has a setpoint.
        self.powered = (self.asked != 0.0) | (self.applied != 0.0) | actuation.servos


class ReplayedRows:
    """Recomputed rows of a plant, a block at a time.

    Attributes:
        predicted: States integrated from the samples before, (lines, nq + nv).
        forces_apart: Differences of the contact forces from independent checks, N, (lines,).
        accuracy: How far rounding of the states changes the columns by varied forces, (lines, number of signals).
        forces: Places in a row of logged forces that are checked.
        copied: Places in a row of the columns of the controller, and the array of their values.
        filler: Fills a line from live arrays.
        follows_event: Whether an event has been added since the last row.
    """

    def __init__(self, plant: Plant, layout: Layout) -> None:
        """Bind the columns of the plant to the layout of the log.

        Raises:
            InputError: The columns of the log are not those of its models.
        """
        self._plant, self._layout = plant, layout
        model = plant.system.mj
        self._again = np.zeros((RECORDED_ROWS, len(layout.keys)))
        self.predicted, self.forces_apart = np.zeros((RECORDED_ROWS, model.nq + model.nv)), np.zeros(RECORDED_ROWS)
        self.accuracy = np.zeros_like(self._again)
        known = plant.columns
        # They cannot be recomputed.
        controller = tuple(
            signal for signal in layout.signals if signal.group in ("estimate", "controller", "phase", "clock")
        )
        self.copied = layout.places(signal.key for signal in controller), np.zeros(len(controller))
        row = _row_of_log([*known, Columns(controller, live=self.copied[1])], layout)
        self._writer = RowWriter(row, plant.state.sampler, RECORDED_ROWS)
        self.filler, self.follows_event = self._writer.filler, False
        by_part = [(part, layout.places(s.key for s in part.signals)) for part in known]
        self._at_state = [(part.at_state, places) for part, places in by_part if part.at_state]
        self._at_event = [(part.at_event, places) for part, places in by_part if part.at_event]
        self._since_row = np.zeros(len(layout.keys))
        self._resume = [(part.resume, layout.places(s.key for s in part.signals)) for part in known if part.resume]
        joints = plant.system.joints.values()
        sensing = [signal.key for part in plant.sampler.columns for signal in part.signals] if plant.sampler else []
        self._sensing = layout.places(sensing)
        self._state = layout.places((*coordinate_keys(joints), *rate_keys(joints)))
        self._known = np.setdiff1d(np.arange(len(layout.keys)), np.concatenate((self.copied[0], self._state)))
        checks = (contact_model.force_check(layout) for contact_model in plant.integrator.replayable)
        self._force_checks = [check for check in checks if check is not None]
        self.forces = np.concatenate([np.zeros(0, dtype=np.intp), *(check.places for check in self._force_checks)])
        self._energy, self._mass = layout.index["energy.total_J"], float(model.body_mass.sum())
        self._completed = 0

    def begin(self, block: FloatArray) -> LoggedRows:
        """Begin a block of logged rows."""
        self._completed = 0
        return LoggedRows(block, np.ascontiguousarray(block[:, self._state]), self._layout, self._plant.actuation)

    def restore(self, row: FloatArray | None) -> None:
        """Continue accumulated columns from a logged row; None: from zero, as at the start of a run."""
        for resume, places in self._resume:
            resume(row[places] if row is not None else np.zeros(len(places)))

    def write(self, line: int, time_s: float, logged: FloatArray) -> None:
        """Write the row of the state in ``data``; columns of the controller are copied from the logged row."""
        places, copy = self.copied
        copy[:] = logged[places]
        if self._plant.sampler is not None:
            self._plant.sampler.take_over(logged[self._sensing], time_s)
        self.accuracy[line] = self._accuracy(self._at_state) + self._since_row
        self._since_row.fill(0.0)
        self.follows_event = False
        self._writer.fill(line, time_s)
        self.forces_apart[line] = max((check.residual(logged) for check in self._force_checks), default=0.0)

    def add_event(self) -> None:
        """Note how far rounding of the state after an event changes the columns of values after events."""
        # Columns of values after events show the largest one: so does their accuracy.
        np.maximum(self._since_row, self._accuracy(self._at_event), out=self._since_row)
        self.follows_event = True

    def _accuracy(self, parts: _Parts) -> FloatArray | float:
        """How far rounding of the state in ``data`` changes columns through the forces: the sum over all variations."""
        replayable = self._plant.integrator.replayable
        varied = [self._values(parts) for contact_model in replayable for _ in contact_model.varied_forces()]
        # Variations are independent of each other, and each may be met with the worst sign.
        return np.abs(np.array(varied) - self._values(parts)).sum(axis=0) if varied else 0.0

    def _values(self, parts: _Parts) -> FloatArray:
        """Columns of some parts at the state in ``data``, not NaN; zeros elsewhere, (number of signals,)."""
        values = np.zeros(len(self._layout.keys))
        for now, places in parts:
            values[places] = now()
        return np.nan_to_num(values)

    def skip(self, line: int) -> None:
        """Leave a row that has no valid state as NaN."""
        self.complete(line)
        self._completed = line + 1
        self._again[line] = self.predicted[line] = self.forces_apart[line] = np.nan

    def complete(self, line: int) -> None:
        """Compute the table columns of the rows before a line."""
        if line > self._completed:
            lines = slice(self._completed, line)
            self._again[lines] = self._writer.complete(self._writer.block[lines])
        self._completed = line

    def compare(self, block: FloatArray, motion: Agreement, columns: Agreement) -> FloatArray:
        """Compare a finished block with the logged one; returns the recomputed rows for the checks."""
        count, model = len(block), self._plant.system.mj
        self.complete(count)
        again, predicted = self._again[:count].copy(), self.predicted[:count].copy()
        # A quaternion and its negative are one rotation: the integrated one takes the sign of the log.
        predicted[:, : model.nq] = with_signs_of(model, predicted[:, : model.nq], block[:, self._state[: model.nq]])
        size = np.abs(predicted)
        # Rounding in one coordinate moves others through the linkage: the scale is that of the largest of its kind.
        lever, speed = (size[:, part].max(axis=1, keepdims=True) for part in (slice(model.nq), slice(model.nq, None)))
        scale = np.concatenate((np.repeat(lever, model.nq, axis=1), np.repeat(speed, model.nv, axis=1)), axis=1)
        motion.rows(self._layout, self._state, block, predicted, scale)
        # The sum of all m |v| is at most sqrt(2 M T).
        momentum = (1.0 + lever[:, 0]) * np.sqrt(2.0 * self._mass * np.abs(again[:, self._energy]))
        measured = scales(self._layout, self._known, again, momentum)
        accuracy = self.accuracy[:count, self._known]
        columns.rows(self._layout, self._known, block, again[:, self._known], measured, accuracy)
        return again


def _row_of_log(columns: Sequence[Columns], layout: Layout) -> Row:
    """Row layout of some parts.

    Raises:
        InputError: It differs from that of the log.
    """
    for one, other in same_names(columns):
        raise InputError(f"its models have two columns {one.key}: {one.element} and {other.element}")
    row = Row(columns)
    # Columns are compared by place: a log of other models would be compared number by number with something else.
    if layout.keys != row.layout.keys:
        odd = sorted(set(layout.keys) ^ set(row.layout.keys))
        raise InputError(f"the columns of the log are not those of its models: {', '.join(odd[:3]) or 'another order'}")
    return row
