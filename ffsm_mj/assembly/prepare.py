"""A scenario: built or read, validated, compiled once, and run any number of times, also from an instant of a logged run."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, Self, TypeAlias, cast

from pydantic import Field, PrivateAttr

from ffsm_mj.analysis.run import Run
from ffsm_mj.assembly.assemble import Assembly, CompiledScenario
from ffsm_mj.assembly.models import Reader, compile_scenario
from ffsm_mj.assembly.origin import Origin, origin_of, refuse_changes, with_initial_state
from ffsm_mj.assembly.recorded_files import recorded_files, with_waypoints
from ffsm_mj.assembly.run import simulate
from ffsm_mj.errors import InputError, ScenarioNote, raised_by_plugin
from ffsm_mj.fields.interface import Field as ExternalField
from ffsm_mj.fields.interface import register_all
from ffsm_mj.invocation import on_command_line, override
from ffsm_mj.log.run_folder import SCENARIO, RunFolder, write_scenario
from ffsm_mj.model.files import read_model
from ffsm_mj.model.properties import PropertyChange
from ffsm_mj.model.system import System
from ffsm_mj.records.events import Outcome
from ffsm_mj.scenario.loading import refuse_wrong_classes, stated_source, validated
from ffsm_mj.scenario.overrides import Overrides, as_texts
from ffsm_mj.scenario.scenario import ScenarioConfig
from ffsm_mj.scenario.shipped import scenario_path
from ffsm_mj.scenario.source import YamlSource, read_yaml

_NONE: Mapping[str, Any] = MappingProxyType({})


Classes: TypeAlias = Mapping[str, Any]
"""Control laws or estimators of a script: classes by the ``kind`` under which a scenario asks for them."""


class Scenario(ScenarioConfig):
    """What is simulated: a robot, objects, control laws by phase, contacts, sensors, and the numbers of the integration.

    Built from its keys, ``Scenario(name="...", duration_s=2.0, robot=Robot(...), phases=[...])``, or read by :meth:`load`.
    The keys are those of a scenario file; each takes its class, or a mapping as in a file. Units are in the names of the
    keys. Positions are in m and in the world frame unless a key says otherwise; quaternions are w, x, y, z. Paths are
    relative to the file that names them, in Python to the current folder.

    Immutable, comparable and picklable. Models are read and compiled once, when a method or attribute first needs them, and
    every run has its own copy of them and its own components, so that runs are identical bit for bit, in sequence, in
    threads or in other processes.

    Raises:
        InputError: One line per fault: the dotted key, what is wrong, and what is allowed.
    """

    controllers: Annotated[Classes, Field(exclude=True)] = {}
    """Control laws of the caller's own (:class:`ffsm_mj.controller_protocol.Controller`; a ``Config`` may be left out)."""
    estimators: Annotated[Classes, Field(exclude=True)] = {}
    """Estimators of the caller's own (:class:`ffsm_mj.controller_protocol.Estimator`)."""
    _base: YamlSource = PrivateAttr()
    _overrides: tuple[str, ...] = PrivateAttr()
    _config: ScenarioConfig = PrivateAttr()
    _source: YamlSource = PrivateAttr()

    if not TYPE_CHECKING:  # a type checker derives the arguments from the keys

        def __init__(self, *, controllers: Classes = _NONE, estimators: Classes = _NONE, **keys: Any) -> None:
            self._validate(stated_source(keys), (), controllers, estimators)

    @classmethod
    def load(
        cls, scenario: str | Path, overrides: Overrides = (), *, controllers: Classes = _NONE, estimators: Classes = _NONE
    ) -> Scenario:
        """Read and validate a scenario file; its models are not read yet.

        Args:
            scenario: A path, a run folder, or the name of a shipped scenario.
            overrides: ``key=value`` strings as on the command line, or a mapping of dotted keys to values.
            controllers: Control laws of the caller's own, classes by kind.
            estimators: Estimators of the caller's own, likewise.

        Raises:
            InputError: One line per fault, with file, line and column.
        """
        loaded = cls.__new__(cls)
        loaded._validate(read_yaml(scenario_path(scenario)), as_texts(overrides), controllers, estimators)
        return loaded

    def _validate(self, base: YamlSource, overrides: Sequence[str], controllers: Classes, estimators: Classes) -> None:
        """Become the scenario of a source with overrides.

        Raises:
            InputError: One line per fault.
        """
        refuse_wrong_classes(controllers, estimators)
        with _naming(overrides):
            source = base.overridden(overrides)
            config = validated(source, controllers, estimators)
        private = {"_base": base, "_overrides": tuple(overrides), "_config": config, "_source": source}
        classes = {"controllers": dict(controllers), "estimators": dict(estimators)}
        state = config.__getstate__()
        self.__setstate__(state | {"__dict__": state["__dict__"] | classes, "__pydantic_private__": private})

    def with_overrides(self, overrides: Overrides, *, controllers: Classes = _NONE, estimators: Classes = _NONE) -> Scenario:
        """The scenario with other values; see :meth:`load` for the arguments, which are added to its own.

        Raises:
            InputError: One line per fault, with the override that causes it.
        """
        if not overrides and not controllers and not estimators:
            return self
        changed = self.__class__.__new__(self.__class__)
        all_overrides = [*self._overrides, *as_texts(overrides)]
        laws, others = {**self.controllers, **controllers}, {**self.estimators, **estimators}
        changed._validate(self._base, all_overrides, laws, others)
        return changed

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:  # noqa: ARG002
        """:meth:`with_overrides` under pydantic's name: a copy is validated."""
        return cast("Self", self.with_overrides(update or {}))

    def __eq__(self, other: object) -> bool:
        """Whether all keys are equal, and the paths in them belong to the same folder."""
        if not isinstance(other, Scenario):
            return False
        return self._folders == other._folders and all(
            getattr(self, key) == getattr(other, key) for key in type(self).model_fields
        )

    __hash__ = None  # type: ignore[assignment]  # its mappings have none

    @property
    def _folders(self) -> list[Path]:
        """Folders to which the paths of models are relative."""
        keys: list[tuple[str, ...]] = [("robot", "mjcf"), *(("objects", name, "mjcf") for name in self.objects)]
        return [self._source.folder(path).resolve() for path in keys]

    @cached_property
    def prepared(self) -> PreparedRun:
        """The scenario with its models compiled, and the components of one run as proof that there are no faults.

        Raises:
            InputError: One line per fault of the models, the control laws or other components.
        """
        with _naming(self._overrides):
            run = recipe(self._config, self._source, self.controllers, estimators=self.estimators)
            run.unused.append(run.assemble())  # reports faults of the components
        return run

    def check(self) -> list[str]:
        """Compile the models and assemble a run, which stays for the next one.

        Returns:
            What a user should know before it runs, one line each.

        Raises:
            InputError: One line per fault of the models, the control laws or other components.
        """
        return self.prepared.notes()

    def describe(self) -> list[str]:
        """Lines of text that describe the scenario, with what :meth:`check` returns.

        Raises:
            InputError: See :meth:`check`.
        """
        return self.prepared.describe()

    @property
    def system(self) -> System:
        """Robot and objects, compiled: the MuJoCo model ``system.mj`` with names and index maps.

        Raises:
            InputError: See :meth:`check`.
        """
        return self.prepared.system

    @property
    def changes(self) -> tuple[PropertyChange, ...]:
        """Properties of bodies and geoms that the scenario gives, as compiled, then those that its laws believe in.

        Raises:
            InputError: See :meth:`check`.
        """
        return self.prepared.changes

    def run(
        self,
        out: str | Path | None = None,
        *,
        force: bool = False,
        rerun: bool | None = None,
        live: str | None = None,
        report: Callable[[float, float], None] | None = None,
        check: bool = True,
    ) -> Run:
        """Simulate; see :func:`ffsm_mj.run` for the arguments and for what is raised."""
        folder = RunFolder(Path(out), force=force) if out is not None else None
        if folder is not None:
            folder.refuse_earlier_run()
        with law_errors(check):
            prepared = self.prepared
        warn_of_notes(prepared)
        return uninterrupted(prepared.run(folder=folder, rerun=rerun, live=live, report=report, check=check))

    def to_yaml(self, folder: str | Path) -> Path:
        """Write ``scenario.yaml`` with every default, its models and recorded files, all by paths relative to it.

        ``ffsm run FOLDER`` gives the rows that :meth:`run` gives, bit for bit; classes of a script must be passed again.

        Args:
            folder: Created if it does not exist.

        Returns:
            The file.

        Raises:
            InputError: The folder holds one of the files already, or cannot be written; or see :meth:`check`.
        """
        prepared = self.prepared
        return write_scenario(Path(folder), prepared.scenario_yaml, prepared.logged_files)


