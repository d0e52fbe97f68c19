"""What a recording shows in its scene: geoms, estimated poses, the target, forces and torques, marks of events."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import rerun as rr

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.rigid_body import rotation_matrix
from ffsm_mj.log.drawing import DrawnShape, Poser, rotated, shapes
from ffsm_mj.log.markers import (
    LVLH_ARROWS,
    SHOWN_S,
    DrawnMark,
    MarkSequence,
    are_near,
    arrow_series,
    declared_arrows,
    has_orbit,
    lvlh_frames,
    texts,
)
from ffsm_mj.log.palette import AXES, BLUE, FORCE, GHOST, MARK, ORANGE, PURPLE, SKY, TARGET_ON_DARK, TORQUE, VERMILION
from ffsm_mj.log.rerun.layout import Opening
from ffsm_mj.log.rerun.plots import FORCES, TORQUES, Recording
from ffsm_mj.model.system import System
from ffsm_mj.records.events import Event
from ffsm_mj.records.kinds import ArrowColumns
from ffsm_mj.records.metadata import LoggedTask
from ffsm_mj.records.run_log import RunHeader
from ffsm_mj.records.signals import Layout, coordinate_keys, identifier


def body_path(system: System, body: int) -> str:
    """Entity of a body, such as ``world/robot/base``. They are not nested: all poses are in the world frame."""
    tree, _, name = system.mj.body(body).name.partition("/")
    return f"world/{identifier(tree)}/{identifier(name)}"


def log_shapes(recording: Recording, system: System) -> dict[int, str]:
    """Log every drawn geom once, in the frame of its body; returns the entity of the first one of each body."""
    first: dict[int, str] = {}
    for shape in shapes(system):
        parent = body_path(system, shape.body) if shape.body else "world/static"
        entity = f"{parent}/{identifier(shape.name)}"
        recording.constant(entity, archetype(shape))
        first.setdefault(shape.body, entity)
    return first


def target_cross(point_m: FloatArray, name: str, scale: float) -> rr.LineStrips3D:
    """A small cross at a target, on a pole that carries its name above the motion, at a scale of markers."""
    x, y, z = scale * np.eye(3)
    arms = [[point_m, point_m + 0.6 * z], *([point_m - 0.2 * axis, point_m + 0.2 * axis] for axis in (x, y))]
    return rr.LineStrips3D(arms, colors=[TARGET_ON_DARK], radii=[0.02 * scale], labels=[name, "", ""], show_labels=True)


def archetype(shape: DrawnShape) -> Any:
    """A shape in the frame of its body."""
    colour = tuple(round(255 * c) for c in shape.rgba)
    if shape.kind != "mesh":
        return primitive(shape, colour)
    turn = rotation_matrix(shape.quaternion)
    return rr.Mesh3D(  # without normals it would not be shaded
        vertex_positions=shape.vertices @ turn.T + shape.position,
        vertex_normals=shape.normals @ turn.T,
        triangle_indices=shape.triangles,
        albedo_factor=colour,
    )


def primitive(shape: DrawnShape, colour: Sequence[int], fill_mode: str = "solid") -> Any:
    """A shape in the frame of its body, solid or as a wireframe; the bounding box of a mesh.

    Args:
        shape: The shape.
        colour: Red, green, blue and opacity, each from 0 to 255.
        fill_mode: Fill mode of Rerun.
    """
    look: dict[str, Any] = {
        "quaternions": [np.roll(shape.quaternion, -1)],  # xyzw
        "colors": [colour],
        "fill_mode": fill_mode,
    }
    if shape.kind in ("box", "mesh"):
        size, centre = shape.size, shape.position
        if shape.kind == "mesh":
            low, high = shape.vertices.min(axis=0), shape.vertices.max(axis=0)
            size, centre = 0.5 * (high - low), shape.position + rotated(0.5 * (low + high), shape.quaternion)
        return rr.Boxes3D(half_sizes=[size], centers=[centre], **look)
    if shape.kind == "ellipsoid":
        return rr.Ellipsoids3D(half_sizes=[shape.size], centers=[shape.position], **look)
    radius, half_length = shape.size[:2]
    if shape.kind == "cylinder":
        return rr.Cylinders3D(lengths=[2 * half_length], radii=[radius], centers=[shape.position], **look)
    # A capsule of Rerun extends from its origin along +z; MuJoCo's is centred.
    axis = rotated(np.array([0.0, 0.0, half_length]), shape.quaternion)
    return rr.Capsules3D(lengths=[2 * half_length], radii=[radius], translations=[shape.position - axis], **look)


_GHOST = (*GHOST, 170)


class Ghosts:
    """Sends the estimated poses of floating robots and objects with all their bodies; nothing without an estimate."""

    def __init__(self, recording: Recording, system: System, layout: Layout) -> None:
        """Log the wireframes of the geoms."""
        self._system, self._recording = system, recording
        keys = [key.replace("state.", "estimate.", 1) for key in coordinate_keys(system.joints.values())]
        floating = [tree for tree in system.trees if tree.joints[0].kind == "free"]
        self._bodies = [body for tree in floating for body in tree.bodies] if set(keys) <= set(layout.index) else []
        if not self._bodies:
            return
        self._coordinates, self._poser = layout.places(keys), Poser(system.mj)
        for shape in shapes(system):
            if shape.body in self._bodies:
                # Of a mesh the bounding box is drawn, as meshes have no wireframe in the viewer.
                wireframe = primitive(shape, _GHOST, "majorwireframe")
                recording.constant(f"{self._path(shape.body)}/{identifier(shape.name)}", wireframe)
        for tree in floating:
            text = rr.Points3D(
                [np.zeros(3)], colors=[GHOST], radii=[0.0], labels=[f"estimate of {tree.name}"], show_labels=True
            )
            recording.constant(f"{self._path(tree.root)}/name", text)

    def _path(self, body: int) -> str:
        return body_path(self._system, body).replace("world/", "world/estimate/", 1)

    def send(self, rows: FloatArray, index: Any) -> None:
        """Send the poses of some rows, (n, number of signals), at an index of their times."""
        if self._bodies:
            positions, quaternions = self._poser.poses(rows[:, self._coordinates])
            for body in self._bodies:
                self._recording.send(self._path(body), index, poses(positions[:, body], quaternions[:, body]))


def poses(positions: FloatArray, quaternions: FloatArray) -> Any:
    """Columns of the poses of a body: positions, (n, 3), m, and orientations wxyz, (n, 4)."""
    return rr.Transform3D.columns(translation=positions, quaternion=np.roll(quaternions, -1, axis=-1))  # xyzw


class OrbitFrame:
    """The entity ``world/orbit`` of a run in orbit: LVLH axes at the world origin, with arrows along V-bar and R-bar.

    A 3-D view whose origin it is shows everything in LVLH axes.
    """

    def __init__(self, recording: Recording, layout: Layout, scale: float) -> None:
        """Draw the arrows at a scale of markers; nothing without an orbit."""
        self._recording, self._layout = recording, layout
        if not has_orbit(layout):
            return
        axes = list(LVLH_ARROWS.values())
        vectors, colours = 3.0 * scale * np.eye(3)[axes], [AXES[axis] for axis in axes]
        radii, labels = [0.04 * scale], [name.split(",")[0] for name in LVLH_ARROWS]  # long ones overlap
        arrows = rr.Arrows3D(vectors=vectors, colors=colours, radii=radii, labels=labels, show_labels=True)
        recording.constant("world/orbit/axes", arrows)

    def send(self, rows: FloatArray, index: Any) -> None:
        """Send the axes in some rows, (n, number of signals), at an index of their times."""
        if has_orbit(self._layout):
            frames = lvlh_frames(self._layout, rows)
            self._recording.send("world/orbit", index, rr.Transform3D.columns(mat3x3=frames))


class Target:
    """Draws the target of a task; one that moves is followed."""

    def __init__(self, recording: Recording, header: RunHeader, task: LoggedTask, scale: float) -> None:
        """Draw it at a scale of markers."""
        self._task, self._layout, self._moving = task, header.layout, task.moving_columns(header.layout)
        self._recording = recording
        line = rr.SeriesLines(names=["tip error"], colors=[ORANGE], widths=[1.5])
        recording.constant("plots/tip_error", line)
        place = np.zeros(3) if self._moving else task.point_m
        recording.constant("world/task/target", target_cross(place, "target", scale))

    @property
    def points(self) -> FloatArray:
        """Points to keep in view: where it stands or begins, (1, 3), m."""
        return self._task.point_m[None]

    def send(self, rows: FloatArray, index: Any) -> None:
        """Send where it is in some rows, and the distance of the tip, at an index of their times."""
        if self._moving:
            self._recording.send("world/task/target", index, rr.Transform3D.columns(translation=rows[:, self._moving]))
        error = np.linalg.norm(self._task.errors_m(self._layout, lambda key: rows[:, self._layout.index[key]]), axis=1)
        self._recording.send("plots/tip_error", index, rr.Scalars.columns(scalars=error))


_COLOURS = (FORCE, PURPLE, SKY, VERMILION, BLUE)
"""Colours of forces and their curves in turn; torques have one of their own."""


class Forces:
    """Sends the arrows that contact models declare; an entity is created when its arrow first acts."""

    def __init__(self, recording: Recording, header: RunHeader, scale: float) -> None:
        """Start without entities, at a scale of markers."""
        self._scale = scale
        self._recording, self._declared = recording, declared_arrows(header)
        self._begun: list[ArrowColumns] = []

    def possible(self, *, torques: bool) -> list[str]:
        """Names of all declared forces, or torques."""
        return [arrow.name for arrow in self._declared if arrow.is_torque == torques]

    def begun(self, *, torques: bool) -> list[str]:
        """Names of the forces, or torques, that have acted."""
        return [arrow.name for arrow in self._begun if arrow.is_torque == torques]

    def send(self, rows: FloatArray, index: Any) -> None:
        """Send arrows and magnitudes of some rows at an index of their times."""
        for arrow in self._declared:
            series = arrow_series(arrow, rows, self._scale)
            if arrow not in self._begun:
                if not series.acts.any():
                    continue
                self._begin(arrow)
            arrows = rr.Arrows3D.columns(origins=series.origins, vectors=series.vectors)
            self._recording.send(f"world/contacts/{arrow.name}", index, arrows)
            self._recording.send(_plot(arrow), index, rr.Scalars.columns(scalars=series.sizes))

    def _begin(self, arrow: ArrowColumns) -> None:
        colour = TORQUE if arrow.is_torque else _COLOURS[len(self._begun) % len(_COLOURS)]
        self._begun.append(arrow)
        look = rr.Arrows3D.from_fields(colors=[colour], radii=[0.03 * self._scale])
        self._recording.constant(f"world/contacts/{arrow.name}", look)
        line = rr.SeriesLines(names=[arrow.name], colors=[colour], widths=[1.5])
        self._recording.constant(_plot(arrow), line)


def _plot(arrow: ArrowColumns) -> str:
    """Entity of a magnitude over time."""
    return f"{TORQUES if arrow.is_torque else FORCES}/{arrow.name}"


Send = Callable[[float, str, Any], None]
"""Sends one value to an entity at a time in s."""


class Marks:
    """Draws the marks of events as they come, and removes them after some time."""

    def __init__(self, send: Send, opening: Opening, scale: float) -> None:
        """Start without marks, at a scale of markers."""
        self._send, self._opening, self._scale = send, opening, scale
        self._sequence = MarkSequence(scale)
        self._shown: list[tuple[float, str]] = []
        self._instant: list[DrawnMark] = []
        self._labelled: list[DrawnMark] = []

    def event(self, event: Event) -> None:
        """Draw the marks of an event; their texts follow when all marks of the instant are known."""
        for drawn in self._sequence.add(event):
            if self._instant and drawn.time_s > self._instant[0].time_s:
                self.label()
            entity = _entity(drawn)
            self._send(drawn.time_s, entity, _shape(drawn, self._scale))
            self._instant.append(drawn)
            self._shown.append((drawn.end_s, entity))
            self._opening.add_mark(drawn.time_s, drawn.mark.point_m)

    def label(self) -> None:
        """Draw the texts of the last instant."""
        for drawn, lines in texts(self._instant, self._scale):
            if self._makes_room(drawn):
                self._send(drawn.time_s, _text_of(drawn), _text(drawn, lines, self._scale))
        self._instant.clear()

    def clear(self, now_s: float) -> None:
        """Remove marks whose time is over; never ahead of the motion, or a viewer would jump there."""
        if self._instant and self._instant[0].time_s < now_s:
            self.label()
        for end_s, entity in [mark for mark in self._shown if mark[0] <= now_s]:
            self._shown.remove((end_s, entity))
            self._send(end_s, entity, rr.Clear.columns(is_recursive=[True]))

    def _makes_room(self, new: DrawnMark) -> bool:
        """Whether the text of a new mark is shown.

        Of marks of one kind at one place within ``SHOWN_S``, only that of greatest magnitude has a text; it replaces the
        earlier ones.
        """
        self._labelled = [old for old in self._labelled if new.time_s - old.time_s < SHOWN_S]
        # Bouncing contacts hit the same place many times within seconds; their texts would cover each other.
        near = [old for old in self._labelled if are_near(old, new, self._scale)]
        if any(old.kind is new.kind and new.mark.magnitude <= old.mark.magnitude for old in near):
            return False
        for old in near:
            self._labelled.remove(old)
            if old.time_s < new.time_s:
                self._send(new.time_s, _text_of(old), rr.Clear.columns(is_recursive=[False]))
        self._labelled.append(new)
        return True


def _entity(drawn: DrawnMark) -> str:
    return f"world/{drawn.kind.plural}/{drawn.instant}/{identifier(drawn.mark.name)}_{drawn.number + 1}"


def _shape(drawn: DrawnMark, scale: float) -> Any:
    """An arrow that ends at the point, so that the body that it pushes does not hide it, or a dot."""
    vector = drawn.vector
    if not vector.any():
        return rr.Points3D.columns(positions=[drawn.mark.point_m], colors=[MARK], radii=[0.06 * scale])
    origins = [np.array(drawn.mark.point_m) - vector]
    return rr.Arrows3D.columns(origins=origins, vectors=[vector], colors=[MARK], radii=[0.04 * scale])


_CLEAR_M = 1.5
"""Length of an arrow at scale 1 in whose middle a text does not hide the contact; that of a shorter one stands higher."""


def _text_of(drawn: DrawnMark) -> str:
    return f"{_entity(drawn)}/text"


def _text(drawn: DrawnMark, lines: Sequence[str], scale: float) -> Any:
    """The text at a mark, at the middle of its arrow or above it."""
    above = max(0.0, _CLEAR_M * scale - float(np.linalg.norm(drawn.vector)))
    place = np.array(drawn.mark.point_m) - 0.5 * drawn.vector + (0.0, 0.0, above)
    return rr.Points3D.columns(positions=[place], colors=[MARK], radii=[0.0], labels=[", ".join(lines)])
