"""Plumes of thrusters as every viewer draws them: where the exhaust leaves, in which direction and how long it is."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import mujoco
import numpy as np
import numpy.typing as npt

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.rigid_body import external_actuators
from ffsm_mj.log.drawing import Frames
from ffsm_mj.model.system import System
from ffsm_mj.records.signals import Layout, identifier

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
    push, exhaust = model.actuator_gear[actuator, :3], np.zeros(3)
    mujoco.mju_rotVecQuat(exhaust, -push / np.linalg.norm(push), model.site_quat[target])
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
