"""Builds the simulated system of a scenario, for a run and for the replay of its log: contact models, steps, sensors."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ffsm_mj.actuation.actuation import Actuation
from ffsm_mj.assembly.grasps import GraspedSystem, grasp_models_of
from ffsm_mj.balance.balance import Balance
from ffsm_mj.balance.step_error import StepError
from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.contact.pairs import ContactPair, UnilateralConstraint
from ffsm_mj.contact_models.grasp.records import KINDS
from ffsm_mj.contact_models.impact.columns import DeepestOverlap, FrictionHeat
from ffsm_mj.contact_models.impact.model import ImpactModel, ImpactRules
from ffsm_mj.contact_models.impact.records import LIMIT_IMPACT
from ffsm_mj.contact_models.impact.rest_rule import RestRule
from ffsm_mj.contact_models.interface import ContactModel, ForceSource, Scene, Source
from ffsm_mj.contact_models.joint_friction.coordinates import friction_coordinates
from ffsm_mj.contact_models.joint_friction.record import STICK_SLIP
from ffsm_mj.contact_models.persistent.model import PersistentContactModel
from ffsm_mj.contact_models.persistent.record import FRICTION_KINDS, LIMIT_KINDS
from ffsm_mj.contact_models.registry import contact_model_of, record_kinds_of
from ffsm_mj.controller_protocol import Task
from ffsm_mj.dynamics.motion import Motion, actuator_power
from ffsm_mj.dynamics.rigid_body import free_components
from ffsm_mj.dynamics.springs import FastestMode, JointSprings
from ffsm_mj.dynamics.stiff_actuators import StiffActuators
from ffsm_mj.errors import Fault, Faults, ScenarioFaults
from ffsm_mj.fields.interface import Field, field_of
from ffsm_mj.fields.orbit import magnetic_field_of
from ffsm_mj.fields.surroundings import Surroundings
from ffsm_mj.model.actuators import has_servos
from ffsm_mj.model.inputs import controller_of, further_inputs
from ffsm_mj.model.system import System
from ffsm_mj.records.events import EFFORT_CHANGE, RunEnded
from ffsm_mj.records.metadata import orbit_metadata
from ffsm_mj.scenario.environment import EnvironmentConfig
from ffsm_mj.scenario.scenario import ScenarioConfig
from ffsm_mj.sensing.sensor import sensors_of
from ffsm_mj.simulation.control_timing import ControlTiming, DelayedControl, command_delays_s
from ffsm_mj.simulation.fields import ExternalFields, bodies_of
from ffsm_mj.simulation.integrator import EventDrivenIntegrator
from ffsm_mj.simulation.orbit import orbit_columns, orbit_of
from ffsm_mj.simulation.plant import Plant, StateSignals
from ffsm_mj.simulation.step_control import MOST_PARTS, StepControl
from ffsm_mj.tolerances import DAMPER_STEP, EPSILON, MODE_STEP, RESOLVED_STEP, STIFF_STEP
from ffsm_mj.verification.residuals import DRIFT_WINDOW_STEPS

if TYPE_CHECKING:
    from ffsm_mj.sensing.sampler import SensorSampler

_SHARE = 0.5
"""Of what a check allows, for the largest of a step's errors of energy, P and L of the robot, and of the objects, together.

Errors of many steps add up to less than their sum, so a run is well within what the checks allow.
"""

_OF_SERVOS = 1e-9
"""Accuracy of a run with servos whose steps do not resolve them: that of the checks."""
_ROUNDING = 20.0 * EPSILON
"""Relative error of a sub-step that is rounding: those of a transient are too short for the budget.

