"""``run.rrd`` for the Rerun viewer: geometry, motion, plots, phases and events on one timeline, ``sim_time``.

A derived view: positions are float32 there. The physics is proved from the MCAP.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr

from ffsm_mj.errors import LogWriteError
from ffsm_mj.events import Event, ImpactRecord, OutcomeRecord, PhaseRecord
from ffsm_mj.log.drawing import FramePicker, Frames, moving_bodies, target
from ffsm_mj.log.narration import event_time, is_warning, sentence
from ffsm_mj.log.rerun_blueprint import TIMELINE, blueprint
from ffsm_mj.log.rerun_scene import body_path, log_shapes
from ffsm_mj.log.sink import RunHeader
from ffsm_mj.model import FloatArray, System
from ffsm_mj.signals import PARTIES, Layout

_ARROW_SHOWN_S = 2.0
_COLOURS = {"total": [230, 230, 230], "robot": [230, 159, 0], "objects": [86, 180, 233]}
_TRAIL_COLOURS = ([230, 159, 0], [213, 94, 0], [86, 180, 233], [0, 158, 115], [204, 121, 167])
_AXIS_COLOURS = ([213, 94, 0], [0, 158, 115], [86, 180, 233])


class RerunSink:
    """Writes one recording, block by block."""

    def __init__(self, path: Path, system: System, view_rate_hz: float) -> None:
        """Name the file; nothing is written yet."""
        self._path, self._system = path, system
        self._picker = FramePicker(system, view_rate_hz)

    def open(self, header: RunHeader) -> None:
        """Start the recording with everything that does not change."""
        self._layout = header.layout
        self._recording = rr.RecordingStream("ffsm-mj", recording_id=f"{header.scenario_name}-{header.facts['created_utc']}")
        try:
            self._path.touch()
        except OSError as error:
            raise LogWriteError(self._path, error) from error
        self._recording.save(self._path)
        self._recording.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        log_shapes(self._recording, self._system)
        self._target(header)
        self._plots = _plots(header.layout)
        for path, (_, names, colours) in self._plots.items():
            self._recording.log(path, rr.SeriesLines(names=names, colors=colours, widths=[1.5] * len(names)), static=True)
        self._framed = False

    def _target(self, header: RunHeader) -> None:
        """A small cross where the tip is wanted."""
        self._goal = goal = target(header.facts)
        if goal is None:
            return
        self._axes = ["xyz".index(axis) for axis in header.facts["task_axes"].split()]
        line = rr.SeriesLines(names=["tip error"], colors=[[230, 159, 0]], widths=[1.5])
        self._recording.log("plots/tip_error", line, static=True)
        arms = [[goal - 0.15 * e, goal + 0.15 * e] for e in np.eye(3)]
        self._recording.log("world/target", rr.LineStrips3D(arms, colors=[[240, 228, 66]], radii=[0.012]), static=True)

    def rows(self, block: FloatArray) -> None:
        """Send the frames of a block: poses, trails, plots."""
        frames = self._picker.pick(block)
        if frames is None:
            return
        index = [rr.TimeColumn(TIMELINE, duration=frames.times)]
        positions, quaternions = frames.positions, frames.quaternions
        if not self._framed:
            self._frame_scene(positions[0])
        for body in moving_bodies(self._system):
            columns = rr.Transform3D.columns(
                translation=positions[:, body], quaternion=np.roll(quaternions[:, body], -1, axis=-1)
            )
            self._send(body_path(self._system, body), index, columns)
        self._trails(frames, index)
        if self._goal is not None:
            tip = frames.rows[:, self._layout.columns("state.tip_x_m", 3)][:, self._axes]
            error = np.linalg.norm(tip - self._goal[self._axes], axis=1)
            self._send("plots/tip_error", index, rr.Scalars.columns(scalars=error))
        for path, (columns_of, _, _) in self._plots.items():
            values = frames.rows[:, columns_of]
            flat = rr.Scalars.columns(scalars=values.ravel()).partition(np.full(len(values), len(columns_of)))
            self._send(path, index, flat)

    def _frame_scene(self, positions: FloatArray) -> None:
        bodies = positions[moving_bodies(self._system)]
        points = np.vstack((bodies, self._goal[None])) if self._goal is not None else bodies
        self._recording.send_blueprint(
            blueprint(points.min(axis=0) - 1.0, points.max(axis=0) + 1.0, tip=self._goal is not None)
        )
        self._framed = True

    def _trails(self, frames: Frames, index: Any) -> None:
        trails = {tree.name: frames.positions[:, tree.root] for tree in self._system.trees}
        if "state.tip_x_m" in self._layout.index:
            trails["tip"] = frames.rows[:, self._layout.columns("state.tip_x_m", 3)]
        for (name, points), colour in zip(trails.items(), _TRAIL_COLOURS * len(trails), strict=False):
            count = len(points)
            columns = rr.Points3D.columns(positions=points, colors=[colour] * count, radii=[0.012] * count)
            self._send(f"world/trails/{name}", index, columns)

    def _send(self, path: str, index: Any, columns: Any) -> None:
        rr.send_columns(path, indexes=index, columns=columns, recording=self._recording)

    def event(self, event: Event) -> None:
        """Log an event as text, a phase also as a state, an impact also as an arrow."""
        self._text(event)
        if isinstance(event, PhaseRecord):
            self._recording.log("phase", rr.StateChange(state=event.name))
        elif isinstance(event, ImpactRecord):
            self._impact(event)

    def _impact(self, event: ImpactRecord) -> None:
        arrow = rr.Arrows3D(
            origins=[event.point_m],
            vectors=[np.array(event.normal) * event.impulse_N_s],
            colors=[[240, 228, 66]],
            radii=[0.025],
            labels=[f"{event.impulse_N_s:.4g} N s"],
        )
        self._recording.log(f"world/impacts/{event.event}", arrow)
        self._at(event.time_s + _ARROW_SHOWN_S)
        self._recording.log(f"world/impacts/{event.event}", rr.Clear(recursive=False))

    def _text(self, event: Event | OutcomeRecord) -> None:
        self._at(event_time(event))
        self._recording.log("events", rr.TextLog(sentence(event), level="WARN" if is_warning(event) else "INFO"))

    def _at(self, time_s: float) -> None:
        self._recording.set_time(TIMELINE, duration=time_s)

    def flush(self) -> None:
        """Nothing: Rerun's own thread writes; the MCAP is the log that survives."""

    def close(self, outcome: OutcomeRecord | None) -> None:
        """Say how the run ended and finish the file."""
        if not hasattr(self, "_recording"):
            return
        if outcome is not None:
            self._text(outcome)
        self._recording.flush()
        self._recording.disconnect()


