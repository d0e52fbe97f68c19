"""Builds the components of a run from a scenario: model, initial state, contacts, actuator limits, controllers.

The size of a run is estimated before it starts, so that a run that does not fit is refused.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from ffsm_controllers.phases import Phase, PhaseMachine
from ffsm_mj.actuation.actuation import Actuation
from ffsm_mj.assembly.contact_rules import Contacts, refuse_undetectable, resolve_contacts
from ffsm_mj.assembly.control_laws import build_phases, refuse_same_names, refuse_start, task_of
from ffsm_mj.assembly.controller_model import ControllerModel, ControllerModelPhaseMachine
from ffsm_mj.assembly.estimation import EstimatePhaseMachine, make_estimator
from ffsm_mj.assembly.grasps import GraspedSystem
from ffsm_mj.assembly.initial_state import initial_state
from ffsm_mj.assembly.joint_limits import joint_limits, refuse_outside
from ffsm_mj.assembly.plant import build_plant, refuse_coarse_steps, start_contacts
from ffsm_mj.assembly.recorded_files import RecordedFiles, resolved_yaml
from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact_models.grasp.model import GraspModel
from ffsm_mj.contact_models.interface import Source
from ffsm_mj.controller_protocol import ControllerContext, Task
from ffsm_mj.errors import Fault, Faults, InputError, ScenarioFaults, unknown_name
from ffsm_mj.model.properties import PropertyChange
from ffsm_mj.model.system import System
from ffsm_mj.records.columns import Row
from ffsm_mj.scenario.scenario import ScenarioConfig
from ffsm_mj.scenario.source import YamlSource
from ffsm_mj.simulation.orbit import orbit_of
from ffsm_mj.simulation.plant import Plant
from ffsm_mj.simulation.progress import Start
from ffsm_mj.simulation.wall_clock import WallClock

_RECORD_BYTES = 100
"""Upper bound of the overhead per sample in the log, bytes."""
_PLENTY = 1 << 62
_BEST_COMPRESSION = 5
"""Least compression ratio; logs shrink to a half to a fifth of their size."""


@dataclass(frozen=True, eq=False)
class CompiledScenario:
    """A scenario with its models compiled: what a run is assembled from.

    Attributes:
        scenario: The validated scenario.
        source: Where each of its keys stands.
        system: Robot and objects.
        laws: Control laws of a script, classes by kind, beside those that are installed.
        controller_system: System of the controller model; None: control laws know the plant.
        grasped_systems: The systems in which grasps hold, by the names of these.
        estimators: Estimators of a script, classes by kind, beside those that are installed.
        recorded: Files that the control laws name.
        start: Finds the state at which the run begins, by simulating where that is needed; None: it begins at t = 0.
        before: Files of the run that it goes on from, contents by name.
    """

    scenario: ScenarioConfig
    source: YamlSource
    system: System
    laws: Mapping[str, Any]
    controller_system: System | None = None
    grasped_systems: Mapping[str, GraspedSystem] = field(default_factory=dict)
    estimators: Mapping[str, Any] = field(default_factory=dict)
    recorded: RecordedFiles = field(default_factory=RecordedFiles)
    start: Callable[[], Start] | None = None
    before: Mapping[str, bytes] = field(default_factory=dict)

    @property
    def changes(self) -> tuple[PropertyChange, ...]:
        """Properties of bodies and geoms that the scenario gives, as compiled, then those only of its controller model."""
        known = {change.path for change in self.system.changes}
        others = self.controller_system.changes if self.controller_system is not None else ()
        return (*self.system.changes, *(change for change in others if change.path not in known))

    @cached_property
    def scenario_yaml(self) -> str:
        """The scenario with every default written out, as logs keep it."""
        return resolved_yaml(self.scenario, self.system, self.recorded)

    @property
    def logged_files(self) -> dict[str, bytes]:
        """Contents of the files of models and control laws, by their names in run folder and log."""
        return self.system.logged_files | dict(self.recorded.contents) | dict(self.before)

    def assemble(self) -> Assembly:
        """New components of one run, with copies of the models: the run writes their time step.

        Raises:
            InputError: One line per fault, with the place in the scenario or the model.
        """
        controller_system = self.controller_system.copy() if self.controller_system is not None else None
        grasped_systems = {name: grasped.copy() for name, grasped in self.grasped_systems.items()}
        copied = {field.name: getattr(self, field.name) for field in fields(CompiledScenario)}
        copied |= {"system": self.system.copy(), "controller_system": controller_system, "grasped_systems": grasped_systems}
        with self.source.locating():
            return _assembled(CompiledScenario(**copied))


@dataclass(frozen=True)
class Assembly:
    """Components of one run, checked for consistency.

    Attributes:
        compiled: Scenario of the run, with models of its own.
        plant: The simulated system at its initial state, all derived quantities current.
        controller_data: MuJoCo data that control laws see: that of the plant or of the controller model.
        contacts: Contact rules, with their pairs.
        limits: Joint limits.
        known_pairs: Geom pairs that need no watching: those of the contact models, and ignored ones.
        controller: The phase machine.
        task: The tip's task, if any.
        row: Columns of all components.
        start_notes: Notes on the initial state, one line each.
        clock: Paces control ticks; None: they do not wait.
    """

    compiled: CompiledScenario
    plant: Plant
    controller_data: Any
    contacts: Contacts
    limits: tuple[JointLimit, ...]
    known_pairs: frozenset[frozenset[int]]
    controller: PhaseMachine
    task: Task | None
    row: Row
    start_notes: tuple[str, ...] = ()
    clock: WallClock | None = None

    @property
    def scenario(self) -> ScenarioConfig:
        """Scenario of the run."""
        return self.compiled.scenario

    @property
    def grasped_systems(self) -> Mapping[str, GraspedSystem]:
        """The systems in which grasps hold, by the names of these."""
        return self.compiled.grasped_systems

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


def _assembled(compiled: CompiledScenario) -> Assembly:
    """Build the components of one run, which owns the models.

    Raises:
        ScenarioFaults: Something in the scenario does not fit.
        InputError: Something in a model does not.
    """
    scenario, system, grasped_systems, controller_system = (
        compiled.scenario,
        compiled.system,
        compiled.grasped_systems,
        compiled.controller_system,
    )
    data, _, start_notes = initial_state(scenario, system)
    refuse_coarse_steps(scenario, system, data)
    contacts = resolve_contacts(scenario.contacts, system)
    refuse_undetectable(system, data, contacts)
    _refuse_endless(scenario, contacts)
    limits = joint_limits(scenario, system)
    refuse_outside(scenario, system, data, limits)
    task = task_of(scenario, system)
    plant = build_plant(scenario, system, data, contacts.pairs, limits, grasped_systems, task)
    start_contacts(plant)
    contexts = _contexts(scenario, controller_system or system, plant, grasped_systems)
    grasped = {name: context for name, context in contexts.items() if name}
    phases = build_phases(scenario, contexts[""], compiled.laws, grasped, compiled.recorded)
    controller_model = ControllerModel(controller_system, data, system) if controller_system is not None else None
    controller = _phase_machine(scenario, phases, contexts, controller_model, plant, grasped_systems, compiled.estimators)
    controller_data = data if controller_model is None else controller_model.data
    refuse_start(phases[0], scenario.phases[0], controller_data)
    paced = scenario.realtime
    clock = WallClock(paced.factor, paced.max_late_s, scenario.control_period_s) if paced is not None else None
    columns = [*plant.columns, *controller.columns, *((clock.columns,) if clock is not None else ())]
    refuse_same_names(columns, system)
    row = Row(columns)
    if fault := _too_large(scenario.ticks, len(row.layout.signals), scenario.log.max_size_GB):
        raise ScenarioFaults([Fault(fault, ("duration_s",))])
    known = contacts.ignored.union(*(contact_model.watched for contact_model in plant.integrator.sources))
    return Assembly(compiled, plant, controller_data, contacts, limits, known, controller, task, row, start_notes, clock)


def _phase_machine(
    scenario: ScenarioConfig,
    phases: Sequence[Phase],
    contexts: Mapping[str, ControllerContext],
    controller_model: ControllerModel | None,
    plant: Plant,
    grasped_systems: Mapping[str, GraspedSystem],
    estimators: Mapping[str, Any],
) -> PhaseMachine:
    """The phases, with control laws that see the plant, a controller model at its state, or an estimate."""
    if controller_model is None:
        return PhaseMachine(phases)
    grasped = _grasped_models(plant.integrator.sources, grasped_systems)
    if scenario.estimator.kind != "truth" and scenario.has_rigid_laws:
        text = "an estimator estimates the joints of the plant: write 'controller_joints: flexible', or leave joint_flex out"
        raise ScenarioFaults([Fault(text, ("robot", "joint_flex"))])
    if scenario.estimator.kind == "truth":
        return ControllerModelPhaseMachine(phases, controller_model, grasped)
    systems = {name: one.controller_system for name, one in grasped_systems.items() if one.controller_system is not None}
    fields = {name: field for name in systems if (field := contexts[name].external_field) is not None}
    context = replace(contexts[""], grasped=systems, grasped_fields=fields)
    estimator = make_estimator(scenario.estimator, context, estimators)
    models = {name: (system, grasped[name]) for name, system in systems.items()}
    return EstimatePhaseMachine(phases, estimator, scenario.estimator.kind, context.system, controller_model, models)


def _refuse_endless(scenario: ScenarioConfig, contacts: Contacts) -> None:
    """Refuse phases and grasps that wait for an event that cannot occur.

    Raises:
        ScenarioFaults: There is one.
    """
    with Faults() as faults:
        for i, phase in enumerate(scenario.phases):
            for end in phase.ends:
                if end.event == "impact" and not contacts.pairs:
                    faults.add("no impact can end it: no two geoms have a contact rule", "phases", i, *end.keys)
                if end.event in ("contact_slips", "contact_sticks") and not any(pair.mu > 0.0 for pair in contacts.pairs):
                    faults.add("nothing slips or sticks: no contact rule has friction, mu > 0", "phases", i, *end.keys)
        names = [*(rule.name for rule in contacts.rules), *(pair.name for pair in contacts.pairs)]
        for name, grasp in scenario.grasps.items():
            for k, touched in enumerate(grasp.when.touch or ()):
                if touched not in names:
                    faults.add(unknown_name("contact rule or pair", touched, names), "grasps", name, "when", "touch", k)


def _contexts(
    scenario: ScenarioConfig, system: System, plant: Plant, grasped_systems: Mapping[str, GraspedSystem]
) -> dict[str, ControllerContext]:
    """What control laws are made for: in the scene (empty name), and while an object is grasped, by the grasp's name."""
    systems = {"": system} | {name: grasped.controller_system or grasped.system for name, grasped in grasped_systems.items()}
    return {
        name: ControllerContext(
            grasped,
            task_of(scenario, grasped),
            scenario.control_period_s,
            limits=plant.actuation.envelope,
            sensors=plant.sampler.by_name if plant.sampler is not None else {},
            external_field=plant.fields_in(grasped),
            orbit=orbit_of(scenario.environment),
        )
        for name, grasped in systems.items()
    }


