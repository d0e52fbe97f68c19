"""External fields: their logged impulses are integrals of forces computed again from the states of rows."""

from __future__ import annotations

import numpy as np

from ffsm_mj.records.signals import COMPONENTS
from ffsm_mj.verification.independent.finding import FIELD_IMPULSE, Array, Finding, Worst
from ffsm_mj.verification.independent.kept_rows import SAME_TIME_S
from ffsm_mj.verification.independent.scene import LoggedRows, LoggedScene

_BOOLE = np.array((7.0, 32.0, 12.0, 32.0, 7.0)) / 90.0
_SIMPSON = np.array((1.0, 0.0, 4.0, 0.0, 1.0)) / 6.0
"""Weights of five rows at equal distances, of all of them and of every other one."""
_MARGIN = 4.0
"""Bound on the error of the first over their difference. Of smooth forces it is far less; accelerations that jump at ticks
between the rows, and with them the second rates of forces, give both errors of one size."""
_SUBSYSTEMS = ("robot", "objects")


def field_impulses(scene: LoggedScene, rows: LoggedRows) -> list[Finding]:
    """Worst difference of the impulses of external fields between rows from integrals of their forces at the rows.

    Less what a sum over five rows can be wrong by. Rows with events between them are left out: there velocities jump. Work
    is not compared: what these forces do is in the balance of energy.
    """
    worst = Worst(FIELD_IMPULSE)
    if not rows.is_whole or not scene.fields.are_all or not scene.scenario.get("environment"):
        return []
    numbers = rows.kept.spread.kept
    magnetorquers = [scene.actuators.index(one.name) for one in scene.system.magnetorquers]
    keys = [f"balance.field_on_{name}_{part}" for name in _SUBSYSTEMS for part in COMPONENTS]
    places = np.reshape(scene.layout.places(keys), (2, 6))
    for window in zip(*(numbers[i::4] for i in range(4)), numbers[4::4], strict=False):
        times = np.array([rows.time_s(number) for number in window])
        is_even = np.ptp(np.diff(times)) < SAME_TIME_S
        dipoles = np.array([scene.efforts_of(rows.kept[number])[magnetorquers] for number in window])
        if np.ptp(dipoles, axis=0).any():  # torques that jump are no smooth functions of the rows
            continue
        if not is_even or rows.has_events(times[0] - SAME_TIME_S, times[-1] + SAME_TIME_S):
            continue
        forces = np.array([_forces(scene, rows.kept[number]) for number in window])
        fine, coarse = ((times[-1] - times[0]) * np.tensordot(weights, forces, 1) for weights in (_BOOLE, _SIMPSON))
        first, last = (rows.kept[number][places] for number in (window[0], window[-1]))
        for i, name in enumerate(_SUBSYSTEMS):
            for part, unit in ((slice(0, 3), "N s"), (slice(3, 6), "N m s")):
                away, unsure = (last - first - fine)[i, part], (fine - coarse)[i, part]
                missing = max(0.0, float(np.linalg.norm(away) - _MARGIN * np.linalg.norm(unsure)))
                worst.add(name, missing, last[i, part], float(times[-1]), unit)
    return worst.findings


def _forces(scene: LoggedScene, row: Array) -> Array:
    """Force and moment about the world origin of the fields on robot and objects at a row, (2, 6)."""
    scene.put_row(row)
    total, robot = np.zeros((2, 6)), scene.system.trees[0].bodies
    for body, wrench in scene.field_wrenches():
        force, torque = np.split(wrench, 2)
        total[int(body not in robot)] += (*force, *(torque + np.cross(scene.data.xipos[body], force)))
    return total
