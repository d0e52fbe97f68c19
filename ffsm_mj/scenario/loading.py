"""Loading of scenarios: read, apply overrides, validate; every fault is reported with its location.

A script may pass control laws and estimators, classes by kind, without a package.
"""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal

import mujoco
import numpy as np
from pydantic import BaseModel, Field, ValidationError, create_model

from ffsm_controllers import kinds
from ffsm_controllers.estimators import estimators
from ffsm_mj.actuation.config import ACTUATOR_KINDS
from ffsm_mj.config import PartName, StrictModel, chosen_by_kind
from ffsm_mj.contact_models.impact.law import impact_law, plugin_fault
from ffsm_mj.contact_models.registry import PLUGINS as CONTACT_MODELS
from ffsm_mj.contact_models.registry import record_kinds_of
from ffsm_mj.errors import Fault, Faults, InputError, ScenarioFaults, faults_below, unknown_name
from ffsm_mj.fields.interface import PLUGINS as FIELDS
from ffsm_mj.model.inline import inline_model
from ffsm_mj.plugins import Plugins
from ffsm_mj.records.signals import identifier
from ffsm_mj.scenario.environment import EnvironmentConfig, environment_faults
from ffsm_mj.scenario.faults import KindNames, plain_faults
from ffsm_mj.scenario.models import with_scene
from ffsm_mj.scenario.phases import PhaseConfig, graph_faults, is_branching
from ffsm_mj.scenario.scenario import ScenarioConfig, TruthConfig, timing_faults
from ffsm_mj.scenario.source import YamlSource, read_yaml
from ffsm_mj.sensing.config import SensorConfig

_METHODS = {"controllers": ("start", "control", "telemetry"), "estimators": ("start", "update", "telemetry")}


class NoSettings(StrictModel):
    """Configuration of a control law or estimator without a ``Config``."""

    kind: str


def refuse_script_classes(option: str, classes: Mapping[str, Any], installed: Collection[str]) -> None:
    """Refuse classes that are not control laws, or not estimators.

    Args:
        option: How they are passed, ``controllers`` or ``estimators``.
        classes: Classes by kind.
        installed: Installed kinds.

    Raises:
        InputError: One line per fault.
    """
    if not isinstance(classes, Mapping):
        raise InputError(f"{option}: must be a mapping of classes by kind, and is {type(classes).__name__}")
    lines, methods = [], _METHODS[option]
    for kind, law in classes.items():
        missing = [name for name in methods if not callable(getattr(law, name, None))]
        config = getattr(law, "Config", NoSettings)
        if kind in installed:
            lines.append(f"{option}: {kind!r} is the name of an existing kind; choose another name")
        elif not isinstance(law, type) or missing:
            lines.append(f"{option}: {kind!r} is no class with the methods {', '.join(methods)}")
        elif not isinstance(getattr(law, "telemetry_signals", None), tuple | list | property):
            lines.append(f"{option}: {kind!r} has no telemetry_signals; () reports nothing")
        elif not (isinstance(config, type) and issubclass(config, StrictModel)):
            lines.append(f"{option}: the Config of {kind!r} is no ffsm_mj.controller_protocol.StrictModel")
        elif config is not NoSettings and _kind_of(config) != kind:
            lines.append(f"{option}: the Config of {kind!r} needs the field kind: Literal[{kind!r}]")
    if lines:
        raise InputError(lines)


def _kind_of(config: type[StrictModel]) -> str | None:
    field = config.model_fields.get("kind")
    values: tuple[Any, ...] = getattr(field.annotation, "__args__", ()) if field is not None else ()
    return str(values[0]) if len(values) == 1 else None


def config_of(law: Any, kind: str) -> type[StrictModel]:
    """Configuration model of a law."""
    if hasattr(law, "Config"):
        return law.Config  # type: ignore[no-any-return]
    only: Any = Literal[kind]
    return create_model(f"{law.__name__}Config", __base__=NoSettings, kind=(only, ...))


def _importable(config: Any, classes: Mapping[str, Any]) -> Any:
    """A configuration as an instance of an importable class: one that a class of a script leaves out has its kind only."""
    settled = config is None or config.kind not in classes or hasattr(classes[config.kind], "Config")
    return config if settled else NoSettings(kind=config.kind)