def _grasped_models(sources: Sequence[Source], grasped_systems: Mapping[str, GraspedSystem]) -> dict[str, ControllerModel]:
    """Controller models while an object is grasped, by the name of the grasp."""
    return {
        name: ControllerModel(one.controller_system, source.data_of(name), one.system, grasped=True)
        for source in sources
        if isinstance(source, GraspModel)
        for name, one in grasped_systems.items()
        if one.controller_system is not None
    }


def logged_bytes(ticks: int, columns: int) -> int:
    """Size of all samples before compression: a double and its tag per column."""
    return ticks * (9 * columns + _RECORD_BYTES)


def _too_large(ticks: int, columns: int, limit_GB: float) -> str:
    """Message if the samples exceed a limit; empty if they do not."""
    size = logged_bytes(ticks, columns) / 1e9
    if size <= limit_GB:
        return ""
    return (
        f"{ticks} control periods of {columns} columns are {size:.3g} GB before compression, more than log.max_size_GB "
        f"({limit_GB:g}); shorten the run, lengthen control_period_s or raise that"
    )


def refuse_without_room(ticks: int, columns: int, folder: Path | None) -> None:
    """Check that a run fits on the disk or in memory.

    Args:
        ticks: Control ticks.
        columns: Of a sample.
        folder: The run folder, which need not exist yet; None for a run that is kept in memory.

    Raises:
        InputError: It does not fit, even with the best compression.
    """
    if folder is not None:
        need, room = logged_bytes(ticks, columns) // _BEST_COMPRESSION, _free(folder)
        if need > room:
            raise InputError(f"{folder}: the run takes {need / 1e9:.3g} GB at least, {room / 1e9:.3g} GB are free")
        return
    need, room = 8 * ticks * columns, _memory()
    if need > room:
        raise InputError(
            f"the run takes {need / 1e9:.3g} GB of memory, this machine has {room / 1e9:.3g} GB; give it a folder (out=...)"
        )


def _free(folder: Path) -> int:
    """Free space at a folder that need not exist yet, bytes; if unknown, more than any run needs."""
    try:
        there = next(path for path in (folder.absolute(), *folder.absolute().parents) if path.is_dir())
        return shutil.disk_usage(there).free
    except OSError:
        return _PLENTY


def _memory() -> int:
    """Memory of this machine, bytes; if unknown, more than any run needs."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return _PLENTY
