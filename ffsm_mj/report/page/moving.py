"""Time-dependent parts of the scene: arrows of forces and torques while they act, plumes of firing thrusters."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import k3d
import numpy as np
import numpy.typing as npt

from ffsm_mj.arrays import FloatArray
from ffsm_mj.log.contact_forces import force_columns
from ffsm_mj.log.rerun.plots import thrusters
from ffsm_mj.log.rerun.plumes import plume_vectors
from ffsm_mj.model.system import System
from ffsm_mj.records.signals import Layout
from ffsm_mj.report.page.poses import Poses
from ffsm_mj.report.page.solids import Triangles, arrow, plume

FORCE, TORQUE, PLUME = 0x009E73, 0xF0E442, 0xFFAA3C
"""Colours of forces, of torques and of plumes."""
ARROW_M = (0.4, 1.5)
"""Least and greatest length of an arrow, m; in between, 1 m is 1 N s of an impulse, or 1 N."""
TICKS_PER_S = 1000.0
"""K3D's time in ms: it merges times that differ by less than 0.001, whatever their unit."""
FAR_M = 1e6
"""Positions beyond this are clipped: they come from a run that diverged."""
SWITCH_S = 1e-5
"""Transition time to appear or disappear: K3D switches values half-way between two times."""


def forces(layout: Layout, poses: Poses) -> Iterator[Any]:
    """An arrow along each contact force on the second geom of a pair, or load, that ends at its point of application."""
    for pair in force_columns(layout):
        pressing = pair.pressing(poses.rows) & (pair.sizes(poses.rows) > 0.0)
        pushes, ends = (poses.rows[:, columns] for columns in (pair.vector, pair.centre))
        sizes = np.linalg.norm(pushes, axis=1, keepdims=True)
        pushes = np.clip(sizes, *ARROW_M) * pushes / np.maximum(sizes, 1e-300)
        yield from _while(pressing, arrow(), TORQUE if pair.turns else FORCE, poses.times, ends - pushes, pushes)


def plumes(layout: Layout, system: System, poses: Poses) -> Iterator[Any]:
    """A cone along the exhaust of each firing thruster, with length proportional to force over maximum force."""
    for thruster in thrusters(layout, system).values():
        efforts, bounds = poses.rows[:, thruster.applied], poses.rows[0, thruster.bounds]
        full = max(abs(bounds[np.isfinite(bounds)]), default=0.0) or max(np.abs(efforts).max(), 1.0)
        origins, exhausts = plume_vectors(system, thruster.actuator, poses, efforts, full)
        fires = np.asarray(np.isfinite(exhausts).all(axis=1) & exhausts.any(axis=1))
        yield from _while(fires, plume(), PLUME, poses.times, origins, exhausts)


def _while(
    on: npt.NDArray[np.bool_], made: Triangles, colour: int, times: FloatArray, starts: FloatArray, vectors: FloatArray
) -> Iterator[Any]:
    """A solid along vectors, visible while the mask is set, (n,); nothing if it never is."""
    if on.any():
        matrices = map(along_z, starts[on], vectors[on])
        moving = dict(zip(map(tick, times[on].tolist()), matrices, strict=True))
        yield solid(made, colour, moving, during(_spans(times, on)))


def solid(made: Triangles, colour: int, matrix: Any, shown: dict[str, bool]) -> Any:
    """A mesh of one colour with a constant or time-dependent pose and visibility."""
    corners, faces = made
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
    found = {0.0: False}
    for start, end in spans:
        found |= {max(start - SWITCH_S, 0.0): False, start: True, end: True, end + SWITCH_S: False}
    return {tick(time): on for time, on in sorted(found.items())}


def tick(time: float) -> str:
    """K3D's key of a time in s."""
    return repr(TICKS_PER_S * time)


def single(values: Any) -> Any:
    """Finite numbers in single precision."""
    return np.nan_to_num(np.clip(values, -FAR_M, FAR_M)).astype(np.float32)
