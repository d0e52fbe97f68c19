"""The models of a log, put to logged states, and the forces that its rows state; MuJoCo computes all of it.

The model is that of the log without any closed grasp: what holds an object acts on it, and on what holds it, as a wrench.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.model.system import System
from ffsm_mj.records.load_columns import logged_load_columns
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.records.signals import Layout, coordinate_keys, effort_key, identifier, rate_keys
from ffsm_mj.tolerances import RANK
from ffsm_mj.verification.independent.fields import KnownFields
from ffsm_mj.verification.independent.finding import Array
from ffsm_mj.verification.independent.kept_rows import SAME_TIME_S, KeptRows

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
        fields: Its external fields, as far as they are no code of users.
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
        self._loads = [(columns, layout.index[columns.closed]) for columns in logged_load_columns(layout)]
        contact = [key for key in layout.keys if key.startswith("contact.")]
        self._states = layout.places([key for key in contact if key.endswith(("_mode", "_limit"))])
        self.grasps = {name: self._latch(name, stated) for name, stated in (scenario.get("grasps") or {}).items()}
        self.fields = KnownFields(scenario)
        self._field_force = np.zeros(self.model.nv)

    def _latch(self, name: str, stated: Mapping[str, Any]) -> Latched:
        robot, child = (self.system.index("site", stated[key]) for key in ("robot_site", "object_site"))
        return Latched(name, robot, child, stopped_rows(stated.get("joint", "rigid"), stated.get("axis") or ()))

    def put(self, qpos: Any, qvel: Any, efforts: Any = None, time_s: float = 0.0) -> None:
        """Put the data to a state, with positions, velocities, passive and actuator forces and external fields current.

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
        self._apply_fields()

    def _apply_fields(self) -> None:
        """Write the wrenches of external fields into ``data.xfrc_applied``, and their generalised forces."""
        model, data = self.model, self.data
        self._field_force[:] = 0.0
        for body, wrench in self.field_wrenches():
            data.xfrc_applied[body] += wrench
            mujoco.mj_applyFT(model, data, wrench[:3], wrench[3:], data.xipos[body], body, self._field_force)

    def field_wrenches(self) -> list[tuple[int, Array]]:
        """Ids of the moving bodies, and force and torque of external fields about their mass centres, world axes, (6,)."""
        model, data = self.model, self.data
        moving = [body for tree in self.system.trees for body in tree.bodies if model.body_mass[body] > 0.0]
        wrenches = []
        for body in moving if self.scenario.get("environment") else ():
            axes = data.ximat[body].reshape(3, 3)
            inertia = axes * model.body_inertia[body] @ axes.T
            wrenches.append((body, self.fields.wrench(data.time, model.body_mass[body], data.xipos[body], inertia)))
        return [*wrenches, *self._magnetic_torques()]

    def _magnetic_torques(self) -> Iterator[tuple[int, Array]]:
        """Bodies of magnetorquers, and their torques as wrenches, with the dipoles in the data."""
        model, data, magnetic = self.model, self.data, self.fields.magnetic
        if magnetic is None:
            return
        for one in self.system.magnetorquers:
            actuator = int(model.actuator(one.name).id)
            site = int(model.actuator_trnid[actuator, 0])
            body = int(model.site_bodyid[site])
            dipole = data.ctrl[actuator] * data.site_xmat[site].reshape(3, 3)[:, "xyz".index(one.axis)]
            yield body, np.concatenate((np.zeros(3), np.cross(dipole, magnetic.at(data.time, data.xipos[body]))))

    def put_row(self, row: Array, efforts: Any = None) -> None:
        """The same for a row of the log and, unless others are given, its own efforts."""
        applied = row[self._efforts] if efforts is None else efforts
        self.put(row[self._q], row[self._v], applied, float(row[self.layout.time]))

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
        """Generalised forces of springs, dampers, gravity, external fields and actuators, less those of inertia, (nv,)."""
        data = self.data
        return np.asarray(data.qfrc_passive + data.qfrc_actuator + self._field_force - data.qfrc_bias)

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
        grasps, closed_now = [*self.grasps.values()], []
        for columns, closed in self._loads:
            if (number := int(row[closed])) > 0:
                named = [grasp for grasp in grasps if identifier(grasp.name) == columns.grasp]
                closed_now += named if columns.grasp else grasps[number - 1 : number]
        return closed_now


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


_CLOSED_WITH_FORCE = 2.0
"""Magnitude of the state of a contact rule, or of the limits of a joint, from which on it may exert a force."""


