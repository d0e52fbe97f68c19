"""Bounds of grasps: one closes as soon as they hold, and one that misses was never nearer than it says."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from ffsm_mj.verification.independent.finding import Finding, Worst
from ffsm_mj.verification.independent.kept_rows import SAME_TIME_S
from ffsm_mj.verification.independent.logged_rows import LoggedRows
from ffsm_mj.verification.independent.scene import Latched, LoggedScene
from ffsm_mj.verification.independent.tolerances import GRASP_BOUNDS


def grasp_bounds(scene: LoggedScene, rows: LoggedRows) -> list[Finding]:
    """Worst excess of the largest ratio of a value to its bound, at grasps and near misses."""
    worst = Worst(GRASP_BOUNDS)
    events: list[Any] = [record for record in scene.log.events() if hasattr(record, "time_s")]
    others_than_arming = ("replaces", "least_ratio", "reason")
    for record in events:
        given = (scene.scenario.get("grasps") or {}).get(getattr(record, "grasp", ""), {})
        within = given.get("when", {}).get("within")
        if not within:
            continue
        own = [each for each in events if getattr(each, "grasp", "") == record.grasp and each is not record]
        armed_s = [each.time_s for each in own if not any(hasattr(each, name) for name in others_than_arming)]
        if hasattr(record, "replaces"):
            scene.put(record.qpos, scene.rates(record.qvel_before))
            ratio = _ratio(scene, scene.grasps[record.grasp], within)
            # Distance and angle are continuous, so that they may be below their bounds from the arming on alone; speeds may
            # be so from any event on.
            speeds = within.get("speed_m_s") or within.get("rate_rad_s")
            others = [each.time_s for each in events if each is not record] if speeds else armed_s
            begins = np.min(np.abs(np.array([np.inf, *others]) - record.time_s)) > SAME_TIME_S
            worst.add(record.grasp, abs(ratio - 1.0) if begins else max(0.0, ratio - 1.0), 0.0, record.time_s, "")
        elif hasattr(record, "least_ratio"):
            _near_miss(scene, rows, record, within, max((t for t in armed_s if t <= record.time_s), default=-np.inf), worst)
    return worst.found


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
