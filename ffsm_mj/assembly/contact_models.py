"""Contact models of a run: impact, persistent contact, then those that the scenario declares."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ffsm_mj.assembly.grasps import GraspedSystem, grasp_models_of
from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.contact.pairs import ContactPair, UnilateralConstraint
from ffsm_mj.contact_models.grasp.records import KINDS
from ffsm_mj.contact_models.impact.columns import DeepestOverlap, FrictionHeat
from ffsm_mj.contact_models.impact.model import ImpactModel, ImpactRules
from ffsm_mj.contact_models.impact.records import LIMIT_IMPACT
from ffsm_mj.contact_models.impact.rest_rule import RestRule
from ffsm_mj.contact_models.interface import ContactModel, ForceSource, Scene, Source
from ffsm_mj.contact_models.joint_friction.coordinates import friction_coordinates
from ffsm_mj.contact_models.joint_friction.model import JointFriction
from ffsm_mj.contact_models.joint_friction.record import STICK_SLIP
from ffsm_mj.contact_models.persistent.model import PersistentContactModel
from ffsm_mj.contact_models.persistent.record import FRICTION_KINDS, LIMIT_KINDS
from ffsm_mj.contact_models.registry import contact_model_of, record_kinds_of
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.errors import Fault, ScenarioFaults
from ffsm_mj.records.run_kinds import EFFORT_CHANGE
from ffsm_mj.scenario.scenario import ScenarioConfig
from ffsm_mj.simulation.control_timing import DelayedControl


def contact_models_of(
    scenario: ScenarioConfig,
    scene: Scene,
    motion: Motion,
    pairs: tuple[ContactPair, ...],
    limits: tuple[JointLimit, ...],
    held: Mapping[str, GraspedSystem],
) -> tuple[Source, ...]:
    """All contact models of a scenario, in the order in which simultaneous events are applied.

    Args:
        scenario: Scenario of the run.
        scene: The logged system and its data.
        motion: Its motion.
        pairs: Impact pairs.
        limits: Joint limits.
        held: Systems with grasped objects, by the name of the grasp.

    Raises:
        ScenarioFaults: A declared model cannot be created from its configuration.
    """
    overlap, heat = DeepestOverlap(limits), FrictionHeat()
    persistent = PersistentContactModel(scene, (*pairs, *limits), overlap, heat)
    impacts = ImpactModel(scene, (*pairs, *limits), _rules(scenario), persistent, overlap, heat)
    declared = _declared(scenario, scene)
    pushing = [each for each in declared if isinstance(each, ForceSource)]
    others = [persistent, *pushing]
    on = friction_coordinates(scene.system)
    friction = JointFriction(scene, on, persistent, pushing) if on is not None else None
    loops, grasps = grasp_models_of(scenario, scene, motion, held, others, friction)
    return tuple(each for each in (impacts, friction, loops, persistent, grasps, *declared) if each is not None)


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
    made: list[ContactModel] = []
    faults: list[Fault] = []
    for i, config in enumerate(scenario.contact_models):
        try:
            made.append(contact_model_of(config.kind)(config, scene))
        except ScenarioFaults as error:
            faults += [Fault(fault.message, ("contact_models", i, *fault.path)) for fault in error.faults]
        except LookupError as error:
            faults.append(Fault(str(error.args[0]), ("contact_models", i)))
    if faults:
        raise ScenarioFaults(faults)
    return tuple(made)


def record_kinds(
    scenario: ScenarioConfig, constraints: Sequence[UnilateralConstraint], sources: Sequence[Source]
) -> tuple[str, ...]:
    """Names of the kinds of records of friction, joint limits, delays, grasps, dry friction and declared contact models."""
    limits = any(isinstance(each, JointLimit) for each in constraints)
    kinds = [
        *(FRICTION_KINDS if any(each.mu > 0.0 for each in constraints) else ()),
        *((LIMIT_IMPACT, *LIMIT_KINDS) if limits else ()),
        *((EFFORT_CHANGE,) if any(isinstance(each, DelayedControl) for each in sources) else ()),
        *(KINDS if scenario.grasps else ()),
        *((STICK_SLIP,) if any(isinstance(each, JointFriction) for each in sources) else ()),
        *(kind for each in scenario.contact_models for kind in record_kinds_of(each.kind)),
    ]
    return tuple(dict.fromkeys(kind.name for kind in kinds))