It is the sum of three, of energy, P and L, each a difference of sums of a dozen terms: 2.1e-15 is seen in a robot of 500 kg.
"""
_TRANSIENT_PARTS, _MOST_IMPLICIT_PARTS = 400.0, 1 << 16
"""Sub-steps of the time in which the fastest servo decays, while it does, and the largest number of a step."""


def step_control(
    scenario: ScenarioConfig, system: System, data: Any, balance: Balance, motion: Motion
) -> StepControl | None:
    """What cuts the steps of a run, or of its replay; None where the scenario asks for no accuracy, and no servo needs it.

    Servos that are too fast for explicit steps make those of the motion implicit.

    Args:
        scenario: What is asked for.
        system: Robot and objects.
        data: Their state.
        balance: Enters what the efforts do in a step.
        motion: Motion of the system.

    Raises:
        ScenarioFaults: Something in the models breaks conservation, by which the error of a step is measured.
    """
    accuracy, parts = scenario.accuracy, MOST_PARTS
    if has_servos(system.mj):
        mechanical, fastest = StiffActuators(system.mj, data, motion.response).fastest()
        of_step = scenario.time_step_s * mechanical
        if of_step > STIFF_STEP:  # activations are known functions of the time, or no part of Newton's matrix
            motion.make_implicit()
            parts = max(parts, min(_MOST_IMPLICIT_PARTS, round(_TRANSIENT_PARTS * of_step)))
        of_step = scenario.time_step_s * max(mechanical, fastest)
        # Where no balance can tell the error, steps are as long as the scenario says.
        if accuracy is None and of_step > RESOLVED_STEP and not system.faults:
            accuracy = _OF_SERVOS
    if accuracy is None:
        return None
    if system.faults:
        why = f"nothing is conserved that could tell the error of a step ({system.faults[0]}); leave accuracy out"
        raise ScenarioFaults([Fault(why, ("accuracy",))])
    # The checks judge the sum of the errors of so many steps, whatever their length.
    steps = float(DRIFT_WINDOW_STEPS)
    if scenario.accuracy is None:
        steps = min(steps, scenario.duration_s / scenario.time_step_s)
    budget = _SHARE * accuracy / steps
    least = _ROUNDING if motion.stiff is not None else 0.0
    return StepControl(budget, scenario.time_step_s, StepError(system, data, balance), parts, least)


def spring_lines(scenario: ScenarioConfig, system: System, data: Any) -> list[str]:
    """Lines of ``ffsm check`` on springs and dampers; none if there are none.

    Args:
        scenario: What is asked for.
        system: Robot and objects.
        data: Their state.
    """
    mode, decay = _fastest(system, data)
    lines, h = [], scenario.time_step_s
    if mode.rate > 0.0:
        loss = (h * mode.rate) ** 6 / 72.0
        lines.append(
            f"  joint springs: fastest mode {mode.rate:.4g} rad/s ({mode.rate / (2.0 * math.pi):.4g} Hz), mostly of joint "
            f"{_joint(system, mode)!r}; steps up to {rounded_down(MODE_STEP / mode.rate):g} s; "
            f"RK4 takes {loss:.1e} of its energy per step"
        )
    if decay.rate > 0.0:
        lines.append(
            f"  joint dampers: fastest decay {decay.rate:.4g} 1/s, mostly of joint {_joint(system, decay)!r}; "
            f"steps up to {rounded_down(DAMPER_STEP / decay.rate):g} s"
        )
    return lines


def refuse_coarse_steps(scenario: ScenarioConfig, system: System, data: Any) -> None:
    """Refuse a time step that does not resolve the springs and dampers, unless ``accuracy`` divides steps.

    Args:
        scenario: What is asked for.
        system: Robot and objects.
        data: Their state.

    Raises:
        ScenarioFaults: The step is too long at this state; path ``time_step_s``.
    """
    if scenario.accuracy is not None or has_servos(system.mj):  # with servos step-size control sees to it
        return
    h = scenario.time_step_s
    mode, decay = _fastest(system, data)
    with Faults() as faults:
        for slowest, limit, what in (
            (mode, MODE_STEP, f"the spring of joint {{}} has a mode of {mode.rate:.4g} rad/s, h w ="),
            (decay, DAMPER_STEP, f"the damper of joint {{}} has a decay rate of {decay.rate:.4g} 1/s, h d / I ="),
        ):
            if h * slowest.rate > limit:
                text = f"{what.format(repr(_joint(system, slowest)))} {h * slowest.rate:.3g}, more than {limit:g}"
                most = rounded_down(limit / slowest.rate)
                faults.add(f"{text}; use at most {most:g}, or set 'accuracy'", "time_step_s")


def _fastest(system: System, data: Any) -> tuple[FastestMode, FastestMode]:
    """Fastest oscillation of the springs and fastest decay of the dampers at a state."""
    return JointSprings(system.mj).fastest(system.mj, data)


def _joint(system: System, mode: FastestMode) -> str:
    return next(joint.name for joint in system.joints.values() if joint.dofs.start <= mode.dof < joint.dofs.stop)


def rounded_down(value: float) -> float:
    """Round a positive number down to three digits."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 2)
    return float(f"{math.floor(value / unit) * unit:.3g}")


