"""Configuration model of study files: typed, validated and immutable."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, PositiveFloat, PositiveInt, field_validator

from ffsm_mj.campaign.plan.config import NAME_PATTERN, DispersedRuns, Name, without_duplicates
from ffsm_mj.config import StrictModel

VariantName = Annotated[str, Field(pattern=NAME_PATTERN)]
MetricNames = Annotated[tuple[Name, ...], AfterValidator(without_duplicates)]
Direction = Literal["minimize", "maximize"]


class VariantConfig(StrictModel):
    """One of the variants that a study compares: what it changes in the scenario of the study."""

    description: str = ""
    """One line for the report."""
    scenario: Name | None = None
    """A scenario file or the name of a shipped scenario, in place of that of the study."""
    controllers: dict[Name, dict[Name, Any]] = {}
    """Control laws by phase: each replaces the ``controller`` of the phase, its kind included."""
    overrides: dict[Name, Any] = {}
    """Overrides of the scenario, by dotted key, applied after those of the study and after ``controllers``."""

    def overrides_after(self, shared: dict[str, Any]) -> dict[str, Any]:
        """Overrides of the study, then those of the variant, in the order in which they are applied."""
        own = {f"phases.{phase}.controller": law for phase, law in self.controllers.items()} | self.overrides
        return {key: value for key, value in shared.items() if key not in own} | own


class MetricsConfig(StrictModel):
    """Metrics of each run, with a Python file that defines some of them."""

    file: Name
    """Python file, relative to the study file: each function of a run without a leading underscore is a metric."""
    names: MetricNames = ()
    """Further metrics, as in a list of metrics."""


class ParetoConfig(StrictModel):
    """Metrics of the figure of error against effort."""

    error: Name
    """Metric of the vertical axis."""
    effort: Name
    """Metric of the horizontal axis."""


class StudyLimits(StrictModel):
    """Limits of runs."""

    timeout_s: PositiveFloat | None = None
    """Largest wall time of a run, s."""
    workers: PositiveInt | None = None
    """Number of worker processes; default: one per processor."""


class StudyFile(DispersedRuns):
    """A study: variants of a scenario, all run with the same samples of its dispersed keys, and compared run by run."""

    study: Annotated[str, Field(pattern=NAME_PATTERN)]
    """Name of the study: letters, digits, '.', '_' and '-'."""
    variants: Annotated[dict[VariantName, VariantConfig], Field(min_length=2)]
    """Variants by name, at least two; ``{}`` is the scenario as it is."""
    metrics: MetricNames | MetricsConfig = ()
    """Metrics of each run, as in a campaign: a list of names; or a Python file with further names."""
    objectives: dict[Name, Direction] = {}
    """Whether less or more of a metric is better; only these metrics have a best variant."""
    reference: Name | None = None
    """Variant with which the others are compared; default: every variant is compared with every other."""
    pareto: ParetoConfig | None = None
    limits: StudyLimits = StudyLimits()

    @field_validator("metrics", mode="before")
    @classmethod
    def _list_or_mapping(cls, value: Any) -> Any:
        if not isinstance(value, list | tuple | dict | MetricsConfig):
            raise ValueError("should be a list of names, or a mapping with 'file' and 'names'")
        return value

    @property
    def metrics_file(self) -> str | None:
        """Python file with metrics; None if the study names none."""
        return self.metrics.file if isinstance(self.metrics, MetricsConfig) else None

    @property
    def metric_names(self) -> tuple[str, ...]:
        """Metrics that the file names under ``metrics``, ``objectives`` and ``pareto``, without duplicates."""
        return tuple(dict.fromkeys(name for name, _ in self.named_metrics()))

    def named_metrics(self) -> Iterator[tuple[str, tuple[str | int, ...]]]:
        """These metrics, each with its location in the file."""
        listed = isinstance(self.metrics, MetricsConfig)
        for i, name in enumerate(self.metrics.names if isinstance(self.metrics, MetricsConfig) else self.metrics):
            yield name, ("metrics", "names", i) if listed else ("metrics", i)
        for name in self.objectives:
            yield name, ("objectives", name)
        if self.pareto is not None:
            yield self.pareto.error, ("pareto", "error")
            yield self.pareto.effort, ("pareto", "effort")