def with_plugins(scenario: ScenarioConfig) -> ScenarioConfig:
    """The scenario with validated contact models and external fields.

    Raises:
        ScenarioFaults: An unknown kind, or an invalid configuration.
    """
    changes: dict[str, Any] = {}
    with Faults() as faults:
        if scenario.contact_models:
            changes["contact_models"] = _configs(scenario.contact_models, CONTACT_MODELS, faults, "contact_models")
        if (around := scenario.environment) is not None and around.fields:
            fields = _configs(around.fields, FIELDS, faults, "environment", "fields")
            changes["environment"] = around.model_copy(update={"fields": fields})
    return scenario.model_copy(update=changes) if changes else scenario


def _configs(values: Sequence[Any], plugins: Plugins[Any], faults: Faults, *path: str) -> tuple[StrictModel, ...]:
    """Validated configurations of plug-ins at a path."""
    configs: list[StrictModel] = []
    for i, value in enumerate(values):
        with faults.below(*path, i):
            configs.append(value if isinstance(value, StrictModel) else _config(value, plugins))
    return tuple(configs)


def _config(value: Any, plugins: Plugins[Any]) -> StrictModel:
    if not isinstance(value, Mapping) or not isinstance(value.get("kind"), str):
        raise LookupError(f"needs a 'kind'; allowed: {', '.join(sorted(plugins.every())) or 'none is installed'}")
    with faults_below("kind"):
        config: type[StrictModel] = plugins.named(value["kind"]).Config
    try:
        return config.model_validate(value)
    except ValidationError as error:
        raise ScenarioFaults(plain_faults(error, KindNames(config, (), (), {}))) from error


def endings(configs: tuple[Any, ...], *, grasps: bool) -> tuple[str, ...]:
    """Events that may end a phase: of contacts and joint limits, grasps, releases, records of contact models."""
    named = (kind.name for config in configs for kind in record_kinds_of(config.kind))
    contacts = ("impact", "contact_begins", "contact_ends", "contact_slips", "contact_sticks")
    return (*contacts, "limit_impact", "limit_begins", "limit_ends", *(("grasp", "release") if grasps else ()), *named)


def fault_of_ending(until: str | None, configs: tuple[Any, ...], *, grasps: bool) -> str:
    """What is wrong with a phase's ``until``; empty if it is valid."""
    allowed = (*endings(configs, grasps=grasps), "settled", "finished", "end")
    return "" if until is None or until in allowed else unknown_name("end of a phase", until, allowed)


_BUILT_IN = "ffsm_controllers"


def grasp_faults(scenario: ScenarioConfig) -> list[Fault]:
    """Faults of grasps in phases: unknown grasps, and a grasp armed while it is closed."""
    faults = []
    for i, phase in enumerate(scenario.phases):
        for key, names in (("arm", phase.arm), ("release", phase.release)):
            unknown = ((k, name) for k, name in enumerate(names) if name not in scenario.grasps)
            faults += [Fault(unknown_name("grasp", name, scenario.grasps), ("phases", i, key, k)) for k, name in unknown]
    first: dict[str, str] = {}
    for name in scenario.grasps:
        other = first.setdefault(identifier(name), name)
        if other != name:
            faults.append(Fault(f"its columns would have the names of those of {other!r}; rename it", ("grasps", name)))
    if is_branching(scenario.phases):
        return faults  # what was armed or closed before depends on the way that the run takes
    return faults or [*_armed_while_closed(scenario), *_ends_at_no_grasp(scenario)]


def never_armed(scenario: ScenarioConfig) -> Iterator[str]:
    """Messages for grasps that no phase arms; a control law may still request them."""
    armed = {name for phase in scenario.phases for name in phase.arm}
    asking = [phase.name for phase in scenario.phases if not _asks_for_nothing(phase)]
    for name in scenario.grasps:
        if name not in armed:
            law = f" unless the control law of phase {asking[0]!r} requests it" if asking else ""
            yield f"no phase arms the grasp {name!r}, so it never closes{law}; write 'arm: [{name}]' in a phase"


def _ends_at_no_grasp(scenario: ScenarioConfig) -> Iterator[Fault]:
    """Phases that wait for a grasp that cannot close: no grasp is armed, and no control law may request one."""
    for i, phase in enumerate(scenario.phases):
        if not _asks_for_nothing(phase):
            return
        if phase.until == "grasp" and phase.for_s is None and not phase.arm and scenario.grasps:
            message = f"no grasp is armed, so none ends this phase; write 'arm: [{next(iter(scenario.grasps))}]'"
            yield Fault(message, ("phases", i, "until"))