def contact_models_of(
    scenario: ScenarioConfig,
    scene: Scene,
    motion: Motion,
    pairs: tuple[ContactPair, ...],
    limits: tuple[JointLimit, ...],
    grasped_systems: Mapping[str, GraspedSystem],
    fields: ExternalFields | None,
) -> tuple[Source, ...]:
    """All contact models of a scenario, in the order in which simultaneous events are applied.

    Args:
        scenario: Scenario of the run.
        scene: The logged system and its data.
        motion: Its motion.
        pairs: Impact pairs.
        limits: Joint limits.
        grasped_systems: Systems with grasped objects, by the name of the grasp.
        fields: External fields; None: there are none.

    Raises:
        ScenarioFaults: A declared model cannot be created from its configuration.
    """
    overlap, heat = DeepestOverlap(limits), FrictionHeat()
    persistent = PersistentContactModel(scene, (*pairs, *limits), overlap, heat)
    impacts = ImpactModel(scene, (*pairs, *limits), _rules(scenario), persistent, overlap, heat)
    declared = _declared(scenario, scene)
    outside = () if fields is None else (fields,)
    pushing: list[ForceSource] = [*outside, *(model for model in declared if isinstance(model, ForceSource))]
    others = [persistent, *pushing]
    on = friction_coordinates(scene.system)
    friction = None
    if on is not None:
        from ffsm_mj.contact_models.joint_friction.model import JointFriction  # few scenes need it

        friction = JointFriction(scene, on, persistent, pushing)
    loops, grasps = grasp_models_of(scenario, scene, motion, grasped_systems, others, friction)
    return tuple(model for model in (*outside, impacts, friction, loops, persistent, grasps, *declared) if model is not None)


def _rules(scenario: ScenarioConfig) -> ImpactRules:
    interval = scenario.impact.rest_interval_s
    return ImpactRules(
        law=scenario.impact.law,
        rest=RestRule(scenario.time_step_s if interval is None else interval, scenario.impact.rest_speed_m_s),
        max_impacts=scenario.impact.max_impacts,
        stop_on_impact=scenario.stop_on_impact,
    )


def _declared(scenario: ScenarioConfig, scene: Scene) -> tuple[ContactModel, ...]:
    """The contact models that a scenario declares, in its order.

    Raises:
        ScenarioFaults: A model cannot be created from its configuration, e.g. for an unknown geom.
    """
    models: list[ContactModel] = []
    with Faults() as faults:
        for i, config in enumerate(scenario.contact_models):
            with faults.below("contact_models", i):
                models.append(contact_model_of(config.kind)(config, scene))
    return tuple(models)


