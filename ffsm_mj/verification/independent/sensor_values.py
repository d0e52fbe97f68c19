"""True values of sensors, computed again by MuJoCo from the state of the row at which the sample was taken."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from ffsm_mj.records.metadata import logged_start_s
from ffsm_mj.verification.independent.accelerations import accelerate, forces_known, is_out_of_contact, load_on
from ffsm_mj.verification.independent.finding import Array, Finding, Worst
from ffsm_mj.verification.independent.logged_rows import LoggedRows
from ffsm_mj.verification.independent.scene import Latched, LoggedScene
from ffsm_mj.verification.independent.sensor_settings import SensorSettings
from ffsm_mj.verification.independent.tolerances import SENSOR_VALUES

_OF_FORCES = (
    *("accelerometer", "force", "torque", "framelinacc", "frameangacc", "touch"),
    *("actuatorfrc", "jointactuatorfrc", "tendonactuatorfrc"),
)
"""Kinds whose value depends on forces or accelerations."""


def sensor_values(scene: LoggedScene, rows: LoggedRows, sensors: Sequence[SensorSettings]) -> list[Finding]:
    """Worst difference of logged true values from those at the states of the samples, each in the unit of its sensor.

    Samples inside of steps have no row and are left out, as are values of forces where contacts exert them: the forces of a
    row are those under its new efforts, and a sample is taken before these are decided.
    """
    worst, known = Worst(SENSOR_VALUES), rows.is_whole and forces_known(scene)
    due: dict[int, list[tuple[SensorSettings, Array]]] = {}
    for sensor in sensors:
        for shown, at in rows.kept.samples[sensor.sampled].kept:
            if at in rows.kept and shown in rows.kept and not rows.is_at_event(at):
                due.setdefault(at, []).append((sensor, rows.kept[shown][list(sensor.true)]))
    for at, samples in due.items():
        forced = _put(scene, rows, at, with_forces=known and any(s.model.kind in _OF_FORCES for s, _ in samples))
        closed = scene.closed_in(rows.kept[at])
        for sensor, logged in samples:
            if np.isnan(logged).any() or not (forced or sensor.model.kind not in _OF_FORCES):
                continue  # the joint is gone while a grasp is closed, or forces are not known
            if closed and sensor.model.kind.startswith("subtree"):
                continue  # MuJoCo's subtree of a link contains what it grasps
            value = np.array(scene.data.sensor(sensor.name).data)
            if sensor.model.shape == "rotation" and value @ logged < 0.0:
                value = -value  # both signs are one orientation
            worst.add(sensor.name, value - logged, logged, rows.time_s(at), sensor.model.unit)
    return worst.found


def _put(scene: LoggedScene, rows: LoggedRows, at: int, *, with_forces: bool) -> bool:
    """Put the data to the state of a row as a sample sees it; returns whether sensors of forces are evaluated."""
    model, data, row, efforts = scene.model, scene.data, rows.kept[at], None
    if with_forces and is_out_of_contact(scene, row):
        # At t = 0, before the first command, nothing is powered; a run that goes on from another has its efforts.
        is_start = at == 0 and not logged_start_s(scene.log.header.metadata)
        efforts = np.zeros(model.nu) if is_start else rows.efforts_after(scene, at - 1, rows.time_s(at))
    scene.put_row(row, np.zeros(model.nu) if efforts is None else efforts)
    mujoco.mj_sensorPos(model, data)
    mujoco.mj_sensorVel(model, data)
    if efforts is None:
        return False
    closed = scene.closed_in(row)
    accelerate(scene, closed)
    if closed and not _load(scene, closed):
        return False
    mujoco.mj_sensorAcc(model, data)
    return True


def _load(scene: LoggedScene, closed: Sequence[Latched]) -> bool:
    """Put the load of a grasp on its object and on what holds it; returns whether it is known: that of a single grasp is."""
    if len(closed) > 1:
        return False
    model, data, point = scene.model, scene.data, np.array(scene.data.site_xpos[closed[0].child])
    link, child = scene.bodies(closed[0])
    load = load_on(scene, int(model.body_rootid[child]), point)
    for body, sign in ((child, 1.0), (link, -1.0)):
        data.xfrc_applied[body, :3] += sign * load[:3]
        data.xfrc_applied[body, 3:] += sign * (load[3:] + np.cross(point - data.xipos[body], load[:3]))
    mujoco.mj_rnePostConstraint(model, data)
    return True
