"""The free-flying phase (paper, section 4.4): base and arm under PD back to where the phase began, at rest.

A wrench on the base is asked of thrusters and wheels: the force of the thrusters, the torque of the wheels, or of the
thrusters too where there are none. Ideal world-aligned actuators, body-fixed one-way thrusters and wheels that store the
momentum are all allocated the same way; what an on-off thruster makes of its share is decided by the plant.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Literal

import mujoco

from ffsm_controllers.base_control import BaseControl, Stiffness
from ffsm_controllers.pd import Gain, Pd, PdConfig
from ffsm_mj.controller_protocol import (
    Command,
    ControllerContext,
    Damping,
    Fault,
    Observation,
    ScenarioFaults,
    Signal,
    StrictModel,
)


class BaseGains(StrictModel):
    """PD gains of the base towards its pose at the start of the phase."""

    kp: Gain
    """N/m for translation, N m/rad for rotation; 0 only brings it to rest."""
    kd: Gain
    """N s/m for translation, N m s/rad for rotation."""


class ArmGains(StrictModel):
    """PD gains of the arm towards its configuration at the start of the phase."""

    joints: tuple[str, ...] | None = None
    """Joints to hold; left out: every motor-driven joint of the robot but the base's and the wheels'."""
    kp: tuple[Gain, ...] | Gain
    """N m/rad: one for all joints or one each."""
    kd: tuple[Gain, ...] | Gain
    """N m s/rad: one for all joints or one each."""


class FreeFlyingConfig(StrictModel):
    """PD on base and arm through thrusters, wheels and joint motors."""

    kind: Literal["free_flying"]
    thrusters: tuple[str, ...] = ()
    """Actuators that push the base: body-fixed at sites, or ideal ones on base joints."""
    wheels: tuple[str, ...] = ()
    """Motors of reaction wheels, or an ideal one on a base hinge; without any the thrusters turn the base too."""
    translation: BaseGains | None = None
    """Left out: the base's translation is not controlled. The paper: kp 50, kd 37.5."""
    rotation: BaseGains | None = None
    """Left out: the base's rotation is not controlled. The paper: kp 200, kd 150."""
    arm: ArmGains | None = None
    """Left out: the arm is off. The paper: kp 150, kd 112.5."""


class FreeFlying:
    """PD wrench on the base, allocated; joint PD on the arm."""

    Config = FreeFlyingConfig
    telemetry_signals: ClassVar[tuple[Signal, ...]] = (
        Signal("controller", "base_position_error_m", "m", "distance of the base from where the phase began"),
        Signal("controller", "base_rotation_error_rad", "rad", "angle of the base from where the phase began"),
    )

    def __init__(self, config: FreeFlyingConfig, context: ControllerContext) -> None:
        """Resolve actuators and joints.

        Raises:
            ScenarioFaults: An unknown name, or a demand that no actuator can serve.
        """
        self._model, self._base_dofs = context.system.mj, context.system.robot.base_dofs
        self._base = BaseControl(
            context.system, config.thrusters, config.wheels, _stiffness(config.translation), _stiffness(config.rotation)
        )
        self._arm = self._arm_control(config.arm, context)

    def _arm_control(self, arm: ArmGains | None, context: ControllerContext) -> Pd | None:
        if arm is None:
            return None
        joints = arm.joints
        if joints is None:
            model, wheels = self._model, {int(self._model.actuator_trnid[w, 0]) for w in self._base.wheels}
            driven = [int(model.actuator_trnid[i, 0]) for i in range(model.nu) if _drives_joint(model, i)]
            base = range(self._base_dofs.start, self._base_dofs.stop)
            arm_joints = [j for j in driven if j not in wheels and model.jnt_dofadr[j] not in base]
            joints = tuple(model.joint(j).name for j in arm_joints)
        try:
            return Pd(PdConfig(kind="pd", joints=joints, kp=arm.kp, kd=arm.kd), context)
        except ScenarioFaults as faults:
            raise ScenarioFaults([Fault(f.message, ("arm", *f.path)) for f in faults.faults]) from faults

    def start(self, observation: Observation) -> None:
        """Take pose and configuration as the reference."""
        self._base.start(observation)
        if self._arm is not None:
            self._arm.start(observation)

    def control(self, observation: Observation, command: Command) -> None:
        """Ask for the wrench and drive the arm."""
        self._base.control(observation, command)
        if self._arm is not None:
            self._arm.control(observation, command)

    def damping_at(self, data: Any) -> Damping | None:
        """That of the arm, as if the base floated."""
        return None if self._arm is None else self._arm.damping_at(data)._replace(key="arm.kd")

    def telemetry(self) -> Sequence[float]:
        """Position and rotation error of the base at the last tick."""
        return self._base.error


def _stiffness(gains: BaseGains | None) -> Stiffness | None:
    return None if gains is None else Stiffness(gains.kp, gains.kd)


def _drives_joint(model: Any, actuator: int) -> bool:
    return bool(model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT)
