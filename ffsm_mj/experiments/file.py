"""Campaign files: typed, validated and immutable; the shipped ones, and their JSON Schema for editors."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, PositiveFloat, PositiveInt, field_validator, model_validator

from ffsm_mj.conditions import Condition, conditions
from ffsm_mj.config import StrictModel
from ffsm_mj.errors import Fault, InputError, unknown_name
from ffsm_mj.experiments.distributions import Dispersion
from ffsm_mj.scenario.shipped import scenarios_dir
from ffsm_mj.similar_names import similar_file
from ffsm_mj.yaml import read_node

Name = Annotated[str, Field(min_length=1)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]
NAME_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9._-]*$"
"""Names of campaigns and variants, which are names of folders."""
_MOST_RUNS = 10_000_000
OLD_KEY = "study"
"""Key of version 0.2 for the name of a campaign with variants."""


Kind = Literal["random", "lhs", "sobol", "saltelli", "grid"]
"""``random``: independent; ``lhs``: Latin hypercube; ``sobol``: scrambled Sobol points; ``saltelli``: for Sobol indices;
``grid``: every combination of levels."""


class SamplesConfig(StrictModel):
    """Sampling of the dispersed parameters."""

    kind: Kind
    """``random``: independent; ``lhs``: Latin hypercube; ``sobol``: scrambled Sobol points; ``saltelli``: for Sobol indices;
    ``grid``: every combination of levels."""
    n: Annotated[int, Field(ge=1, le=_MOST_RUNS)] | None = None
    """Number of samples; a power of 2 for ``sobol`` and ``saltelli``, which gives n (d + 2) runs; not for ``grid``."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Seed of the random numbers."""

    @model_validator(mode="after")
    def _validate_n(self) -> SamplesConfig:
        if self.kind == "grid":
            if self.n is not None:
                raise ValueError("a grid has one run per combination of its levels; leave n out")
            return self
        if self.n is None:
            raise ValueError("needs 'n', the number of samples; only a grid has none")
        if self.kind in ("sobol", "saltelli") and self.n & (self.n - 1):
            below = 1 << (self.n.bit_length() - 1)
            raise ValueError(f"n must be a power of 2 for {self.kind}: {below} or {2 * below}, not {self.n}")
        return self


class KeepConfig(StrictModel):
    """Runs whose logs are written; they are repeated from the design at the end of the campaign."""

    failures: Annotated[int, Field(ge=0)] = 0
    """Number of failed runs, the first ones."""
    worst: dict[Name, PositiveInt] = {}
    """Number of runs with the largest values of a metric, by metric."""


class LimitsConfig(StrictModel):
    """Limits of runs and of the campaign."""

    timeout_s: PositiveFloat | None = None
    """Largest wall time of a run, s."""
    max_failed: Share | None = None
    """The campaign stops if more than this fraction of its first 50 runs fails; default: 0.5, and 1 with variants."""
    workers: PositiveInt | None = None
    """Number of worker processes; default: one per processor."""


class StopConfig(StrictModel):
    """Early end of the campaign when a confidence interval is narrow enough; evaluated after 2^k runs."""

    metric: Name
    """``success``, for the interval of the fraction of successes, or a metric, for the interval of its median."""
    width: PositiveFloat
    """Width of the 95 % interval at which the campaign ends."""


def without_duplicates(names: tuple[str, ...]) -> tuple[str, ...]:
    """The names as given.

    Raises:
        ValueError: A name is listed twice.
    """
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ValueError(f"{twice} is listed twice")
    return names


MetricNames = Annotated[tuple[Name, ...], AfterValidator(without_duplicates)]
Direction = Literal["minimize", "maximize"]


class MetricsConfig(StrictModel):
    """Metrics of each run, with a Python file that defines some of them."""

    file: Name
    """Python file, relative to the campaign file: each function of a run without a leading underscore is a metric."""
    names: MetricNames = ()
    """Further metrics, as in a list of metrics."""


