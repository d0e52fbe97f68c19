"""Grasps as a contact model: an armed grasp is watched, closes, and holds its object as a part of the robot until released.

Requests come from phases and control laws: ``<grasp>.arm``, ``<grasp>.disarm``, ``<grasp>.release``. What they ask for is
done where the next step begins, a release before anything else.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.contact_models.grasp.config import CaptureConfig
from ffsm_mj.contact_models.grasp.impulse import plastic_impulse
from ffsm_mj.contact_models.grasp.latch import Latch
from ffsm_mj.contact_models.grasp.load import LoadBuffer
from ffsm_mj.contact_models.grasp.nearness import Nearness
from ffsm_mj.contact_models.grasp.record import KINDS, ArmingRecord, CaptureRecord, NearMissRecord, ReleaseRecord
from ffsm_mj.contact_models.impact.model import ImpactModel
from ffsm_mj.contact_models.interface import ContactModel, EventEffect, EventTime, Scene
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.dynamics.rigid_body import cross, momentum_matrix
from ffsm_mj.model.grasp import Grasp
from ffsm_mj.model.system import System
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.events import Outcome, RunEnded
from ffsm_mj.records.signals import CAPTURE_CENTRE, CAPTURE_EVENT_LOADS, CAPTURE_LOADS, SUBSYSTEMS, Signal

ARM, DISARM, RELEASE = "arm", "disarm", "release"
"""What may be asked of a grasp, after its name and a dot."""

_LOADS = ("force on the held object", "torque on the held object about its site")
_BETWEEN = "right after an event since the sample before"
_AT_EVENTS = (
    f"greatest force on the held object {_BETWEEN}, under the efforts decided there; 0: no event",
    f"greatest torque on the held object about its site {_BETWEEN}; 0: no event",
    f"when the force was greatest {_BETWEEN}; NaN: no event",
)
_SIGNALS = (
    Signal("contact", "capture_grasp", "", "position among the captures of the scenario of the one that holds; 0: none"),
    *(
        Signal("contact", key.partition(".")[2], unit, f"{_LOADS[i // 3]}, world axes, under the efforts of this row")
        for i, (key, unit) in enumerate(CAPTURE_LOADS.items())
    ),
    *(
        Signal("contact", key.partition(".")[2], "m", "site of the held object, where the load acts; NaN: nothing is held")
        for key in CAPTURE_CENTRE
    ),
    *(
        Signal("contact", key.partition(".")[2], unit, meaning)
        for (key, unit), meaning in zip(CAPTURE_EVENT_LOADS.items(), _AT_EVENTS, strict=True)
    ),
)


class GraspModel(ContactModel):
    """All grasps of a run, one of which holds at a time; see :class:`~ffsm_mj.contact_models.interface.ContactModel`."""

    kind = "capture"
    records = KINDS
    pushes = False  # what moves is one rigid body: nothing is pushed

    def __init__(
        self,
        scene: Scene,
        free: Motion,
        impacts: ImpactModel,
        grasps: Sequence[tuple[Grasp, CaptureConfig, System]],
        others: Sequence[ContactModel] = (),
    ) -> None:
        """Nothing is armed, nothing is held.

        Args:
            scene: The system that is logged.
            free: Its motion.
            impacts: Resolves impacts before a grasp closes, and knows who holds what stays closed.
            grasps: Each with what the scenario says of it, and the system in which it holds, its model the run's own.
            others: Who may push what is held.
        """
        super().__init__(None, scene)
        self._free, self._impacts = free, impacts
        self._grips = {each[0].name: Latch(i, scene, free, *each, others) for i, each in enumerate(grasps, start=1)}
        self._step_s = float(scene.system.mj.opt.timestep)
        self._holding: Latch | None = None
        self._closing: Latch | None = None
        self._asked: set[str] = set()
        self.requests = tuple(f"{name}.{what}" for name in self._grips for what in (ARM, DISARM, RELEASE))
        self._loads, self._told = LoadBuffer(), 0.0
        self.columns = (Columns(_SIGNALS, table=self._loads.table, note=self._note, resume=self._resume),)

    @property
    def disarmed(self) -> dict[str, frozenset[frozenset[int]]]:
        """Pairs of geoms that cannot meet while a grasp holds, by its name."""
        return {name: grip.held.rigid for name, grip in self._grips.items()}

    def data_of(self, grasp: str) -> Any:
        """MuJoCo data of what moves while a grasp holds."""
        return self._grips[grasp].held.data

    def names(self) -> str:
        """The grasps that are armed or hold."""
        return ", ".join(name for name, grip in self._grips.items() if grip.armed or grip is self._holding) or self.kind

    def handle_request(self, request: str) -> None:
        """A phase or a control law asks for something; it is done where the next step begins."""
        self._asked.add(request)
        self._reconsider()

    def restart(self) -> None:
        """Look anew; a pair that was struck may close an armed grasp."""
        struck, self._impacts.struck = self._impacts.struck, frozenset()
        if struck and self._closing is None:
            self._closing = next((grip for grip in self._grips.values() if grip.armed and grip.pairs & struck), None)
        for grip in self._grips.values():
            grip.jumped()
        self._reconsider()

    def _reconsider(self) -> None:
        self._watching = [grip for grip in self._grips.values() if grip.watches]
        self.horizon = -math.inf if self._asked or self._closing or self._watching else math.inf

    def due(self) -> bool:
        """Whether something was asked for, a pair was struck, or the bounds of an armed grasp hold."""
        if self._asked or self._closing is not None:
            return True
        within = [grip for grip in self._watching if grip.is_within()]
        self._closing = within[0] if within else None
        return bool(within)

    def is_clear(self) -> bool:
        """Whether the bounds of no armed grasp held in the last step."""
        looks = [grip.was_clear(self._step_s) for grip in self._watching]
        return all(looks)

    def first_event(self, duration_s: float) -> float | None:
        """When the bounds of an armed grasp first hold."""
        found = [(at, grip) for grip in self._watching if (at := grip.first(self.motion.path, duration_s)) is not None]
        at_s, self._closing = min(found, key=lambda each: each[0]) if found else (None, None)
        return at_s

    def after_substep(self, duration_s: float) -> None:
        """Keep in mind how near the armed grasps came."""
        for grip in self._watching:
            grip.after_substep(self.motion.path, duration_s)

    def on_event_located(self, _: float) -> None:
        """Somebody else may act before: then nothing closes yet."""
        self._closing = next((grip for grip in self._watching if grip is self._closing and grip.is_within()), None)

    def act(self, instant: EventTime) -> EventEffect | None:
        """Do what was asked for, or take hold.

        Raises:
            RunEnded: A grasp is armed, or would take hold, while another holds.
        """
        if not self._asked:
            grip, self._closing = self._closing, None
            return self._capture(grip, instant) if grip is not None else None
        asked, holding, self._asked = self._asked, self._holding, set()
        records: list[Any] = []
        if holding is not None and f"{holding.grasp.name}.{RELEASE}" in asked:
            records.append(self._release(holding, instant))
        released = bool(records)
        for name, grip in self._grips.items():
            if f"{name}.{DISARM}" in asked and grip.armed:
                records += self._disarm(grip, instant)
            if f"{name}.{ARM}" in asked:
                self._refuse_second(name, "is armed", instant.time_s)
                records += self._arm(grip, instant)
        return (
            EventEffect(tuple(records), motion=self._free if released else None, triggers_control=released)
            if records
            else None
        )

    def _arm(self, grip: Latch, instant: EventTime) -> list[Any]:
        """Let it close; where it is armed already nothing changes."""
        if grip.armed:
            return []
        grip.arm(instant.time_s)
        who = self.scene.numbers.next_number(), grip.grasp.name
        return [ArmingRecord(*who, instant.time_s, instant.step, **self._state(self.scene.data.qvel))]

    def finish(self, instant: EventTime) -> Sequence[Any]:
        """The run is over: grasps that are still armed have missed."""
        return [record for grip in self._grips.values() if grip.armed for record in self._disarm(grip, instant)]

    def _refuse_second(self, name: str, does: str, time_s: float) -> None:
        if self._holding is not None:
            by = self._holding.grasp
            message = f"grasp {name!r} {does} at t = {time_s:.6g} s while {by.name!r} holds {by.tree!r}"
            raise RunEnded(Outcome.CONTROLLER_FAILED, f"{message}: one grasp holds at a time; release it first")

    def _capture(self, grip: Latch, instant: EventTime) -> EventEffect:
        self._refuse_second(grip.grasp.name, "would take hold", instant.time_s)
        system, data, held = self.scene.system, self.scene.data, grip.held
        sites, near, point = grip.sites, grip.near(), grip.sites.point(data)
        found = plastic_impulse(system.mj, data, sites.link, sites.root, point)
        before, energies, momentum = np.array(data.qvel), self._energies(), self._momentum()
        data.qvel[:] += found.change
        mujoco.mj_forward(system.mj, data)
        held.hold()
        energies_after, momentum_after = self._energies(), self._momentum()
        gained, change = energies_after - energies, momentum_after - momentum
        self._holding = grip
        grip.disarm()
        force, moment = found.impulse[:3], found.impulse[3:]
        record = CaptureRecord(
            event=self.scene.numbers.next_number(),
            grasp=grip.grasp.name,
            time_s=instant.time_s,
            step=instant.step,
            robot_site=grip.grasp.robot_site,
            object_site=grip.grasp.object_site,
            point_m=_plain(point),
            **near._asdict(),
            held_position_m=_plain(held.model.body_pos[held.root]),
            held_quaternion=_plain(held.model.body_quat[held.root]),
            rank=found.rank,
            impulse_N_s=_plain(force),
            angular_impulse_N_m_s=_plain(moment),
            loss_J=found.loss_J,
            energy_before_J=_by_party(energies),
            energy_after_J=_by_party(energies_after),
            momentum_before={"total": _plain(momentum)},
            momentum_after={"total": _plain(momentum_after)},
            energy_change_J=float(gained[0]),
            linear_momentum_change_N_s=float(np.linalg.norm(change[:3])),
            angular_momentum_change_N_m_s=float(np.linalg.norm(change[3:])),
            **self._state(before),
        )
        return EventEffect((record,), Exchange(gained, np.concatenate((force, moment + cross(point, force)))), held)

    def _release(self, grip: Latch, instant: EventTime) -> ReleaseRecord:
        """Let the object go at the velocities that it has as a part of the link."""
        self._holding = None
        mujoco.mj_forward(self.scene.system.mj, self.scene.data)
        point = _plain(grip.sites.point(self.scene.data))
        who = self.scene.numbers.next_number(), grip.grasp.name
        return ReleaseRecord(*who, instant.time_s, instant.step, point, **self._state(self.scene.data.qvel))

    def _disarm(self, grip: Latch, instant: EventTime) -> list[Any]:
        """Let it close no more; one that waited for bounds has missed."""
        grip.disarm()
        if self._closing is grip:
            self._closing = None
        if grip.least is None:
            return []
        near, at_s = grip.least
        bounds = grip.stated_bounds
        failed = max(bounds, key=lambda name: getattr(near, name) / bounds[name])
        return [
            NearMissRecord(
                event=self.scene.numbers.next_number(),
                grasp=grip.grasp.name,
                time_s=instant.time_s,
                step=instant.step,
                least_ratio=grip.ratio(near),
                least_s=at_s,
                **near._asdict(),
                bounds={name: (bound,) for name, bound in bounds.items()},
                failed=failed,
                failed_value=getattr(near, failed),
                failed_bound=bounds[failed],
                **self._state(self.scene.data.qvel),
            )
        ]

    def _state(self, before: FloatArray) -> dict[str, Any]:
        """Fields of a record that say what moved, the state after being that in ``data``."""
        system, data = self.scene.system, self.scene.data
        return {
            "qpos": _plain(data.qpos),
            "qvel_before": system.by_joint(before),
            "qvel_after": system.by_joint(data.qvel),
        }

    def _energies(self) -> FloatArray:
        """Kinetic energy of (total, robot, objects), J."""
        system, data, h = self.scene.system, self.scene.data, np.empty(self.scene.system.mj.nv)
        mujoco.mj_mulM(system.mj, data, h, data.qvel)
        total, robot = 0.5 * float(h @ data.qvel), 0.5 * float(h[system.robot.dofs] @ data.qvel[system.robot.dofs])
        return np.array((total, robot, total - robot))

    def _momentum(self) -> FloatArray:
        return np.asarray(momentum_matrix(self.scene.system.mj, self.scene.data, 0) @ self.scene.data.qvel)

    def after_event(self, time_s: float) -> None:
        """What is held bears another load from here on."""
        if self._holding is not None:
            self._loads.after_event(self._holding.load, time_s)

    def _note(self, _: float) -> None:
        """Who holds, and with what load under the efforts that act from here on."""
        self._loads.note(self._holding.load if self._holding is not None else None)

    def _resume(self, values: FloatArray) -> None:
        self._told = float(values[0])
        force, torque, at_s = values[-3:].tolist()
        self._loads.between = force, torque, at_s if force > 0.0 else math.nan

    def restore_state(self) -> Motion | None:
        """Hold what the columns say is held, at the state in ``data``; what is armed they do not say."""
        for grip in self._grips.values():
            grip.disarm()
        told, grips = self._told, [*self._grips.values()]
        self._holding = grips[int(told) - 1] if 1.0 <= told <= len(grips) else None
        if self._holding is None:
            return None
        self._holding.held.hold()
        return self._holding.held

    def prepare_replay(self, records: Sequence[Any]) -> None:
        """``analyze`` is where a log has these records: be about to leave them.

        Raises:
            ValueError: They are of a grasp that there is not.
        """
        self.scene.numbers.continue_from(records[0].event)
        for record in records:
            if record.grasp not in self._grips:
                raise ValueError(f"no grasp {record.grasp!r}")
            grip = self._grips[record.grasp]
            if isinstance(record, CaptureRecord):
                self._closing = grip
            elif isinstance(record, ReleaseRecord):
                self._asked.add(f"{record.grasp}.{RELEASE}")
            elif isinstance(record, ArmingRecord):
                self._asked.add(f"{record.grasp}.{ARM}")
            else:
                if not grip.armed or grip.least is None:  # a part of the log in which it was armed is lost: it is believed
                    near = Nearness(record.position_m, record.angle_rad, record.speed_m_s, record.rate_rad_s)
                    grip.armed, grip.least = True, (near, record.least_s)
                self._asked.add(f"{record.grasp}.{DISARM}")


def _by_party(energies: FloatArray) -> dict[str, tuple[float, ...]]:
    return {subsystem: (energy,) for subsystem, energy in zip(SUBSYSTEMS, energies.tolist(), strict=True)}


def _plain(values: Any) -> tuple[float, ...]:
    return tuple(np.asarray(values).tolist())
