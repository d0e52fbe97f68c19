"""Log columns and event records of joints at their limits: state, force and impulse by joint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.contact_models.interface import EventTime, Scene
from ffsm_mj.contact_models.persistent.active_set import ActiveContactSet
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.kinds import RecordKind
from ffsm_mj.records.signals import Signal, identifier, limit_force_name

_FREE, _TOUCHING, _PRESSED = 0.0, 1.0, 2.0
"""Magnitude of the state of a joint's limits in the log; its sign is negative at the lower limit."""
_STATES = {_FREE: "free", _TOUCHING: "touching", _PRESSED: "pressed"}


def state_key(limit: JointLimit) -> str:
    """Column of the state of a joint's limits."""
    return f"contact.{identifier(limit.joint)}_limit"


def force_key(limit: JointLimit) -> str:
    """Column of the force of a joint's limits."""
    return f"contact.{limit_force_name(limit.joint, limit.unit)}"


class LimitReport:
    """Writes the columns and event records of the limited joints of a run.

    Attributes:
        columns: Columns of every limited joint.
    """

    def __init__(self, scene: Scene, limits: Sequence[JointLimit], closed: ActiveContactSet) -> None:
        """Initialise with no joint at a limit."""
        self._scene, self._active_set, self._limits = scene, closed, tuple(limits)
        joints = list(dict.fromkeys((limit.joint, limit.unit) for limit in limits))
        self._values, self._is_blank = np.zeros((len(joints), 3)), True
        self._row = {limit: joints.index((limit.joint, limit.unit)) for limit in limits}
        signals = tuple(signal for joint, unit in joints for signal in _signals(joint, unit))
        live = self._values.reshape(-1)
        columns = Columns(signals, live, None, lambda _: self._write_values(), self._restore_values, self._at_state)
        self.columns = (columns,) if signals else ()

    def logged_limits(self) -> list[JointLimit]:
        """Limits at which a joint rests according to the columns."""
        return [limit for limit, row in self._row.items() if self._values[row, 0] * limit.sign < 0.0]

    def _restore_values(self, logged: FloatArray) -> None:
        self._values[:] = logged.reshape(self._values.shape)
        self._is_blank = False

    def _at_state(self) -> FloatArray:
        self._write_values()
        return self._values.flatten()

    def _write_values(self) -> None:
        """Write the columns for the state in ``data`` under its efforts."""
        held = [pair for pair in self._active_set.by_pair if isinstance(pair, JointLimit)]
        if not held and self._is_blank:
            return
        self._values[:, :2], self._is_blank = 0.0, not held
        for limit, (state, force) in self._now(held).items():
            self._values[self._row[limit], :2] = -limit.sign * state, limit.sign * force

    def _now(self, limits: Sequence[JointLimit]) -> dict[JointLimit, tuple[float, float]]:
        """State and force of some limits, N or N m, at the state in ``data`` under its efforts."""
        closed = self._active_set
        found = dict.fromkeys(limits, (_FREE, 0.0))
        if not closed.contact_points or not limits:
            return found
        decision = closed.decide()
        for i, (contact, force) in enumerate(zip(decision.contact_points, decision.forces.tolist(), strict=True)):
            if isinstance(contact.pair, JointLimit) and contact.pair in found:
                found[contact.pair] = (_PRESSED, force) if i in decision.pressing else (_TOUCHING, 0.0)
        return found

    def add_forces(self, applied: FloatArray) -> None:
        """Add the forces of all limits under the efforts in ``data``, (nv,) of the motion."""
        closed = self._active_set
        held = [pair for pair in closed.by_pair if isinstance(pair, JointLimit)]
        for limit, (_, force) in self._now(held).items():
            applied[closed.motion.dofs[limit.dof]] += limit.sign * force

    def add_impulses(self, impulses: Mapping[Any, float]) -> None:
        """Add the impulses in a step, N s or N m s."""
        for limit, impulse in impulses.items():
            if isinstance(limit, JointLimit):
                self._values[self._row[limit], 2] += impulse

    def forces_before(self, limits: Sequence[JointLimit]) -> dict[JointLimit, float]:
        """Forces at the end of the last step, N or N m; 0 if there was no step since the last event."""
        forces: dict[JointLimit, float] = dict.fromkeys(limits, 0.0)
        last = self._active_set.last_stage
        if last is not None:
            for contact, force in zip(self._active_set.pressing, last.forces.tolist(), strict=True):
                if isinstance(contact.pair, JointLimit) and contact.pair in forces:
                    forces[contact.pair] = force
        return forces

    def records(
        self,
        kind: RecordKind,
        before: Mapping[JointLimit, float],
        instant: EventTime,
        event: int,
        qvel_before: Mapping[str, tuple[float, ...]],
    ) -> tuple[Any, ...]:
        """Event records of joint limits at the state in ``data``.

        Args:
            kind: Kind of record.
            before: Force of each limit just before, N or N m.
            instant: Time and step of the event.
            event: Event number.
            qvel_before: Generalised velocity before, by joint.
        """
        model, data = self._scene.system.mj, self._scene.data
        near = {limit: limit.proximity(model, data) for limit in before}
        return tuple(
            kind.record(
                event=event,
                time_s=instant.time_s,
                step=instant.step,
                joint=limit.joint,
                side=limit.side,
                unit=limit.unit,
                value=limit.value(data),
                limit=limit.limit,
                state=_STATES[state],
                force_before=before[limit],
                force_after=force,
                impulse=float(self._values[self._row[limit], 2]),
                point_m=tuple(near[limit].points[0].tolist()),
                axis=tuple(near[limit].normal.tolist()),
                qpos=tuple(data.qpos.tolist()),
                qvel_before=qvel_before,
                qvel_after=self._scene.system.by_joint(data.qvel),
            )
            for limit, (state, force) in self._now([*before]).items()
        )


def _signals(joint: str, unit: str) -> tuple[Signal, ...]:
    """Columns of the limits of one joint."""
    force = "torque" if unit == "rad" else "force"
    of_force = "N_m" if unit == "rad" else "N"
    units = of_force.replace("_", " ")
    return (
        Signal(
            "contact",
            f"{identifier(joint)}_limit",
            "",
            f"limits of {joint}: 0 free, -1 at the lower and 1 at the upper one without force, -2 and 2 pressed against it",
            joint,
        ),
        Signal(
            "contact",
            limit_force_name(joint, unit),
            units,
            f"{force} of the limits on {joint}, positive at the lower one, under the efforts of this row",
            joint,
        ),
        Signal(
            "contact",
            f"{identifier(joint)}_limit_impulse_{of_force}_s",
            f"{units} s",
            f"time integral of the magnitude of the {force} of the limits on {joint} since t = 0",
            joint,
        ),
    )
