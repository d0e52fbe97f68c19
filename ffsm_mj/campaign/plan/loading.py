"""Plan of a campaign: campaign file and base scenario validated, scenario compiled, dispersions bound to keys."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ffsm_mj.assembly.prepare import PreparedRun, Scenario, prepare, scenario_of
from ffsm_mj.campaign.plan.bindings import bind_dispersions
from ffsm_mj.campaign.plan.config import CampaignFile
from ffsm_mj.campaign.plan.design import Binding, Design
from ffsm_mj.campaign.plan.design_sampling import columns, refuse_levels, sample_design
from ffsm_mj.campaign.plan.dispersions import SampledScalar
from ffsm_mj.campaign.plan.metric_names import refuse_metrics
from ffsm_mj.campaign.plan.row_check import refuse_wrong_rows
from ffsm_mj.campaign.plan.sampler import EXTENDABLE
from ffsm_mj.campaign.plan.shipped import CAMPAIGNS
from ffsm_mj.campaign.plan.targets import Targets
from ffsm_mj.campaign.script_classes import NO_CLASSES, ScriptClasses
from ffsm_mj.errors import Fault, InputError, ScenarioFaults, one_line
from ffsm_mj.invocation import command, on_command_line, override
from ffsm_mj.scenario.faults import KindNames, plain_faults
from ffsm_mj.scenario.loading import stated_source
from ffsm_mj.scenario.scenario import located
from ffsm_mj.scenario.shipped import scenario_path
from ffsm_mj.scenario.source import YamlSource, source_of
from ffsm_mj.yaml.node import KeyPath
from ffsm_mj.yaml.parser import read_node


@dataclass(frozen=True, eq=False)
class Plan:
    """A validated campaign.

    Attributes:
        config: The campaign file.
        source: Locations of its keys.
        overrides: Overrides of the base scenario for all runs, ``key=json``.
        base: The compiled base scenario.
        scalars: Scalars that are sampled for each run.
        bindings: Keys of the scenario that the samples set.
    """

    config: CampaignFile
    source: YamlSource
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

    def _sampled(self, kind: str, n: int, seed: int) -> Design:
        try:
            design = sample_design(kind, n, seed, self.scalars, self.bindings)
        except ScenarioFaults as faults:
            raise located(faults, self.source) from faults
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


def load_campaign(
    campaign: Mapping[str, Any] | str | Path, overrides: Sequence[str] = (), own: ScriptClasses = NO_CLASSES
) -> Plan:
    """Read and validate a campaign; no design is sampled.

    Args:
        campaign: A file, the name of a shipped campaign, or the keys of one, with a scenario as :func:`ffsm_mj.run` takes.
        overrides: ``key=value`` overrides of the campaign file.
        own: Control laws and estimators of the caller, see :func:`ffsm_mj.run`.

    Raises:
        InputError: One line per fault, with file, line and column.
    """
    if isinstance(campaign, Mapping):
        return stated_plan(campaign, overrides, own)
    path = CAMPAIGNS.path(campaign)
    return make_plan(source_of(read_node(path, "campaign"), path).overridden(overrides), own)


def stated_plan(
    keys: Mapping[str, Any], overrides: Sequence[str] = (), own: ScriptClasses = NO_CLASSES, name: str = "campaign"
) -> Plan:
    """Validate a campaign that a program states; no design is sampled.

    Args:
        keys: Its keys; see :func:`load_campaign`.
        overrides: ``key=value`` overrides of them.
        own: Control laws and estimators of the caller, see :func:`ffsm_mj.run`.
        name: What it is.

    Raises:
        InputError: One line per fault, with its key.
    """
    given, stated, base = keys.get("scenario"), dict(keys), None
    if isinstance(given, Scenario | Mapping):
        base = scenario_of(given, controllers=own.controllers, estimators=own.estimators)
        stated["scenario"] = base.name
    return make_plan(stated_source(stated, name).overridden(overrides), own, base)


def make_plan(source: YamlSource, own: ScriptClasses = NO_CLASSES, base: Scenario | None = None) -> Plan:
    """Validate a campaign; no design is sampled.

    Args:
        source: Data of the campaign file and locations of its keys; paths are relative to the file.
        own: Control laws and estimators of the caller, see :func:`ffsm_mj.run`.
        base: Its scenario; None: the one that it names.

    Raises:
        InputError: One line per fault, with file, line and column.
    """
    if "campaign" not in source.data and "phases" in source.data:
        raise InputError(f"{source.path}: is a scenario, not a campaign; use {_to_run(source.path)}")
    try:
        config = CampaignFile.model_validate(source.data)
    except ValidationError as error:
        raise InputError(source.lines(plain_faults(error, KindNames(CampaignFile, (), (), {})))) from error
    return plan_of(config, source, own, base=base)


@dataclass(frozen=True)
class Places:
    """Where the keys of a campaign stand in the file that it was read from.

    Attributes:
        scenario: Place of the scenario.
        overrides: Places of overrides by their keys; those that are not listed stand in ``overrides``.
        metrics: Places of metrics by their names; those that are not listed stand in ``metrics``.
    """

    scenario: KeyPath = ("scenario",)
    overrides: Mapping[str, KeyPath] = field(default_factory=dict)
    metrics: Mapping[str, KeyPath] = field(default_factory=dict)

    def override(self, key: str) -> KeyPath:
        """Place of an override."""
        return self.overrides.get(key, ("overrides", key))


def plan_of(
    config: CampaignFile,
    source: YamlSource,
    own: ScriptClasses = NO_CLASSES,
    places: Places | None = None,
    base: Scenario | None = None,
) -> Plan:
    """Compile the base scenario of a campaign and bind its dispersions; no design is sampled.

    Args:
        config: The campaign.
        source: Locations of its keys; paths are relative to the file.
        own: Control laws, estimators and metrics of the caller.
        places: Where its keys stand in the source.
        base: Its scenario; None: the one that it names.

    Raises:
        InputError: One line per fault, with file, line and column.
    """
    places = places or Places()
    scenario = base_path(config.scenario, source, places) if base is None else base
    changes = {key: f"{key}={json.dumps(value)}" for key, value in config.overrides.items()}
    prepared = _base(scenario, changes, source, own, places)
    if prepared.origin is not None:
        message = "a campaign needs a scenario that begins at t = 0: each of its runs has a seed of its own"
        raise located(ScenarioFaults([Fault(message, ("initial", "from"))]), prepared.source)
    try:
        refuse_metrics(config, prepared.system, own.metrics, places.metrics)
        refuse_levels(config)
        scalars = columns(config.dispersions)
        bindings = bind_dispersions(config.dispersions, Targets(prepared))
    except ScenarioFaults as faults:
        raise located(faults, source) from faults
    return Plan(config, source, tuple(changes.values()), prepared, scalars, bindings)


def _to_run(scenario: Path) -> str:
    return f"'{command('run', scenario)}'" if on_command_line() else "ffsm_mj.run"


def base_path(text: str, source: YamlSource, places: Places) -> Path:
    """Path of the scenario that a file names.

    Raises:
        InputError: There is none.
    """
    relative = text.endswith((".yaml", ".yml")) or "/" in text
    try:
        return scenario_path(source.folder(places.scenario) / text if relative else text)
    except InputError as error:
        raise InputError([source.line(Fault(line, places.scenario)) for line in error.lines]) from error


def _base(
    scenario: Scenario | Path, changes: Mapping[str, str], source: YamlSource, own: ScriptClasses, places: Places
) -> PreparedRun:
    try:
        return prepare(scenario, list(changes.values()), controllers=own.controllers, estimators=own.estimators)
    except InputError as error:
        lines = []
        for line in error.lines:
            begins = {key: one_line(f"{override(change)}: ") for key, change in changes.items()}
            key = next((key for key, begin in begins.items() if line.startswith(begin)), None)
            lines.append(line if key is None else source.line(Fault(line.removeprefix(begins[key]), places.override(key))))
        raise InputError(lines) from error