class VariantConfig(StrictModel):
    """One of the variants that a campaign compares: what it changes in the scenario of the campaign."""

    description: str = ""
    """One line for the report."""
    scenario: Name | None = None
    """A scenario file or the name of a shipped scenario, in place of that of the campaign."""
    controllers: dict[Name, dict[Name, Any]] = {}
    """Control laws by phase: each replaces ``controller`` or ``controllers`` of the phase, its kind included. Of several
    parts ``{PART: {kind: ...}, ...}``, as in ``controllers`` of a phase."""
    overrides: dict[Name, Any] = {}
    """Overrides of the scenario, by dotted key, applied after those of the campaign and after ``controllers``."""

    def overrides_after(self, shared: dict[str, Any]) -> dict[str, Any]:
        """Overrides of the campaign, then those of the variant, in the order in which they are applied."""
        changes = {self.law_key(phase): law for phase, law in self.controllers.items()} | self.overrides
        return {key: value for key, value in shared.items() if key not in changes} | changes

    def law_key(self, phase: str) -> str:
        """Key of the scenario that the law of a phase replaces: that of parts, if each of its keys has one."""
        law = self.controllers[phase]
        in_parts = bool(law) and "kind" not in law and all(isinstance(part, Mapping) for part in law.values())
        return f"phases.{phase}.{'controllers' if in_parts else 'controller'}"


class ParetoConfig(StrictModel):
    """Metrics of the figure of error against effort."""

    error: Name
    """Metric of the vertical axis."""
    effort: Name
    """Metric of the horizontal axis."""


class CampaignFile(StrictModel):
    """A campaign: a scenario, run many times with dispersed keys; with variants, each with the same samples."""

    campaign: Annotated[str, Field(pattern=NAME_PATTERN)]
    """Name of the campaign: letters, digits, '.', '_' and '-'."""
    description: str = ""
    """One line for ``run --list``."""
    scenario: Name
    """A scenario file, relative to this file, or the name of a shipped scenario."""
    overrides: dict[Name, Any] = {}
    """Overrides of the scenario for all runs, by dotted key."""
    samples: SamplesConfig
    dispersions: Annotated[dict[Name, Dispersion], Field(min_length=1)]
    """Dispersions by key of the scenario, or by a free name with ``keys``."""
    variants: dict[Annotated[str, Field(pattern=NAME_PATTERN)], VariantConfig] = {}
    """Variants of the scenario by name, at least two, compared run by run; ``{}`` is the scenario as it is."""
    metrics: MetricNames | MetricsConfig = ()
    """Metrics of each run: paths into ``summary.json``, and those listed in docs/campaigns.md; or a Python file with
    further names."""
    success: str | None = None
    """Condition for the success of a completed run: ``METRIC < NUMBER``, several joined by ``and``."""
    truncated: Literal["count", "fail"] = "count"
    """Whether runs whose checks fail by the truncation of the step alone pass (``count``) or fail (``fail``)."""
    keep: KeepConfig = KeepConfig()
    limits: LimitsConfig = LimitsConfig()
    stop: StopConfig | None = None
    objectives: dict[Name, Direction] = {}
    """Whether less or more of a metric is better; only these metrics have a best variant."""
    reference: Name | None = None
    """Variant with which the others are compared; default: every variant is compared with every other."""
    pareto: ParetoConfig | None = None

    @field_validator("success")
    @classmethod
    def _validate_success(cls, value: str | None) -> str | None:
        if value is not None:
            conditions(value)
        return value

    @field_validator("variants")
    @classmethod
    def _validate_variants(cls, value: dict[str, VariantConfig]) -> dict[str, VariantConfig]:
        if len(value) == 1:
            raise ValueError("needs at least 2 variants; leave the key out for a campaign without")
        return value

    @field_validator("metrics", mode="before")
    @classmethod
    def _validate_metrics(cls, value: Any) -> Any:
        if not isinstance(value, list | tuple | dict | MetricsConfig):
            raise ValueError("should be a list of names, or a mapping with 'file' and 'names'")
        return value

    def with_samples(self, n: int) -> CampaignFile:
        """The file with another number of samples."""
        return self.model_copy(update={"samples": self.samples.model_copy(update={"n": n})})

    @property
    def conditions(self) -> tuple[Condition, ...]:
        """Conditions for the success of a run; empty if there are none."""
        return conditions(self.success) if self.success is not None else ()

    @property
    def max_failed(self) -> float:
        """Fraction of failures among the first runs above which the campaign stops."""
        default = 1.0 if self.variants else 0.5
        return default if self.limits.max_failed is None else self.limits.max_failed

    @property
    def metrics_file(self) -> str | None:
        """Python file with metrics; None if the campaign names none."""
        return self.metrics.file if isinstance(self.metrics, MetricsConfig) else None

    @property
    def all_metrics(self) -> tuple[str, ...]:
        """All metrics that any key of the file names, without duplicates."""
        return tuple(dict.fromkeys(name for name, _ in self.named_metrics()))

    def named_metrics(self) -> Iterator[tuple[str, tuple[str | int, ...]]]:
        """These metrics, each with its location in the file."""
        listed: tuple[str | int, ...] = ("metrics",)
        names = self.metrics
        if isinstance(names, MetricsConfig):
            listed, names = ("metrics", "names"), names.names
        yield from ((name, (*listed, i)) for i, name in enumerate(names))
        yield from ((name, ("objectives", name)) for name in self.objectives)
        if self.pareto is not None:
            yield self.pareto.error, ("pareto", "error")
            yield self.pareto.effort, ("pareto", "effort")
        yield from ((condition.metric, ("success",)) for condition in self.conditions)
        yield from ((name, ("keep", "worst", name)) for name in self.keep.worst)
        if self.stop is not None and self.stop.metric != "success":
            yield self.stop.metric, ("stop", "metric")

    def faults(self) -> Iterator[Fault]:
        """Keys that do not agree with others."""
        if not self.variants:
            for key in ("objectives", "reference", "pareto"):
                if getattr(self, key):
                    yield Fault("compares variants, and the campaign has none: add 'variants'", (key,))
        elif self.stop is not None:
            yield Fault("variants are compared over the same runs, all of which are executed; leave it out", ("stop",))
        elif self.reference is not None and self.reference not in self.variants:
            yield Fault(unknown_name("variant", self.reference, self.variants), ("reference",))
        if self.stop is not None and self.stop.metric == "success" and self.success is None:
            yield Fault("the campaign has no success condition: set 'success', or name a metric", ("stop", "metric"))
        axes = {} if self.pareto is None else {"error": self.pareto.error, "effort": self.pareto.effort}
        for axis, name in axes.items():
            if self.objectives.get(name) == "maximize":
                yield Fault(f"less of {name} is better here, but objectives says 'maximize'", ("pareto", axis))


