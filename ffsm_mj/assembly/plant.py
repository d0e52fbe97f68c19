"""Builds the simulated system of a scenario, for a run and for the replay of its log."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ffsm_mj.actuation.actuation import Actuation
from ffsm_mj.assembly.contact_models import contact_models_of
from ffsm_mj.assembly.grasps import GraspedSystem
from ffsm_mj.assembly.step_control import step_control
from ffsm_mj.balance.balance import Balance
from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact_models.interface import Scene
from ffsm_mj.controller_protocol import Task
from ffsm_mj.dynamics.motion import Motion, actuator_power
from ffsm_mj.errors import Fault, ScenarioFaults
from ffsm_mj.log.recorder import BLOCK_ROWS
from ffsm_mj.model.inputs import controller_of, further_inputs
from ffsm_mj.model.system import System
from ffsm_mj.records.events import RunEnded
from ffsm_mj.scenario.scenario import ScenarioConfig
from ffsm_mj.sensing.sampler import SensorSampler
from ffsm_mj.sensing.sensor import sensors_of
from ffsm_mj.simulation.control_timing import ControlTiming, DelayedControl, command_delays_s
from ffsm_mj.simulation.integrator import EventDrivenIntegrator
from ffsm_mj.simulation.plant import Plant, StateSignals


def build_plant(
    scenario: ScenarioConfig,
    system: System,
    data: Any,
    pairs: tuple[ContactPair, ...],
    limits: tuple[JointLimit, ...],
    held: Mapping[str, GraspedSystem],
    task: Task | None,
) -> Plant:
    """Build the simulated system of a scenario; :func:`start_contacts` must follow at the state from which it starts.

    Args:
        scenario: Scenario of the run.
        system: Robot and objects; the plant writes the time step of its model.
        data: Their state, derived quantities current.
        pairs: Impact pairs.
        limits: Joint limits.
        held: Systems with grasped objects, by the name of the grasp.
        task: Task of the scenario; None if it has none.

    Raises:
        ScenarioFaults: A contact model or an actuator does not fit the system, or no accuracy can be measured.
    """
    scene, motion = Scene(system, data), Motion(system.mj, data, actuator_power(system, system.mj, data))
    actuation = Actuation(system, scenario.actuators, data, scenario.initial.activations)
    control = _delayed_control(scenario, scene, actuation)
    models = contact_models_of(scenario, scene, motion, pairs, limits, held)
    integrator = EventDrivenIntegrator(motion, (*models, control) if control is not None else models)
    power = motion.power
    work, outside = (None, None) if power is None else (power.work, power.outside)
    impulse = None if outside is None else outside.impulse
    balance = Balance(system, data, motion.momentum, capacity=BLOCK_ROWS, actuator_work=work, actuator_impulse=impulse)
    integrator.control = step_control(scenario, system, data, balance, motion)
    tip = (task.tip_site, task.axes, task.motion) if task is not None else (None,)
    state = StateSignals(system, data, *tip)
    sampler = _sampler(scenario, scene, integrator, pairs)
    return Plant(scene, actuation, integrator, balance, state, sampler, control)


def start_contacts(plant: Plant) -> None:
    """Let the contact models begin at the initial state.

    Raises:
        ScenarioFaults: No motion follows from it, as that of a sliding contact in Painleve's paradox.
    """
    try:
        plant.integrator.restore_state(plant.integrator.motion)
    except RunEnded as ended:
        raise ScenarioFaults([Fault(f"no run begins in this state: {ended.message}", ("initial",))]) from None


def _delayed_control(scenario: ScenarioConfig, scene: Scene, actuation: Actuation) -> DelayedControl | None:
    """Timing of control; None if every command acts at once."""
    system, given = scene.system, {name: config.delay_s for name, config in scenario.actuators.items()}
    own = {system.resolve("actuator", name): delay for name, delay in given.items()}
    for i in np.flatnonzero(further_inputs(system.mj)).tolist():
        own.setdefault(actuation.names[i], own.get(actuation.names[controller_of(system.mj, i)]))
    delays = command_delays_s(actuation.names, system.actuator_delays_s, scenario.actuation.delay_s, own)
    timing = ControlTiming(delays, scenario.actuation.control_jitter_s, scenario.control_period_s, scenario.seed)
    return None if timing.is_ideal else DelayedControl(timing, scene, actuation)


def _sampler(
    scenario: ScenarioConfig, scene: Scene, integrator: EventDrivenIntegrator, pairs: tuple[ContactPair, ...]
) -> SensorSampler | None:
    """Sensors of the models; None: there are none.

    Raises:
        ScenarioFaults: A key of ``sensors`` does not fit them.
    """
    sensors = sensors_of(scene.system, scenario.sensors, scenario.control_period_s, scenario.duration_s)
    if not sensors:
        return None
    return SensorSampler(
        sensors,
        scene.system,
        scene.data,
        lambda: integrator.motion,
        integrator.wrenches,
        integrator.contacts,
        seed=scenario.seed,
        time_step_s=scenario.time_step_s,
        bodies_of={pair.name: (pair.body_a, pair.body_b) for pair in pairs},
    )
