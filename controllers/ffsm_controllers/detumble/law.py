"""Detumbling: the angular momentum of the stack, robot and grasped object, goes into the wheels, or out by thrusters.

With L the angular momentum about the centre of mass of the stack, h = sum_i a_i I_i thetadot_i that of the wheels relative
to their bearings and L_r = L - h, wheels are to take hdot = s k L_r: L_r falls as exp(-k t) where no limit is reached. The
share s <= 1 is the largest that torque limits of all driven joints and the bounds on the load of the grasp leave. Wheels,
arm and everything that floats are one system: u = M_c qdd + c_c with the reduced dynamics of wheels and arm, so that the
arm is held, or moves, while the stack is slowed down.

In LVLH axes, which turn at Omega, the stack is to turn with them: L_r is then without J Omega, J its inertia. The rate of
J Omega and the torque of external fields are fed forward: the wheels take them too.

A wheel at its maximum speed is left out; what the others cannot span is taken by thrusters, which then also unload the
saturated wheels: they keep L_r at a small value opposite to the momentum of these wheels, which the wheels follow.

Source: Dimitrov & Yoshida 2004, Momentum distribution in a space manipulator for facilitating the post-impact control, IROS;
Hughes 1986, Spacecraft Attitude Dynamics (gyrostats).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import mujoco
import numpy as np

from ffsm_controllers.allocation import actuators_by_name, moments, unit_moments
from ffsm_controllers.detumble.arm_motion import ArmMotion
from ffsm_controllers.detumble.config import DetumbleConfig
from ffsm_controllers.detumble.joints import detumble_joints
from ffsm_controllers.detumble.latch import GraspLoad
from ffsm_controllers.detumble.outcome import DetumbleOutcome
from ffsm_controllers.detumble.thrusters import MomentumThrusters
from ffsm_controllers.detumble.wheels import WheelShare, wheel_share
from ffsm_mj.controller_protocol import (
    Command,
    ConstrainedModel,
    ControllerContext,
    ControllerReport,
    Fault,
    FloatArray,
    IntArray,
    Observation,
    Signal,
    StackMomentum,
    Stateful,
    cross,
)
from ffsm_mj.task_model import JointModel

_ABSORBED = 0.5
"""Share of the least wheel torque that thrusters make the wheels give up while they unload them."""


class Detumble(Stateful):
    """Angular momentum of the stack to zero except that of the wheels."""

    @dataclass
    class State:
        """Motion of the arm, what the law has come to, and whether thrusters unload wheels."""

        arm: ArmMotion.State | None
        outcome: DetumbleOutcome.State
        dumping: bool

    Config = DetumbleConfig
    after_others = True
    telemetry_signals: ClassVar[tuple[Signal, ...]] = (
        Signal(
            "controller",
            "stack_momentum_N_m_s",
            "N m s",
            "angular momentum of the stack without that of its wheels, less that to keep",
        ),
        Signal("controller", "wheel_momentum_N_m_s", "N m s", "angular momentum of the wheels relative to their bearings"),
        Signal("controller", "detumble_share", "", "share of the demanded rate of momentum that the limits leave"),
    )

    def __init__(self, config: DetumbleConfig, context: ControllerContext) -> None:
        """Resolve wheels, thrusters and joints.

        Raises:
            ScenarioFaults: An unknown name, a wheel that is no rotor, positions that do not fit the joints, a rate that the
                control period cannot serve, or a share of a load limit that there is not.
        """
        self._config, self._context, self._mj = config, context, context.system.mj
        self._stack, self._constrained = StackMomentum(context.system), ConstrainedModel(context.system.mj)
        resolved = detumble_joints(config, context, self._stack)
        self._n, self._wheel = len(resolved.wheels), resolved.wheels
        self._model = JointModel(context, resolved.names) if resolved.names else None
        self._gear = self._mj.actuator_gear[:, 0]
        limits = context.limits
        self._saturation = np.full(self._mj.nu, np.inf) if limits is None else limits.saturation
        joints = self._model.joints if self._model is not None else None
        self._arm = ArmMotion(config.arm, joints, slice(self._n, None)) if joints is not None else None
        thrusters = actuators_by_name(context.system, config.thrusters, "thrusters")
        self._thrusters = MomentumThrusters(context.system, thrusters, limits) if len(thrusters) else None
        self._latch = GraspLoad(config.latch, context.system)
        self._axes = context.lvlh_axes(config.frame)
        self._unit, self._turning = unit_moments(self._mj), np.empty((3, self._mj.nv))
        self._outcome = DetumbleOutcome(config, resolved.wheel_names)
        self._dumping = False

    def start_faults(self, data: Any) -> Sequence[Fault]:
        """Joints that depend on each other."""
        return self._model.start_faults(data) if self._model is not None else ()

    @property
    def driven_actuators(self) -> IntArray:
        """Wheels, motors of the arm, and thrusters."""
        joint_actuators = self._model.joints.actuators if self._model is not None else np.zeros(0, dtype=np.intp)
        return joint_actuators if self._thrusters is None else np.concatenate((joint_actuators, self._thrusters.actuators))

    def start(self, observation: Observation) -> None:
        """Take the reference of the arm."""
        if self._arm is not None:
            self._arm.start(observation.phase_start_s, observation.data)
        self._dumping = False
        self._outcome.start()

    def control(self, observation: Observation, command: Command) -> None:
        """Drive wheels, arm and thrusters."""
        data = observation.data
        rest, h = self._stack.parts(data)
        columns = self._stack.wheel_columns(data)[:, self._wheel]
        wanted, torque = self._wanted(observation.time_s, data)
        rest = rest - wanted
        demand = self._config.rate_1_s * rest + torque
        coupling = self._momentum_keeping(data, columns)
        rates = self._rates(data) + self._context.control_period_s * coupling
        share = self._wheel_share(columns, demand, rates)
        asked = self._impulse(data, rest, columns, share)
        pushed = moments(self._mj, data, self._unit).T @ command.others if command.others.any() else None
        s, thrust = self._drive(observation, command, coupling, share, asked, pushed)
        self._outcome.look(observation.time_s, rest, h, s, share, thrust)

    def _wanted(self, time_s: float, data: Any) -> tuple[FloatArray, FloatArray]:
        """Angular momentum that is to be left, and what changes the rest without wheels and thrusters, (3,) each.

        The latter is the torque of external fields less the rate of the former.
        """
        wanted, torque, field, axes = np.zeros(3), np.zeros(3), self._context.external_field, self._axes
        root = self._context.system.robot.root
        if field is not None:
            force, answer = np.zeros((1, self._mj.nv)), np.empty((1, self._mj.nv))
            field.add_to(data, force[0])
            self._constrained.respond(data, force, answer)
            mujoco.mj_angmomMat(self._mj, data, self._turning, root)
            torque = self._turning @ answer[0]
        if axes is not None:
            axes.update(time_s)
            # Composite inertia of the tree about its mass centre: xx, yy, zz, xy, xz, yz.
            inertia = data.crb[root][[[0, 3, 4], [3, 1, 5], [4, 5, 2]]]
            mujoco.mj_jacBody(self._mj, data, None, self._turning, root)
            turning, wanted = self._turning @ data.qvel, inertia @ axes.spin
            # The inertia is constant in the stack, which turns.
            torque = torque - cross(turning, wanted) + inertia @ (cross(turning, axes.spin) - axes.spin_rate)
        return wanted, torque

    def _drive(
        self,
        observation: Observation,
        command: Command,
        coupling: FloatArray,
        share: WheelShare,
        impulse: FloatArray | None,
        pushed: FloatArray | None,
    ) -> tuple[float, FloatArray | None]:
        """Command all actuators; returns the share of the demand, and the efforts of the thrusters."""
        data, model = observation.data, self._model
        if model is not None:
            model.update(data, pushed)
        thrust, by_thrust = self._thrust(data, impulse)
        if model is None:
            if thrust is not None and self._thrusters is not None:
                command.drive(self._thrusters.actuators, thrust)
            return 1.0, thrust
        wanted = np.concatenate((coupling, self._arm_accelerations(observation)))
        u0 = model.M_c @ wanted + model.c_c
        u1 = model.M_c @ np.concatenate((share.accelerations, np.zeros(len(wanted) - self._n)))
        q0, q1 = model.coasting + u0 @ model.mobility, u1 @ model.mobility
        s, t = self._shares(data, u0, u1, q0, q1, by_thrust)
        command.drive(model.joints.actuators, u0 + s * u1)
        if thrust is not None and self._thrusters is not None:
            # A disturbance of the joints: an on-off thruster may not deliver what is asked of it.
            thrust = t * thrust
            command.drive(self._thrusters.actuators, thrust)
        return s, thrust

    def _thrust(self, data: Any, impulse: FloatArray | None) -> tuple[FloatArray | None, FloatArray]:
        """Efforts of the thrusters, None while they are not needed, and the accelerations of all dofs by them, (nv,)."""
        if self._thrusters is None or impulse is None:
            return None, np.zeros(self._mj.nv)
        thrust = self._thrusters.efforts(data, impulse, self._context.control_period_s)
        force = moments(self._mj, data, self._unit)[self._thrusters.actuators].T @ thrust
        answer = np.empty((1, self._mj.nv))
        self._constrained.respond(data, force[None, :], answer)
        return thrust, answer[0]

    def _momentum_keeping(self, data: Any, columns: FloatArray) -> FloatArray:
        """Accelerations of the wheels that keep their momentum in place while the base turns them: A qdd = -omega x h."""
        if not self._n:
            return np.zeros(0)
        mujoco.mj_jacBody(self._mj, data, None, self._turning, self._context.system.robot.root)
        turning = cross(self._turning @ data.qvel, columns @ self._rates(data))
        return self._wheel_share(columns, -turning, self._rates(data)).accelerations

    def _wheel_share(self, columns: FloatArray, demand: FloatArray, rates: FloatArray) -> WheelShare:
        return wheel_share(columns, demand, rates, self._limits_of_wheels(), self._context.control_period_s)

    def _arm_accelerations(self, observation: Observation) -> FloatArray:
        model, arm, data = self._model, self._arm, observation.data
        assert model is not None
        assert arm is not None
        W = None
        if arm.null_space:
            mujoco.mj_jacBody(self._mj, data, None, self._turning, self._context.system.robot.root)
            W = (self._turning @ model.mobility.T @ model.M_c)[:, self._n :]
        return arm.accelerations(observation.time_s, data, W)

    def _shares(
        self, data: Any, u0: FloatArray, u1: FloatArray, q0: FloatArray, q1: FloatArray, by_thrust: FloatArray
    ) -> tuple[float, float]:
        """Shares of the demand on the wheels and of the thrust that torque limits and the bounds of the grasp leave."""
        rate = float(np.linalg.norm(self._stack.wheel_columns(data)[:, self._wheel] @ self._demanded(u1)))
        s, bound = 1.0, self._config.max_torque_N_m
        if bound is not None and rate > bound:
            s = bound / rate
        s, t = min(s, self._room(data, u0, u1)), 1.0
        if self._latch.is_bounded:
            self._latch.update(data)
            load = self._latch.at(q0)
            alone = self._latch.ratio(load)
            self._outcome.load(alone)
            if by_thrust.any():
                t = self._latch.share(load, self._latch.at(q0 + by_thrust) - load, alone)
                load = load + t * (self._latch.at(q0 + by_thrust) - load)
            s = min(s, self._latch.share(load, self._latch.at(q0 + q1) - self._latch.at(q0), alone))
        return s, t

    def _demanded(self, u1: FloatArray) -> FloatArray:
        """Accelerations of the wheels by their part of the demand, (n,)."""
        assert self._model is not None
        return np.asarray(np.linalg.solve(self._model.M_c, u1)[: self._n])

    def _room(self, data: Any, u0: FloatArray, u1: FloatArray) -> float:
        """Share of the efforts u1 that fits beside u0; joints that u0 alone takes to their limits do not count."""
        model, limits = self._model, self._context.limits
        if limits is None or model is None:
            return 1.0
        velocity = np.zeros(self._mj.nu)
        velocity[model.joints.actuators] = self._gear[model.joints.actuators] * data.qvel[model.joints.dofs]
        low, high = (bound[model.joints.actuators] for bound in limits.bounds(velocity))
        counts = (u0 > low) & (u0 < high) & (u1 != 0.0)
        ends = np.where(u1 > 0.0, high, low)
        return min(1.0, float(((ends - u0)[counts] / u1[counts]).min(initial=1.0)))

    def _impulse(self, data: Any, rest: FloatArray, columns: FloatArray, share: WheelShare) -> FloatArray | None:
        """Angular impulse that thrusters are to give in the coming period, N m s; None while wheels can take all."""
        if self._thrusters is None:
            return None
        left = share.left / self._config.rate_1_s
        if not self._n:
            return -rest
        beyond = bool(np.linalg.norm(left) > self._config.tolerance_N_m_s)
        self._dumping |= beyond
        if not self._dumping:
            return None
        rates, most = self._rates(data), self._config.unload_to * self._limits_of_wheels()
        above = np.where(np.abs(rates) > most, rates - np.copysign(most, rates), 0.0)
        excess = columns @ above
        size = float(np.linalg.norm(excess))
        if size == 0.0:
            self._dumping = False
            return -left if beyond else None
        direction = excess / size
        opposite = min(size, _ABSORBED * self._least_wheel_torque() / self._config.rate_1_s)
        along = max(float(rest @ direction) + opposite, 0.0)
        return -(left - direction * float(left @ direction) + along * direction)

    def _least_wheel_torque(self) -> float:
        limits, model = self._context.limits, self._model
        if limits is None or model is None:
            return math.inf
        return float(limits.bounds(np.zeros(self._mj.nu))[1][model.joints.actuators[: self._n]].min())

    def _rates(self, data: Any) -> FloatArray:
        return np.asarray(data.qvel[self._stack.dofs[self._wheel]])

    def _limits_of_wheels(self) -> FloatArray:
        assert self._model is not None or not self._n
        return self._saturation[self._model.joints.actuators[: self._n]] if self._model is not None else np.zeros(0)

    def is_finished(self, time_s: float) -> bool:
        """Whether the momentum is below its tolerance and the arm has arrived."""
        return self._outcome.is_below and (self._arm is None or self._arm.has_arrived(time_s))

    def telemetry(self) -> Sequence[float]:
        """Momentum without the wheels, that of the wheels, and the share of the demand at the last tick."""
        return self._outcome.values

    def summary(self) -> ControllerReport:
        """What is left of the momentum, and which limits were reached."""
        return self._outcome.report(self._latch)
