"""The scene of a page, drawn by K3D at keyframes: moving bodies, target, path of the tip, marks, forces, plumes."""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import k3d
import numpy as np
import numpy.typing as npt

from ffsm_mj.analysis.run import Run
from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.rigid_body import rotation_matrix
from ffsm_mj.errors import one_line
from ffsm_mj.log import palette
from ffsm_mj.log.camera import aimed, direction, framed_points
from ffsm_mj.log.drawing import DrawnShape, Frames, camera_path, marker_scale, robot_boxes, shapes
from ffsm_mj.log.markers import (
    LVLH_ARROWS,
    DrawnMark,
    arrow_colour,
    arrow_series,
    declared_arrows,
    drawn_marks,
    has_orbit,
    lvlh_frames,
    plume_series,
    texts,
    thrusters,
)
from ffsm_mj.log.palette import packed
from ffsm_mj.log.scenario import logged_scenario
from ffsm_mj.model.system import System
from ffsm_mj.records.kinds import kind_of
from ffsm_mj.records.metadata import LoggedTask, logged_task
from ffsm_mj.records.run_log import RunHeader
from ffsm_mj.records.signals import Layout
from ffsm_mj.report.page.solids import Triangles, arrow_solid, joined, plume_solid, triangles
from ffsm_mj.report.plots.subject import Subject

_MOST, _PER_SECOND = 600, 50.0
"""Greatest and, for a short run, least number of poses besides events; a browser interpolates between them."""


@dataclass(frozen=True)
class Poses(Frames):
    """Poses of all bodies at increasing times of a run, each from the first row at or after the time.

    Attributes:
        events: Number of the times that are events.
    """

    events: int

    @property
    def description(self) -> str:
        """One line with the number of poses."""
        at = f", {self.events} of them at events" if self.events else ""
        return f"{len(self.times)} poses over {self.times[-1]:g} s{at}"

    def nearest(self, time: float) -> int:
        """Index of the pose nearest to a time."""
        return int(np.argmin(np.abs(self.times - time)))


def picked_times(run: Run) -> FloatArray:
    """Evenly spaced times over a run, s."""
    end = run.digest.end_s
    return np.linspace(0.0, end, max(2, min(_MOST, 1 + math.ceil(end * _PER_SECOND))))


def poses(subject: Subject) -> Poses:
    """Poses at evenly spaced times, and at each event from its record."""
    run = subject.run
    rows = np.unique(np.clip(np.searchsorted(run.time, picked_times(run) - 1e-9), 0, len(run.time) - 1))
    by_time = dict(zip(run.time[rows].tolist(), run.qpos[rows], strict=True))
    # A log may hold any numbers: use a record only if its number of coordinates is that of the models.
    records = [record for record in run.log.events if hasattr(record, "qpos")]
    at_events = {
        kind_of(record).time(record): np.array(record.qpos)
        for record in records
        if len(record.qpos) == subject.system.mj.nq and np.isfinite(record.qpos).all()
    }
    by_time |= at_events
    times = np.array(sorted(by_time))
    bodies = subject.system.mj.nbody
    positions, quaternions = np.empty((len(times), bodies, 3)), np.empty((len(times), bodies, 4))
    for i, time in enumerate(times.tolist()):
        data = subject.silhouette.place(by_time[time])
        positions[i], quaternions[i] = data.xpos, data.xquat
    after = np.clip(np.searchsorted(run.time, times - 1e-9), 0, len(run.time) - 1)
    return Poses(times, np.asarray(run.log.rows[after]), positions, quaternions, len(at_events))


PLUME = packed(palette.PLUME)
"""Colour of plumes."""
TICKS_PER_S = 1000.0
"""K3D's time in ms: it merges times that differ by less than 0.001, whatever their unit."""
FAR_M = 1e6
"""Positions beyond this are clipped: they come from a run that diverged."""
SWITCH_S = 1e-5
"""Transition time to appear or disappear: K3D switches values half-way between two times."""


def forces(header: RunHeader, poses: Poses, scale: float) -> Iterator[Any]:
    """An arrow along each force and torque that a contact model declares; it ends at the point of application."""
    for arrow in declared_arrows(header):
        series = arrow_series(arrow, poses.rows, scale)
        colour = packed(arrow_colour(arrow))
        yield from _while(series.acts, arrow_solid(scale), colour, poses.times, series.origins, series.vectors)


