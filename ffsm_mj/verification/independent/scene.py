"""The models of a log, put to logged states, and the forces that its rows state; MuJoCo computes all of it.

The model is that of the log without any closed grasp: what holds an object acts on it, and on what holds it, as a wrench.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.model.system import System
from ffsm_mj.records.load_columns import logged_load_columns
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.records.signals import Layout, coordinate_keys, effort_key, identifier, rate_keys
from ffsm_mj.verification.independent.finding import Array

_HUGE = 1e10
"""Largest number that MuJoCo accepts in a state."""


@dataclass(frozen=True)
class Latched:
    """A closed grasp.

    Attributes:
        name: Its name.
        robot: Id of the site of what grasps.
        child: Id of the site of the grasped object.
        stopped: Components of the relative twist that it stops, in the frame of the first site, (n, 6).
    """

    name: str
    robot: int
    child: int
    stopped: Array


class LoggedScene:
    """Models of a log and their data.

    Attributes:
        log: The log; its records only.
        layout: Columns of the rows.
        scenario: Its scenario as plain data.
        system: Its compiled models.
        model: A MuJoCo model of its own, with sensors.
        data: Data of that model.
        grasps: All grasps of the scenario, by name.
    """

    def __init__(self, log: RunLog, layout: Layout, system: System, scenario: Mapping[str, Any]) -> None:
        """Look up columns and grasps.

        Raises:
            LookupError: The rows lack a coordinate or an effort, or the models an element that the scenario names.
        """
        self.log, self.layout, self.system, self.scenario = log, layout, system, scenario
        self.model: Any = copy.copy(system.mj)
        self.model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
        self.data: Any = mujoco.MjData(self.model)
        joints = system.joints.values()
        self._q, self._v = layout.places(coordinate_keys(joints)), layout.places(rate_keys(joints))
        self.actuators = [self.model.actuator(i).name for i in range(self.model.nu)]
        self._efforts = layout.places([effort_key(layout, name, "applied") for name in self.actuators])
        self._ctrl_per_effort = 1.0 / np.array([_effort_per_ctrl(self.model, i) for i in range(self.model.nu)])
        self._loads = [(each, layout.index[each.closed]) for each in logged_load_columns(layout)]
        contact = [key for key in layout.keys if key.startswith("contact.")]
        self._states = layout.places([key for key in contact if key.endswith(("_mode", "_limit"))])
        self.grasps = {name: self._latch(name, given) for name, given in (scenario.get("grasps") or {}).items()}

    def _latch(self, name: str, given: Mapping[str, Any]) -> Latched:
        robot, child = (self.system.index("site", given[key]) for key in ("robot_site", "object_site"))
        return Latched(name, robot, child, stopped_rows(given.get("joint", "rigid"), given.get("axis") or ()))

    def put(self, qpos: Any, qvel: Any, efforts: Any = None, time_s: float = 0.0) -> None:
        """Put the data to a state, with positions, velocities, passive and actuator forces current.

        Args:
            qpos: Coordinates, (nq,).
            qvel: Rates, (nv,).
            efforts: Efforts by actuator, (nu,); None: none.
            time_s: Time.

        Raises:
            ValueError: A number is none, or so large that MuJoCo refuses it.
        """
        data = self.data
        ctrl = np.zeros(self.model.nu) if efforts is None else np.asarray(efforts) * self._ctrl_per_effort
        if not np.all(np.abs(np.concatenate((qpos, qvel, ctrl))) < _HUGE):
            raise ValueError("no state")
        data.qpos[:], data.qvel[:], data.ctrl[:], data.time = qpos, qvel, ctrl, time_s
        data.xfrc_applied[:], data.qfrc_applied[:] = 0.0, 0.0
        mujoco.mj_fwdPosition(self.model, data)
        mujoco.mj_fwdVelocity(self.model, data)
        mujoco.mj_fwdActuation(self.model, data)

    def put_row(self, row: Array, efforts: Any = None) -> None:
        """The same for a row of the log and, unless others are given, its own efforts."""
        own = row[self._efforts] if efforts is None else efforts
        self.put(row[self._q], row[self._v], own, float(row[self.layout.time]))

    def efforts_of(self, row: Array) -> Array:
        """Efforts that a row states, by actuator, (nu,)."""
        return row[self._efforts]

    def rates(self, by_joint: Mapping[str, Sequence[float]]) -> Array:
        """Generalised velocity from rates by joint, (nv,).

        Raises:
            LookupError: A joint is missing.
        """
        return np.concatenate([by_joint[joint] for joint in self.system.joints])

    def efforts_after(self, record: Any) -> Array | None:
        """Efforts by actuator from an event on; None if the record states none."""
        stated = getattr(record, "efforts_after", None)
        return np.array([stated[name][0] for name in self.actuators]) if stated else None

    def mass_matrix(self) -> Array:
        """Mass matrix at the state in the data, (nv, nv)."""
        M = np.empty((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, self.data, M)
        return M

    def free_force(self) -> Array:
        """Generalised forces of springs, dampers, gravity and actuators, less those of inertia, (nv,)."""
        data = self.data
        return np.asarray(data.qfrc_passive + data.qfrc_actuator - data.qfrc_bias)

    def body_rows(self, body: int, point: Array, *, rates: bool = False) -> Array:
        """Jacobian of the twist of a body at a point, linear part first, or its rate, (6, nv)."""
        rows = np.empty((6, self.model.nv))
        of = mujoco.mj_jacDot if rates else mujoco.mj_jac
        of(self.model, self.data, rows[:3], rows[3:], point, body)
        return rows

    def latch_rows(self, grasp: Latched, *, rates: bool = False) -> Array:
        """Rows of the relative twist that a grasp stops, or their rates at its constant axes, world axes, (n, nv)."""
        point = self.data.site_xpos[grasp.child]
        link, child = self.bodies(grasp)
        relative = self.body_rows(child, point, rates=rates) - self.body_rows(link, point, rates=rates)
        return np.asarray(self.stopped(grasp) @ relative)

    def equality_rows(self) -> Array:
        """Rows of the equality constraints of the models at the state in the data, as MuJoCo states them, (n, nv)."""
        model = copy.copy(self.model)
        model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)
        model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        data = mujoco.MjData(model)
        data.qpos[:] = self.data.qpos
        mujoco.mj_fwdPosition(model, data)
        rows = np.array(data.efc_J).reshape(-1, model.nv)
        return np.asarray(rows[data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY])

    def stopped(self, grasp: Latched) -> Array:
        """Components that a grasp stops, in world axes, (n, 6)."""
        frame = self.data.site_xmat[grasp.robot].reshape(3, 3)
        return np.hstack((grasp.stopped[:, :3] @ frame.T, grasp.stopped[:, 3:] @ frame.T))

    def bodies(self, grasp: Latched) -> tuple[int, int]:
        """Bodies of what grasps and of what is grasped."""
        return int(self.model.site_bodyid[grasp.robot]), int(self.model.site_bodyid[grasp.child])

    def latch_drift(self, grasp: Latched) -> Array:
        """Relative acceleration along the rows of a grasp that its turning axes ask for, (n,).

        In the axes of a link that turns at w, a relative velocity v of the object's site has the rate a - 2 w x v and a
        relative spin s the rate a - w x s, where a are rates of the twists of both bodies at the site. Rates along what is
        stopped are zero, so a is the rest. It vanishes for a rigid grasp.
        """
        point = self.data.site_xpos[grasp.child]
        link, child = self.bodies(grasp)
        of_link = self.body_rows(link, point) @ self.data.qvel
        relative = self.body_rows(child, point) @ self.data.qvel - of_link
        turning = np.concatenate((2.0 * np.cross(of_link[3:], relative[:3]), np.cross(of_link[3:], relative[3:])))
        return np.asarray(self.stopped(grasp) @ turning)

    def contact_states(self, row: Array) -> Array:
        """Modes of the contact rules and states of the limited joints in a row: 0 open, from 2 on, or to -2, with force."""
        return row[self._states]

    def closed_in(self, row: Array) -> list[Latched]:
        """The grasps that are closed in a row."""
        grasps, found = [*self.grasps.values()], []
        for columns, closed in self._loads:
            if (number := int(row[closed])) > 0:
                own = [each for each in grasps if identifier(each.name) == columns.grasp]
                found += own if columns.grasp else grasps[number - 1 : number]
        return found


def stopped_rows(kind: str, axis: Sequence[float]) -> Array:
    """Components of the relative twist at the object's site that a kind of latch stops, frame of the first site, (n, 6).

    A cylindrical latch stops what is across its axis; a hinge also the motion along it, a slide also the turn about it.

    Raises:
        LookupError: There is no such kind.
    """
    free_along, free_about = {
        "rigid": (False, False),
        "ball": (False, False),
        "hinge": (False, True),
        "slide": (True, False),
        "cylindrical": (True, True),
    }[kind]
    every = np.eye(3)
    across = every
    if free_along or free_about:
        unit = np.array(axis, dtype=float) / np.linalg.norm(axis)
        least = every[np.argmin(np.abs(unit))]
        first = np.cross(unit, least) / np.linalg.norm(np.cross(unit, least))
        across = np.stack((first, np.cross(unit, first)))
    linear = across if free_along else every
    angular = np.empty((0, 3)) if kind == "ball" else across if free_about else every
    rows = np.zeros((len(linear) + len(angular), 6))
    rows[: len(linear), :3], rows[len(linear) :, 3:] = linear, angular
    return rows


def _effort_per_ctrl(model: Any, actuator: int) -> float:
    """Effort of a motor for a ctrl of 1: its gain, at a joint times its gear; 1 for a servo, whose ctrl is its setpoint."""
    if model.actuator_biastype[actuator] or model.actuator_gaintype[actuator] or model.actuator_dyntype[actuator]:
        return 1.0
    on_joint = model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT
    gear = model.actuator_gear[actuator, 0] if on_joint else 1.0
    return float(model.actuator_gainprm[actuator, 0] * gear) or 1.0
