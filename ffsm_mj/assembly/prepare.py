"""Preparation of a scenario: read, validated and compiled once, it can be run any number of times."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ffsm_mj.assembly.assemble import Assembly, assemble
from ffsm_mj.assembly.description import describe, notes
from ffsm_mj.assembly.grasps import GraspedSystem
from ffsm_mj.assembly.models import Reader, changes_of, compile_scenario
from ffsm_mj.assembly.origin import Origin, origin_of, refuse_changes, with_initial_state
from ffsm_mj.assembly.override_faults import overrides_named
from ffsm_mj.assembly.recorded_files import RecordedFiles, recorded_files
from ffsm_mj.assembly.resolved import resolved_yaml
from ffsm_mj.assembly.run import simulate
from ffsm_mj.assembly.target_file import with_waypoints
from ffsm_mj.errors import InputError, raised_by_plugin
from ffsm_mj.log.run_folder import RunFolder
from ffsm_mj.model.files import read_model
from ffsm_mj.model.properties import PropertyChange
from ffsm_mj.model.system import System
from ffsm_mj.records.events import Outcome
from ffsm_mj.report.run import Run
from ffsm_mj.scenario.loading import load_scenario, validated
from ffsm_mj.scenario.scenario import Scenario
from ffsm_mj.scenario.shipped import scenario_path
from ffsm_mj.scenario.source import YamlSource


def run(
    scenario: str | Path,
    overrides: Sequence[str] | Mapping[str, Any] = (),
    *,
    controllers: Mapping[str, Any] = MappingProxyType({}),
    estimators: Mapping[str, Any] = MappingProxyType({}),
    out: str | Path | None = None,
    force: bool = False,
    rerun: bool | None = None,
    live: str | None = None,
    report: Callable[[float, float], None] | None = None,
    check: bool = True,
) -> Run:
    """Simulate a scenario.

    Args:
        scenario: A path, or the name of a shipped scenario.
        overrides: ``key=value`` strings as on the command line, or a mapping of dotted keys to values.
        controllers: Control laws of the caller's own, classes by the ``kind`` under which the scenario asks for them
            (:class:`ffsm_mj.controller_protocol.Controller`; a ``Config`` may be left out): no package is needed.
        estimators: Estimators of the caller's own, likewise (:class:`ffsm_mj.controller_protocol.Estimator`).
        out: Run folder to write; None keeps the run in memory only.
        force: Replace a run that ``out`` already holds.
        rerun: Write ``run.rrd`` into the folder; None: as the scenario says.
        live: ``host:port`` of a Rerun viewer to stream to; one that is missing or goes away never ends the run.
        report: Told (simulation time, duration) in s as the run goes.
        check: Raise what a control law, an estimator, a contact model or another callback raised, when the log is closed:
            the same exception with its traceback, a note on the end of the run, and the attribute ``run_folder``, a
            ``Path`` or None. If false, the run is returned, with the outcome ``controller_failed`` or ``internal_error``.

    Returns:
        The run, the same object that :func:`ffsm_mj.load_run` reads from the log.

    Raises:
        InputError: The scenario or a model is wrong, or the folder holds a run.
        Exception: With ``check``, whatever a control law, an estimator or a contact model raised.
        KeyboardInterrupt: Ctrl-C or SIGTERM, when the log is closed: a loop over runs ends.
    """
    folder = RunFolder(Path(out), force=force) if out is not None else None
    if folder is not None:
        folder.refuse_earlier_run()
    made = prepare(scenario, overrides, controllers=controllers, estimators=estimators, check=check)
    return uninterrupted(made.run(folder=folder, rerun=rerun, live=live, report=report, check=check))


def uninterrupted(finished: Run) -> Run:
    """The run, if it was not interrupted.

    Raises:
        KeyboardInterrupt: It was.
    """
    if finished.outcome == Outcome.INTERRUPTED:
        raise KeyboardInterrupt
    return finished


def prepare(
    scenario: str | Path,
    overrides: Sequence[str] | Mapping[str, Any] = (),
    *,
    controllers: Mapping[str, Any] = MappingProxyType({}),
    estimators: Mapping[str, Any] = MappingProxyType({}),
    check: bool = False,
) -> PreparedRun:
    """Read, validate and compile a scenario without running it.

    Args:
        scenario: A path, or the name of a shipped scenario.
        overrides: See :func:`run`.
        controllers: See :func:`run`.
        estimators: See :func:`run`.
        check: Raise an exception in the constructor of a control law itself, not the fault that it is.

    Raises:
        InputError: The scenario or a model is wrong.
    """
    given = as_overrides(overrides) if isinstance(overrides, Mapping) else list(overrides)

    def prepared(some: Sequence[str]) -> PreparedRun:
        config, source = load_scenario(scenario_path(scenario), some, controllers, estimators)
        made = recipe(config, source, controllers, estimators=estimators)
        made.unused.append(made.assemble())  # reports faults of the components
        return made

    try:
        with overrides_named(given, prepared):
            return prepared(given)
    except InputError as error:
        if check and (raised := raised_by_plugin(error)) is not None:
            raise raised from None
        raise


def as_overrides(values: Mapping[str, Any]) -> list[str]:
    """Values by dotted key as command-line overrides."""
    return [f"{key}={json.dumps(value)}" for key, value in values.items()]


def recipe(
    config: Scenario,
    source: YamlSource,
    controllers: Mapping[str, Any] = MappingProxyType({}),
    read: Reader = read_model,
    *,
    estimators: Mapping[str, Any] = MappingProxyType({}),
) -> PreparedRun:
    """Compile a scenario that was read; faults of its components are reported at assembly.

    Args:
        config: The scenario.
        source: Where its keys stand.
        controllers: See :func:`run`.
        read: Reads the files of a model.
        estimators: See :func:`run`.

    Raises:
        InputError: A model, a file of a control law or that of the target is wrong.
    """
    own: dict[str, Any] = {"controllers": controllers, "estimators": estimators}
    origin = origin_of(config, source, lambda file: prepare(file, **own))
    if origin is not None:
        config = with_initial_state(config, origin, source)
    system, controller_system, held = compile_scenario(config, source, read)
    config = with_waypoints(config, source)
    recorded = recorded_files(config, source)
    made = PreparedRun(
        config, source, system, dict(controllers), controller_system, held, dict(estimators), recorded, origin
    )
    if origin is not None:
        refuse_changes(origin, made)
    return made


@dataclass(frozen=True, eq=False)
class PreparedRun:
    """A prepared scenario: immutable and picklable.

    Every run uses its own copy of the models and its own components, so runs are identical bit for bit, in sequence or in
    several threads at once.

    Attributes:
        scenario: The validated scenario.
        source: Where each of its keys stands.
        system: Robot and objects; its model is copied, never run.
        laws: Control laws of a script, classes by kind.
        controller_system: System of the controller model, likewise copied; None: control laws know the plant.
        held: The systems in which captures hold, likewise copied, by the names of these.
        estimators: Estimators of a script, classes by kind.
        recorded: Files that the control laws name.
        origin: The instant of another run at which it begins; None: t = 0.
        unused: Components that were made to find their faults, and that the next run takes.
    """

    scenario: Scenario
    source: YamlSource
    system: System
    laws: Mapping[str, Any]
    controller_system: System | None = None
    held: Mapping[str, GraspedSystem] = field(default_factory=dict)
    estimators: Mapping[str, Any] = field(default_factory=dict)
    recorded: RecordedFiles = field(default_factory=RecordedFiles)
    origin: Origin | None = None
    unused: list[Assembly] = field(default_factory=list, init=False, repr=False, compare=False)

    def __getstate__(self) -> dict[str, Any]:
        """What another process needs: components are not picklable, and are made again."""
        return vars(self) | {"unused": []}

    @property
    def changes(self) -> tuple[PropertyChange, ...]:
        """Properties of bodies and geoms that the scenario gives, as compiled, then those that its laws believe in."""
        return changes_of(self.system, self.controller_system)

    @cached_property
    def scenario_yaml(self) -> str:
        """The scenario with every default written out, as logs keep it."""
        return resolved_yaml(self.scenario, self.system, self.recorded)

    @property
    def logged_files(self) -> dict[str, bytes]:
        """Contents of the files of models and control laws, by their names in run folder and log."""
        before = self.origin.files if self.origin is not None else {}
        return self.system.logged_files | dict(self.recorded.contents) | before

    def changed(self, source: YamlSource) -> PreparedRun:
        """Prepare another scenario with the same control laws and estimators of a script.

        Raises:
            InputError: One line per fault, with the place in the scenario or the model.
        """
        return recipe(validated(source, self.laws, self.estimators), source, self.laws, estimators=self.estimators)

    def assemble(self) -> Assembly:
        """New components of one run at t = 0.

        Raises:
            InputError: One line per fault, with the place in the scenario or the model.
        """
        with suppress(IndexError):  # another thread may take them
            return self.unused.pop()
        controller_system = self.controller_system.copy() if self.controller_system is not None else None
        held = {name: each.copy() for name, each in self.held.items()}
        system, laws = self.system.copy(), self.laws
        recorded = self.recorded
        return assemble(
            self.scenario,
            self.source,
            system,
            laws,
            controller_system,
            held,
            estimators=self.estimators,
            recorded=recorded,
            origin=self.origin,
        )

    def run(
        self,
        *,
        folder: RunFolder | None = None,
        rerun: bool | None = None,
        live: str | None = None,
        report: Callable[[float, float], None] | None = None,
        check: bool = False,
    ) -> Run:
        """Simulate; see :func:`run`."""
        with_rerun, assembly = self.scenario.log.rerun if rerun is None else rerun, self.assemble()
        return simulate(assembly, folder, with_rerun=with_rerun, live=live, report=report, check=check)

    def notes(self) -> list[str]:
        """What a user should know about the scenario before it runs, one line each."""
        return self._looked_at(notes)

    def describe(self) -> list[str]:
        """Lines of text that describe the run, with notes."""
        return self._looked_at(describe)

    def _looked_at(self, look: Callable[[Assembly], list[str]]) -> list[str]:
        """What some components say, which no run has meanwhile."""
        components = self.assemble()
        said = look(components)
        self.unused.append(components)
        return said