LVLH = {name: packed(palette.AXES[axis]) for name, axis in LVLH_ARROWS.items()}
"""Colours of the arrows of LVLH by their meaning."""


def lvlh_arrows(layout: Layout, poses: Poses, length_m: float) -> Iterator[Any]:
    """Arrows along V-bar and R-bar at the world origin of a run in orbit, which turn in the world axes."""
    if not has_orbit(layout):
        return
    frames = lvlh_frames(layout, poses.rows)
    for name, axis in LVLH_ARROWS.items():
        matrices = np.array([along_z(np.zeros(3), length_m * frame[:, axis]) for frame in frames])
        yield solid(arrow_solid(0.5 * length_m), LVLH[name], _over_time(poses, matrices), {"0.0": True})


def plumes(layout: Layout, system: System, poses: Poses, scale: float) -> Iterator[Any]:
    """A cone along the exhaust of each firing thruster, with length proportional to force over maximum force."""
    for thruster in thrusters(system, layout):
        series = plume_series(thruster, poses, scale)
        yield from _while(series.fires, plume_solid(scale), PLUME, poses.times, series.origins, series.vectors)


def _while(
    on: npt.NDArray[np.bool_], triangles: Triangles, colour: int, times: FloatArray, starts: FloatArray, vectors: FloatArray
) -> Iterator[Any]:
    """A solid along vectors, visible while the mask is set, (n,); nothing if it never is."""
    if on.any():
        matrices = map(along_z, starts[on], vectors[on])
        moving = dict(zip(map(tick, times[on].tolist()), matrices, strict=True))
        yield solid(triangles, colour, moving, during(_spans(times, on)))


def solid(triangles: Triangles, colour: int, matrix: Any, shown: dict[str, bool]) -> Any:
    """A mesh of one colour with a constant or time-dependent pose and visibility."""
    corners, faces = triangles
    mesh = k3d.mesh(single(corners), faces.astype(np.uint32), color=colour, flat_shading=False, visible=shown)
    mesh.model_matrix = matrix
    return mesh


def along_z(start: FloatArray, vector: FloatArray) -> Any:
    """Transform of a solid of 1 m along the z axis to a start point and a vector; it is scaled along its axis only."""
    length = np.linalg.norm(vector)
    across = np.cross(vector, np.eye(3)[np.argmin(np.abs(vector))])
    across /= np.linalg.norm(across)
    matrix = np.eye(4)
    matrix[:3] = np.column_stack((across, np.cross(vector / length, across), vector, start))
    return single(matrix)


def _spans(times: FloatArray, on: npt.NDArray[np.bool_]) -> list[tuple[float, float]]:
    """First and last time of each interval in which the mask is set."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], on, [False])).astype(int)))
    return [(float(times[first]), float(times[end - 1])) for first, end in edges.reshape(-1, 2)]


def during(spans: Iterable[tuple[float, float]]) -> dict[str, bool]:
    """Visibility by time for some closed intervals."""
    visible = {0.0: False}
    for start, end in spans:
        visible |= {max(start - SWITCH_S, 0.0): False, start: True, end: True, end + SWITCH_S: False}
    return {tick(time): on for time, on in sorted(visible.items())}


def tick(time: float) -> str:
    """K3D's key of a time in s."""
    return repr(TICKS_PER_S * time)


def single(values: Any) -> Any:
    """Finite numbers in single precision."""
    return np.nan_to_num(np.clip(values, -FAR_M, FAR_M)).astype(np.float32)


BEFORE, AFTER, MARK, TARGET = map(packed, (palette.ROBOT_ON_DARK, palette.TIP_AFTER, palette.MARK, palette.ON_ANY_GROUND))
"""Colours of the tip's path before and after the first mark, of marks and of the target."""
MOST_MARKS = 200
_AXES_SHARE = 0.2
"""Length of the arrows of LVLH against the radius of the view."""
_FIELD_OF_VIEW_DEG = 45.0
_HALF_VIEW = (0.36, 0.36)
"""Tangents of half the field of view in a square picture, less a margin."""