def forces_known(scene: LoggedScene) -> bool:
    """Whether all forces but those of contacts, limits and grasps are known from models and efforts."""
    model = scene.model
    rubs = np.any(model.dof_frictionloss) or np.any(model.tendon_frictionloss)
    return not scene.scenario.get("contact_models") and scene.fields.are_all and model.neq == 0 and not rubs


def is_out_of_contact(scene: LoggedScene, row: Array) -> bool:
    """Whether neither a contact nor a joint limit exerts a force in a row."""
    return bool(np.all(np.abs(scene.contact_states(row)) < _CLOSED_WITH_FORCE))


def accelerate(scene: LoggedScene, closed: Sequence[Latched]) -> None:
    """Write accelerations at the state in the data, and what follows from them, with grasps closed.

    With mass matrix M, all known forces f, rows J of what the closed grasps stop and the drift d of these rows,
    M a = f + J^T l and J a = d. A run integrates another model instead, in which the first grasped object is a part of the
    robot.
    """
    data = scene.data
    M, force = scene.mass_matrix(), scene.free_force()
    acceleration = np.linalg.solve(M, force)
    if closed:
        J = np.concatenate([scene.latch_rows(grasp) for grasp in closed])
        drift = np.concatenate([scene.latch_drift(g) - scene.latch_rows(g, rates=True) @ data.qvel for g in closed])
        # Rows may depend on each other, as in a plane: the acceleration is unique all the same.
        L = np.linalg.cholesky(M)
        A = np.linalg.solve(L, J.T)
        acceleration += np.linalg.solve(L.T, np.linalg.pinv(A.T, rcond=RANK) @ (drift - J @ acceleration))
    data.qacc[:] = acceleration
    mujoco.mj_rnePostConstraint(scene.model, data)


def load_on(scene: LoggedScene, tree: int, point: Array) -> Array:
    """Force and torque about a point that a tree needs from outside to accelerate as in the data, (6,): N and N m.

    Args:
        scene: The scene, after :func:`accelerate`.
        tree: Root body of the tree.
        point: The point, world axes, m, (3,).
    """
    torque, force = np.split(np.asarray(scene.data.cfrc_int[tree]), 2)
    return np.concatenate((force, torque + np.cross(scene.data.subtree_com[scene.model.body_rootid[tree]] - point, force)))


class LoggedRows:
    """Kept rows and the events between them.

    Attributes:
        kept: The kept rows.
        is_whole: Whether nothing of the log is missing, neither rows nor bytes in which a record could have been: only then
            is it known what was closed, and which efforts acted, between two rows.
    """

    def __init__(self, log: RunLog, kept: KeptRows) -> None:
        """Bind to a log."""
        self.kept, self.is_whole = kept, kept.is_regular and not log.damage
        self._changes: list[Any] = [record for record in log.events if getattr(record, "efforts_after", None)]
        self._changed_s = np.array([record.time_s for record in self._changes])
        self._instants = np.sort(np.array(log.instants_s))

    def time_s(self, number: int) -> float:
        """Time of a kept row."""
        return float(self.kept[number][self.kept.layout.time])

    def is_at_event(self, number: int) -> bool:
        """Whether an event is at the time of a row, so that it is open whether the row is of before or after it."""
        time_s = self.time_s(number)
        near = int(np.searchsorted(self._instants, time_s - SAME_TIME_S))
        return near < len(self._instants) and self._instants[near] <= time_s + SAME_TIME_S

    def has_events(self, start_s: float, end_s: float) -> bool:
        """Whether an event is between two times."""
        first, last = np.searchsorted(self._instants, (start_s, end_s))
        return bool(last > first)

    def efforts_after(self, scene: LoggedScene, number: int, time_s: float) -> Array | None:
        """Efforts that act up to an instant after a row, (nu,): those of the last event between, or of the row; or None.

        An event at the time of the row is of the step that ends there, or of that which begins: its number tells.
        """
        if number not in self.kept or not self.is_whole:
            return None
        row_s = self.time_s(number)
        end = int(np.searchsorted(self._changed_s, time_s - SAME_TIME_S))
        start = int(np.searchsorted(self._changed_s, row_s - SAME_TIME_S))
        first_step = round(row_s / scene.model.opt.timestep)
        changes = [change for change in self._changes[start:end] if change.step >= first_step]
        if not changes:
            return scene.efforts_of(self.kept[number])
        # Records of one instant may state different efforts, and not all are numbered together: then it is not known.
        last = scene.efforts_after(changes[-1])
        at_once = [change for change in changes if change.time_s >= changes[-1].time_s - SAME_TIME_S]
        return last if all(change.efforts_after == changes[-1].efforts_after for change in at_once) else None
