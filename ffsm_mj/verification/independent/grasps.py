"""Grasps: what a latch stops is at rest once it is closed, bounds hold then and not before, loads are what motion needs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.records.load_columns import load_columns_of
from ffsm_mj.tolerances import RANK
from ffsm_mj.verification.independent.finding import (
    GRASP_BOUNDS,
    GRASP_IMPULSE,
    GRASP_LOAD,
    GRASP_TWIST,
    Array,
    Finding,
    Worst,
)
from ffsm_mj.verification.independent.kept_rows import SAME_TIME_S
from ffsm_mj.verification.independent.scene import (
    Latched,
    LoggedRows,
    LoggedScene,
    accelerate,
    forces_known,
    is_out_of_contact,
    load_on,
)


def grasps(scene: LoggedScene, rows: LoggedRows) -> list[Finding]:
    """Worst residuals of the grasps of a log."""
    twist, impulse = Worst(GRASP_TWIST), Worst(GRASP_IMPULSE)
    if not rows.is_whole:
        return []
    events = scene.log.events
    closed = _closed_at_start(scene, rows, events)
    for record in events:
        if hasattr(record, "replaces"):
            closed = [name for name in closed if name != record.replaces]
            _grasp(scene, record, [scene.grasps[name] for name in closed if name in scene.grasps], twist, impulse)
            closed.append(record.grasp)
        elif hasattr(record, "reason") and hasattr(record, "grasp"):
            closed = [name for name in closed if name != record.grasp]
    return [*twist.findings, *impulse.findings]


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
    if kept := [scene.latch_rows(other) for other in others] + ([scene.equality_rows()] if scene.model.neq else []):
        # Impulses of the grasps that were closed already, and of equality constraints, are not in the record: they may be
        # any along their rows.
        missing = _across(np.concatenate(kept), M, missing)
    momentum: Array = np.abs(M) @ (np.abs(before) + np.abs(after))
    impulse.add(grasp.name, missing, momentum, record.time_s, "N s, N m s")


def _across(rows: Array, M: Array, momentum: Array) -> Array:
    """A generalised momentum less what impulses along rows can explain, in the metric of the kinetic energy, (nv,)."""
    L = np.linalg.cholesky(M)
    B = np.linalg.solve(L, rows.T)
    weighted = np.linalg.solve(L, momentum)
    return np.asarray(L @ (weighted - B @ (np.linalg.pinv(B, rcond=RANK) @ weighted)))


def grasp_bounds(scene: LoggedScene, rows: LoggedRows) -> list[Finding]:
    """Worst excess of the largest ratio of a value to its bound, at grasps and near misses."""
    worst = Worst(GRASP_BOUNDS)
    events: list[Any] = [record for record in scene.log.events if hasattr(record, "time_s")]
    others_than_arming = ("replaces", "least_ratio", "reason")
    for record in events:
        bounds = (scene.scenario.get("grasps") or {}).get(getattr(record, "grasp", ""), {})
        within = bounds.get("when", {}).get("within")
        if not within:
            continue
        related = [event for event in events if getattr(event, "grasp", "") == record.grasp and event is not record]
        armed_s = [other.time_s for other in related if not any(hasattr(other, name) for name in others_than_arming)]
        if hasattr(record, "replaces"):
            scene.put(record.qpos, scene.rates(record.qvel_before))
            ratio = _ratio(scene, scene.grasps[record.grasp], within)
            # Distance and angle are continuous, so that they may be below their bounds from the arming on alone; speeds may
            # be so from any event on.
            speeds = within.get("speed_m_s") or within.get("rate_rad_s")
            others = [event.time_s for event in events if event is not record] if speeds else armed_s
            begins = np.min(np.abs(np.array([np.inf, *others]) - record.time_s)) > SAME_TIME_S
            worst.add(record.grasp, abs(ratio - 1.0) if begins else max(0.0, ratio - 1.0), 0.0, record.time_s, "")
        elif hasattr(record, "least_ratio"):
            _near_miss(scene, rows, record, within, max((t for t in armed_s if t <= record.time_s), default=-np.inf), worst)
    return worst.findings


def _near_miss(scene: LoggedScene, rows: LoggedRows, record: Any, within: Any, armed_s: float, worst: Worst) -> None:
    """No row between arming and disarming is nearer than the closest approach."""
    for number in rows.kept.spread.kept:
        if armed_s <= (time_s := rows.time_s(number)) <= record.time_s:
            scene.put_row(rows.kept[number])
            nearer = record.least_ratio - _ratio(scene, scene.grasps[record.grasp], within)
            worst.add(record.grasp, max(0.0, nearer), record.least_ratio, time_s, "")


def _ratio(scene: LoggedScene, grasp: Latched, within: Any) -> float:
    """Largest ratio of a bounded value to its bound at the state in the data."""
    data, turn = scene.data, np.empty(3)
    link, child = scene.bodies(grasp)
    point, frames = np.array(data.site_xpos[grasp.child]), np.empty((2, 4))
    for frame, site in zip(frames, (grasp.robot, grasp.child), strict=True):
        mujoco.mju_mat2Quat(frame, data.site_xmat[site])
    mujoco.mju_subQuat(turn, frames[1], frames[0])
    twist = (scene.body_rows(child, point) - scene.body_rows(link, point)) @ data.qvel
    values = {
        "position_m": point - data.site_xpos[grasp.robot],
        "angle_rad": turn,
        "speed_m_s": twist[:3],
        "rate_rad_s": twist[3:],
    }
    return max(float(np.linalg.norm(values[name]) / bound) for name, bound in within.items() if bound is not None)


def grasp_load(scene: LoggedScene, rows: LoggedRows) -> list[Finding]:
    """Worst difference between logged loads and those that the motion needs.

    Rows at events, and those in which contacts or limits exert forces, are left out.
    """
    worst = Worst(GRASP_LOAD)
    if not rows.is_whole or not forces_known(scene):
        return []
    for number in rows.kept.closed.kept:
        row = rows.kept[number]
        closed = scene.closed_in(row)
        if not closed or rows.is_at_event(number) or not is_out_of_contact(scene, row):
            continue
        scene.put_row(row)
        accelerate(scene, closed)
        _compare(scene, row, closed, rows.time_s(number), worst)
    return worst.findings


def _compare(scene: LoggedScene, row: Array, closed: list[Latched], time_s: float, worst: Worst) -> None:
    """Compare the loads of a row, object by object."""
    model, data = scene.model, scene.data
    for root in {int(model.body_rootid[scene.bodies(grasp)[1]]) for grasp in closed}:
        points = [np.array(data.site_xpos[grasp.child]) for grasp in closed]
        signs = [[int(model.body_rootid[body]) == root for body in scene.bodies(grasp)] for grasp in closed]
        child = next(i for i, (_, is_child) in enumerate(signs) if is_child)
        needed, load, size = load_on(scene, root, points[child]), np.zeros(6), 0.0
        for grasp, point, (holds, is_object) in zip(closed, points, signs, strict=True):
            force, torque = _logged(scene, row, grasp)
            size = max(size, float(np.abs((*force, *torque)).max()))
            moved = np.concatenate((force, torque + np.cross(point - points[child], force)))
            load += (float(is_object) - float(holds)) * moved
        missing = needed - load
        if sum(is_object or holds for holds, is_object in signs) > 1:
            # Rows that depend on what the joints of the object's own base stop share the load with them: only what moves
            # the object is known.
            moves = scene.body_rows(root, points[child])
            left, sizes, _ = np.linalg.svd(moves[:, model.body_dofadr[root] :][:, : model.body_dofnum[root]])
            missing = left[:, : int(np.sum(sizes > 1e-10))].T @ missing
        worst.add(closed[child].name, missing, (size, *needed), time_s, "N, N m")


def _logged(scene: LoggedScene, row: Array, grasp: Latched) -> tuple[Array, Array]:
    """Force and torque that a row states for a grasp."""
    columns = load_columns_of(scene.layout, grasp.name)
    if columns is None:  # it is closed by one of these columns
        raise LookupError(grasp.name)
    force, torque = np.split(row[scene.layout.places(columns.loads)], 2)
    return force, torque