@contextmanager
def _naming(overrides: Sequence[str]) -> Iterator[None]:
    """Context that names the overrides behind each fault that is at no key of theirs: one of them may cause it."""
    try:
        yield
    except InputError as error:
        others = f" (with {' '.join(map(override, overrides))})" if overrides else ""
        lines = [line if text else line + others for line, text in zip(error.lines, error.overrides, strict=True)]
        raise InputError(lines, error.overrides) from error


def scenario_of(
    scenario: Scenario | Mapping[str, Any] | str | Path,
    overrides: Overrides = (),
    *,
    controllers: Classes = _NONE,
    estimators: Classes = _NONE,
) -> Scenario:
    """A scenario as it was given: an object, its keys, a path, or the name of a shipped one; with overrides and classes.

    Raises:
        InputError: One line per fault.
    """
    plugins: dict[str, Any] = {"controllers": controllers, "estimators": estimators}
    if isinstance(scenario, Mapping):
        plugins = {key: {**scenario.get(key, {}), **classes} for key, classes in plugins.items()}
        return Scenario(**{**scenario, **plugins}).with_overrides(overrides)
    if isinstance(scenario, Scenario):
        return scenario.with_overrides(overrides, **plugins)
    return Scenario.load(scenario, overrides, **plugins)


def run(
    scenario: Scenario | Mapping[str, Any] | str | Path,
    overrides: Overrides = (),
    *,
    controllers: Classes = _NONE,
    estimators: Classes = _NONE,
    fields: Iterable[type[ExternalField]] = (),
    out: str | Path | None = None,
    force: bool = False,
    rerun: bool | None = None,
    live: str | None = None,
    report: Callable[[float, float], None] | None = None,
    check: bool = True,
) -> Run:
    """Simulate a scenario.

    Args:
        scenario: A :class:`Scenario`, a mapping of its keys, a path, or the name of a shipped scenario.
        overrides: ``key=value`` strings as on the command line, or a mapping of dotted keys to values.
        controllers: Control laws of the caller's own, classes by the ``kind`` under which the scenario asks for them
            (:class:`ffsm_mj.controller_protocol.Controller`; a ``Config`` may be left out): no package is needed.
        estimators: Estimators of the caller's own, likewise (:class:`ffsm_mj.controller_protocol.Estimator`).
        fields: External fields of the caller's own, classes that the scenario names by kind under ``environment.fields``
            (:class:`ffsm_mj.fields.interface.Field`); they stay known in this process, to replays of the log too.
        out: Run folder to write; None keeps the run in memory only.
        force: Replace a run that ``out`` already holds.
        rerun: Write ``run.rrd`` into the folder; None: as the scenario says.
        live: ``host:port`` of a Rerun viewer to stream to; one that is missing or goes away never ends the run.
        report: Told (simulation time, duration) in s as the run goes; ``ffsm_mj.progress()`` shows a line of it.
        check: Raise what a control law, an estimator, a contact model or another callback raised, when the log is closed:
            the same exception with its traceback, a note on the end of the run, and the attribute ``run_folder``, a
            ``Path`` or None. If false, the run is returned, with the outcome ``controller_failed`` or ``internal_error``.

    Warns:
        ScenarioNote: What to know about the scenario, one warning for each note of ``ffsm check``.

    Returns:
        The run, the same object that :func:`ffsm_mj.load_run` reads from the log.

    Raises:
        InputError: The scenario or a model is wrong, or the folder holds a run.
        Exception: With ``check``, whatever a control law, an estimator or a contact model raised.
        KeyboardInterrupt: Ctrl-C or SIGTERM, when the log is closed: a loop over runs ends.
    """
    register_all(fields)
    if out is not None:
        RunFolder(Path(out), force=force).refuse_earlier_run()  # before the models are compiled
    chosen = scenario_of(scenario, overrides, controllers=controllers, estimators=estimators)
    return chosen.run(out, force=force, rerun=rerun, live=live, report=report, check=check)


