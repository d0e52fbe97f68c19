"""The free-flying phase (paper, section 4.4): base and arm under PD back to where the phase began, at rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import mujoco
import numpy as np

from ffsm_controllers.base_pd import BaseActuation, BasePd
from ffsm_controllers.pd import Gain, Pd, PdConfig
from ffsm_mj.controller_protocol import (
    Command,
    ControllerContext,
    Damping,
    IntArray,
    Observation,
    StrictModel,
    faults_below,
)


class ArmGains(StrictModel):
    """PD gains of the arm towards its configuration at the start of the phase."""

    joints: tuple[str, ...] | None = None
    """Joints to hold; left out: every motor-driven joint of the robot but those of the base, the wheels and other parts."""
    kp: tuple[Gain, ...] | Gain
    """N m/rad: one for all joints or one each."""
    kd: tuple[Gain, ...] | Gain
    """N m s/rad: one for all joints or one each."""


class FreeFlyingConfig(BaseActuation):
    """PD on base and arm through thrusters, wheels and joint motors."""

    kind: Literal["free_flying"]
    arm: ArmGains | None = None
    """Left out: the arm is off. The paper: kp 150, kd 112.5."""


class FreeFlying(BasePd):
    """PD wrench on the base, allocated; joint PD on the arm."""

    @dataclass
    class State(BasePd.State):
        """With that of the control of the arm."""

        arm: Pd.State | None

    Config: ClassVar[type[BaseActuation]] = FreeFlyingConfig

    def __init__(self, config: FreeFlyingConfig, context: ControllerContext) -> None:
        """Resolve actuators and joints.

        Raises:
            ScenarioFaults: An unknown name, or a demand that no actuator can serve.
        """
        super().__init__(config, context)
        self._arm = None if config.arm is None else self._arm_control(config.arm, context)

    def _arm_control(self, arm: ArmGains, context: ControllerContext) -> Pd:
        joints = arm.joints
        if joints is None:
            system, model, other = context.system, context.system.mj, {*self._base.wheels.tolist(), *context.reserved}
            driven = [int(model.actuator_trnid[i, 0]) for i in range(model.nu) if _drives_joint(model, i) and i not in other]
            base = range(system.robot.base_dofs.start, system.robot.base_dofs.stop)
            joints = tuple(model.joint(j).name for j in driven if model.jnt_dofadr[j] not in base)
        with faults_below("arm"):
            return Pd(PdConfig(kind="pd", joints=joints, kp=arm.kp, kd=arm.kd), context)

    @property
    def driven_actuators(self) -> IntArray:
        """Thrusters, wheels and motors of the arm."""
        base = super().driven_actuators
        return base if self._arm is None else np.concatenate((base, self._arm.driven_actuators))

    def start(self, observation: Observation) -> None:
        """Take pose and configuration as the reference."""
        super().start(observation)
        if self._arm is not None:
            self._arm.start(observation)

    def control(self, observation: Observation, command: Command) -> None:
        """Ask for the wrench and drive the arm."""
        super().control(observation, command)
        if self._arm is not None:
            self._arm.control(observation, command)

    def damping_at(self, data: Any) -> Damping | None:
        """That of the arm, as if the base floated."""
        return None if self._arm is None else self._arm.damping_at(data)._replace(key="arm.kd")


def _drives_joint(model: Any, actuator: int) -> bool:
    return bool(model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT)
