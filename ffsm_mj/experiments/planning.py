"""Plan of a campaign: campaign file and base scenario validated, scenario compiled, dispersions bound to keys."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ffsm_mj.assembly.prepare import PreparedRun, Scenario, prepare, scenario_of
from ffsm_mj.errors import Fault, Faults, InputError, plural
from ffsm_mj.experiments.bindings import Targets, bind_dispersions, extreme_rows, override_faults, refuse_wrong_rows
from ffsm_mj.experiments.design import EXTENDABLE, Binding, Design, refuse_levels, sample_design, scalars_of
from ffsm_mj.experiments.distributions import SampledScalar
from ffsm_mj.experiments.file import OLD_KEY, CampaignFile, Kind, VariantConfig, campaign_path
from ffsm_mj.experiments.metrics import NO_CLASSES, FileMetric, ScriptClasses, fault_of, read_metrics
from ffsm_mj.invocation import command, on_command_line
from ffsm_mj.records.signals import identifier
from ffsm_mj.scenario.faults import KindNames, plain_faults
from ffsm_mj.scenario.loading import load_scenario, plain, stated_source
from ffsm_mj.scenario.overrides import Overrides, as_texts
from ffsm_mj.scenario.shipped import scenario_path
from ffsm_mj.scenario.source import YamlSource, source_of
from ffsm_mj.yaml import KeyPath, read_node, write_flow


@dataclass(frozen=True, eq=False)
class Plan:
    """A validated campaign of one scenario.

    Attributes:
        config: The campaign file; of a variant, what it comes to.
        source: Locations of its keys.
        classes: Control laws, estimators and metrics of the caller, with those of the metrics file.
        overrides: Overrides of the base scenario for all runs, ``key=json``.
        base: The compiled base scenario.
        scalars: Scalars that are sampled for each run.
        bindings: Keys of the scenario that the samples set.
    """

    config: CampaignFile
    source: YamlSource
    classes: ScriptClasses
    overrides: tuple[str, ...]
    base: PreparedRun
    scalars: tuple[SampledScalar, ...]
    bindings: tuple[Binding, ...]

    def design(self) -> Design:
        """Sample the design.

        Raises:
            InputError: The scenario does not accept the values of a run.
        """
        samples = self.config.samples
        return self._sampled(samples.kind, samples.n or 0, samples.seed)

    def _sampled(self, kind: Kind, n: int, seed: int) -> Design:
        with self.source.locating():
            design = sample_design(kind, n, seed, self.scalars, self.bindings)
        refuse_wrong_rows(self.base, design, self.source, self.scalars)
        return design

    def extended(self, design: Design, n: int) -> Design:
        """Extend a design; its runs are the first of the new design.

        Args:
            design: The present design.
            n: New number of samples.

        Raises:
            InputError: Samples of this kind cannot be extended, n is not a valid size, or this machine computes other
                numbers for the present runs.
        """
        if design.kind not in EXTENDABLE:
            allowed = ", ".join(EXTENDABLE)
            raise self._refusal(
                f"a design of kind {design.kind} cannot be extended: a larger one has other samples; allowed: {allowed}"
            )
        if n <= design.n or (design.kind == "sobol" and n & (n - 1)):
            form = "a power of 2" if design.kind == "sobol" else "a number"
            raise self._refusal(f"cannot be extended to {n}: {form} above the present {design.n} is required")
        longer = self._sampled(design.kind, n, design.seed)
        if longer.rows[: len(design.rows)] != design.rows or longer.bindings != design.bindings:
            raise self._refusal(
                "the extended design would not begin with the present runs, which come from another file or other versions"
            )
        return longer

    def _refusal(self, message: str) -> InputError:
        return InputError(self.source.line(Fault(message, ("samples",))))


@dataclass(frozen=True, eq=False)
class VariantsPlan:
    """A validated campaign with variants: each is a campaign of its own, with the same samples.

    Attributes:
        config: The campaign file.
        classes: Control laws, estimators and metrics of the caller, with those of the metrics file.
        variants: Plan of each variant that its scenario can run, by name.
        not_applicable: Why the control laws of the other variants cannot be created for their scenarios, by name.
    """

    config: CampaignFile
    classes: ScriptClasses
    variants: Mapping[str, Plan]
    not_applicable: Mapping[str, str]


def load_campaign(
    campaign: Mapping[str, Any] | str | Path, overrides: Overrides = (), classes: ScriptClasses = NO_CLASSES
) -> Plan | VariantsPlan:
    """Read and validate a campaign; no design is sampled, and a metrics file is not executed.

    Args:
        campaign: A file, the name of a shipped campaign, or the keys of one, with a scenario as :func:`ffsm_mj.run` takes;
            paths in it are then relative to the current folder.
        overrides: Overrides of the campaign file.
        classes: Control laws, estimators and metrics of the caller; its metrics replace the file that the campaign names.

    Raises:
        InputError: One line per fault, with file, line and column.
    """
    texts = as_texts(overrides)
    if not isinstance(campaign, Mapping):
        path = campaign_path(campaign)
        return _plan(source_of(read_node(path, "campaign"), path).overridden(texts), classes)
    scenario, stated, base = campaign.get("scenario"), dict(campaign), None
    if isinstance(scenario, Scenario | Mapping):
        base = scenario_of(scenario, controllers=classes.controllers, estimators=classes.estimators)
        stated["scenario"] = base.name
    return _plan(stated_source(stated, "campaign").overridden(texts), classes, base)


def read_campaign(file: Path) -> CampaignFile:
    """Read and validate a campaign file, without its scenario.

    Raises:
        InputError: One line per fault, with file, line and column.
    """
    return _validated(source_of(read_node(file, "campaign"), file))


def stored_plan(file: Path, classes: ScriptClasses) -> Plan:
    """Read and validate the campaign file in the folder of a campaign; it names no Python file.

    Args:
        file: The file.
        classes: Control laws, estimators and metrics of the caller.

    Raises:
        InputError: One line per fault, with file, line and column.
    """
    source = source_of(read_node(file, "campaign"), file)
    config = _validated(source)
    if config.metrics_file is not None or config.variants:
        raise InputError(f"{file}: is not the file of a stored campaign (variants, or metrics of a file)")
    return _Planner(config, source, classes, None).plan()


def load_plan(campaign: Mapping[str, Any] | str | Path) -> Plan:
    """Read and validate a campaign without variants; see :func:`load_campaign`.

    Raises:
        InputError: It has variants, or see :func:`load_campaign`.
    """
    plan = load_campaign(campaign)
    if isinstance(plan, VariantsPlan):
        raise InputError(f"{plan.config.campaign}: has variants; a campaign without is needed here")
    return plan


def _plan(source: YamlSource, classes: ScriptClasses, base: Scenario | None = None) -> Plan | VariantsPlan:
    """Validate a campaign.

    Args:
        source: Data of the campaign file and locations of its keys; paths are relative to the file.
        classes: Control laws, estimators and metrics of the caller.
        base: Its scenario; None: the one that it names.

    Raises:
        InputError: One line per fault, with file, line and column.
    """
    if OLD_KEY in source.data and "campaign" not in source.data:
        line = "a study is a campaign with variants: write 'campaign' in place of 'study'"
        raise InputError(source.line(Fault(line, (OLD_KEY,))))
    if "campaign" not in source.data and "phases" in source.data:
        use = f"'{command('run', source.path)}'" if on_command_line() else "ffsm_mj.run"
        raise InputError(f"{source.path}: is a scenario, not a campaign; use {use}")
    config = _validated(source)
    classes = classes if classes.metrics else replace(classes, metrics=_metrics_of_file(config, source))
    planner = _Planner(config, source, classes, base)
    return planner.variants() if config.variants else planner.plan()


def _validated(source: YamlSource) -> CampaignFile:
    """The campaign file of a source.

    Raises:
        InputError: One line per fault, with file, line and column.
    """
    try:
        config = CampaignFile.model_validate(source.data)
    except ValidationError as error:
        raise source.located(plain_faults(error, KindNames(CampaignFile, (), (), {}))) from error
    if faults := list(config.faults()):
        raise source.located(faults)
    return config


def _metrics_of_file(config: CampaignFile, source: YamlSource) -> dict[str, FileMetric]:
    """Metrics of the Python file that a campaign names."""
    if config.metrics_file is None:
        return {}
    try:
        return read_metrics(source.folder(("metrics", "file")) / config.metrics_file)
    except InputError as error:
        raise InputError([source.line(Fault(line, ("metrics", "file"))) for line in error.lines]) from error


@dataclass(frozen=True)
class _Planner:
    """Plans the campaign of a file, or that of each of its variants.

    Attributes:
        config: The campaign file.
        source: Locations of its keys.
        classes: Control laws, estimators and metrics of the caller.
        base: Its scenario; None: the one that it names.
    """

    config: CampaignFile
    source: YamlSource
    classes: ScriptClasses
    base: Scenario | None

    def variants(self) -> VariantsPlan:
        """Plan the variants.

        Raises:
            InputError: A variant is invalid, or none is applicable.
        """
        planned, not_applicable = dict[str, Plan](), dict[str, str]()
        seed: int | None = None
        for name, variant in self.config.variants.items():
            try:
                plan = self.plan(name, variant, seed)
            except InputError as error:
                if not self._only_its_laws_fail(name, variant):
                    raise
                not_applicable[name] = "; ".join(error.lines)
                continue
            seed = plan.base.scenario.seed if seed is None else seed
            planned[name] = plan
        if not planned:
            name, reason = next(iter(not_applicable.items()))
            raise InputError(self.source.line(Fault(f"no variant is applicable; {name}: {reason}", ("variants",))))
        return VariantsPlan(self.config, self.classes, planned, not_applicable)

    def plan(self, name: str = "", variant: VariantConfig | None = None, seed: int | None = None) -> Plan:
        """Compile the base scenario of a campaign, or of a variant, and bind its dispersions.

        Args:
            name: Name of the variant.
            variant: The variant; None: a campaign without.
            seed: Seed of the first variant: runs of one number have the same noise in all variants.

        Raises:
            InputError: One line per fault, with file, line and column.
        """
        config = self._config(name, variant)
        prepared = self._prepared(name, variant, config.overrides)
        if seed is not None and prepared.scenario.seed != seed and "seed" not in config.overrides:
            config = config.model_copy(update={"overrides": config.overrides | {"seed": seed}})
            prepared = self._prepared(name, variant, config.overrides)
        if prepared.origin is not None:
            message = "a campaign needs a scenario that begins at t = 0: each of its runs has a seed of its own"
            raise prepared.source.located([Fault(message, ("initial", "from"))])
        with self.source.locating():
            self._refuse_metrics(prepared)
            refuse_levels(config)
            scalars = scalars_of(config.dispersions)
            bindings = bind_dispersions(config.dispersions, Targets(prepared))
        overrides = tuple(as_texts(config.overrides))
        return Plan(config, self.source, self.classes, overrides, prepared, scalars, bindings)

    def _config(self, name: str, variant: VariantConfig | None) -> CampaignFile:
        """Campaign file of a campaign without variants; of a variant, that of a campaign of its own."""
        names = tuple(dict.fromkeys([*self.config.all_metrics, *self.classes.metrics]))
        changes: dict[str, Any] = {"metrics": names} if self.classes.metrics else {}
        if variant is not None:
            none: dict[str, Any] = {"variants": {}, "objectives": {}, "reference": None, "pareto": None}
            limits = self.config.limits.model_copy(update={"max_failed": self.config.max_failed})
            changes = none | {
                "campaign": name,
                "description": variant.description,
                "scenario": variant.scenario or self.config.scenario,
                "overrides": variant.overrides_after(self.config.overrides),
                "metrics": names,
                "limits": limits,
            }
        return self.config.model_copy(update=changes)

    def _prepared(self, name: str, variant: VariantConfig | None, overrides: Mapping[str, Any]) -> PreparedRun:
        """The base scenario with its overrides, whose faults are located in the campaign file."""
        changes = {f"{key}={json.dumps(value)}": _place(name, variant, key) for key, value in overrides.items()}
        plugins: dict[str, Any] = {"controllers": self.classes.controllers, "estimators": self.classes.estimators}
        scenario = self._scenario(name, variant)
        try:
            return prepare(scenario, list(changes), **plugins)
        except InputError as error:
            faults = zip(error.lines, override_faults(error, changes), strict=True)
            raise InputError([line if fault is None else self.source.line(fault) for line, fault in faults]) from error

    def _scenario(self, name: str, variant: VariantConfig | None) -> Scenario | Path:
        """Scenario of a campaign or of a variant.

        Raises:
            InputError: There is none.
        """
        replaced = variant is not None and variant.scenario is not None
        if self.base is not None and not replaced:
            return self.base
        text = variant.scenario if variant is not None and variant.scenario is not None else self.config.scenario
        place: KeyPath = ("variants", name, "scenario") if replaced else ("scenario",)
        relative = text.endswith((".yaml", ".yml")) or "/" in text
        try:
            return scenario_path(self.source.folder(place) / text if relative else text)
        except InputError as error:
            raise InputError([self.source.line(Fault(line, place)) for line in error.lines]) from error

    def _only_its_laws_fail(self, name: str, variant: VariantConfig) -> bool:
        """Whether all that is wrong with a variant is that its control laws cannot be created for its scenario.

        Its scenario file with the laws is then valid, and without them a run can be prepared.
        """
        if not variant.controllers:
            return False
        replaced = tuple(f"phases.{phase}.controller" for phase in variant.controllers)
        others = {key: value for key, value in variant.overrides.items() if not key.startswith(replaced)}
        changes = as_texts(variant.overrides_after(self.config.overrides))
        try:
            scenario = self._scenario(name, variant)
            if isinstance(scenario, Scenario):
                scenario.with_overrides(changes)
            else:
                load_scenario(scenario, changes, self.classes.controllers, self.classes.estimators)
            self.plan(name, variant.model_copy(update={"controllers": {}, "overrides": others}))
        except InputError:
            return False
        return True

    def _refuse_metrics(self, prepared: PreparedRun) -> None:
        """Refuse names that are not metrics, and metrics of the caller with the name of a built-in one.

        Raises:
            ScenarioFaults: One fault per name.
        """
        actuators = [identifier(name) for name in prepared.system.names("actuator")]
        places: dict[str, KeyPath] = {}
        for name, path in self.config.named_metrics():
            places.setdefault(name, path)
        with Faults() as faults:
            for name, path in places.items():
                if (fault := fault_of(name, actuators, self.classes.metrics)) is not None:
                    faults.add(fault, *path)
            for name in self.classes.metrics:
                if fault_of(name, actuators) is None:
                    faults.add(f"{name} is a built-in metric; give the function another name", "metrics")


def _place(name: str, variant: VariantConfig | None, key: str) -> KeyPath:
    """Where an override stands in the campaign file."""
    if variant is not None and key in variant.overrides:
        return ("variants", name, "overrides", key)
    phases = (phase for phase in variant.controllers if variant.law_key(phase) == key) if variant is not None else ()
    return next((("variants", name, "controllers", phase) for phase in phases), ("overrides", key))


def described(plan: Plan | VariantsPlan) -> list[str]:
    """Lines that describe a campaign: its variants, the runs of the first one, and its base scenario."""
    if isinstance(plan, Plan):
        return _description(plan, plan.design())
    config = plan.config
    first, *others = plan.variants.values()
    design = first.design()
    width = max(map(len, config.variants))
    lines = [
        f"{config.campaign}: valid",
        f"  {plural(len(plan.variants), 'variant')} of {plural(len(design.rows), 'run')} each, with the same samples",
    ]
    for name, variant in config.variants.items():
        changes = [f"{key} = {_kind(value)}" for key, value in variant.overrides_after({}).items()]
        if variant.scenario is not None:
            changes.insert(0, f"scenario {variant.scenario}")
        lines.append(f"  {name:{width}}  {', '.join(changes) or 'as the scenario'}")
    lines += [f"not applicable: {name}: {reason}" for name, reason in plan.not_applicable.items()]
    for planned in others:
        planned.design()  # refuses samples that the scenario of the variant does not accept
    if plan.classes.metrics:
        lines.append(f"  own metrics: {', '.join(plan.classes.metrics)}")
    lines += [f"variant {line}" if not i else line for i, line in enumerate(_description(first, design))]
    return [*lines, *(f"note: {note}" for planned in others for note in instabilities(planned))]


def instabilities(plan: Plan | VariantsPlan) -> list[str]:
    """Notes on unstable gains of control laws in the base scenario of a campaign or of its variants, which they name."""
    if isinstance(plan, VariantsPlan):
        return [note for variant in plan.variants.values() for note in instabilities(variant)]
    try:
        return [f"{plan.config.campaign}: {note}" for note in plan.base.instabilities()]
    except InputError:
        return []  # it cannot start as it is; runs with other initial values may


def _kind(value: object) -> str:
    """A value of an override; of a control law its kind, of one in parts the kinds of these."""
    if isinstance(value, Mapping):
        if "kind" in value:
            return f"kind {value['kind']}"
        if value and all(isinstance(part, Mapping) and "kind" in part for part in value.values()):
            return ", ".join(f"{name} of kind {part['kind']}" for name, part in value.items())
    return write_flow(plain(value))


def _description(plan: Plan, design: Design) -> list[str]:
    """Lines that describe the runs of a campaign, then its base scenario."""
    config = plan.config
    size = (
        f"{design.n} x ({len(design.parameters)} + 2) runs" if design.kind == "saltelli" else plural(len(design.rows), "run")
    )
    chance = "every combination" if design.kind == "grid" else f"{design.kind}, seed {design.seed}"
    lines = [f"{config.campaign}: valid", f"  {size} of {plan.base.scenario.name} ({chance})"]
    for column, name in enumerate(design.parameters):
        keys = [binding.key for binding in plan.bindings if any(column in effect.columns for effect in binding.effects)]
        values = [row[column] for row in design.rows]
        lines.append(f"  {name}: {_range(values)}, sets {', '.join(keys)}")
    lines.append(f"  metrics: {', '.join(config.all_metrics) or 'only those of every run'}")
    if config.success is not None:
        lines.append(f"  success: {config.success}")
    lines += [f"  base {line}" if line.startswith(plan.base.scenario.name) else line for line in plan.base.describe()]
    return [*lines, *(f"note: {note}" for note in _runs_that_cannot_start(plan, design))]


def _runs_that_cannot_start(plan: Plan, design: Design) -> Iterator[str]:
    """Notes on runs with the smallest and largest values that will fail at the start."""
    for run in extreme_rows(design):
        source = plan.base.source.overridden(as_texts(design.overrides(run)))
        try:
            plan.base.changed(source).assemble()
        except InputError as error:
            yield f"run {run} cannot start: {error.lines[0]}"


def _range(values: Sequence[object]) -> str:
    numbers = [value for value in values if isinstance(value, int | float) and not isinstance(value, bool)]
    if len(numbers) == len(values):
        return f"{min(numbers):.6g} to {max(numbers):.6g}"
    return ", ".join(dict.fromkeys(map(str, values)))
