"""Effects of the impact at one configuration.

They follow from the configuration and the relative velocity at the contact alone: with W = J M^-1 J^T of robot and object,
the impulse without friction is (1 + e) u / (n^T (W_r + W_o) n), and every jump of velocity is M^-1 J^T times the impulse.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import mujoco
import numpy as np

from ffsm_mj.analysis.tables import Table
from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.impact.resolution import contact_rows
from ffsm_mj.dynamics.rigid_body import cross, mass_matrix, tangents
from ffsm_mj.experiments.impact_map.reach import Target
from ffsm_mj.impact import resolve
from ffsm_mj.model.system import System
from ffsm_mj.records.signals import identifier

EFFECTS = {
    "impulse_N_s": ("N s", "normal impulse"),
    "friction_impulse_N_s": ("N s", "friction impulse, its magnitude"),
    "robot_mass_kg": ("kg", "effective mass of the robot along the normal, 1 / (n^T W_r n)"),
    "object_mass_kg": ("kg", "effective mass of what it hits, 1 / (n^T W_o n); infinite if that is fixed"),
    "effective_mass_kg": ("kg", "effective mass of the contact, 1 / (n^T (W_r + W_o) n)"),
    "base_rate_change_rad_s": ("rad/s", "change of the angular velocity of the base, its magnitude"),
    "base_velocity_change_m_s": ("m/s", "change of the velocity of the base's frame, its magnitude"),
    "joint_rate_change": ("rad/s", "largest change of a rate of the arm's joints; m/s for slides"),
    "object_spin_rad_s": ("rad/s", "angular velocity of the object after the impact, its magnitude"),
    "energy_change_J": ("J", "change of the kinetic energy"),
    "base_percussion_x_m": ("m", "point of the base's percussion axis nearest to its frame: the impact leaves its velocity"),
    "base_percussion_y_m": ("m", "likewise, y"),
    "base_percussion_z_m": ("m", "likewise, z"),
    "object_percussion_x_m": ("m", "point of the object's percussion axis nearest to its centre of mass"),
    "object_percussion_y_m": ("m", "likewise, y"),
    "object_percussion_z_m": ("m", "likewise, z"),
}
"""Unit and meaning of each effect by name; points are in world axes at the instant of the impact."""
OBJECTIVES = tuple(EFFECTS)[:9]
"""Effects that a map can make small or large."""


class Evaluation:
    """Effects of the impact of a target at configurations that reach it."""

    def __init__(self, target: Target) -> None:
        """Build data of its own."""
        self._target, self._data = target, target.data()
        tree = target.system.tree_of_body(target.other_body)
        self._object = tree.root if tree is not None else None
        self._across = tangents(target.contact.normal)
        self._spin = self._twist(target.other_body, target.qvel)[3:]

    def effects(self, qpos: FloatArray) -> dict[str, float]:
        """Effects by name, those of :data:`EFFECTS`, at a configuration of the scene."""
        return self.at(qpos)[0]

    def at(self, qpos: FloatArray) -> tuple[dict[str, float], FloatArray]:
        """Effects, and the change of the generalised velocities, (nv,)."""
        target, data = self._target, self._data
        model, tree = target.system.mj, target.system.robot
        data.qpos[:] = qpos
        mujoco.mj_fwdPosition(model, data)
        J, M = contact_rows(model, data, target.contact, self._across), mass_matrix(model, data)
        # Any velocity with the right velocities at the contact gives the impulse and the jumps: here the smallest.
        wanted = np.array([target.contact.normal, *self._across]) @ target.velocity
        data.qvel[:] = np.linalg.lstsq(J, wanted, rcond=1e-10)[0]
        impact = resolve(model, data, [target.contact], target.law)
        jump = impact.after.qvel - impact.before.qvel
        response = np.linalg.solve(M, J[0])
        inverse_mass = float(J[0] @ response)
        of_robot = float(J[0, tree.dofs] @ response[tree.dofs])
        base = self._twist(tree.root, jump)
        struck = self._twist(target.other_body, jump)
        centre = data.subtree_com[self._object] if self._object is not None else data.xpos[target.other_body]
        spin = self._spin + struck[3:]
        base_point = _axis_point(base, data.xpos[tree.root], data.xpos[tree.root])
        object_point = _axis_point(struck, data.xpos[target.other_body], centre)
        values = (
            float(impact.impulses[0]),
            float(np.linalg.norm(impact.friction.impulses[0])) if impact.friction is not None else 0.0,
            1.0 / of_robot,
            1.0 / (inverse_mass - of_robot) if self._object is not None else math.inf,
            1.0 / inverse_mass,
            float(np.linalg.norm(base[3:])),
            float(np.linalg.norm(base[:3])),
            float(np.abs(jump[target.arm_dofs]).max(initial=0.0)),
            float(np.linalg.norm(spin)),
            impact.energy_change_J,
            *base_point.tolist(),
            *object_point.tolist(),
        )
        return dict(zip(EFFECTS, values, strict=True)), jump

    def _twist(self, body: int, qvel: FloatArray) -> FloatArray:
        """Velocity of a body's frame and its angular velocity in world axes, (6,), at the configuration in the data."""
        nv = self._target.system.mj.nv
        jacp, jacr = np.empty((3, nv)), np.empty((3, nv))
        mujoco.mj_jacBody(self._target.system.mj, self._data, jacp, jacr, body)
        return np.concatenate((jacp @ qvel, jacr @ qvel))


