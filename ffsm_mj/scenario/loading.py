"""Loading of scenarios: read, apply overrides, validate; every fault is reported with its location."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import mujoco
import numpy as np
from pydantic import BaseModel, ValidationError

from ffsm_controllers import kinds
from ffsm_controllers.estimators import estimators
from ffsm_mj.actuation.config import ACTUATOR_KINDS
from ffsm_mj.contact_models.impact.law import impact_law, plugin_fault
from ffsm_mj.errors import Fault, InputError, ScenarioFaults, unknown_name
from ffsm_mj.model.inline import inline_model
from ffsm_mj.scenario.contact_models import fault_of_ending
from ffsm_mj.scenario.estimator_config import TruthConfig
from ffsm_mj.scenario.faults import KindNames, plain_faults
from ffsm_mj.scenario.grasps import grasp_faults
from ffsm_mj.scenario.phase_config import PhaseConfig
from ffsm_mj.scenario.phase_graph import graph_faults, is_branching
from ffsm_mj.scenario.scenario import ScenarioConfig, timing_faults, with_contact_models
from ffsm_mj.scenario.scene_file import with_scene
from ffsm_mj.scenario.script_laws import as_phases, config_of, importable, model_with, refuse_script_classes
from ffsm_mj.scenario.source import YamlSource, read_yaml

_MOST_FRAMES = 1e6


def load_scenario(
    path: Path,
    overrides: Sequence[str] = (),
    laws: Mapping[str, Any] = MappingProxyType({}),
    own_estimators: Mapping[str, Any] = MappingProxyType({}),
) -> tuple[ScenarioConfig, YamlSource]:
    """Read and validate a scenario.

    Args:
        path: The file.
        overrides: ``key=value`` each.
        laws: Control laws of a script, classes by kind.
        own_estimators: Estimators of a script, likewise.

    Returns:
        The scenario and its source, which knows the location of each key.

    Raises:
        InputError: One line per fault, with file, line and column.
    """
    refuse_own_classes(laws, own_estimators)
    source = read_yaml(path, overrides)
    return validated(source, laws, own_estimators), source


def refuse_own_classes(laws: Mapping[str, Any], own_estimators: Mapping[str, Any]) -> None:
    """Refuse classes of a script that are not control laws, or not estimators.

    Raises:
        InputError: One line per fault.
    """
    refuse_script_classes("controllers", laws, kinds().classes)
    refuse_script_classes("estimators", own_estimators, {"truth", *estimators().classes})


def stated_source(keys: Mapping[str, Any], name: str = "scenario") -> YamlSource:
    """Source of what a program states: a fault names its key, and paths are relative to the current folder.

    Args:
        keys: Values by key: plain ones, arrays, paths, models, configurations such as
            :class:`~ffsm_mj.scenario.model_config.Robot`, and mappings and sequences of them.
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
    own_estimators: Mapping[str, Any] = MappingProxyType({}),
) -> ScenarioConfig:
    """Validate the data of a source.

    Args:
        source: Data and the location of each key.
        laws: Control laws of a script, classes by kind, already accepted by :func:`refuse_script_classes`.
        own_estimators: Estimators of a script, likewise.

    Raises:
        InputError: One line per fault, with file, line and column.
    """
    source = with_scene(source)
    installed = kinds()
    model = _model_with(laws, own_estimators) if laws or own_estimators else ScenarioConfig
    try:
        scenario = model.model_validate(source.data)
    except ValidationError as error:
        kinds_known = KindNames(
            model,
            {*installed.classes, *laws},
            ACTUATOR_KINDS,
            installed.broken | estimators().broken,
            _script_laws(source.data),
            {"truth", *estimators().classes, *own_estimators},
        )
        raise InputError(source.lines(plain_faults(error, kinds_known))) from error
    with source.locating():
        scenario = with_contact_models(_with_script_laws(scenario, laws, own_estimators))
        if faults := _other_faults(scenario):
            raise ScenarioFaults(faults)
    return scenario


def _model_with(laws: Mapping[str, Any], own_estimators: Mapping[str, Any]) -> type[ScenarioConfig]:
    """Scenario model that accepts these beside what is installed."""
    configs = [
        (*installed.configs.values(), *(config_of(each, kind) for kind, each in own.items()))
        for installed, own in ((kinds(), laws), (estimators(), own_estimators))
    ]
    return model_with(ScenarioConfig, PhaseConfig, configs[0], (TruthConfig, *configs[1]))


def controller_kinds() -> tuple[str, ...]:
    """Installed kinds of control laws."""
    return tuple(kinds().classes)


def _script_laws(data: Any) -> tuple[str, ...]:
    """Kinds of script laws in the data of a scenario that may be invalid."""
    named = data.get("script_laws") if isinstance(data, Mapping) else None
    return tuple(map(str, named)) if isinstance(named, list | tuple) else ()