def external_fields(scenario: ScenarioConfig, scene: Scene) -> ExternalFields | None:
    """The external fields of a scenario, with the columns of its orbit; None: there are none.

    Raises:
        ScenarioFaults: A field cannot be created from its configuration, or the models do not fit an orbit.
    """
    around, acting, magnetorquers = scenario.environment, list[Field](), scene.system.magnetorquers
    if around is None or (not around.fields and around.orbit is None and not magnetorquers):
        return None
    bodies = bodies_of(scene.system)
    with Faults() as faults:
        for i, config in enumerate(around.fields):
            with faults.below("environment", "fields", i):
                acting.append(field_of(config.kind)(config, bodies))
        if around.orbit is not None:
            for text in _unfit_for_orbit(scene.system, around):
                faults.add(text, "environment", "orbit")
        for one in magnetorquers:
            actuator = scene.system.index("actuator", one.name)
            if scene.system.actuator_trees[actuator] < 0:
                faults.add("is a site of a body that does not move", "actuators", one.name, "site")
    orbit = orbit_of(around)
    magnetic = None
    if around.magnetic_field is not None and magnetorquers:
        magnetic = magnetic_field_of(around.magnetic_field, orbit, around.epoch)
    if orbit is None:
        return ExternalFields(scene, acting, magnetic=magnetic)
    tide = orbit.field()
    fields = ExternalFields(scene, acting, tide, magnetic=magnetic)
    fields.columns = (*fields.columns, orbit_columns(tide, fields))
    return fields


def surroundings_of(around: EnvironmentConfig | None, fields: ExternalFields | None) -> Surroundings:
    """What the sensors of a scenario know of its surroundings."""
    if around is None:
        return Surroundings()
    orbit = orbit_of(around)
    magnetic = magnetic_field_of(around.magnetic_field, orbit, around.epoch) if around.magnetic_field is not None else None
    return Surroundings(orbit, () if fields is None else fields.acting, magnetic)


def environment_metadata(scenario: ScenarioConfig) -> dict[str, str]:
    """Metadata of the orbit of a scenario."""
    around = scenario.environment
    if around is None:
        return {}
    orbit = orbit_of(around)
    pushed = around.fields or any(actuator.kind == "magnetorquer" for actuator in scenario.actuators.values())
    alone = orbit is not None and orbit.is_circular and not pushed
    return orbit_metadata(orbit.spin.tolist() if orbit is not None and alone else None, around.epoch)


_IN_PLANE = (True, True, False, False, False, True)
"""Components of (P, L) that joints of a base leave free in the plane x-y."""


def _unfit_for_orbit(system: System, around: EnvironmentConfig) -> Iterator[str]:
    """Why the models of a scene cannot be in orbit."""
    if np.any(system.mj.opt.gravity):
        yield "the models have a uniform gravity beside it; set it to 0 in the files, or write 'conservative: true'"
    oblate = around.orbit is not None and around.orbit.j2
    for tree in system.trees:
        free = tuple(map(bool, free_components(system, tree)))
        planar = free == _IN_PLANE and around.world_axes == "hill" and not oblate
        if not all(free) and not planar:
            yield (
                f"the field moves the base of {tree.name!r} out of its joints: give it a free joint, or with "
                "'world_axes: hill' and without J2 joints in the plane x-y"
            )


def record_kinds(
    scenario: ScenarioConfig, constraints: Sequence[UnilateralConstraint], sources: Sequence[Source]
) -> tuple[str, ...]:
    """Names of the kinds of records of friction, joint limits, delays, grasps, dry friction and declared contact models."""
    limits = any(constraint.is_limit for constraint in constraints)
    kinds = [
        *(FRICTION_KINDS if any(constraint.mu > 0.0 for constraint in constraints) else ()),
        *((LIMIT_IMPACT, *LIMIT_KINDS) if limits else ()),
        *((EFFORT_CHANGE,) if any(isinstance(source, DelayedControl) for source in sources) else ()),
        *(KINDS if scenario.grasps else ()),
        *((STICK_SLIP,) if any(STICK_SLIP in getattr(source, "records", ()) for source in sources) else ()),
        *(kind for declared in scenario.contact_models for kind in record_kinds_of(declared.kind)),
    ]
    return tuple(dict.fromkeys(kind.name for kind in kinds))


