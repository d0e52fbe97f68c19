"""Plan of a study: study file validated, and a campaign with the same samples planned for each variant."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from pydantic import ValidationError

from ffsm_mj.assembly.prepare import as_overrides
from ffsm_mj.campaign.execution.file_metrics import FileMetric, read_metrics
from ffsm_mj.campaign.execution.metrics import fault_of
from ffsm_mj.campaign.plan.config import CampaignFile, LimitsConfig
from ffsm_mj.campaign.plan.loading import Places, Plan, base_path, plan_of
from ffsm_mj.campaign.script_classes import NO_CLASSES, ScriptClasses
from ffsm_mj.errors import Fault, InputError, unknown_name
from ffsm_mj.model.system import System
from ffsm_mj.records.signals import identifier
from ffsm_mj.scenario.faults import KindNames, plain_faults
from ffsm_mj.scenario.loading import load_scenario
from ffsm_mj.scenario.source import YamlSource, source_of
from ffsm_mj.studies.config import StudyFile, VariantConfig
from ffsm_mj.studies.shipped import STUDIES
from ffsm_mj.yaml.node import KeyPath
from ffsm_mj.yaml.parser import read_node


@dataclass(frozen=True, eq=False)
class StudyPlan:
    """A validated study.

    Attributes:
        config: The study file.
        source: Locations of its keys.
        own: Control laws, estimators and metrics of the caller, with those of the metrics file.
        variants: Campaign of each variant that its scenario can run, by name.
        not_applicable: Why the control laws of the other variants cannot be created for their scenarios, by name.
    """

    config: StudyFile
    source: YamlSource
    own: ScriptClasses
    variants: Mapping[str, Plan]
    not_applicable: Mapping[str, str]


def load_study(study: str | Path, overrides: Sequence[str] = (), own: ScriptClasses = NO_CLASSES) -> StudyPlan:
    """Read and validate a study; no design is sampled, and a metrics file is not executed.

    Args:
        study: A file, or the name of a shipped study.
        overrides: ``key=value`` overrides of the study file.
        own: Control laws, estimators and metrics of the caller; its metrics replace the file that the study names.

    Raises:
        InputError: One line per fault, with file, line and column.
    """
    path = STUDIES.path(study)
    return plan_study(source_of(read_node(path, "study"), path).overridden(overrides), own)


def plan_study(source: YamlSource, own: ScriptClasses = NO_CLASSES) -> StudyPlan:
    """Validate a study; see :func:`load_study`.

    Args:
        source: Data of the study file and locations of its keys; paths are relative to the file.
        own: Control laws, estimators and metrics of the caller.

    Raises:
        InputError: One line per fault, with file, line and column.
    """
    try:
        config = StudyFile.model_validate(source.data)
    except ValidationError as error:
        raise InputError(source.lines(plain_faults(error, KindNames(StudyFile, (), (), {})))) from error
    if faults := list(_faults_of_keys(config)):
        raise InputError(source.lines(faults))
    own = own if own.metrics else replace(own, metrics=_of_file(config, source))
    planned, not_applicable = dict[str, Plan](), dict[str, str]()
    seed: int | None = None
    for name, variant in config.variants.items():
        try:
            plan = _planned(config, name, variant, source, own, seed)
        except InputError as error:
            if not _validates(config, name, variant, source, own):
                raise
            not_applicable[name] = _reason(error)
            continue
        seed = plan.base.scenario.seed if seed is None else seed
        _refuse_built_in(own, source, plan.base.system)
        planned[name] = plan
    if not planned:
        name, reason = next(iter(not_applicable.items()))
        raise InputError(source.line(Fault(f"no variant is applicable; {name}: {reason}", ("variants",))))
    return StudyPlan(config, source, own, planned, not_applicable)


def _faults_of_keys(config: StudyFile) -> Iterator[Fault]:
    """Keys that do not agree with others."""
    if config.reference is not None and config.reference not in config.variants:
        yield Fault(unknown_name("variant", config.reference, config.variants), ("reference",))
    axes = {} if config.pareto is None else {"error": config.pareto.error, "effort": config.pareto.effort}
    for axis, name in axes.items():
        if config.objectives.get(name) == "maximize":
            yield Fault(f"less of {name} is better here, but objectives says 'maximize'", ("pareto", axis))


def _of_file(config: StudyFile, source: YamlSource) -> dict[str, FileMetric]:
    """Metrics of the Python file that the study names."""
    if config.metrics_file is None:
        return {}
    try:
        return read_metrics(source.folder(("metrics", "file")) / config.metrics_file)
    except InputError as error:
        raise InputError([source.line(Fault(line, ("metrics", "file"))) for line in error.lines]) from error


def _planned(
    config: StudyFile, name: str, variant: VariantConfig, source: YamlSource, own: ScriptClasses, seed: int | None
) -> Plan:
    """Campaign of a variant.

    Args:
        config: The study.
        name: Name of the variant.
        variant: The variant.
        source: Locations of the study's keys.
        own: Classes and functions of the caller.
        seed: Seed of the first variant: runs of one number have the same noise in all variants.

    Raises:
        InputError: The variant is invalid, or its control laws cannot be created.
    """
    campaign, places = _campaign(config, name, variant, own), _places(config, name, variant)
    plan = plan_of(campaign, source, own, places)
    if seed is None or plan.base.scenario.seed == seed or "seed" in campaign.overrides:
        return plan
    same = campaign.model_copy(update={"overrides": campaign.overrides | {"seed": seed}})
    return plan_of(same, source, own, places)


def _campaign(config: StudyFile, name: str, variant: VariantConfig, own: ScriptClasses) -> CampaignFile:
    names = dict.fromkeys([*config.metric_names, *own.metrics])
    return CampaignFile(
        campaign=name,
        description=variant.description,
        scenario=variant.scenario or config.scenario,
        overrides=variant.overrides_after(config.overrides),
        samples=config.samples,
        dispersions=config.dispersions,
        metrics=tuple(names),
        success=config.success,
        truncated=config.truncated,
        limits=LimitsConfig(timeout_s=config.limits.timeout_s, max_failed=1.0, workers=config.limits.workers),
    )


def _places(config: StudyFile, name: str, variant: VariantConfig) -> Places:
    """Where the keys of a variant stand in the study file."""
    scenario: KeyPath = ("variants", name, "scenario") if variant.scenario is not None else ("scenario",)
    places: dict[str, KeyPath] = {
        f"phases.{phase}.controller": ("variants", name, "controllers", phase) for phase in variant.controllers
    }
    places |= {key: ("variants", name, "overrides", key) for key in variant.overrides}
    return Places(scenario, places, dict(reversed(list(config.named_metrics()))))


def _validates(config: StudyFile, name: str, variant: VariantConfig, source: YamlSource, own: ScriptClasses) -> bool:
    """Whether all that is wrong with a variant is that its control laws cannot be created for its scenario.

    Its scenario file with the laws is then valid, and without them a run can be prepared.
    """
    if not variant.controllers:
        return False
    replaced = tuple(f"phases.{phase}.controller" for phase in variant.controllers)
    kept = {key: value for key, value in variant.overrides.items() if not key.startswith(replaced)}
    without = variant.model_copy(update={"controllers": {}, "overrides": kept})
    try:
        path = base_path(variant.scenario or config.scenario, source, _places(config, name, variant))
        load_scenario(path, as_overrides(variant.overrides_after(config.overrides)), own.controllers, own.estimators)
        _planned(config, name, without, source, own, None)
    except InputError:
        return False
    return True


def _reason(error: InputError) -> str:
    """The faults of a variant, without the places where they stand."""
    return "; ".join(error.lines)


def _refuse_built_in(own: ScriptClasses, source: YamlSource, system: System) -> None:
    """Refuse metrics of the caller that have the name of a built-in one.

    Raises:
        InputError: One line per fault.
    """
    actuators = [identifier(name) for name in system.names("actuator")]
    taken = [name for name in own.metrics if fault_of(name, actuators) is None]
    if taken:
        message = "{} is a built-in metric; give the function another name"
        raise InputError(source.lines([Fault(message.format(name), ("metrics",)) for name in taken]))
