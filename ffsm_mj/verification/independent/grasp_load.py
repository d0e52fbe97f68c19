"""Load of closed grasps: what the grasped object needs from outside to move as it does."""

from __future__ import annotations

import numpy as np

from ffsm_mj.records.load_columns import load_columns_of
from ffsm_mj.verification.independent.accelerations import accelerate, forces_known, is_out_of_contact, load_on
from ffsm_mj.verification.independent.finding import Array, Finding, Worst
from ffsm_mj.verification.independent.logged_rows import LoggedRows
from ffsm_mj.verification.independent.scene import Latched, LoggedScene
from ffsm_mj.verification.independent.tolerances import GRASP_LOAD


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
    return worst.found


def _compare(scene: LoggedScene, row: Array, closed: list[Latched], time_s: float, worst: Worst) -> None:
    """Compare the loads of a row, object by object."""
    model, data = scene.model, scene.data
    for root in {int(model.body_rootid[scene.bodies(grasp)[1]]) for grasp in closed}:
        points = [np.array(data.site_xpos[grasp.child]) for grasp in closed]
        signs = [[int(model.body_rootid[body]) == root for body in scene.bodies(grasp)] for grasp in closed]
        own = next(i for i, (_, is_child) in enumerate(signs) if is_child)
        needed, given, size = load_on(scene, root, points[own]), np.zeros(6), 0.0
        for grasp, point, (holds, is_held) in zip(closed, points, signs, strict=True):
            force, torque = _logged(scene, row, grasp)
            size = max(size, float(np.abs((*force, *torque)).max()))
            moved = np.concatenate((force, torque + np.cross(point - points[own], force)))
            given += (float(is_held) - float(holds)) * moved
        missing = needed - given
        if sum(is_held or holds for holds, is_held in signs) > 1:
            # Rows that depend on what the joints of the object's own base stop share the load with them: only what moves
            # the object is known.
            moves = scene.body_rows(root, points[own])
            left, sizes, _ = np.linalg.svd(moves[:, model.body_dofadr[root] :][:, : model.body_dofnum[root]])
            missing = left[:, : int(np.sum(sizes > 1e-10))].T @ missing
        worst.add(closed[own].name, missing, (size, *needed), time_s, "N, N m")


def _logged(scene: LoggedScene, row: Array, grasp: Latched) -> tuple[Array, Array]:
    """Force and torque that a row states for a grasp."""
    columns = load_columns_of(scene.layout, grasp.name)
    if columns is None:  # it is closed by one of these columns
        raise LookupError(grasp.name)
    force, torque = np.split(row[scene.layout.places(columns.loads)], 2)
    return force, torque
