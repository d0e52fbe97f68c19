"""The scene of a page, drawn by K3D: bodies that move, the target, the tip's path, marks of records, forces of contacts."""

from __future__ import annotations

import html
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import k3d
import numpy as np
import numpy.typing as npt

from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import one_line
from ffsm_mj.log.contact_forces import force_columns
from ffsm_mj.log.drawing import Shape, shapes
from ffsm_mj.log.instants import SHOWN_S
from ffsm_mj.present.page.poses import Poses
from ffsm_mj.present.page.solids import arrow, joined, triangles
from ffsm_mj.present.plots.subject import Subject
from ffsm_mj.records.facts import logged_task
from ffsm_mj.records.kinds import Mark

BEFORE, AFTER, MARK, FORCE, TORQUE, TARGET = 0x56B4E9, 0xE69F00, 0xD55E00, 0x009E73, 0xF0E442, 0xCC79A7
"""Colours of the tip's path before and after the first mark, of marks, of forces, of torques and of the target."""
MOST_MARKS = 200
_ARROW_M = (0.4, 1.5)
"""Drawn lengths of an arrow, m; between them 1 m is 1 N s of an impulse, or 1 N."""
TICKS_PER_S = 1000.0
"""K3D's time is in ms: it takes times less than 0.001 apart, whatever their unit, for the same."""
_FAR_M = 1e6
"""What is farther away is not drawn at its place: it comes from a run that diverged."""
_SWITCH_S = 1e-5
"""How long it takes to appear or go: values between two times of a drawing change half-way."""


@dataclass(frozen=True)
class Scene:
    """What the page's script shows.

    Attributes:
        snapshot: For K3D's viewer, compressed.
        centre: What the camera looks at, (3,), m.
        radius: Of a ball around it that is to be in view, m.
        undrawn: How many marks are beyond those that are drawn.
    """

    snapshot: bytes
    centre: FloatArray
    radius: float
    undrawn: int


def scene(subject: Subject, poses: Poses) -> Scene:
    """Draw a run."""
    found = [(time, mark) for _, time, mark in subject.marks if np.isfinite((time, *mark.point_m, *mark.direction)).all()]
    marks = sorted(found, key=lambda drawn: drawn[0])
    low, high = _box(subject, poses, marks)
    plot = k3d.plot(menu_visibility=False, camera_auto_fit=False, grid_auto_fit=False, axes_helper=0, camera_fov=45.0)
    middle, half = 0.5 * (low + high), 0.5 * np.maximum(high - low, 0.6 * np.max(high - low))
    plot.grid = [*np.floor(middle - half).tolist(), *np.ceil(middle + half).tolist()]
    plot.axes = ["x,\\,m", "y,\\,m", "z,\\,m"]
    for drawn in _everything(subject, poses, marks[:MOST_MARKS]):
        plot += drawn
    return Scene(
        plot.get_binary_snapshot(), middle, 0.5 * float(np.linalg.norm(high - low)), max(0, len(marks) - MOST_MARKS)
    )


def _box(subject: Subject, poses: Poses, marks: list[tuple[float, Mark]]) -> tuple[FloatArray, FloatArray]:
    """Corners of a box around what is worth looking at first: bodies at the start and the first mark, marks, the target."""
    moments = [0, *(poses.nearest(marks[0][0]) for _ in marks[:1])]
    points = [poses.positions[moments, 1:].reshape(-1, 3), *(np.array([mark.point_m]) for _, mark in marks[:MOST_MARKS])]
    task = logged_task(subject.run.log.header.facts)
    points += [task.point_m[None]] if task is not None else []
    everything = np.concatenate(points)
    everything = everything[(np.abs(everything) < _FAR_M).all(axis=1)]  # a log may hold any double
    if not len(everything):
        return np.full(3, -1.0), np.full(3, 1.0)
    return everything.min(axis=0) - 0.8, everything.max(axis=0) + 0.8


def _everything(subject: Subject, poses: Poses, marks: list[tuple[float, Mark]]) -> Iterator[Any]:
    yield from _bodies(subject, poses)
    yield from _paths(subject, marks)
    task = logged_task(subject.run.log.header.facts)
    if task is not None:
        arms = [task.point_m + sign * 0.2 * axis for axis in np.eye(3) for sign in (-1, 1)]
        yield k3d.lines(_single(arms), [[0, 1], [2, 3], [4, 5]], indices_type="segment", width=0.03, color=TARGET)
    for time, mark in marks:
        ahead = min((other for other, _ in marks if other > time), default=np.inf)
        yield from _mark(time, mark, min(time + SHOWN_S, ahead - 2.0 * _SWITCH_S))
    yield from _forces(subject, poses)


def _bodies(subject: Subject, poses: Poses) -> Iterator[Any]:
    """One mesh for all shapes of a body that are equally opaque and shaded alike."""
    groups: dict[tuple[int, float, bool], list[Shape]] = {}
    for shape in shapes(subject.system):
        groups.setdefault((shape.body, shape.rgba[3], shape.kind == "mesh"), []).append(shape)
    for (body, opacity, flat), alike in groups.items():
        parts = [triangles(shape) for shape in alike]
        corners, faces = joined(parts)
        colours = np.repeat([_colour(shape.rgba) for shape in alike], [len(part[0]) for part in parts])
        look = {"opacity": opacity, "flat_shading": flat, "side": "double"}
        mesh = k3d.mesh(_single(corners), faces.astype(np.uint32), colors=colours.astype(np.uint32), **look)
        mesh.model_matrix = _matrices(poses, body)
        yield mesh


