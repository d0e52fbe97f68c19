"""The scene of a page, drawn by K3D: bodies that move, the target, the tip's path, marks of records, forces, plumes."""

from __future__ import annotations

import html
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import k3d
import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import one_line
from ffsm_mj.log import palette
from ffsm_mj.log.drawing import DrawnShape, box_corners, camera_path, geoms_to_draw, marker_scale, robot_boxes, shapes
from ffsm_mj.log.markers import DrawnMark, drawn_marks
from ffsm_mj.log.palette import packed
from ffsm_mj.records.metadata import LoggedTask, logged_task
from ffsm_mj.report.page.moving import FAR_M, SWITCH_S, along_z, during, forces, plumes, single, solid, tick
from ffsm_mj.report.page.poses import Poses
from ffsm_mj.report.page.solids import arrow_solid, joined, triangles
from ffsm_mj.report.plots.subject import Subject

BEFORE, AFTER, MARK, TARGET = map(packed, (palette.ROBOT_ON_DARK, palette.TIP_AFTER, palette.MARK, palette.ON_ANY_GROUND))
"""Colours of the tip's path before and after the first mark, of marks and of the target."""
MOST_MARKS = 200


@dataclass(frozen=True)
class PageScene:
    """Scene for the script of the page.

    Attributes:
        snapshot: Compressed snapshot for K3D's viewer.
        centre: Target of the camera, (3,), m.
        radius: Radius of the sphere around it that must be in view, m.
        path: Displacements of the camera at the times of the poses, (n, 3), m; None if it stands still.
        undrawn: Number of marks that are not drawn.
        colours: Colours of everything except bodies.
    """

    snapshot: bytes
    centre: FloatArray
    radius: float
    path: FloatArray | None
    undrawn: int
    colours: frozenset[int]


def scene(subject: Subject, poses: Poses) -> PageScene:
    """Draw the scene of a run."""
    scale = marker_scale(subject.system)
    marks = drawn_marks(subject.run.log.events(), scale)
    low, high = _box(subject, poses, marks)
    plot = k3d.plot(menu_visibility=False, camera_auto_fit=False, grid_auto_fit=False, axes_helper=0, camera_fov=45.0)
    middle, half = 0.5 * (low + high), 0.5 * np.maximum(high - low, 0.6 * np.max(high - low))
    plot.grid = [*np.floor(middle - half).tolist(), *np.ceil(middle + half).tolist()]
    plot.axes = ["x,\\,m", "y,\\,m", "z,\\,m"]
    others = list(_others(subject, poses, marks[:MOST_MARKS], scale))
    for drawn in (*_bodies(subject, poses), *others):
        plot += drawn
    radius = 0.5 * float(np.linalg.norm(high - low)) or 1.0
    first_s = marks[0].time_s if marks else 0.0
    boxes = robot_boxes(subject.system, poses.positions)
    path = camera_path(poses.times, single(boxes).astype(np.float64), first_s, (low, high))
    colours = frozenset(int(each.color) for each in others)
    return PageScene(plot.get_binary_snapshot(), middle, radius, path, max(0, len(marks) - MOST_MARKS), colours)


def _box(subject: Subject, poses: Poses, marks: list[DrawnMark]) -> tuple[FloatArray, FloatArray]:
    """Corners of the initial view box: bodies at the start and at the first mark, marks, the target."""
    moments = [0, *(poses.nearest(marks[0].time_s) for _ in marks[:1])]
    model, still = subject.system.mj, {0, *subject.system.fixed_bodies}
    geoms = [geom for geom in geoms_to_draw(model) if int(model.geom_bodyid[geom]) not in still]
    points = [box_corners(model, geoms, poses.positions[i], poses.quaternions[i]) for i in moments]
    points += [poses.positions[moments, 1:].reshape(-1, 3), *(np.array([each.mark.point_m]) for each in marks[:MOST_MARKS])]
    task = logged_task(subject.run.log.header.metadata)
    points += [task.point_m[None]] if task is not None else []
    everything = np.concatenate(points)
    everything = everything[(np.abs(everything) < FAR_M).all(axis=1)]  # a log may hold any double
    if not len(everything):
        return np.full(3, -1.0), np.full(3, 1.0)
    return everything.min(axis=0), everything.max(axis=0)


def _others(subject: Subject, poses: Poses, marks: list[DrawnMark], scale: float) -> Iterator[Any]:
    yield from _paths(subject, marks, scale)
    task = logged_task(subject.run.log.header.metadata)
    if task is not None:
        yield _target(task, subject, poses, scale)
    for drawn in marks:
        ahead = min((other.time_s for other in marks if other.time_s > drawn.time_s), default=np.inf)
        yield from _mark(drawn, min(drawn.end_s, ahead - 2.0 * SWITCH_S), scale)
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
    turn = np.empty(9)
    for matrix, quaternion in zip(matrices, poses.quaternions[:, body], strict=True):
        mujoco.mju_quat2Mat(turn, quaternion)
        matrix[:3, :3] = turn.reshape(3, 3)
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


def _mark(drawn: DrawnMark, labelled_until: float, scale: float) -> Iterator[Any]:
    """An arrow that ends at its point and is never occluded, or a dot; its text is shown until that of the next mark."""
    time, mark, vector = drawn.time_s, drawn.mark, drawn.vector
    shown, point = during([(time, drawn.end_s)]), np.array(mark.point_m)
    if vector.any():
        yield solid(arrow_solid(scale), MARK, along_z(point - vector, vector), shown)
    else:
        yield k3d.points(single([point]), color=MARK, point_size=0.12 * scale, shader="3d", visible=shown)
    text = f'<span class="mark">{html.escape(one_line(mark.text))}</span>'
    look = {"color": MARK, "is_html": True, "label_box": False, "max_length": 0.08}
    yield k3d.label(text, (point - vector).tolist(), visible=during([(time, max(time, labelled_until))]), **look)


def _colour(rgba: tuple[float, ...]) -> int:
    red, green, blue = (round(255 * value) for value in rgba[:3])
    return red << 16 | green << 8 | blue