def _armed_while_closed(scenario: ScenarioConfig) -> Iterator[Fault]:
    """Grasps that a phase arms while they are certainly closed: alone armed they ended a phase, and nothing ended them."""
    closed: dict[str, str] = {}
    for i, phase in enumerate(scenario.phases):
        closed = {name: since for name, since in closed.items() if name not in phase.release}
        for k, name in enumerate(phase.arm):
            if name in closed:
                reason = f"it is closed since the end of phase {closed[name]!r}; release it first"
                yield Fault(f"{name!r} cannot close: {reason}", ("phases", i, "arm", k))
        waiting = [name for name in phase.arm if name not in closed]
        bears_any_load = all(scenario.grasps[name].load_limit is None for name in waiting)
        if phase.until == "release" or not _asks_for_nothing(phase):
            closed = {}
        elif phase.until == "grasp" and phase.for_s is None and len(waiting) == 1 and bears_any_load:
            # One of the same two sites has taken over from another.
            sites = _sites(scenario, waiting[0])
            closed = {name: since for name, since in closed.items() if _sites(scenario, name) != sites}
            closed[waiting[0]] = phase.name


def _sites(scenario: ScenarioConfig, name: str) -> tuple[str, str]:
    """Sites that a grasp joins, without prefixes that may be left out."""
    config = scenario.grasps[name]
    return config.robot_site.rpartition("/")[2], config.object_site.rpartition("/")[2]


def _asks_for_nothing(phase: PhaseConfig) -> bool:
    """Whether the phase's control laws certainly request no grasp or release: built-in ones do not, others may."""
    classes = [kinds().classes.get(law.kind) for law in phase.laws.values()]
    return all(law is not None and law.__module__.partition(".")[0] == _BUILT_IN for law in classes)


_MOST_FRAMES = 1e6


def load_scenario(
    path: Path,
    overrides: Sequence[str] = (),
    laws: Mapping[str, Any] = MappingProxyType({}),
    estimator_classes: Mapping[str, Any] = MappingProxyType({}),
) -> tuple[ScenarioConfig, YamlSource]:
    """Read and validate a scenario.

    Args:
        path: The file.
        overrides: ``key=value`` each.
        laws: Control laws of a script, classes by kind.
        estimator_classes: Estimators of a script, likewise.

    Returns:
        The scenario and its source, which knows the location of each key.

    Raises:
        InputError: One line per fault, with file, line and column.
    """
    refuse_wrong_classes(laws, estimator_classes)
    source = read_yaml(path, overrides)
    return validated(source, laws, estimator_classes), source


def refuse_wrong_classes(laws: Mapping[str, Any], estimator_classes: Mapping[str, Any]) -> None:
    """Refuse classes of a script that are not control laws, or not estimators.

    Raises:
        InputError: One line per fault.
    """
    refuse_script_classes("controllers", laws, kinds().classes)
    refuse_script_classes("estimators", estimator_classes, {"truth", *estimators().classes})


def stated_source(keys: Mapping[str, Any], name: str = "scenario") -> YamlSource:
    """Source of what a program states: a fault names its key, and paths are relative to the current folder.

    Args:
        keys: Values by key: plain ones, arrays, paths, models, configurations such as
            :class:`~ffsm_mj.scenario.models.Robot`, and mappings and sequences of them.
        name: What it is.
    """
    return YamlSource(Path(name), plain(keys), None)


def plain(value: Any, path: tuple[str, ...] = ()) -> Any:
    """A value of a program, at a path of keys, as that of a file; a model in memory stays one.

    Raises:
        InputError: A ``mujoco.MjSpec`` does not compile.
    """
    if isinstance(value, BaseModel):
        fields = type(value).model_fields
        value = {fields[key].alias or key: getattr(value, key) for key in fields if key in value.model_fields_set}
    if isinstance(value, Mapping):
        return {key: plain(item, (*path, str(key))) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item, (*path, str(i))) for i, item in enumerate(value)]
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    try:
        return inline_model(value) if isinstance(value, Path | mujoco.MjSpec) else value
    except InputError as error:
        raise InputError([f"{'.'.join(path)}: {line}" for line in error.lines]) from error