def _axis_point(change: FloatArray, origin: FloatArray, near: FloatArray) -> FloatArray:
    """Point nearest to another one on the axis about which a change of velocity turns and along which it slides, (3,).

    The percussion axis: an impulse changes the velocity of its points along itself only; in the plane it is the centre of
    percussion. NaN if the body does not begin to turn.

    Args:
        change: Change of the velocity of the body's frame and of its angular velocity, (6,).
        origin: Origin of that frame, (3,).
        near: The other point, (3,).
    """
    linear, angular = change[:3], change[3:]
    size = float(np.linalg.norm(angular))
    if size <= 1e-12 * (1.0 + float(np.linalg.norm(linear))):
        return np.full(3, math.nan)
    point = origin + cross(angular, linear) / size**2
    return np.asarray(point + angular * ((near - point) @ angular) / size**2)


Origin = Literal["run", "sample", "optimum"]


@dataclass(frozen=True, eq=False)
class Configuration:
    """A configuration of the scene at the contact, and what the impact does there.

    Attributes:
        origin: ``run``: as the scenario arrives; ``sample``; ``optimum``.
        qpos: Coordinates, (nq,).
        qvel: Velocities before the impact, (nv,); None if no rates of the arm arrive with the velocity of the run.
        jump: Change of the velocities, (nv,).
        effects: Effects by name, see :data:`ffsm_mj.experiments.impact_map.evaluation.EFFECTS`.
        overlap_m: Greatest depth of an overlap, m; 0 without one.
        overlapping: Its geoms.
    """

    origin: Origin
    qpos: FloatArray
    qvel: FloatArray | None
    jump: FloatArray
    effects: dict[str, float]
    overlap_m: float
    overlapping: str

    @property
    def status(self) -> str:
        """``ok``, ``overlap`` or ``no rates``: the last two cannot be reached by a run."""
        if self.overlap_m > 0.0:
            return "overlap"
        return "ok" if self.qvel is not None else "no rates"


def initial_block(system: System, configuration: Configuration, keys: dict[str, str]) -> dict[str, Any]:
    """``initial`` of a scenario that begins at a configuration, just before the impact.

    Args:
        system: Robot and objects.
        configuration: The configuration; it has rates.
        keys: Names that the scenario gives joints, by full name; others are named in full.
    """
    qvel = configuration.qvel
    if qvel is None:
        raise ValueError("no rates of the arm arrive at this configuration with the velocity of the run")
    block: dict[str, Any] = {"joints": {}, "rates": {}}
    for name, joint in system.joints.items():
        for part, values in (("joints", configuration.qpos[joint.qpos]), ("rates", qvel[joint.dofs])):
            numbers = [float(value) + 0.0 for value in values]
            block[part][keys.get(name, name)] = numbers if len(numbers) > 1 else numbers[0]
    return block


_UNITS = {"hinge": ("rad", "rad/s", "rad_s"), "slide": ("m", "m/s", "m_s")}
_REST = {
    "origin": "run: as the scenario arrives; sample; optimum",
    "status": "ok; overlap: geoms overlap; no rates: the arm cannot arrive with the velocity of the run",
    "overlapping": "geoms of the deepest overlap",
}


def table_of(target: Target, configurations: Sequence[Configuration]) -> Table:
    """Table with one row per configuration; joints of one coordinate have columns."""
    columns: dict[str, Any] = {"origin": [configuration.origin for configuration in configurations]}
    units, meanings = {"origin": ""}, {"origin": _REST["origin"]}

    def add(name: str, unit: str, meaning: str, values: list[Any]) -> None:
        columns[name], units[name], meanings[name] = values, unit, meaning

    add("status", "", _REST["status"], [configuration.status for configuration in configurations])
    for name, (unit, meaning) in EFFECTS.items():
        add(name, unit, meaning, [configuration.effects[name] for configuration in configurations])
    for joint in target.system.robot.joints:
        if joint.kind not in _UNITS:
            continue
        unit, rate, suffix = _UNITS[joint.kind]
        name, at, dof = identifier(joint.name), joint.qpos.start, joint.dofs.start
        add(
            f"q_{name}_{unit}",
            unit,
            f"coordinate of {joint.name}",
            [float(configuration.qpos[at]) for configuration in configurations],
        )
        rates = [
            np.nan if configuration.qvel is None else float(configuration.qvel[dof]) for configuration in configurations
        ]
        add(f"rate_{name}_{suffix}", rate, f"rate of {joint.name} before the impact", rates)
        jumps = [float(configuration.jump[dof]) for configuration in configurations]
        add(f"change_{name}_{suffix}", rate, f"change of the rate of {joint.name}", jumps)
    add("overlap_m", "m", "greatest depth of an overlap", [configuration.overlap_m for configuration in configurations])
    add("overlapping", "", _REST["overlapping"], [configuration.overlapping for configuration in configurations])
    return Table("impact_map", {name: np.array(values) for name, values in columns.items()}, units, meanings)