@dataclass(frozen=True)
class PageScene:
    """Scene for the script of the page.

    Attributes:
        snapshot: Compressed snapshot for K3D's viewer.
        centre: Target of the camera, (3,), m.
        to_eye: From there to the camera in a view that is not higher than wide, (3,), m.
        path: Displacements of the camera at the times of the poses, (n, 3), m; None if it stands still.
        undrawn: Number of marks that are not drawn.
        colours: Colours of everything except bodies.
    """

    snapshot: bytes
    centre: FloatArray
    to_eye: FloatArray
    path: FloatArray | None
    undrawn: int
    colours: frozenset[int]


def scene(subject: Subject, poses: Poses) -> PageScene:
    """Draw the scene of a run."""
    scale = marker_scale(subject.system)
    marks = drawn_marks(subject.run.log.events, scale)
    points = _framed(subject, poses, marks)
    low, high = points.min(axis=0), points.max(axis=0)
    look = {"menu_visibility": False, "camera_auto_fit": False, "grid_auto_fit": False, "grid_visible": False}
    plot = k3d.plot(axes_helper=0, camera_fov=_FIELD_OF_VIEW_DEG, **look)
    eye, centre = aimed(points, _back(subject, poses, marks, points), _HALF_VIEW)
    length_m = max(2.0 * scale, _AXES_SHARE * 0.5 * float(np.linalg.norm(high - low)))
    others = list(_others(subject, poses, marks[:MOST_MARKS], scale))
    others += lvlh_arrows(subject.run.log.header.layout, poses, length_m)
    for drawn in (*_bodies(subject, poses), *others):
        plot += drawn
    first_s = marks[0].time_s if marks else 0.0
    boxes = robot_boxes(subject.system, poses.positions)
    path = camera_path(poses.times, single(boxes).astype(np.float64), first_s, (low, high))
    colours = frozenset(int(other.color) for other in others)
    return PageScene(plot.get_binary_snapshot(), centre, eye - centre, path, max(0, len(marks) - MOST_MARKS), colours)


def _framed(subject: Subject, poses: Poses, marks: list[DrawnMark]) -> FloatArray:
    """Points to keep in view at the first mark, (n, 3), m: moving bodies, its marks, and the target."""
    first, task = _first_pose(poses, marks), logged_task(subject.run.log.header.metadata)
    bodies = framed_points(subject.system, poses.positions[first], poses.quaternions[first])
    points = np.vstack((bodies, _first_points(marks), *([task.point_m] if task is not None else [])))
    near = points[(np.abs(points) < FAR_M).all(axis=1)]  # a log may hold any double
    return near if len(near) else np.array([[-1.0] * 3, [1.0] * 3])


def _first_pose(poses: Poses, marks: list[DrawnMark]) -> int:
    """Index of the pose at the first mark, or of the start."""
    return poses.nearest(marks[0].time_s) if marks else 0


def _first_points(marks: list[DrawnMark]) -> FloatArray:
    """Points of the marks at the time of the first one, (n, 3), m."""
    points = [mark.mark.point_m for mark in marks if mark.time_s == marks[0].time_s]
    return np.array(points[:MOST_MARKS]).reshape(-1, 3)


def _back(subject: Subject, poses: Poses, marks: list[DrawnMark], points: FloatArray) -> FloatArray:
    """Direction from the scene to the camera: that of the scenario, or the one that shows most at the first mark."""
    first = _first_pose(poses, marks)
    positions, contacts = (single(part).astype(np.float64) for part in (poses.positions[first], _first_points(marks)))
    posed = subject.system, positions, poses.quaternions[first]
    return direction(logged_scenario(subject.run.log).view, posed, contacts, points, _HALF_VIEW)


def _others(subject: Subject, poses: Poses, marks: list[DrawnMark], scale: float) -> Iterator[Any]:
    yield from _paths(subject, marks, scale)
    task = logged_task(subject.run.log.header.metadata)
    if task is not None:
        yield _target(task, subject, poses, scale)
    yield from (_mark(drawn, scale) for drawn in marks)
    instants = [list(together) for _, together in groupby(marks, key=lambda drawn: drawn.time_s)]
    for together, after in zip(instants, [*instants[1:], None], strict=False):
        until_s = min(together[0].end_s, after[0].time_s - 2.0 * SWITCH_S if after else np.inf)
        yield from (_label(drawn, lines, until_s) for drawn, lines in texts(together, scale))
    header = subject.run.log.header
    yield from forces(header, poses, scale)
    yield from plumes(header.layout, subject.system, poses, scale)