def validated(
    source: YamlSource,
    laws: Mapping[str, Any] = MappingProxyType({}),
    estimator_classes: Mapping[str, Any] = MappingProxyType({}),
) -> ScenarioConfig:
    """Validate the data of a source.

    Args:
        source: Data and the location of each key.
        laws: Control laws of a script, classes by kind, already accepted by :func:`refuse_script_classes`.
        estimator_classes: Estimators of a script, likewise.

    Raises:
        InputError: One line per fault, with file, line and column.
    """
    source = with_scene(source)
    installed = kinds()
    model = _model_with(laws, estimator_classes) if laws or estimator_classes else ScenarioConfig
    try:
        scenario = model.model_validate(source.data)
    except ValidationError as error:
        kinds_known = KindNames(
            model,
            {*installed.classes, *laws},
            ACTUATOR_KINDS,
            installed.broken | estimators().broken,
            _script_laws(source.data),
            {"truth", *estimators().classes, *estimator_classes},
        )
        raise source.located(plain_faults(error, kinds_known)) from error
    with source.locating():
        scenario = with_plugins(_with_script_laws(scenario, laws, estimator_classes))
        if faults := _other_faults(scenario):
            raise ScenarioFaults(faults)
    return scenario


def _model_with(laws: Mapping[str, Any], estimator_classes: Mapping[str, Any]) -> type[ScenarioConfig]:
    """Scenario model that accepts these beside what is installed."""
    law, estimator = (
        chosen_by_kind(
            ChainMap({kind: config_of(class_, kind) for kind, class_ in script.items()}, installed.configs, *others)
        )
        for script, installed, others in ((laws, kinds(), ()), (estimator_classes, estimators(), ({"truth": TruthConfig},)))
    )
    parts: Any = Annotated[dict[PartName, law], Field(min_length=1)] | None  # type: ignore[valid-type]
    name = PhaseConfig.__name__
    phase: Any = create_model(name, __base__=PhaseConfig, controller=(law | None, None), controllers=(parts, None))
    phases: Any = Annotated[tuple[phase, ...], Field(min_length=1)]
    name, default = ScenarioConfig.__name__, ScenarioConfig.model_fields["estimator"].default
    return create_model(name, __base__=ScenarioConfig, phases=(phases, ...), estimator=(estimator, default))


def controller_kinds() -> tuple[str, ...]:
    """Installed kinds of control laws."""
    return tuple(kinds().classes)


def _script_laws(data: Any) -> tuple[str, ...]:
    """Kinds of script laws in the data of a scenario that may be invalid."""
    named = data.get("script_laws") if isinstance(data, Mapping) else None
    return tuple(map(str, named)) if isinstance(named, list | tuple) else ()


def _with_script_laws(
    scenario: ScenarioConfig, laws: Mapping[str, Any], estimator_classes: Mapping[str, Any]
) -> ScenarioConfig:
    """Scenario that lists which of these laws and estimators it uses."""
    if not laws and not estimator_classes:
        return scenario.model_copy(update={"script_laws": None})
    used = tuple(kind for kind in laws if any(law.kind == kind for phase in scenario.phases for law in phase.laws.values()))
    used += tuple(kind for kind in estimator_classes if scenario.estimator.kind == kind)
    # Instances of importable classes can be pickled.
    phases = tuple(
        PhaseConfig.model_construct(
            **dict(one)
            | {
                "controller": _importable(one.controller, laws),
                "controllers": one.controllers and {name: _importable(law, laws) for name, law in one.controllers.items()},
            }
        )
        for one in scenario.phases
    )
    estimator = _importable(scenario.estimator, estimator_classes)
    changes = {"phases": phases, "estimator": estimator, "script_laws": used or None}
    return ScenarioConfig.model_construct(**dict(scenario) | changes)


def _other_faults(scenario: ScenarioConfig) -> list[Fault]:
    """Faults of keys that do not fit each other."""
    faults = Faults()
    faults.collected += [*timing_faults(scenario), *_impact_law_faults(scenario)]
    frames = min(scenario.duration_s / scenario.control_period_s, scenario.duration_s * scenario.log.view_rate_hz)
    if frames > _MOST_FRAMES and not faults.collected:
        faults.add(f"gives {frames:.3g} frames for viewers; at most {_MOST_FRAMES:g}", "log", "view_rate_hz")
    around = scenario.environment
    if around is not None:
        stars = any(sensor.axes == "eci" for sensor in scenario.sensors.values())
        faults.collected += environment_faults(around, stars=stars)
    if scenario.initial.frame != "world" and (around is None or around.orbit is None):
        faults.add("needs 'environment.orbit': LVLH are axes on an orbit", "initial", "frame")
    for name, sensor in scenario.sensors.items():
        if text := _lacking_for_sensor(sensor, around):
            faults.add(text, "sensors", name, "axes" if sensor.axes == "eci" else "kind")
    for name, actuator in scenario.actuators.items():
        if actuator.kind == "magnetorquer" and (around is None or around.magnetic_field is None):
            faults.add("a magnetorquer needs 'environment.magnetic_field'", "actuators", name, "kind")
    if scenario.extends is not None:
        faults.add("can only stand in a scenario file", "extends")
    for reserved in {"robot", "world"} & set(scenario.objects):
        faults.add("this name is taken; choose another", "objects", reserved)
    trees = ("robot", *scenario.objects)
    for key in ("model", "controller_model"):
        for tree in set(getattr(scenario, key)).difference(trees):
            faults.add(unknown_name("model", tree, trees), key, tree)
    for i, phase in enumerate(scenario.phases):
        with faults.below("phases", i), Faults() as of_phase:
            _check_phase(scenario, i, phase, of_phase)
    graph = graph_faults(scenario.phases) if is_branching(scenario.phases) else []
    return [*faults.collected, *grasp_faults(scenario), *graph]