def _plots(layout: Layout) -> dict[str, tuple[list[int], list[str], list[list[int]]]]:
    """Columns, names and colours of each plotted entity."""
    index = layout.index
    plots: dict[str, tuple[list[int], list[str], list[list[int]]]] = {}
    plots["plots/energy"] = ([index[f"energy.{p}_J"] for p in PARTIES], list(PARTIES), [_COLOURS[p] for p in PARTIES])
    for party in ("robot", "objects"):
        for kind, letter, unit in (("linear", "P", "N_s"), ("angular", "L", "N_m_s")):
            columns = [index[f"momentum.{party}_{letter}_{axis}_{unit}"] for axis in "xyz"]
            names = [f"{party} {letter}_{axis}" for axis in "xyz"]
            plots[f"plots/{kind}_momentum/{party}"] = (columns, names, list(map(list, _AXIS_COLOURS)))
    plots["plots/ledger"] = (
        [index["ledger.total_energy_residual_J"]]
        + [index[key] for key in layout.keys if key.startswith("ledger.total_residual_")],
        ["energy J"] + [f"{letter}_{axis}" for letter in "PL" for axis in "xyz"],
        [[230, 230, 230], *map(list, _AXIS_COLOURS), *map(list, _AXIS_COLOURS)],
    )
    efforts = [key for key in layout.keys if key.startswith("actuators.") and "_applied_" in key]
    for key in efforts:
        name = key.removeprefix("actuators.").rsplit("_applied_", 1)[0]
        bounds = [index[key.replace("_applied_", f"_{side}_")] for side in ("lower", "upper")]
        plots[f"plots/efforts/{name}"] = (
            [index[key], *bounds],
            [name, f"{name} lower", f"{name} upper"],
            [[230, 159, 0], [120, 120, 120], [120, 120, 120]],
        )
    return plots
