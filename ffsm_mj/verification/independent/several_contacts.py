"""Restitution where several contacts without friction meet at one instant, solved anew."""

from __future__ import annotations

from itertools import groupby
from typing import Any

import numpy as np

from ffsm_mj.verification.independent.finding import Array, Finding, Worst
from ffsm_mj.verification.independent.kept_rows import MOST, SAME_TIME_S
from ffsm_mj.verification.independent.logged_rows import LoggedRows
from ffsm_mj.verification.independent.scene import LoggedScene
from ffsm_mj.verification.independent.tolerances import SEVERAL_CONTACTS

_LAWS = ("blend", "newton")
"""Laws of which this is a part; others share impulses in other ways."""


def several_contacts(scene: LoggedScene, rows: LoggedRows) -> list[Finding]:
    """Worst difference of the speeds after an impact of several contacts from (1 + e) times the plastic impulse.

    That is the law where all e are equal and no contact approaches after it, as where a face lands flat. Impacts with closed
    grasps, joint limits or friction are left out, and those in which contacts or limits that are closed already react.
    """
    worst = Worst(SEVERAL_CONTACTS)
    events = [list(event) for _, event in groupby(scene.log.impact_records, key=lambda record: record.event)]
    covered = [event for event in events if len(event) > 1 and all(_is_covered(record, event[0]) for record in event)]
    for event in covered[:: 1 + len(covered) // MOST] if not scene.grasps else ():
        if _is_alone(scene, rows, event[0].time_s):
            _compare(scene, event, worst)
    return worst.found


def _is_alone(scene: LoggedScene, rows: LoggedRows, time_s: float) -> bool:
    """Whether no contact or limit was closed in the row before an impact, and no event has closed one since."""
    number = dict(rows.kept.before.kept).get(time_s, -1)
    if number not in rows.kept or not rows.is_whole:
        return False
    closed = np.any(scene.contact_states(rows.kept[number]))
    return not closed and not rows.has_events(rows.time_s(number) - SAME_TIME_S, time_s - SAME_TIME_S)


def _is_covered(record: Any, first: Any) -> bool:
    without_friction = not hasattr(record, "joint") and record.mu == 0.0 and record.law in _LAWS
    return without_friction and record.restitution_used == first.restitution_used


def _compare(scene: LoggedScene, records: list[Any], worst: Worst) -> None:
    from scipy.optimize import nnls  # takes a second to import: only impacts with several contacts pay

    scene.put(records[0].qpos, scene.rates(records[0].qvel_before))
    J = np.stack([_row(scene, record) for record in records])
    L = np.linalg.cholesky(scene.mass_matrix())
    A, w = np.linalg.solve(L, J.T).T, L.T @ scene.data.qvel
    lengths = np.linalg.norm(A, axis=1)
    if not np.all(lengths > 0.0):
        return
    plastic = A.T @ (nnls(A.T / lengths, -w)[0] / lengths)
    before, elastic = A @ w, A @ (w + 2.0 * plastic)
    if elastic.min() < -1e-9 * np.abs(before).max():
        return  # further reflections follow: the law decides on them
    after = A @ (w + (1.0 + records[0].restitution_used) * plastic)
    logged = np.array([record.separation_speed_m_s for record in records])
    worst.add(f"impact {records[0].event + 1}", logged - after, before, records[0].time_s, "m/s")


def _row(scene: LoggedScene, record: Any) -> Array:
    """Normal velocity of the second geom's body relative to the first's at the contact point, (nv,)."""
    first, second = (int(scene.model.geom(name).bodyid[0]) for name in record.geoms)
    point = np.array(record.point_m)
    relative = scene.body_rows(second, point)[:3] - scene.body_rows(first, point)[:3]
    return np.asarray(np.array(record.normal) @ relative)
