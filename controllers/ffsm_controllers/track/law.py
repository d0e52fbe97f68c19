"""Computed torque on a site that follows a site of an object: position, attitude and their rates.

With the words of :class:`~ffsm_mj.task_model.TaskModel` u = alpha^T Lambda (wanted - drift), Lambda the inverse of
alpha M_c^-1 alpha^T. What is wanted is what the object's site does, coasting, less kd times the relative rates and kp times
the error: that obeys e'' = -kd e' - kp e whatever object, base and momentum do, the position in world axes, a turn about one
axis in the object's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ffsm_controllers.allocation import moments, unit_moments
from ffsm_controllers.base_control import BaseControl, Stiffness
from ffsm_controllers.pd import per_joint
from ffsm_controllers.task_space.config import object_site
from ffsm_controllers.task_space.damping import most_unstable
from ffsm_controllers.task_space.joints import controllable_directions, joints_that_move
from ffsm_controllers.task_space.singularity import SingularityMonitor, damped_inverse
from ffsm_controllers.track.config import BaseConfig, TrackConfig
from ffsm_controllers.track.reach import ReachMonitor
from ffsm_mj.controller_protocol import (
    Command,
    ControllerContext,
    ControllerReport,
    Damping,
    Fault,
    FloatArray,
    IntArray,
    MovingFrame,
    Observation,
    ScenarioFaults,
    Signal,
    Stateful,
    faults_below,
)
from ffsm_mj.task_model import TaskModel

_POSITION = (
    Signal("controller", "track_error_m", "m", "distance of the robot's site from where it is to be"),
    Signal("controller", "track_speed_m_s", "m/s", "speed of the robot's site against where it is to be"),
)
_ATTITUDE = (
    Signal("controller", "track_angle_rad", "rad", "angle of the robot's site against the object's"),
    Signal("controller", "track_rate_rad_s", "rad/s", "angular speed of the robot's site against the object's"),
)
_ARM = (
    Signal("controller", "track_mass_kg", "kg", "largest effective inertia of the robot's site along a principal direction"),
    Signal("controller", "track_share", "", "share of the feedback that the bound on torques leaves"),
)


class Track(Stateful):
    """A site of the robot follows a site of an object.

    While that very object is held there is nothing to follow: the law only damps the joints.
    """

    @dataclass
    class State:
        """Control of the base, what it reports of the last tick, and how near to singularities and bounds it came."""

        base: BaseControl.State | None
        singularity: SingularityMonitor.State
        report: tuple[float, ...]
        largest: float
        least_share: float
        least_rate_share: float
        reach: ReachMonitor.State

    Config = TrackConfig
    after_others = True

    def __init__(self, config: TrackConfig, context: ControllerContext) -> None:
        """Resolve sites, joints and actuators.

        Raises:
            ScenarioFaults: An unknown name, no site to follow with, or a demand on the base that no actuator can serve.
        """
        system, turns = context.system, config.attitude is not None
        self._model, self._config = system.mj, config
        target = object_site(system, config.object_site)
        site = _robot_site(config, context)
        joints = config.joints if config.joints is not None else joints_that_move(context, site)
        self._task = TaskModel(context, joints, (), site=site, attitude=turns)
        dofs = self._task.joints.dofs
        count = len(dofs)
        controllable = controllable_directions(self._model, system.index("site", site), dofs, range(6 if turns else 3))
        self._singularity = SingularityMonitor(controllable, config.singular_mass_kg, context.control_period_s)
        self._target = MovingFrame(self._model, target, np.array(config.offset_m))
        grasped_tree = system.grasp.tree if system.grasp is not None else ""
        self._holds = bool(grasped_tree) and self._model.site(target).name.startswith(f"{grasped_tree}/")
        bound = config.max_torque_N_m
        self._bound = None if bound is None else per_joint(bound, count, "max_torque_N_m")
        fastest = config.max_joint_rate
        self._fastest = None if fastest is None else per_joint(fastest, count, "max_joint_rate")
        self._reach = ReachMonitor(system, system.index("site", site), context.control_period_s)
        self._base = None if config.base is None else _base_control(config.base, context)
        self._unit = unit_moments(self._model)
        self.telemetry_signals: tuple[Signal, ...] = (*_POSITION, *(_ATTITUDE if turns else ()), *_ARM)
        self._report: tuple[float, ...] = (math.nan,) * len(self.telemetry_signals)
        self._largest, self._least_share, self._least_rate_share = 0.0, 1.0, 1.0

    @property
    def driven_actuators(self) -> IntArray:
        """Motors of the joints, and the actuators that hold the base."""
        arm = self._task.joints.actuators
        return arm if self._base is None else np.concatenate((arm, self._base.driven_actuators))

    def start_faults(self, data: Any) -> Sequence[Fault]:
        """Joints that depend on each other."""
        return self._task.start_faults(data)

    def start(self, observation: Observation) -> None:
        """The base is to stay where it is now."""
        if self._base is not None:
            self._base.start(observation)

    def control(self, observation: Observation, command: Command) -> None:
        """Drive base and arm."""
        data, task = observation.data, self._task
        if self._base is not None:
            self._base.control(observation, command)
        if self._holds:
            damped = -self._config.joint_damping_N_m_s_rad * data.qvel[task.joints.dofs]
            command.drive(
                task.joints.actuators, damped if self._bound is None else np.clip(damped, -self._bound, self._bound)
            )
            return
        feedforward, asked = self._wanted(data)
        inertia, mobilities = damped_inverse(task.B.dot(task.alpha.T), self._config.singular_mass_kg)
        feedback = self._feedback(asked * self._rate_share(inertia, asked))
        feedforward -= task.drift
        known = command.effort + command.others
        if known.any():
            feedforward -= task.response(data, moments(self._model, data, self._unit).T.dot(known))
        damped = -self._config.joint_damping_N_m_s_rad * task.qd
        needed = damped + inertia.dot(feedforward - task.B.dot(damped)).dot(task.alpha)
        torque, share = self._bounded(needed, inertia.dot(feedback).dot(task.alpha))
        command.drive(task.joints.actuators, torque)
        largest = 1.0 / float(mobilities[0]) if mobilities[0] > 0.0 else math.inf
        if observation.at_tick:
            self._singularity.look(observation.time_s, mobilities)
            self._reach.look(observation.time_s, data, task.target_m)
        self._report = (*self._errors, largest, share)
        self._largest, self._least_share = max(self._largest, largest), min(self._least_share, share)

    def _wanted(self, data: Any) -> tuple[FloatArray, FloatArray]:
        """Accelerations of where the robot's site is to be, and relative rates that the error asks for, (p,) each."""
        task, target, config = self._task, self._target, self._config
        target.update(data)
        task.target_m, task.target_frame, task.target_rates = target.point, target.frame, target.rates[: task.site.size]
        task.update(data)
        feedforward = target.accelerations(task.coasting)
        error, relative = task.e, task.ed
        gains = config.position
        asked = _asked(error[:3], gains.kp_1_s2, gains.kd_1_s, gains.max_speed_m_s)
        self._errors: tuple[float, ...] = (_length(error[:3]), _length(relative[:3]))
        if config.attitude is None:
            return feedforward[:3], asked
        turns = config.attitude
        turning = _asked(error[3:], turns.kp_1_s2, turns.kd_1_s, turns.max_rate_rad_s)
        feedforward[3:] += target.relative_turn(
            relative[3:]
        )  # what is relative is to fall in the object's frame, which turns
        self._errors = (*self._errors, _length(error[3:]), _length(relative[3:]))
        return feedforward, np.concatenate((asked, turning))

    def _feedback(self, asked: FloatArray) -> FloatArray:
        """Accelerations -kd (relative rates - those asked for), (p,)."""
        config, relative = self._config, self._task.ed
        position = -config.position.kd_1_s * (relative[:3] - asked[:3])
        if config.attitude is None:
            return np.asarray(position)
        return np.concatenate((position, -config.attitude.kd_1_s * (relative[3:] - asked[3:])))

    def _rate_share(self, inertia: FloatArray, asked: FloatArray) -> float:
        """Share of the rates asked for that the joints can give beside the rates with which they follow.

        Rates of the joints are those of least kinetic energy, B^T Lambda times those of the site.
        """
        if self._fastest is None:
            return 1.0
        task = self._task
        following, towards = (task.B.T.dot(inertia.dot(rates)) for rates in (task.target_rates - task.v_h, asked))
        share = _room(self._fastest, following, towards)
        self._least_rate_share = min(self._least_rate_share, share)
        return share

    def _bounded(self, needed: FloatArray, feedback: FloatArray) -> tuple[FloatArray, float]:
        """Torques within their bound: as much of the feedback as fits beside what is needed anyway, and that share."""
        if self._bound is None:
            return needed + feedback, 1.0
        share = _room(self._bound, needed, feedback)
        return np.clip(needed + share * feedback, -self._bound, self._bound), share

    def damping_at(self, data: Any) -> Damping:
        """The one that comes nearest to instability: of the position, of the attitude, or of what the site does not feel."""
        task, config = self._task, self._config
        task.update(data)
        dofs, count = task.joints.dofs, len(task.joints.dofs)
        unseen, dampings = np.eye(count), []
        if not self._holds:
            inertia, _ = damped_inverse(task.B.dot(task.alpha.T), config.singular_mass_kg)
            pushes = inertia.dot(task.alpha).T
            unseen -= pushes.dot(task.B)
            for key, gains, rows in (("position", config.position, slice(0, 3)), ("attitude", config.attitude, slice(3, 6))):
                if gains is not None:
                    matrix = gains.kd_1_s * pushes[:, rows].dot(task.alpha[rows])
                    dampings.append(Damping(f"{key}.kd_1_s", dofs, np.full(count, gains.kd_1_s), matrix))
        gain = config.joint_damping_N_m_s_rad
        dampings.append(Damping("joint_damping_N_m_s_rad", dofs, np.full(count, gain), gain * unseen))
        return most_unstable(task, dampings)

    def telemetry(self) -> Sequence[float]:
        """Errors, relative rates, the largest effective inertia and the share of the feedback at the last tick."""
        return self._report

    def summary(self) -> ControllerReport:
        """How near to a singularity it came, and how much of the feedback the bound on torques left at the least."""
        if self._holds:
            return {}
        mass = self._largest if math.isfinite(self._largest) else "infinite"
        rates = {} if self._fastest is None else {"least_rate_share": self._least_rate_share}
        singular, reach = self._singularity.report(), self._reach.report()
        notes = [str(part["note"]) for part in (singular, reach) if "note" in part]
        note = {"note": "; ".join(notes)} if notes else {}
        return {"largest_mass_kg": mass, "least_share": self._least_share, **rates, **singular, **reach, **note}


