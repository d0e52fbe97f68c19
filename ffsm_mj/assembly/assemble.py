"""Builds the components of a run from a scenario: model, initial state, contacts, actuator limits, controllers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

from ffsm_controllers.phases import Phase, PhaseMachine
from ffsm_mj.actuation.actuation import Actuation
from ffsm_mj.assembly.column_faults import refuse_same_names
from ffsm_mj.assembly.contact_rules import Contacts, resolve_contacts
from ffsm_mj.assembly.contact_start import refuse_undetectable
from ffsm_mj.assembly.control_laws import build_phases, refuse_start
from ffsm_mj.assembly.controller_model import ControllerModel, ControllerModelPhaseMachine
from ffsm_mj.assembly.estimation import EstimatePhaseMachine, make_estimator
from ffsm_mj.assembly.grasps import GraspedSystem
from ffsm_mj.assembly.initial_state import initial_state
from ffsm_mj.assembly.joint_limits import joint_limits, refuse_outside
from ffsm_mj.assembly.models import changes_of
from ffsm_mj.assembly.plant import build_plant, start_contacts
from ffsm_mj.assembly.recorded_files import RecordedFiles
from ffsm_mj.assembly.run_size import too_large
from ffsm_mj.assembly.spring_modes import refuse_coarse_steps
from ffsm_mj.assembly.task import task_of
from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact_models.grasp.model import GraspModel
from ffsm_mj.contact_models.interface import Source
from ffsm_mj.controller_protocol import ControllerContext, Task
from ffsm_mj.errors import Fault, ScenarioFaults, unknown_name
from ffsm_mj.model.properties import PropertyChange
from ffsm_mj.model.system import System
from ffsm_mj.records.columns import Row
from ffsm_mj.scenario.scenario import ScenarioConfig, located
from ffsm_mj.scenario.source import YamlSource
from ffsm_mj.simulation.plant import Plant
from ffsm_mj.simulation.progress import Start


@dataclass(frozen=True)
class Assembly:
    """Components of one run, checked for consistency.

    Attributes:
        scenario: Scenario of the run.
        plant: The simulated system at its initial state, all derived quantities current.
        controller_data: MuJoCo data that control laws see: that of the plant or of the controller model.
        controller_system: System of the controller model; None: control laws know the plant.
        contacts: Contact rules, with their pairs.
        limits: Joint limits.
        known_pairs: Geom pairs that need no watching: those of the contact models, and ignored ones.
        controller: The phase machine.
        task: The tip's task, if any.
        row: Columns of all components.
        recorded: Files that the control laws name.
        start: Finds the state at which the run begins, by simulating where that is needed; None: it begins at t = 0.
        before: Files of the run that it goes on from, contents by name.
        held: The systems in which grasps hold, by the names of these.
        start_notes: Notes on the initial state, one line each.
    """

    scenario: ScenarioConfig
    plant: Plant
    controller_data: Any
    controller_system: System | None
    contacts: Contacts
    limits: tuple[JointLimit, ...]
    known_pairs: frozenset[frozenset[int]]
    controller: PhaseMachine
    task: Task | None
    row: Row
    recorded: RecordedFiles = field(default_factory=RecordedFiles)
    start: Callable[[], Start] | None = None
    before: Mapping[str, bytes] = field(default_factory=dict)
    held: Mapping[str, GraspedSystem] = field(default_factory=dict)
    start_notes: tuple[str, ...] = ()

    @property
    def logged_files(self) -> dict[str, bytes]:
        """Contents of all files of the run by their names in run folder and log."""
        return self.system.logged_files | dict(self.recorded.contents) | dict(self.before)

    @property
    def system(self) -> System:
        """Robot and objects."""
        return self.plant.system

    @property
    def data(self) -> Any:
        """State of the plant."""
        return self.plant.data

    @property
    def pairs(self) -> tuple[ContactPair, ...]:
        """Pairs of geoms whose contacts are resolved."""
        return self.contacts.pairs

    @property
    def actuation(self) -> Actuation:
        """Actuator limits."""
        return self.plant.actuation

    @property
    def changes(self) -> tuple[PropertyChange, ...]:
        """Properties of bodies and geoms that the scenario sets, then those of its controller models."""
        return changes_of(self.system, self.controller_system)


def assemble(
    scenario: ScenarioConfig,
    source: YamlSource,
    system: System,
    laws: Mapping[str, Any],
    controller_system: System | None = None,
    held: Mapping[str, GraspedSystem] = MappingProxyType({}),
    *,
    estimators: Mapping[str, Any] = MappingProxyType({}),
    recorded: RecordedFiles | None = None,
    start: Callable[[], Start] | None = None,
    before: Mapping[str, bytes] = MappingProxyType({}),
) -> Assembly:
    """Build the components of one run.

    Args:
        scenario: What is asked for.
        source: Where each of its keys stands.
        system: Robot and objects, with a model that is the run's own: the run writes its time step.
        laws: Control laws of a script, classes by kind, beside those that are installed.
        controller_system: System of the controller model, likewise the run's own; None: control laws know the plant.
        held: The systems in which grasps hold, likewise the run's own, by the names of these.
        estimators: Estimators of a script, classes by kind, beside those that are installed.
        recorded: Files that the control laws name; None: they name none.
        start: See :class:`Assembly`.
        before: See :class:`Assembly`.

    Raises:
        InputError: One line per fault, with the place in the scenario or the model.
    """
    recorded = recorded or RecordedFiles()
    try:
        data, start_notes = initial_state(scenario, system)
        refuse_coarse_steps(scenario, system, data)
        contacts = resolve_contacts(scenario.contacts, system)
        refuse_undetectable(system, data, contacts)
        _refuse_endless(scenario, contacts)
        limits = joint_limits(scenario, system)
        refuse_outside(scenario, system, data, limits)
        task = task_of(scenario, system)
        plant = build_plant(scenario, system, data, contacts.pairs, limits, held, task)
        start_contacts(plant)
        contexts = _contexts(scenario, controller_system or system, plant, held)
        grasped = {name: each for name, each in contexts.items() if name}
        phases = build_phases(scenario, contexts[""], laws, grasped, recorded)
        controller_model = ControllerModel(controller_system.mj, data, system.mj) if controller_system is not None else None
        controller = _phase_machine(scenario, phases, contexts[""], controller_model, plant, held, estimators)
        controller_data = data if controller_model is None else controller_model.data
        refuse_start(phases[0], scenario.phases[0], controller_data)
        columns = [*plant.columns, *controller.columns]
        refuse_same_names(columns, system)
        row = Row(columns)
        if fault := too_large(scenario.ticks, len(row.layout.signals), scenario.log.max_size_GB):
            raise ScenarioFaults([Fault(fault, ("duration_s",))])
    except ScenarioFaults as faults:
        raise located(faults, source) from faults
    known = contacts.ignored.union(*(contact_model.watched for contact_model in plant.integrator.sources))
    return Assembly(
        scenario,
        plant,
        controller_data,
        controller_system,
        contacts,
        limits,
        known,
        controller,
        task,
        row,
        recorded,
        start,
        before,
        held,
        start_notes,
    )


def _phase_machine(
    scenario: ScenarioConfig,
    phases: Sequence[Phase],
    context: ControllerContext,
    controller_model: ControllerModel | None,
    plant: Plant,
    held: Mapping[str, GraspedSystem],
    estimators: Mapping[str, Any],
) -> PhaseMachine:
    """The phases, with control laws that see the plant, a controller model at its state, or an estimate."""
    if controller_model is None:
        return PhaseMachine(phases)
    grasped = _grasped_models(plant.integrator.sources, held)
    if scenario.estimator.kind != "truth" and scenario.has_rigid_laws:
        text = "an estimator estimates the joints of the plant: write 'controller_joints: flexible', or leave joint_flex out"
        raise ScenarioFaults([Fault(text, ("robot", "joint_flex"))])
    if scenario.estimator.kind == "truth":
        return ControllerModelPhaseMachine(phases, controller_model, grasped)
    systems = {name: each.controller_system for name, each in held.items() if each.controller_system is not None}
    estimator = make_estimator(scenario.estimator, replace(context, grasped=systems), estimators)
    models = {name: (system, grasped[name]) for name, system in systems.items()}
    return EstimatePhaseMachine(phases, estimator, scenario.estimator.kind, context.system, controller_model, models)


def _refuse_endless(scenario: ScenarioConfig, contacts: Contacts) -> None:
    """Refuse phases and grasps that wait for an event that cannot occur.

    Raises:
        ScenarioFaults: There is one.
    """
    faults = []
    for i, phase in enumerate(scenario.phases):
        for end in phase.ends:
            keys: tuple[str | int, ...] = ("phases", i, *end.keys)
            if end.event == "impact" and not contacts.pairs:
                faults.append(Fault("no impact can end it: no two geoms have a contact rule", keys))
            if end.event in ("contact_slips", "contact_sticks") and not any(pair.mu > 0.0 for pair in contacts.pairs):
                faults.append(Fault("nothing slips or sticks: no contact rule has friction, mu > 0", keys))
    names = [*(rule.name for rule in contacts.rules), *(pair.name for pair in contacts.pairs)]
    for name, grasp in scenario.grasps.items():
        for k, touched in enumerate(grasp.when.touch or ()):
            if touched not in names:
                fault = unknown_name("contact rule or pair", touched, names)
                faults.append(Fault(fault, ("grasps", name, "when", "touch", k)))
    if faults:
        raise ScenarioFaults(faults)


def _contexts(
    scenario: ScenarioConfig, system: System, plant: Plant, held: Mapping[str, GraspedSystem]
) -> dict[str, ControllerContext]:
    """What control laws are made for: in the scene (empty name), and while an object is grasped, by the grasp's name."""
    systems = {"": system} | {name: each.controller_system or each.system for name, each in held.items()}
    return {
        name: ControllerContext(
            each,
            task_of(scenario, each),
            scenario.control_period_s,
            limits=plant.actuation.envelope,
            sensors=plant.sampler.by_name if plant.sampler is not None else {},
        )
        for name, each in systems.items()
    }


def _grasped_models(sources: Sequence[Source], held: Mapping[str, GraspedSystem]) -> dict[str, ControllerModel]:
    """Controller models while an object is grasped, by the name of the grasp."""
    return {
        name: ControllerModel(each.controller_system.mj, source.data_of(name), each.system.mj, grasped=True)
        for source in sources
        if isinstance(source, GraspModel)
        for name, each in held.items()
        if each.controller_system is not None
    }