def _lacking_for_sensor(sensor: SensorConfig, around: EnvironmentConfig | None) -> str:
    """What a sensor needs of the surroundings and they lack; empty if nothing."""
    orbit = around is not None and around.orbit is not None
    if sensor.kind == "horizon" and not orbit:
        return "a horizon sensor needs 'environment.orbit': without it there is no nadir"
    if sensor.axes == "eci" and not orbit:
        return "eci are axes of a central body: they need 'environment.orbit'; world axes are inertial too"
    if sensor.kind == "magnetometer" and (around is None or around.magnetic_field is None):
        return "a magnetometer needs 'environment.magnetic_field'"
    return ""


def _check_phase(scenario: ScenarioConfig, i: int, phase: PhaseConfig, faults: Faults) -> None:
    """Add faults of a phase at position i that depend on other keys; paths in the phase."""
    if phase.name in [earlier.name for earlier in scenario.phases[:i]]:
        faults.add(f"another phase has the name {phase.name!r}", "name")
    for end in phase.ends:
        if fault := fault_of_ending(end.event, scenario.contact_models, grasps=bool(scenario.grasps)):
            faults.add(fault, *end.keys)
        if end.event == "settled" and scenario.task is None:
            faults.add("nothing settles: the scenario has no task", *end.keys)
    for keys, law in phase.laws.items():
        if reason := kinds().broken.get(law.kind):
            faults.add(f"the plugin for kind {law.kind!r} cannot be used ({reason})", *keys, "kind")
    if phase.until == "end" and phase is not scenario.phases[-1] and not is_branching(scenario.phases):
        faults.add("only the last phase can last until the end", "until")


def _impact_law_faults(scenario: ScenarioConfig) -> list[Fault]:
    """Friction and restitution of pairs that the impact law does not cover; several contacts are known at an impact only."""
    law, faults = impact_law(scenario.impact.law), []
    contacts = scenario.contacts
    if contacts.rules != () and (fault := plugin_fault(law.name)):
        faults.append(Fault(fault, ("impact", "law")))
    friction = f"'impact.law: {law.name}' does not cover friction; let mu be 0, or the law 'blend' or 'poisson'"
    super_elastic = f"'impact.law: {law.name}' does not cover super-elastic impacts (e > 1)"
    elastic = f"'impact.law: {law.name}' needs the elastic constants where mu > 0, as 'elastic: {{poisson_ratio: 0.3}}'"
    # Without rules every pair has the default.
    rough = contacts.default.mu > 0.0 and contacts.default.elastic is None
    if law.covers.compliance and contacts.rules is None and rough:
        faults.append(Fault(elastic, ("contacts", "default")))
    if contacts.default.mu > 0.0 and not law.covers.friction:
        faults.append(Fault(friction, ("contacts", "default", "mu")))
    for i, rule in enumerate(contacts.rules or ()):
        # A rule that states no mu has that of the default, whose fault is listed above.
        if contacts.mu_of(rule) not in (0.0, contacts.default.mu) and not law.covers.friction:
            faults.append(Fault(friction, ("contacts", "rules", i, "mu")))
        if law.covers.compliance and contacts.mu_of(rule) > 0.0 and contacts.elastic_of(rule) is None:
            faults.append(Fault(elastic, ("contacts", "rules", i)))
        if contacts.restitution_of(rule) > 1.0 and not law.covers.super_elastic:
            faults.append(Fault(super_elastic, ("contacts", "rules", i, "restitution")))
        if contacts.restitution_of(rule) > 1.0 and contacts.mu_of(rule) > 0.0:
            message = "an impact that gains energy (restitution above 1) has no law with friction; set mu of this rule to 0"
            faults.append(Fault(message, ("contacts", "rules", i)))
    return faults