def _matrices(poses: Poses, body: int) -> Any:
    """Where a body is over time, or for good where it never moves."""
    matrices = np.tile(np.eye(4), (len(poses.times), 1, 1))
    matrices[:, :3, :3], matrices[:, :3, 3] = poses.rotations[:, body], poses.positions[:, body]
    matrices = _single(matrices)
    if np.array_equal(matrices, np.broadcast_to(matrices[0], matrices.shape)):
        return matrices[0]
    return dict(zip(map(_tick, poses.times.tolist()), matrices, strict=True))


def _paths(subject: Subject, marks: list[tuple[float, Mark]]) -> Iterator[Any]:
    """The way of the tip, or of the root of the robot where there is no tip, in another colour from the first mark on."""
    robot = subject.system.robot
    path = subject.tip if subject.tip is not None else subject.roots[robot.name]
    times = subject.run.time[subject.chosen]
    first = marks[0][0] if marks else np.inf
    for part, colour in ((path[times <= first], BEFORE), (path[times >= first], AFTER)):
        if len(part) > 1:
            yield k3d.line(_single(part), color=colour, width=0.02)


def _mark(time: float, mark: Mark, told_until: float) -> Iterator[Any]:
    """An arrow that ends at its point, where nothing hides it, or a dot; the text beside it until the next one's."""
    shown, point = _during([(time, time + SHOWN_S)]), np.array(mark.point_m)
    push = np.array(mark.direction) * float(np.clip(mark.magnitude, *_ARROW_M))
    if push.any():
        yield _arrow(MARK, _along(point - push, push), shown)
    else:
        yield k3d.points(_single([point]), color=MARK, point_size=0.12, shader="3d", visible=shown)
    text = f'<span class="mark">{html.escape(one_line(mark.text))}</span>'
    look = {"color": MARK, "is_html": True, "label_box": False, "max_length": 0.08}
    yield k3d.label(text, (point - push).tolist(), visible=_during([(time, max(time, told_until))]), **look)


def _forces(subject: Subject, poses: Poses) -> Iterator[Any]:
    """An arrow along the force on the second geom of each pair, or a load, that ends where it acts, while it does."""
    for pair in force_columns(subject.run.log.header.layout):
        pressing = pair.pressing(poses.rows) & (pair.sizes(poses.rows) > 0.0)
        if not pressing.any():
            continue
        forces, ends = (poses.rows[pressing][:, columns] for columns in (pair.vector, pair.centre))
        sizes = np.linalg.norm(forces, axis=1, keepdims=True)
        pushes = np.clip(sizes, *_ARROW_M) * forces / np.maximum(sizes, 1e-300)
        matrices = list(map(_along, ends - pushes, pushes))
        moving = dict(zip(map(_tick, poses.times[pressing].tolist()), matrices, strict=True))
        yield _arrow(TORQUE if pair.turns else FORCE, moving, _during(_spans(poses.times, pressing)))


def _arrow(colour: int, matrix: Any, shown: dict[str, bool]) -> Any:
    corners, faces = arrow()
    mesh = k3d.mesh(_single(corners), faces.astype(np.uint32), color=colour, flat_shading=False, visible=shown)
    mesh.model_matrix = matrix
    return mesh


def _along(start: FloatArray, push: FloatArray) -> Any:
    """Where an arrow up the z axis begins and ends as another, as a matrix; only its length is changed."""
    length = np.linalg.norm(push)
    across = np.cross(push, np.eye(3)[np.argmin(np.abs(push))])
    across /= np.linalg.norm(across)
    matrix = np.eye(4)
    matrix[:3] = np.column_stack((across, np.cross(push / length, across), push, start))
    return _single(matrix)


def _spans(times: FloatArray, on: npt.NDArray[np.bool_]) -> list[tuple[float, float]]:
    """From the first to the last time of each stretch that is on."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], on, [False])).astype(int)))
    return [(float(times[first]), float(times[end - 1])) for first, end in edges.reshape(-1, 2)]


def _during(spans: Iterable[tuple[float, float]]) -> dict[str, bool]:
    """Visible in some spans of time only; the ends belong to them."""
    found = {0.0: False}
    for start, end in spans:
        found |= {max(start - _SWITCH_S, 0.0): False, start: True, end: True, end + _SWITCH_S: False}
    return {_tick(time): on for time, on in sorted(found.items())}


def _tick(time: float) -> str:
    """A time in s as K3D has it."""
    return repr(TICKS_PER_S * time)


def _colour(rgba: tuple[float, ...]) -> int:
    red, green, blue = (round(255 * value) for value in rgba[:3])
    return red << 16 | green << 8 | blue


def _single(values: Any) -> Any:
    return np.nan_to_num(np.clip(values, -_FAR_M, _FAR_M)).astype(np.float32)