def warn_of_notes(prepared: PreparedRun) -> None:
    """Give a user's program the notes of a scenario as warnings, each at the line of his that runs it.

    Where this package runs a scenario, as for a map of impacts, nobody has asked for its notes.
    """
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and Path(frame.f_code.co_filename).parent == Path(__file__).parent:
        frame, level = frame.f_back, level + 1
    if Path(__file__).parents[1] in Path(frame.f_code.co_filename).parents:
        return
    for note in prepared.notes():
        warnings.warn(f"{prepared.scenario.name}: {note}", ScenarioNote, stacklevel=level)


def uninterrupted(finished: Run) -> Run:
    """The run, if it was not interrupted.

    Raises:
        KeyboardInterrupt: It was.
    """
    if finished.outcome == Outcome.INTERRUPTED:
        raise KeyboardInterrupt
    return finished


@contextmanager
def law_errors(check: bool) -> Iterator[None]:
    """Context that raises, with ``check``, what the constructor of a plug-in raised, in place of the fault that it is."""
    try:
        yield
    except InputError as error:
        if check and (raised := raised_by_plugin(error)) is not None:
            raise raised from None
        raise


def prepare(
    scenario: Scenario | Mapping[str, Any] | str | Path,
    overrides: Overrides = (),
    *,
    controllers: Classes = _NONE,
    estimators: Classes = _NONE,
    check: bool = False,
) -> PreparedRun:
    """Read, validate and compile a scenario without running it.

    Args:
        scenario: See :func:`run`, likewise the others.
        overrides: Changes of the scenario.
        controllers: Control laws of the caller's own.
        estimators: Estimators of the caller's own.
        check: Raise an exception in the constructor of a control law itself, not the fault that it is.

    Raises:
        InputError: The scenario or a model is wrong.
    """
    with law_errors(check):
        return scenario_of(scenario, overrides, controllers=controllers, estimators=estimators).prepared


