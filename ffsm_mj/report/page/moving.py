"""Time-dependent parts of the scene: arrows of forces and torques while they act, plumes of firing thrusters."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import k3d
import numpy as np
import numpy.typing as npt

from ffsm_mj.arrays import FloatArray
from ffsm_mj.log import palette
from ffsm_mj.log.markers import arrow_colour, arrow_series, declared_arrows, plume_series, thrusters
from ffsm_mj.log.palette import packed
from ffsm_mj.model.system import System
from ffsm_mj.records.run_log import RunHeader
from ffsm_mj.records.signals import Layout
from ffsm_mj.report.page.poses import Poses
from ffsm_mj.report.page.solids import Triangles, arrow_solid, plume_solid

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


def plumes(layout: Layout, system: System, poses: Poses, scale: float) -> Iterator[Any]:
    """A cone along the exhaust of each firing thruster, with length proportional to force over maximum force."""
    for thruster in thrusters(system, layout):
        series = plume_series(thruster, poses, scale)
        yield from _while(series.fires, plume_solid(scale), PLUME, poses.times, series.origins, series.vectors)


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
