"""Markers as every viewer draws them: arrows of forces and torques, marks of event records, plumes of thrusters."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np
import numpy.typing as npt

from ffsm_mj._core.orbit import lvlh_axes
from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.rigid_body import external_actuators
from ffsm_mj.log.drawing import Frames, rotated
from ffsm_mj.log.palette import FORCE, PART_OF_FORCE, TORQUE, Colour
from ffsm_mj.model.system import System
from ffsm_mj.records.kinds import ArrowColumns, Mark, RecordKind, kind_of, kinds_of
from ffsm_mj.records.run_log import RunHeader
from ffsm_mj.records.signals import Layout, identifier

ARROW_M = (0.4, 1.5)
"""Least and greatest drawn length of an arrow at scale 1, m; between them 1 m stands for 1 N, 1 N m or 1 N s."""


class ArrowSeries(NamedTuple):
    """One arrow in successive rows.

    Attributes:
        columns: The declaration that it comes from: name and unit.
        acts: Whether it is drawn in each row: its vector and point are finite, and its magnitude is positive, (n,).
        sizes: Magnitude, (n,), in its unit.
        origins: Points at which the drawn arrow starts in world axes, (n, 3), m; zero in rows in which it is not drawn.
        vectors: Drawn vector in world axes, (n, 3), m; the arrow ends at the point of application.
    """

    columns: ArrowColumns
    acts: npt.NDArray[np.bool_]
    sizes: FloatArray
    origins: FloatArray
    vectors: FloatArray


def declared_arrows(header: RunHeader) -> list[ArrowColumns]:
    """Arrows that the contact models of a run declare through their kinds of records."""
    return [arrow for kind in kinds_of(header.kinds) if kind.arrows is not None for arrow in kind.arrows(header.layout)]


def arrow_series(columns: ArrowColumns, rows: FloatArray, scale: float) -> ArrowSeries:
    """The arrow of one declaration in some rows.

    Args:
        columns: The declaration.
        rows: Rows of the log, (n, number of signals).
        scale: Scale of markers (:func:`ffsm_mj.log.drawing.marker_scale`).
    """
    forces, points = rows[:, columns.vector], rows[:, columns.point]
    # The drawn length follows the vector, not the column of the magnitude: a log of unknown origin may hold any values.
    norms = np.linalg.norm(forces, axis=1)
    acts = np.isfinite(points).all(axis=1) & np.isfinite(forces).all(axis=1) & (norms > 0.0)
    vectors = np.zeros_like(forces)
    vectors[acts] = forces[acts] * drawn_length(norms[acts], scale)[:, None] / norms[acts][:, None]
    origins = np.where(acts[:, None], points - vectors, 0.0)
    return ArrowSeries(columns, acts, norms if columns.size is None else rows[:, columns.size], origins, vectors)


def arrow_colour(columns: ArrowColumns) -> Colour:
    """Colour of an arrow, of a force, a part of one or a torque, where it does not depend on the other arrows."""
    if columns.is_torque:
        return TORQUE
    return PART_OF_FORCE if columns.is_part else FORCE


def drawn_vector(direction: Sequence[float], magnitude: float, scale: float) -> FloatArray:
    """Drawn vector of an arrow, (3,), m, of its unit vector and its magnitude in N, N m or N s, at a scale of markers."""
    return np.array(direction) * drawn_length(magnitude, scale)


def drawn_length(magnitude: FloatArray | float, scale: float) -> FloatArray:
    """Drawn length of arrows in m, of their magnitudes in N, N m or N s, at a scale of markers."""
    return scale * np.clip(magnitude, *ARROW_M)


SHOWN_S = 2.0
"""Simulation time for which viewers show a mark."""


def marks_topic(kind: RecordKind) -> str:
    """Topic of ``run.mcap`` that holds the marks of a kind, below the topic of the scene."""
    return f"/scene/{kind.plural}"


_REFERENCE = [f"orbit.{name}" for name in ("R_x_m", "R_y_m", "R_z_m", "V_x_m_s", "V_y_m_s", "V_z_m_s")]
LVLH_ARROWS = {"V-bar": 0, "R-bar, to the central body": 2}
"""Axes of LVLH that viewers draw at the world origin of a run in orbit."""


def has_orbit(layout: Layout) -> bool:
    """Whether a log has the columns of an orbit."""
    return set(_REFERENCE) <= set(layout.index)


def lvlh_frames(layout: Layout, rows: FloatArray) -> FloatArray:
    """LVLH axes as columns in world axes in some rows of a log of a run in orbit, (n, 3, 3)."""
    R, V = (np.ascontiguousarray(part) for part in np.split(rows[:, layout.places(_REFERENCE)], 2, axis=1))
    return lvlh_axes(R, V, 0.0, (0.0, 0.0, 1.0))[0]


class DrawnMark(NamedTuple):
    """A mark of an event record.

    Attributes:
        kind: Kind of the record.
        time_s: Time of the record.
        instant: Number of the earlier instants with marks of this kind.
        number: Number of the earlier marks of this kind at this instant.
        mark: Its point, text and name.
        vector: Drawn vector of its arrow in world axes, (3,), m, which ends at its point; zero if it has no arrow.
    """

    kind: RecordKind
    time_s: float
    instant: int
    number: int
    mark: Mark
    vector: FloatArray

    @property
    def end_s(self) -> float:
        """Time at which viewers remove it."""
        return self.time_s + SHOWN_S


class MarkSequence:
    """Numbers the marks of the records of a run, which come in order of time."""

    def __init__(self, scale: float) -> None:
        """Start before the first record.

        Args:
            scale: Scale of markers (:func:`ffsm_mj.log.drawing.marker_scale`).
        """
        self._scale = scale
        self._last: dict[str, list[DrawnMark]] = {}

    def add(self, record: Any) -> list[DrawnMark]:
        """Marks of the next record that can be drawn; a log of unknown origin may hold numbers that are not finite."""
        kind = kind_of(record)
        time, last = kind.time(record), self._last.get(kind.name, [])
        marks = [mark for mark in kind.marks(record) if _is_finite(mark)] if kind.marks is not None else []
        if not marks:
            return []
        # Contacts of one impact are separate records of the same time: they share an instant, as viewers list them together.
        together = last if last and last[0].time_s == time else []
        instant = together[0].instant if together else last[0].instant + 1 if last else 0
        vectors = [drawn_vector(mark.direction, mark.magnitude, self._scale) for mark in marks]
        added = [
            DrawnMark(kind, time, instant, len(together) + i, mark, vector)
            for i, (mark, vector) in enumerate(zip(marks, vectors, strict=True))
        ]
        self._last[kind.name] = together + added
        return added

    def of_instant(self, kind: RecordKind) -> list[DrawnMark]:
        """All marks so far of the last instant of a kind."""
        return self._last.get(kind.name, [])


def drawn_marks(records: Iterable[Any], scale: float) -> list[DrawnMark]:
    """Marks of records in order of time, at a scale of markers."""
    sequence = MarkSequence(scale)
    return [mark for record in records for mark in sequence.add(record)]


_APART_M = 1.5
"""Texts nearer than this would overlap at scale 1: in a view of the robot, 10 m, one is some 2 m wide and 0.6 m high."""


def are_near(one: DrawnMark, other: DrawnMark, scale: float) -> bool:
    """Whether the texts of two marks, which stand at the middles of their arrows, would overlap."""
    places = [np.array(drawn.mark.point_m) - 0.5 * drawn.vector for drawn in (one, other)]
    return float(np.linalg.norm(places[0] - places[1])) < _APART_M * scale


def texts(marks: Iterable[DrawnMark], scale: float) -> list[tuple[DrawnMark, list[str]]]:
    """Texts of the marks of an instant, and the marks at which they stand: one text where several would overlap.

    It stands at the mark of greatest magnitude and has a line for each kind of records there, of its greatest mark.
    """
    groups: list[list[DrawnMark]] = []
    for drawn in sorted(marks, key=lambda drawn: -drawn.mark.magnitude):
        group = next((group for group in groups if are_near(group[0], drawn, scale)), None)
        if group is None:
            groups.append([drawn])
        elif all(drawn.kind is not other.kind for other in group):
            group.append(drawn)
    return [(group[0], [drawn.mark.text for drawn in group]) for group in groups]


def _is_finite(mark: Mark) -> bool:
    return bool(np.isfinite((*mark.point_m, *mark.direction, mark.magnitude)).all())


PLUME_M = 0.9
"""Drawn length of a plume at full force and scale 1, m."""


class Thruster(NamedTuple):
    """An actuator that pushes the robot with an external force, and its plume.

    Attributes:
        name: Full name of the actuator.
        body: Id of the body that it pushes.
        applied: Column of its force.
        bounds: Columns of its least and greatest force.
        point: Origin of the plume in the frame of the body, (3,), m.
        exhaust: Unit vector of the exhaust under a positive force, (3,), in the frame of the body or in world axes.
        turns: Whether the exhaust turns with the body; else it is fixed in world axes.
    """

    name: str
    body: int
    applied: int
    bounds: tuple[int, int]
    point: FloatArray
    exhaust: FloatArray
    turns: bool

    @property
    def short_name(self) -> str:
        """Its name in the robot's model."""
        return self.name.rsplit("/", 1)[-1]


