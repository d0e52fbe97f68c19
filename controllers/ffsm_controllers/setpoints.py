"""Setpoints of servos for positions and rates of the joints that they move.

A servo exerts the force g u + b0 + b1 l + b2 ldot, with its setpoint u and the length l of its transmission. A law that
wants joints at positions q_d with rates qd_d gives it the setpoint at which this force is zero there: the servo then pulls
towards q_d by its stiffness, and its damping acts on the difference from qd_d, so that a path has no lag of first order. A
servo of velocity, which has b1 = 0, gets the rate qd_d - w (q - q_d) with a stated bandwidth w. A controller with several
inputs gets the length and its rate at each of these two, and no force or voltage in advance.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from ffsm_controllers.joint_servo import ServoConfig
from ffsm_mj.controller_protocol import (
    ControllerContext,
    DrivenJoints,
    Fault,
    Faults,
    FloatArray,
    ScenarioFaults,
    SetpointLaw,
    System,
    servo_joints,
    setpoint_law,
)


class Setpoints:
    """Setpoints of the servos of some joints.

    Attributes:
        joints: The joints and their servos.
    """

    def __init__(self, joints: DrivenJoints, config: ServoConfig, system: System) -> None:
        """Read the laws of the servos.

        Raises:
            ScenarioFaults: A servo of velocity without bandwidth, or a bandwidth where no servo needs one.
        """
        self.joints, self._system, self._model = joints, system, system.mj
        servos = joints.actuators
        self._laws = _setpoint_laws(joints, system)
        self._by_rate = np.array([law.by_rate for law in self._laws], dtype=np.bool_)
        names = ", ".join(system.names("actuator")[i] for i in servos[self._by_rate].tolist())
        if names and not config.has_bandwidth:
            message = f"{names}: a servo of velocity holds no position by itself; write 'bandwidth_rad_s' or 'bandwidth_Hz'"
            raise ScenarioFaults([Fault(message)])
        if config.has_bandwidth and not names:
            message = f"servos drive {', '.join(joints.names)}, with gains of their own: leave it out"
            raise ScenarioFaults([Fault(message, (config.bandwidth[0],))])
        self._frequency = config.frequency_rad_s if names else 0.0
        self._scratch = mujoco.MjData(self._model)

    @classmethod
    def of(cls, config: ServoConfig, context: ControllerContext) -> Setpoints | None:
        """Setpoints of the joints of a law; None if motors drive them.

        Raises:
            ScenarioFaults: Servos drive some of them, and motors others; or see the constructor.
        """
        joints = servo_joints(context.system, config.joints, reserved=context.reserved)
        return cls(joints, config, context.system) if joints is not None else None

    def at(self, data: Any, positions: FloatArray, rates: FloatArray | float = 0.0) -> FloatArray:
        """Setpoints for positions and rates of the joints, (n,) each, at the state in ``data``, (number of servos,)."""
        joints, scratch, servos = self.joints, self._scratch, self.joints.actuators
        scratch.qpos[:], scratch.qvel[:] = data.qpos, 0.0
        scratch.qpos[joints.qpos] = positions
        scratch.qvel[joints.dofs] = rates - self._frequency * (data.qpos[joints.qpos] - positions)
        mujoco.mj_fwdPosition(self._model, scratch)
        mujoco.mj_fwdVelocity(self._model, scratch)
        rate = scratch.actuator_velocity[servos]
        if not self._by_rate.all():
            scratch.qvel[joints.dofs] = rates
            mujoco.mj_fwdVelocity(self._model, scratch)
            rate = np.where(self._by_rate, rate, scratch.actuator_velocity[servos])
        at = zip(self._laws, scratch.actuator_length[servos].tolist(), rate.tolist(), strict=True)
        return np.array([law.force_free(length, rate) for law, length, rate in at])

    def refuse_outside_range(self, positions: Sequence[float], path: tuple[str | int, ...]) -> None:
        """Refuse positions at which a setpoint is beyond the range of its servo, with all else where the model has it.

        Args:
            positions: Position of each joint, rad or m.
            path: Keys of the list of positions.

        Raises:
            ScenarioFaults: One or more are beyond.
        """
        data, model, names = mujoco.MjData(self._model), self._model, self._system.names("actuator")
        with Faults() as faults:
            for i, setpoint in zip(self.joints.actuators.tolist(), self.at(data, np.array(positions)).tolist(), strict=True):
                low, high = model.actuator_ctrlrange[i].tolist()
                if model.actuator_ctrllimited[i] and not low <= setpoint <= high:
                    faults.add(f"need the setpoint {setpoint:g} of {names[i]}, beyond its range [{low:g}, {high:g}]", *path)


def _setpoint_laws(joints: DrivenJoints, system: System) -> list[SetpointLaw]:
    """Laws by which the servos of some joints follow from their setpoints.

    Raises:
        ScenarioFaults: No setpoint of one of them follows from a position.
    """
    model, laws = system.mj, []
    for i in joints.actuators.tolist():
        law = setpoint_law(model, i)
        if law is None or model.actuator_dyntype[i] == mujoco.mjtDyn.mjDYN_INTEGRATOR:
            name = system.names("actuator")[i]
            message = f"no setpoint of {name} is a position; drive it by 'playback' or a law of your own, or make it a motor"
            raise ScenarioFaults([Fault(f"{message}: 'actuators: {{{name}: {{kind: torque}}}}'", ("joints",))])
        laws.append(law)
    return laws
