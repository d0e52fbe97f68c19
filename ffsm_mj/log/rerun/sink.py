"""Rerun recording of a run: geometry, motion, plots, states and events on one timeline, ``sim_time``.

Positions are float32; checks use the MCAP file.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np
import rerun as rr

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.persistent.rule_columns import RuleMode
from ffsm_mj.errors import THE_LOG, InputError, LogWriteError
from ffsm_mj.log.drawing import FramePicker, Frames, marker_scale, posed_bodies
from ffsm_mj.log.markers import plume_series, thrusters
from ffsm_mj.log.palette import (
    PLUME,
    PLUME_OPACITY,
    ROBOT_ON_DARK,
    TIP_AFTER,
    TIP_BEFORE_ON_DARK,
    object_colour,
)
from ffsm_mj.log.recorder import Sink
from ffsm_mj.log.rerun.layout import FOLLOWED, Contents, Framing, Opening, blueprint
from ffsm_mj.log.rerun.plots import (
    FIRING,
    Extent,
    Lanes,
    Recording,
    Switching,
    contact_looks,
    friction_modes,
    phase_looks,
    plots,
    sensing_tabs,
    thruster_looks,
)
from ffsm_mj.log.rerun.scene import Forces, Ghosts, Marks, OrbitFrame, Target, body_path, log_shapes, poses
from ffsm_mj.log.scenario import compile_log, logged_scenario
from ffsm_mj.model.system import System
from ffsm_mj.records.events import Event, OutcomeRecord
from ffsm_mj.records.kinds import kind_of
from ffsm_mj.records.metadata import logged_task
from ffsm_mj.records.run_log import RunHeader, RunLog
from ffsm_mj.records.signals import TIP, coordinate_keys

_PLUME = (*PLUME, round(255 * PLUME_OPACITY))


class RerunSink(Sink):
    """Sink that writes a recording to a file when the run ends, or sends it to a viewer at each flush."""

    def __init__(
        self,
        output: Callable[[], Path] | str,
        system: System,
        view_rate_hz: float,
        view: Sequence[float] | None = None,
    ) -> None:
        """Remember the destination; nothing is written yet.

        Args:
            output: Called for the path of the file when the recording starts; or the address of a viewer to stream to.
            system: The system to draw.
            view_rate_hz: Frames per simulated second.
            view: Direction towards the camera; None: the one that shows most.
        """
        self._output, self._system, self._view = output, system, view
        self._scale = marker_scale(system)
        self._view_rate_hz, self._pending = view_rate_hz, list[Frames]()

    def open(self, header: RunHeader) -> None:
        """Start the recording with everything that is constant."""
        self._layout = layout = header.layout
        self._picker = FramePicker(self._system, layout, self._view_rate_hz)
        name = f"{header.scenario_name}-{header.metadata.get('created_utc', '')}"
        self._stream = rr.RecordingStream(
            f"ffsm-mj {header.scenario_name}",  # an open viewer keeps one layout for each application id
            recording_id=f"{name}-{uuid4().hex}" if self._streams else name,  # many runs are streamed in a second
        )
        self._recording = Recording(self._stream)
        self._connect()
        self._recording.constant("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
        self._base = log_shapes(self._recording, self._system).get(self._system.robot.root, "")
        task = logged_task(header.metadata)
        self._target = Target(self._recording, header, task, self._scale) if task is not None else None
        self._plots = plots(layout, self._system, header.metadata)
        self._sensing = sensing_tabs(layout, self._system)
        self._ghosts = Ghosts(self._recording, self._system, layout)
        self._orbit = OrbitFrame(self._recording, layout, self._scale)
        self._curves = [*self._plots, *(plot for tab in self._sensing.values() for plot in tab)]
        self._extents = {plot.entity: Extent() for plot in self._curves}
        for plot in self._curves:
            widths = list(plot.widths) or [1.5] * len(plot.names)
            self._recording.constant(plot.entity, rr.SeriesLines(names=plot.names, colors=plot.colours, widths=widths))
        self._thrusters = {thruster.short_name: thruster for thruster in thrusters(self._system, layout)}
        self._forces = Forces(self._recording, header, self._scale)
        applied = {name: thruster.applied for name, thruster in self._thrusters.items()}
        switching = Switching(layout.time, applied, FIRING)
        self._firing = Lanes(self._recording, "states/thrusters", switching, thruster_looks())
        self._modes = friction_modes(layout)
        switching = Switching(layout.time, self._modes, {int(mode): mode.word for mode in RuleMode})
        self._contacts = Lanes(self._recording, "states/contacts", switching, contact_looks())
        objects = {tree.name: object_colour(i) for i, tree in enumerate(self._system.objects)}
        self._colours = {self._system.robot.name: ROBOT_ON_DARK} | objects | {"tip": TIP_BEFORE_ON_DARK}
        self._opening = Opening(self._system)
        self._marks = Marks(self._at, self._opening, self._scale)
        self._framed, self._states = False, dict[str, list[str]]()

    def _connect(self) -> None:
        if isinstance(self._output, str):
            self._stream.connect_grpc(self._output)
            return
        # The file is written by this class: on a full disk the thread of the SDK would block its caller forever.
        self._bytes = rr.binary_stream(self._stream)
        self._path = self._output()
        try:
            self._file = self._path.open("wb")
        except OSError as error:
            raise LogWriteError(self._path, error) from error

    def rows(self, block: FloatArray) -> None:
        """Buffer the frames of a block for the next flush, and send the changes of thrusters and contacts in it."""
        self._contacts.send(block)
        for name in self._firing.send(block):
            look = rr.Arrows3D.from_fields(colors=[_PLUME], radii=[0.06 * self._scale])
            self._recording.constant(f"world/plumes/{name}", look)
        frames = self._picker.pick(block)
        if frames is not None:
            self._pending.append(frames)

    def flush(self) -> None:
        """Send the buffered frames: poses, trails, plots, plumes, forces."""
        if not self._pending:
            return
        parts, self._pending = self._pending, []
        frames = Frames.joined(parts)
        index = self._recording.index(frames.times)
        self._opening.add_frames(frames)
        if self._streams and not self._framed:
            # The layout of a stream is sent once, so it has a place for every force that is possible.
            self._arrange(self._forces.possible)
        for body in posed_bodies(self._system):
            moved = poses(frames.positions[:, body], frames.quaternions[:, body])
            self._recording.send(body_path(self._system, body), index, moved)
        self._ghosts.send(frames.rows, index)
        self._orbit.send(frames.rows, index)
        if self._target is not None:
            self._target.send(frames.rows, index)
        self._trails(frames, index)
        self._plumes(frames, index)
        self._lines(frames, index)
        self._forces.send(frames.rows, index)
        self._marks.clear(float(frames.times[-1]))

    @property
    def _streams(self) -> bool:
        return isinstance(self._output, str)

    def _write(self) -> None:
        """Write the whole file at once: not every reader accepts a recording that is written in parts."""
        if isinstance(self._output, str):
            return
        try:
            self._file.write(self._bytes.read() or b"")
            self._file.flush()
        except OSError as error:
            raise LogWriteError(self._path, error) from error

    def _arrange(self, acting: Callable[..., Sequence[str]]) -> None:
        """Send the layout, with the ground and the axes; ``acting`` gives the names of the forces or torques to plot."""
        self._framed = True
        targets = np.empty((0, 3)) if self._target is None else self._target.points
        framing = self._framing(self._opening.framing(targets, self._view))
        contents = Contents(
            framing=framing,
            plots=self._plots,
            sensing=self._sensing,
            extents={} if self._streams else self._extents,
            trails=list(self._colours),
            tip=self._target is not None,
            forces=acting(torques=False),
            torques=acting(torques=True),
            thrusters=len(self._thrusters if self._streams else self._firing.begun),
            contacts=len(self._modes if self._streams else self._contacts.begun),
        )
        self._recording.constant("world/axes", framing.axes)
        self._stream.send_blueprint(blueprint(contents, None if self._streams else self._opening))

    def _framing(self, framing: Framing) -> Framing:
        """A view whose camera follows the robot if it leaves it; in a stream it always follows."""
        if self._streams:
            return replace(framing, follows=self._base)
        path = self._opening.followed((framing.low, framing.high))
        if path is None:
            return framing
        index, places = self._recording.index(path[:, 0]), rr.Points3D.columns(positions=framing.centre + path[:, 1:])
        self._recording.constant(FOLLOWED, rr.Points3D.from_fields(radii=[0.0], colors=[(0, 0, 0, 0)]))
        self._recording.send(FOLLOWED, index, places)
        return replace(framing, follows=FOLLOWED)

    def _trails(self, frames: Frames, index: Any) -> None:
        trails = {tree.name: frames.positions[:, tree.root] for tree in self._system.trees}
        if TIP[0] in self._layout.index:
            trails["tip"] = frames.rows[:, self._layout.places(TIP)]
        first_s = self._opening.first_s
        after = frames.times >= (np.inf if first_s is None else first_s)
        for name, points in trails.items():
            count = len(points)
            late = TIP_AFTER if name == "tip" else self._colours[name]
            colours = np.where(after[:, None], late, self._colours[name])
            looks = rr.Points3D.columns(positions=points, colors=colours, radii=[0.015 * self._scale] * count)
            self._recording.send(f"world/trails/{name}", index, looks)

    def _plumes(self, frames: Frames, index: Any) -> None:
        for name, thruster in self._thrusters.items():
            if name not in self._firing.begun:
                continue
            series = plume_series(thruster, frames, self._scale)
            plume = rr.Arrows3D.columns(origins=series.origins, vectors=series.vectors)
            self._recording.send(f"world/plumes/{name}", index, plume)

    def _lines(self, frames: Frames, index: Any) -> None:
        for plot in self._curves:
            values = plot.values(frames.rows)
            self._extents[plot.entity].add(plot, values)
            flat = rr.Scalars.columns(scalars=values.ravel()).partition(np.full(len(values), len(plot.columns)))
            self._recording.send(plot.entity, index, flat)

    def event(self, event: Event) -> None:
        """Log an event as text, with the state that begins with it and its marks."""
        self._text(event)
        kind = kind_of(event)
        time = kind.time(event)
        if kind.state is not None:
            state = kind.state(event)
            self._at(time, f"states/{kind.name}", rr.StateChange.columns(state=[state]))
            self._states.setdefault(kind.name, []).append(state)
        self._marks.event(event)

    def _text(self, event: Event | OutcomeRecord) -> None:
        kind = kind_of(event)
        time = kind.time(event)
        # The time is in the text: the viewer cuts it in a column of its own.
        line = f"{time:.6f} s  {kind.sentence(event)}"
        text = rr.TextLog.columns(text=[line], level=["WARN" if kind.warning(event) else "INFO"])
        self._at(time, "events", text)

    def _at(self, time_s: float, path: str, columns: Any) -> None:
        """Send one value at one time."""
        self._recording.send(path, self._recording.index([time_s]), columns)

    def close(self, outcome: OutcomeRecord | None) -> None:
        """Send the outcome, and finish the recording.

        Raises:
            LogWriteError: The file cannot be written (full disk).
        """
        if not hasattr(self, "_stream"):
            return
        self.flush()
        self._marks.label()
        if outcome is not None:
            self._text(outcome)
        for name, begun in self._states.items():
            self._recording.constant(f"states/{name}", phase_looks(begun))
        if self._opening.has_frames and not self._streams:
            self._arrange(self._forces.begun)
        try:
            self._write()
        finally:
            self.disconnect()

    def wait(self, patience_s: float) -> None:
        """Wait until the viewer has taken everything that was sent.

        Raises:
            RuntimeError: It has not within ``patience_s``.
        """
        self._stream.flush(timeout_sec=patience_s)

    def disconnect(self) -> None:
        """Close the connection or the file."""
        self._stream.disconnect()
        if not isinstance(self._output, str):
            with suppress(OSError):  # already reported by the write
                self._file.close()


_BLOCKS_AT_ONCE = 25


def write_recording(log: RunLog, path: Path) -> None:
    """Write a recording (``.rrd``) of a log.

    Raises:
        InputError: The models in the log no longer compile, or do not match its columns.
    """
    system = compile_log(log)
    if missing := set(coordinate_keys(system.joints.values())) - set(log.header.layout.keys):
        raise InputError(f"{THE_LOG} has no {min(missing)}, a coordinate of its models")
    scenario = logged_scenario(log)
    sink = RerunSink(lambda: path, system, scenario.log.view_rate_hz, scenario.view)
    sink.open(log.header)
    for event in log.events:
        sink.event(event)
    for number, block in enumerate(log.blocks(), 1):
        sink.rows(block)
        if number % _BLOCKS_AT_ONCE == 0:
            sink.flush()
    sink.close(log.outcome)
