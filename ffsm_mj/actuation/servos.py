"""Servos: actuators with a law of their own, which are commanded by a setpoint.

Their forces are evaluated by MuJoCo in every stage of a step, with the setpoint constant over the control tick.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from ffsm_mj._core.tick import ServoSample
from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.errors import Faults
from ffsm_mj.model.actuators import controllers_of, servo_mask, without_force_limits
from ffsm_mj.model.driven_joints import drives_rotation, unit_suffix
from ffsm_mj.model.inputs import further_inputs, setpoint_law
from ffsm_mj.model.system import System
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.signals import Signal, identifier

_JOINT = int(mujoco.mjtTrn.mjTRN_JOINT)
_DYN = mujoco.mjtDyn
_ACTIVATED = (int(_DYN.mjDYN_INTEGRATOR), int(_DYN.mjDYN_FILTER), int(_DYN.mjDYN_FILTEREXACT))
"""Activations that take the place of the setpoint in the law."""


class ServoForces:
    """Forces of the servos, before and after the clamps of their model files.

    Attributes:
        columns: Forces at the start of a tick, under its setpoints.
    """

    def __init__(self, system: System, data: Any) -> None:
        """Bind to a system and its data, derived quantities current at each sample."""
        model = self._model = system.mj
        self._servos: IntArray = np.flatnonzero(servo_mask(model) & ~further_inputs(model))
        on_joint = model.actuator_trntype[self._servos] == _JOINT
        joints = np.where(on_joint, model.actuator_trnid[self._servos, 0], 0)
        gear = np.where(on_joint, model.actuator_gear[self._servos, 0], 1.0)
        limited = on_joint & model.jnt_actfrclimited[joints].astype(bool)
        ranges = np.where(limited[:, None], model.jnt_actfrcrange[joints], [-np.inf, np.inf])
        limits = model.actuator_forcelimited, model.jnt_actfrclimited, model.tendon_actfrclimited
        unlimited = without_force_limits(model) if any(limit.any() for limit in limits) else None
        forces = np.zeros((len(self._servos), 2))
        sample = ServoSample(model, unlimited, data, self._servos, gear, ranges, forces)
        self.columns = Columns(self._signals(system), live=forces.reshape(-1), on_sample=sample)

    def _signals(self, system: System) -> tuple[Signal, ...]:
        signals, names = [], system.names("actuator")
        for i in self._servos.tolist():
            unit = "N m" if drives_rotation(self._model, i) else "N"
            for what, meaning in (("unclamped", "before the limits of its model file"), ("force", "after these limits")):
                name = f"{identifier(names[i])}_{what}{unit_suffix(unit)}"
                signals.append(
                    Signal("actuators", name, unit, f"force of servo {names[i]}, {meaning}", f"actuator {names[i]}")
                )
        return tuple(signals)


def begin_at_rest(model: Any, data: Any) -> FloatArray:
    """Set activations at which servos exert no force at rest at the state in ``data``; returns such setpoints, (nu,).

    A servo without a length in its law, such as one of velocity, has zero, and so has a voltage. An integrator has the
    setpoint zero.
    """
    setpoints, slews = np.zeros(model.nu), dict[int, int]()
    for kind in (mujoco.mjtGain.mjGAIN_PID, mujoco.mjtGain.mjGAIN_DCMOTOR):
        ids, places, _ = controllers_of(model, kind)
        slews.update(zip(ids.tolist(), places.tolist(), strict=True))
    for i in np.flatnonzero(servo_mask(model)).tolist():
        law, dynamics = setpoint_law(model, i), model.actuator_dyntype[i]
        rest = law.force_free(float(data.actuator_length[i])) if law is not None and law.bias[1] != 0.0 else 0.0
        if slews.get(i, -1) >= 0:
            data.act[slews[i]] = rest
        setpoints[i] = 0.0 if dynamics == mujoco.mjtDyn.mjDYN_INTEGRATOR else rest
        if dynamics in _ACTIVATED:
            data.act[model.actuator_actadr[i]] = rest
    return setpoints


def set_activations(system: System, data: Any, activations: Mapping[str, float | Sequence[float]]) -> None:
    """Set activations of a scenario by actuator.

    Raises:
        ScenarioFaults: An unknown actuator, or one with another number of activations.
    """
    model = system.mj
    with Faults() as faults:
        for name, value in activations.items():
            with faults.below("initial", "activations", name):
                i = system.index("actuator", name)
                values, first, count = np.atleast_1d(value), int(model.actuator_actadr[i]), int(model.actuator_actnum[i])
                if len(values) != count or not count:
                    message = f"{name} has {count or 'no'} activations; {len(values)} are given here"
                    faults.add(message, "initial", "activations", name)
                else:
                    data.act[first : first + count] = values


def activation_columns(system: System, data: Any) -> Columns:
    """Columns of the activations; a log replay goes on from them."""
    model, start, signals = system.mj, np.array(data.act), []
    for i, name in enumerate(system.names("actuator")):
        for k in range(int(model.actuator_actnum[i])):
            field = f"{identifier(name)}_activation" + (f"_{k + 1}" if model.actuator_actnum[i] > 1 else "")
            signals.append(Signal("actuators", field, "", f"activation {k + 1} of servo {name}", f"actuator {name}"))

    def resume(values: FloatArray) -> None:
        data.act[:] = values if values.any() else start

    return Columns(tuple(signals), live=data.act, resume=resume)
