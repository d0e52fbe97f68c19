"""Captures: what the latch stops is at rest right after, and its impulse explains the change of the velocities."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.tolerances import RANK
from ffsm_mj.verification.independent.finding import Array, Finding, Worst
from ffsm_mj.verification.independent.logged_rows import LoggedRows
from ffsm_mj.verification.independent.scene import Latched, LoggedScene
from ffsm_mj.verification.independent.tolerances import GRASP_IMPULSE, GRASP_TWIST


def grasps(scene: LoggedScene, rows: LoggedRows) -> list[Finding]:
    """Worst residuals of the grasps of a log."""
    twist, impulse = Worst(GRASP_TWIST), Worst(GRASP_IMPULSE)
    if not rows.is_whole:
        return []
    events: list[Any] = scene.log.events()
    closed = _closed_at_start(scene, rows, events)
    for record in events:
        if hasattr(record, "replaces"):
            closed = [name for name in closed if name != record.replaces]
            _grasp(scene, record, [scene.grasps[name] for name in closed if name in scene.grasps], twist, impulse)
            closed.append(record.grasp)
        elif hasattr(record, "reason") and hasattr(record, "grasp"):
            closed = [name for name in closed if name != record.grasp]
    return [*twist.found, *impulse.found]


def _closed_at_start(scene: LoggedScene, rows: LoggedRows, events: Sequence[Any]) -> list[str]:
    """Grasps that are closed in the first row and not by a record of its own instant."""
    if 0 not in rows.kept:
        return []
    at_once = {r.grasp for r in events if hasattr(r, "replaces") and r.time_s <= rows.time_s(0)}
    return [grasp.name for grasp in scene.closed_in(rows.kept[0]) if grasp.name not in at_once]


def _grasp(scene: LoggedScene, record: Any, others: Sequence[Latched], twist: Worst, impulse: Worst) -> None:
    """Compare one grasp."""
    grasp, before, after = scene.grasps[record.grasp], scene.rates(record.qvel_before), scene.rates(record.qvel_after)
    scene.put(record.qpos, before)
    rows = scene.latch_rows(grasp)
    # The terms that cancel: the speeds of the joints times their lever arms.
    twist.add(grasp.name, rows @ after, np.abs(rows) @ np.abs(after), record.time_s, "m/s, rad/s")
    link, child = scene.bodies(grasp)
    point = np.array(scene.data.site_xpos[grasp.child])
    relative = scene.body_rows(child, point) - scene.body_rows(link, point)
    wrench = np.concatenate((record.impulse_N_s, record.angular_impulse_N_m_s))
    M, change = scene.mass_matrix(), np.empty(scene.model.nv)
    mujoco.mj_mulM(scene.model, scene.data, change, after - before)
    missing = change - relative.T @ wrench
    if held := [scene.latch_rows(other) for other in others] + ([scene.equality_rows()] if scene.model.neq else []):
        # Impulses of the grasps that were closed already, and of equality constraints, are not in the record: they may be
        # any along their rows.
        missing = _across(np.concatenate(held), M, missing)
    momentum: Array = np.abs(M) @ (np.abs(before) + np.abs(after))
    impulse.add(grasp.name, missing, momentum, record.time_s, "N s, N m s")


def _across(rows: Array, M: Array, momentum: Array) -> Array:
    """A generalised momentum less what impulses along rows can explain, in the metric of the kinetic energy, (nv,)."""
    L = np.linalg.cholesky(M)
    B = np.linalg.solve(L, rows.T)
    weighted = np.linalg.solve(L, momentum)
    return np.asarray(L @ (weighted - B @ (np.linalg.pinv(B, rcond=RANK) @ weighted)))