def recipe(
    config: ScenarioConfig,
    source: YamlSource,
    controllers: Classes = _NONE,
    read: Reader = read_model,
    *,
    estimators: Classes = _NONE,
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
    plugins: dict[str, Any] = {"controllers": controllers, "estimators": estimators}
    origin = origin_of(config, source, lambda file: prepare(file, **plugins))
    if origin is not None:
        config = with_initial_state(config, origin, source)
    system, controller_system, grasped_systems = compile_scenario(config, source, read)
    config = with_waypoints(config, source)
    recorded = recorded_files(config, source)
    run = PreparedRun(
        config,
        source,
        system,
        dict(controllers),
        controller_system,
        grasped_systems,
        dict(estimators),
        recorded,
        origin.start if origin is not None else None,
        origin.files if origin is not None else {},
        origin,
    )
    if origin is not None:
        refuse_changes(origin, run)
    return run


@dataclass(frozen=True, eq=False)
class PreparedRun(CompiledScenario):
    """A prepared scenario: immutable and picklable.

    Every run uses its own copy of the models and its own components, so runs are identical bit for bit, in sequence or in
    several threads at once.

    Attributes:
        origin: The instant of another run at which it begins; None: t = 0.
        unused: Components that were made to find their faults, and that the next run takes.
    """

    origin: Origin | None = None
    unused: list[Assembly] = field(default_factory=list, init=False, repr=False, compare=False)

    def __getstate__(self) -> dict[str, Any]:
        """What another process needs: components are not picklable, and are made again."""
        return vars(self) | {"unused": []}

    def changed(self, source: YamlSource) -> PreparedRun:
        """Prepare another scenario with the same control laws and estimators of a script.

        Raises:
            InputError: One line per fault, with the place in the scenario or the model.
        """
        return recipe(validated(source, self.laws, self.estimators), source, self.laws, estimators=self.estimators)

    def assemble(self) -> Assembly:
        """Components of one run at t = 0 that no other has; see :meth:`CompiledScenario.assemble`."""
        with suppress(IndexError):  # another thread may take them
            return self.unused.pop()
        return super().assemble()

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
        from ffsm_mj.assembly.notes import notes

        return [*self._looked_at(notes), *self._origin_notes()]

    def describe(self) -> list[str]:
        """Lines of text that describe the run, with notes."""
        from ffsm_mj.assembly.notes import describe

        return [*self._looked_at(describe), *(f"note: {note}" for note in self._origin_notes())]

    def _origin_notes(self) -> list[str]:
        return self.origin.notes if self.origin is not None else []

    def instabilities(self) -> list[str]:
        """Notes on phases whose control laws have unstable damping gains, one line each."""
        from ffsm_mj.assembly.notes import unstable_damping

        return self._looked_at(lambda components: [*unstable_damping(components)])

    def _looked_at(self, look: Callable[[Assembly], list[str]]) -> list[str]:
        """What some components say, which no run has meanwhile."""
        components = self.assemble()
        said = look(components)
        self.unused.append(components)
        return said


def prepare_from(
    run: str | Path,
    from_s: float,
    overrides: Overrides = (),
    *,
    controllers: Mapping[str, Any] = MappingProxyType({}),
    estimators: Mapping[str, Any] = MappingProxyType({}),
    check: bool = False,
) -> PreparedRun:
    """Prepare a run that goes on from an instant of a logged one; see :func:`resume`.

    It is the scenario of the logged run, with changes, and with its own folder and the instant as ``initial.from`` and
    ``initial.at_s``. ``check`` is that of :func:`ffsm_mj.assembly.prepare.prepare`.

    Raises:
        InputError: The folder has no scenario, the instant is not one of the run, or a setting cannot change there.
    """
    file = Path(run) / SCENARIO
    if not file.is_file():
        raise InputError(f"{run}: is no run folder that can go on: it has no {SCENARIO}")
    texts = as_texts(overrides)
    begin = ["initial.from=.", f"initial.at_s={from_s!r}"]
    try:
        return prepare(file, [*texts, *begin], controllers=controllers, estimators=estimators, check=check)
    except InputError as error:
        name = "--from" if on_command_line() else "from_s"
        instant = f"{name} {from_s:g}"
        lines = [line.replace(f"{override(begin[1])}: initial.at_s", instant) for line in error.lines]
        lines = [line.replace(" ".join(map(override, begin)), instant) for line in lines]
        raise InputError(lines) from error


def resume(
    run: str | Path,
    from_s: float,
    overrides: Overrides = (),
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
    """Simulate on from an instant of a logged run, bit for bit, or with some of its settings changed there.

    Args:
        run: Folder of the logged run.
        from_s: The instant, s: the run goes on from the first control tick or event at or after it.
        overrides: Settings that change there: of phases, task, contacts, grasps, actuators and limits, or the duration. If
            phases or task change, the control law of the phase under way begins anew. Phases may have control laws of other
            kinds there, which begin without memory.
        controllers: See :func:`ffsm_mj.run`, likewise the others.
        estimators: Estimators of the caller's own.
        out: Run folder to write; None keeps the run in memory only.
        force: Replace a run that ``out`` already holds.
        rerun: Write ``run.rrd`` into the folder.
        live: ``host:port`` of a Rerun viewer.
        report: Told (simulation time, duration) in s as the run goes.
        check: Raise what ended the run by an exception, as :func:`ffsm_mj.run` does.

    Returns:
        The run from the instant on; its times are those of the logged run.

    Raises:
        InputError: See :func:`prepare_from`; or the run cannot be made again up to the instant.
    """
    folder = RunFolder(Path(out), force=force) if out is not None else None
    if folder is not None:
        folder.refuse_earlier_run()
    prepared = prepare_from(run, from_s, overrides, controllers=controllers, estimators=estimators, check=check)
    warn_of_notes(prepared)
    return prepared.run(folder=folder, rerun=rerun, live=live, report=report, check=check)