def _with_script_laws(
    scenario: ScenarioConfig, laws: Mapping[str, Any], own_estimators: Mapping[str, Any]
) -> ScenarioConfig:
    """Scenario that lists which of these laws and estimators it uses."""
    if not laws and not own_estimators:
        return scenario.model_copy(update={"script_laws": None})
    used = tuple(kind for kind in laws if any(law.kind == kind for phase in scenario.phases for law in phase.laws.values()))
    used += tuple(kind for kind in own_estimators if scenario.estimator.kind == kind)
    phases, estimator = as_phases(scenario.phases, PhaseConfig, laws), importable(scenario.estimator, own_estimators)
    changes = {"phases": phases, "estimator": estimator, "script_laws": used or None}
    return ScenarioConfig.model_construct(**dict(scenario) | changes)


def _other_faults(scenario: ScenarioConfig) -> list[Fault]:
    faults = timing_faults(scenario) + _impact_law_faults(scenario)
    frames = min(scenario.duration_s / scenario.control_period_s, scenario.duration_s * scenario.log.view_rate_hz)
    if frames > _MOST_FRAMES and not faults:
        faults.append(Fault(f"gives {frames:.3g} frames for viewers; at most {_MOST_FRAMES:g}", ("log", "view_rate_hz")))
    if scenario.extends is not None:
        faults.append(Fault("can only stand in a scenario file", ("extends",)))
    for reserved in {"robot", "world"} & set(scenario.objects):
        faults.append(Fault("this name is taken; choose another", ("objects", reserved)))
    trees = ("robot", *scenario.objects)
    for key in ("model", "controller_model"):
        unknown = (tree for tree in getattr(scenario, key) if tree not in trees)
        faults += [Fault(unknown_name("model", tree, trees), (key, tree)) for tree in unknown]
    names = [phase.name for phase in scenario.phases]
    for i, phase in enumerate(scenario.phases):
        if phase.name in names[:i]:
            faults.append(Fault(f"another phase has the name {phase.name!r}", ("phases", i, "name")))
        for end in phase.ends:
            if fault := fault_of_ending(end.event, scenario.contact_models, grasps=bool(scenario.grasps)):
                faults.append(Fault(fault, ("phases", i, *end.keys)))
            if end.event == "settled" and scenario.task is None:
                faults.append(Fault("nothing settles: the scenario has no task", ("phases", i, *end.keys)))
        faults += [Fault(fault, ("phases", i, *keys)) for keys, fault in _broken_plugins(phase)]
    faults += grasp_faults(scenario)
    branching = is_branching(scenario.phases)
    for i, phase in enumerate(scenario.phases[:-1]):
        if phase.until == "end" and not branching:
            faults.append(Fault("only the last phase can last until the end", ("phases", i, "until")))
    return faults + (graph_faults(scenario.phases) if branching else [])


def _broken_plugins(phase: PhaseConfig) -> Iterator[tuple[tuple[str, ...], str]]:
    """Keys in the phase, and message, for each control law whose plug-in cannot be used."""
    for keys, law in phase.laws.items():
        if reason := kinds().broken.get(law.kind):
            yield (*keys, "kind"), f"the plugin for kind {law.kind!r} cannot be used ({reason})"


def _impact_law_faults(scenario: ScenarioConfig) -> list[Fault]:
    """Friction and restitution of pairs that the impact law does not cover; several contacts are known at an impact only."""
    law, faults = impact_law(scenario.impact.law), []
    contacts = scenario.contacts
    if contacts.rules != () and (fault := plugin_fault(law.name)):
        faults.append(Fault(fault, ("impact", "law")))
    friction = f"'impact.law: {law.name}' does not cover friction; let mu be 0, or the law 'blend' or 'poisson'"
    super_elastic = f"'impact.law: {law.name}' does not cover super-elastic impacts (e > 1)"
    if contacts.default.mu > 0.0 and not law.covers.friction:
        faults.append(Fault(friction, ("contacts", "default", "mu")))
    for i, rule in enumerate(contacts.rules or ()):
        # A rule that states no mu has that of the default, whose fault is listed above.
        if contacts.mu_of(rule) not in (0.0, contacts.default.mu) and not law.covers.friction:
            faults.append(Fault(friction, ("contacts", "rules", i, "mu")))
        if contacts.restitution_of(rule) > 1.0 and not law.covers.super_elastic:
            faults.append(Fault(super_elastic, ("contacts", "rules", i, "restitution")))
        if contacts.restitution_of(rule) > 1.0 and contacts.mu_of(rule) > 0.0:
            message = "an impact that gains energy (restitution above 1) has no law with friction; set mu of this rule to 0"
            faults.append(Fault(message, ("contacts", "rules", i)))
    return faults
