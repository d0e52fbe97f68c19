"""Velocity or wrench of a site of the robot by the efforts of joints, for any motion and momentum of the base."""

from __future__ import annotations

import numpy as np

from ffsm_controllers.task_space.singularity import damped_inverse
from ffsm_mj.arrays import FloatArray
from ffsm_mj.assembly.assemble import Assembly
from ffsm_mj.assembly.control_laws import task_of
from ffsm_mj.controller_protocol import ControllerContext, Observation
from ffsm_mj.errors import Fault, ScenarioFaults
from ffsm_mj.scenario.env_config import TipVelocityAction, TipWrenchAction
from ffsm_mj.task_model import TaskModel

_AXES = {"x": 0, "y": 1, "z": 2}


class TipAction:
    """Efforts of joints for a velocity or a wrench of a site.

    Velocity: u = alpha^T Lambda (k (v - ydot) - drift - B d) + d, with Lambda the inverse of alpha M_c^-1 alpha^T, so that
    yddot = k (v - ydot) exactly while no actuator is at its limit; d is the damping of the joints, of which the site feels
    nothing. Wrench: u = alpha^T w + d. While an object is grasped, the robot is the one that holds it.

    Attributes:
        actuators: Ids of the motors, (n,).
        scale: Velocity or wrench of the action of ones, in m/s and rad/s, or N and N m, (p,).
    """

    def __init__(self, config: TipVelocityAction | TipWrenchAction, assembly: Assembly) -> None:
        """Resolve site and joints.

        Raises:
            ScenarioFaults: There is no such site or joint, or neither a site nor a task.
        """
        scenario, system = assembly.scenario, assembly.system
        if config.site is None and scenario.task is None:
            raise ScenarioFaults([Fault("is missing: the scenario has no task whose tip could be used", ("site",))])
        site = config.site if config.site is not None else str(system.mj.site(assembly.task.tip_site).name)  # type: ignore[union-attr]
        axes = [_AXES[axis] for axis in config.axes]
        systems = {"": system} | {name: each.system for name, each in assembly.held.items()}
        contexts = {
            name: ControllerContext(each, task_of(scenario, each), scenario.control_period_s)
            for name, each in systems.items()
        }
        self._tasks = {
            name: TaskModel(context, config.joints, (), site=site, axes=axes, attitude=config.rotation)
            for name, context in contexts.items()
        }
        self._config = config
        self.actuators = self._tasks[""].joints.actuators
        linear, angular = (
            (config.max_speed_m_s, config.max_rate_rad_s)
            if isinstance(config, TipVelocityAction)
            else (config.max_force_N, config.max_torque_N_m)
        )
        self.scale = np.array([linear] * len(axes) + [angular or 0.0] * (3 if config.rotation else 0))

    def efforts(self, action: FloatArray, observation: Observation) -> FloatArray:
        """Efforts of the motors, N or N m, (n,), for numbers from -1 to 1, (p,)."""
        config, task, wanted = self._config, self._tasks[observation.attached], action * self.scale
        task.update(observation.data)
        damped = -config.damping_N_m_s_rad * task.qd
        if isinstance(config, TipWrenchAction):
            return np.asarray(wanted.dot(task.alpha) + damped)
        acceleration = config.gain_1_s * (wanted - task.yd) - task.drift - task.B.dot(damped)
        inertia, _ = damped_inverse(task.B.dot(task.alpha.T), config.singular_mass_kg)
        return np.asarray(damped + inertia.dot(acceleration).dot(task.alpha))