class PlumeSeries(NamedTuple):
    """The plume of one thruster in successive frames.

    Attributes:
        fires: Whether it is drawn in each frame, (n,).
        origins: Where it starts in world axes, (n, 3), m.
        vectors: Drawn exhaust in world axes, (n, 3), m, of a length proportional to the force; zero without force.
    """

    fires: npt.NDArray[np.bool_]
    origins: FloatArray
    vectors: FloatArray


def thrusters(system: System, layout: Layout) -> list[Thruster]:
    """Thrusters of the robot, in the order of the actuators; torques on the base are none."""
    return list(_thrusters(system, layout))


def _thrusters(system: System, layout: Layout) -> Iterator[Thruster]:
    names = system.names("actuator")
    for actuator in np.flatnonzero(external_actuators(system)).tolist():
        keys = (f"actuators.{identifier(names[actuator])}_{what}_N" for what in ("applied", "lower", "upper"))
        applied, lower, upper = map(layout.index.get, keys)
        if applied is not None and lower is not None and upper is not None:  # None: its effort is a torque
            body, point, exhaust, turns = _jet(system.mj, actuator)
            yield Thruster(names[actuator], body, applied, (lower, upper), point, exhaust, turns)


def _jet(model: Any, actuator: int) -> tuple[int, FloatArray, FloatArray, bool]:
    """Body, point, exhaust and whether it turns with the body.

    A thruster at a site pushes along its gear in the frame of the site. A motor on a slide joint of the base pushes along
    the axis of the joint, which keeps its direction in the world because the rotations of the base come after its slides.
    """
    target = int(model.actuator_trnid[actuator, 0])
    if model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT:
        return int(model.jnt_bodyid[target]), np.zeros(3), -model.jnt_axis[target], False
    push = model.actuator_gear[actuator, :3]
    exhaust = rotated(-push / np.linalg.norm(push), model.site_quat[target])
    return int(model.site_bodyid[target]), model.site_pos[target].copy(), exhaust, True