def _asked(error: FloatArray, kp: float, kd: float, fastest: float | None) -> FloatArray:
    """The rate that an error asks for: -kp/kd times it, within a bound."""
    asked = (-kp / kd) * error
    speed = _length(asked)
    if fastest is not None and speed > fastest:
        asked *= fastest / speed
    return np.asarray(asked)


def _room(bound: FloatArray, needed: FloatArray, more: FloatArray) -> float:
    """Greatest share in [0, 1] of one vector that fits within a bound on each component beside another one."""
    counts = more != 0.0
    room = (np.copysign(bound, more) - needed)[counts] / more[counts]
    return min(max(float(room.min(initial=1.0)), 0.0), 1.0)


def _length(vector: FloatArray) -> float:
    return math.hypot(*vector.tolist())


def _robot_site(config: TrackConfig, context: ControllerContext) -> str:
    """Full name of the site that follows.

    Raises:
        ScenarioFaults: None is named and there is no task, or it is no site of the robot.
    """
    system = context.system
    if config.robot_site is None:
        if context.task is None:
            raise ScenarioFaults([Fault("track needs 'robot_site', or a 'task' whose tip it takes", ("kind",))])
        return str(system.mj.site(context.task.tip_site).name)
    sites = [name for name in system.names("site") if name.startswith("robot/")]
    with faults_below("robot_site"):
        full = system.resolve("site", config.robot_site)
    if full not in sites:
        raise ScenarioFaults([Fault(f"{full} is no site of the robot; write one of {', '.join(sites)}", ("robot_site",))])
    return full


def _base_control(config: BaseConfig, context: ControllerContext) -> BaseControl:
    translation, rotation = config.translation, config.rotation
    with faults_below("base"):
        return BaseControl(
            context.system,
            config.thrusters,
            config.wheels,
            None if translation is None else Stiffness(translation.kp_N_m, translation.kd_N_s_m),
            None if rotation is None else Stiffness(rotation.kp_N_m_rad, rotation.kd_N_m_s_rad),
            axes=context.lvlh_axes(config.frame),
        )