def _target(task: LoggedTask, subject: Subject, poses: Poses, scale: float) -> Any:
    """A cross at the target; one that moves has a pose at each time."""
    columns = task.moving_columns(subject.run.log.header.layout)
    arms = [sign * 0.2 * scale * axis for axis in np.eye(3) for sign in (-1, 1)]
    cross = k3d.lines(single(arms), [[0, 1], [2, 3], [4, 5]], indices_type="segment", width=0.03 * scale, color=TARGET)
    places = poses.rows[:, columns] if columns else task.point_m[None]
    matrices = np.tile(np.eye(4), (len(places), 1, 1))
    matrices[:, :3, 3] = places
    cross.model_matrix = _over_time(poses, single(matrices))
    return cross


def _bodies(subject: Subject, poses: Poses) -> Iterator[Any]:
    """One mesh for all shapes of a body with the same opacity and shading."""
    groups: dict[tuple[int, float, bool], list[DrawnShape]] = {}
    for shape in shapes(subject.system):
        groups.setdefault((shape.body, shape.rgba[3], shape.kind == "mesh"), []).append(shape)
    for (body, opacity, flat), alike in groups.items():
        parts = [triangles(shape) for shape in alike]
        corners, faces = joined(parts)
        colours = np.repeat([_colour(shape.rgba) for shape in alike], [len(part[0]) for part in parts])
        look = {"opacity": opacity, "flat_shading": flat, "side": "double"}
        mesh = k3d.mesh(single(corners), faces.astype(np.uint32), colors=colours.astype(np.uint32), **look)
        mesh.model_matrix = _matrices(poses, body)
        yield mesh


def _matrices(poses: Poses, body: int) -> Any:
    """Pose of a body over time, or one constant pose if it never moves."""
    matrices = np.tile(np.eye(4), (len(poses.times), 1, 1))
    for matrix, quaternion in zip(matrices, poses.quaternions[:, body], strict=True):
        matrix[:3, :3] = rotation_matrix(quaternion)
    matrices[:, :3, 3] = poses.positions[:, body]
    return _over_time(poses, single(matrices))


def _over_time(poses: Poses, matrices: Any) -> Any:
    """Poses at the times of the page, or one that is constant."""
    if np.array_equal(matrices, np.broadcast_to(matrices[0], matrices.shape)):
        return matrices[0]
    return dict(zip(map(tick, poses.times.tolist()), matrices, strict=True))


def _paths(subject: Subject, marks: list[DrawnMark], scale: float) -> Iterator[Any]:
    """Path of the tip, or of the robot's base without a tip; it changes colour at the first mark."""
    robot = subject.system.robot
    path = subject.tip if subject.tip is not None else subject.roots[robot.name]
    times = subject.run.time[subject.chosen]
    first = marks[0].time_s if marks else np.inf
    for part, colour in ((path[times <= first], BEFORE), (path[times >= first], AFTER)):
        if len(part) > 1:
            yield k3d.line(single(part), color=colour, width=0.02 * scale)


def _mark(drawn: DrawnMark, scale: float) -> Any:
    """An arrow that ends at its point and is never occluded, or a dot."""
    vector, point = drawn.vector, np.array(drawn.mark.point_m)
    shown = during([(drawn.time_s, drawn.end_s)])
    if vector.any():
        return solid(arrow_solid(scale), MARK, along_z(point - vector, vector), shown)
    return k3d.points(single([point]), color=MARK, point_size=0.12 * scale, shader="3d", visible=shown)


def _label(drawn: DrawnMark, lines: list[str], until_s: float) -> Any:
    """Texts at the end of the arrow of a mark that is off its point, until those of the next instant."""
    text = f'<span class="mark">{"<br>".join(html.escape(one_line(line)) for line in lines)}</span>'
    look = {"color": MARK, "is_html": True, "label_box": False, "max_length": 0.08}
    place = np.array(drawn.mark.point_m) - drawn.vector
    return k3d.label(text, place.tolist(), visible=during([(drawn.time_s, max(drawn.time_s, until_s))]), **look)


def _colour(rgba: tuple[float, ...]) -> int:
    red, green, blue = (round(255 * value) for value in rgba[:3])
    return red << 16 | green << 8 | blue