def plume_series(thruster: Thruster, frames: Frames, scale: float) -> PlumeSeries:
    """The plume of a thruster in some frames, at a scale of markers."""
    forces, bounds = frames.rows[:, thruster.applied], frames.rows[0, thruster.bounds]
    # An unbounded thruster is drawn relative to its greatest force in these frames.
    full = max(abs(bounds[np.isfinite(bounds)]), default=0.0) or max(np.abs(forces).max(), 1.0)
    origins, directions = frames.positions[:, thruster.body], np.tile(thruster.exhaust, (len(forces), 1))
    if thruster.turns:
        turns = frames.quaternions[:, thruster.body]
        origins, directions = origins + _rotated(turns, thruster.point), _rotated(turns, thruster.exhaust)
    vectors = scale * PLUME_M * forces[:, None] / full * directions
    fires = np.asarray(np.isfinite(vectors).all(axis=1) & vectors.any(axis=1))
    return PlumeSeries(fires, origins, vectors)


def _rotated(quaternions: FloatArray, vector: FloatArray) -> FloatArray:
    """A vector rotated by each quaternion (wxyz), (n, 3)."""
    w, v = quaternions[:, :1], quaternions[:, 1:]
    turn = 2.0 * np.cross(v, vector)
    return np.asarray(vector + w * turn + np.cross(v, turn))
