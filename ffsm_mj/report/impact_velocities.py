"""Velocities of the bodies in an impact before and after it, as a table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby

import mujoco
import numpy as np

from ffsm_mj.analysis.run import Run
from ffsm_mj.arrays import FloatArray
from ffsm_mj.model.system import System
from ffsm_mj.records.events import ImpactRecord
from ffsm_mj.report.record_tables import MOST_ROWS
from ffsm_mj.report.terminal import table

_HEAD = ("impact", "body", "", "velocity\nx, m/s", "\ny", "\nz", "rate\nx, rad/s", "\ny", "\nz")


def velocity_table(run: Run) -> str:
    """Velocity of the mass centre and angular velocity of each moving body in contact, world axes.

    Of a series of impacts it has the first and the largest one, as the table of impacts. The velocities follow from those
    by joint in the records and from the models; empty without impacts, without models, or where records are not of them.
    """
    system = run.models.system if run.impacts else None
    if system is None:
        return ""
    impacts = run.impacts
    if len(impacts) > MOST_ROWS:
        named = {impacts[0].event, max(impacts, key=lambda record: record.impulse_N_s).event}
        impacts = tuple(record for record in impacts if record.event in named)
    events = (list(contacts) for _, contacts in groupby(impacts, key=lambda record: record.event))
    try:
        rows = [row for contacts in events for row in _rows(system, contacts)]
    except (LookupError, TypeError, ValueError):  # a log of unknown origin may hold any records
        return ""
    more = "\n  and those of later impacts" if len(rows) > MOST_ROWS else ""
    return table(_HEAD, rows[:MOST_ROWS]) + more if rows else ""


def _rows(system: System, contacts: list[ImpactRecord]) -> Iterator[tuple[str, ...]]:
    """Two rows for each body of an impact that moves."""
    first, model = contacts[0], system.mj
    geoms = dict.fromkeys(name for record in contacts for name in record.geoms)
    bodies = dict.fromkeys(int(model.geom_bodyid[system.index("geom", name)]) for name in geoms)
    moving = [body for body in bodies if model.body_weldid[body]]
    before, after = (
        _twists(system, first.qpos, np.concatenate([rates[joint] for joint in system.joints]), moving)
        for rates in (first.qvel_before, first.qvel_after)
    )
    for body in moving:
        yield str(first.event + 1), model.body(body).name, "before", *_cells(before[body])
        yield "", "", "after", *_cells(after[body])


def _twists(system: System, qpos: Sequence[float], qvel: FloatArray, bodies: list[int]) -> dict[int, FloatArray]:
    """Angular velocity and velocity of the mass centre of some bodies at a state, world axes, (6,)."""
    data, twists = mujoco.MjData(system.mj), {body: np.empty(6) for body in bodies}
    data.qpos[:], data.qvel[:] = np.reshape(qpos, system.mj.nq), np.reshape(qvel, system.mj.nv)
    mujoco.mj_kinematics(system.mj, data)
    mujoco.mj_comPos(system.mj, data)
    mujoco.mj_comVel(system.mj, data)
    for body, twist in twists.items():
        mujoco.mj_objectVelocity(system.mj, data, mujoco.mjtObj.mjOBJ_BODY, body, twist, 0)
    return twists


def _cells(twist: FloatArray) -> list[str]:
    return [f"{x:z.6f}" for x in (*twist[3:], *twist[:3])]