def build_plant(
    scenario: ScenarioConfig,
    system: System,
    data: Any,
    pairs: tuple[ContactPair, ...],
    limits: tuple[JointLimit, ...],
    grasped_systems: Mapping[str, GraspedSystem],
    task: Task | None,
) -> Plant:
    """Build the simulated system of a scenario; :func:`start_contacts` must follow at the state from which it starts.

    Args:
        scenario: Scenario of the run.
        system: Robot and objects; the plant writes the time step of its model.
        data: Their state, derived quantities current.
        pairs: Impact pairs.
        limits: Joint limits.
        grasped_systems: Systems with grasped objects, by the name of the grasp.
        task: Task of the scenario; None if it has none.

    Raises:
        ScenarioFaults: A contact model or an actuator does not fit the system, or no accuracy can be measured.
    """
    scene, motion = Scene(system, data), Motion(system.mj, data, actuator_power(system, system.mj, data))
    actuation = Actuation(system, scenario.actuators, data, scenario.initial.activations)
    control = _delayed_control(scenario, scene, actuation)
    fields = external_fields(scenario, scene)
    models = contact_models_of(scenario, scene, motion, pairs, limits, grasped_systems, fields)
    integrator = EventDrivenIntegrator(motion, (*models, control) if control is not None else models)
    power = motion.power
    work, outside = (None, None) if power is None else (power.work, power.outside)
    impulse = None if outside is None else outside.impulse
    balance = Balance(
        system,
        data,
        motion.momentum,
        actuator_work=work,
        actuator_impulse=impulse,
        field_done=None if fields is None else fields.done,
    )
    integrator.control = step_control(scenario, system, data, balance, motion)
    tip = (task.tip_site, task.axes, task.motion) if task is not None else (None,)
    state = StateSignals(system, data, *tip)
    sampler = _sampler(scenario, scene, integrator, pairs, surroundings_of(scenario.environment, fields))
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
    system, stated = scene.system, {name: config.delay_s for name, config in scenario.actuators.items()}
    by_actuator = {system.resolve("actuator", name): delay for name, delay in stated.items()}
    for i in np.flatnonzero(further_inputs(system.mj)).tolist():
        by_actuator.setdefault(actuation.names[i], by_actuator.get(actuation.names[controller_of(system.mj, i)]))
    delays = command_delays_s(actuation.names, system.actuator_delays_s, scenario.actuation.delay_s, by_actuator)
    timing = ControlTiming(delays, scenario.actuation.control_jitter_s, scenario.control_period_s, scenario.seed)
    return None if timing.is_ideal else DelayedControl(timing, scene, actuation)


def _sampler(
    scenario: ScenarioConfig,
    scene: Scene,
    integrator: EventDrivenIntegrator,
    pairs: tuple[ContactPair, ...],
    surroundings: Surroundings,
) -> SensorSampler | None:
    """Sensors of the models; None: there are none.

    Raises:
        ScenarioFaults: A key of ``sensors`` does not fit them.
    """
    timing = scenario.control_period_s, scenario.duration_s
    sensors = sensors_of(scene.system, scenario.sensors, *timing, surroundings.inertial)
    if not sensors:
        return None
    from ffsm_mj.sensing.sampler import SensorSampler

    return SensorSampler(
        sensors,
        scene.system,
        scene.data,
        lambda: integrator.motion,
        integrator.wrenches,
        integrator.contacts,
        surroundings,
        seed=scenario.seed,
        time_step_s=scenario.time_step_s,
        bodies_of={pair.name: (pair.body_a, pair.body_b) for pair in pairs},
    )