def campaigns_dir() -> Path:
    """Folder of the shipped campaigns; the shipped scenarios are in its parent."""
    return scenarios_dir() / "campaigns"


def campaign_names() -> tuple[str, ...]:
    """Names of the shipped campaigns, which commands accept, sorted."""
    return tuple(sorted(path.stem for path in campaigns_dir().glob("*.yaml")))


def campaign_path(path: str | Path) -> Path:
    """Path of a campaign file from a path or the name of a shipped campaign.

    Raises:
        InputError: The text is neither a file nor the name of a shipped one.
    """
    text = str(path)
    if os.path.exists(text) and text not in campaign_names():
        return Path(path)
    if text.endswith((".yaml", ".yml")) or "/" in text:
        raise InputError(f"{text}: no such campaign file{similar_file(Path(text))}")
    if text not in campaign_names():
        raise InputError(f"{text}: no such file, and {unknown_name('shipped campaign', text, campaign_names())}")
    return campaigns_dir() / f"{text}.yaml"


def described_campaigns() -> dict[str, str]:
    """Descriptions of the shipped campaigns by name."""
    return {name: str(read_node(campaign_path(name)).plain().get("description", "")) for name in campaign_names()}


def is_campaign(source: str | Path) -> bool:
    """Whether a path or name is that of a campaign, not of a scenario."""
    try:
        return os.path.isfile(path := campaign_path(source)) and not {"campaign", OLD_KEY}.isdisjoint(read_node(path).value)
    except InputError:
        return False  # it is then read as a scenario, which reports the fault


def campaign_schema() -> dict[str, Any]:
    """JSON Schema of campaign files, for editors."""
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema"}
    return head | CampaignFile.model_json_schema() | {"title": "ffsm-mj campaign"}
