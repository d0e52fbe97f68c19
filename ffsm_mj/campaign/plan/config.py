"""Configuration model of campaign files: typed, validated and immutable."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, PositiveFloat, PositiveInt, field_validator, model_validator

from ffsm_mj.campaign.plan.dispersions import Dispersion
from ffsm_mj.conditions import Condition, conditions
from ffsm_mj.config import StrictModel

Name = Annotated[str, Field(min_length=1)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]
NAME_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9._-]*$"
"""Names of campaigns, studies and variants, which are names of folders."""
_MOST_RUNS = 10_000_000


class SamplesConfig(StrictModel):
    """Sampling of the dispersed parameters."""

    kind: Literal["random", "lhs", "sobol", "saltelli", "grid"]
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
    max_failed: Share = 0.5
    """The campaign stops if more than this fraction of its first 50 runs fails."""
    workers: PositiveInt | None = None
    """Number of worker processes; default: one per processor."""


class StopConfig(StrictModel):
    """Early end of the campaign when a confidence interval is narrow enough; evaluated after 2^k runs."""

    metric: Name
    """``success``, for the interval of the fraction of successes, or a metric, for the interval of its median."""
    width: PositiveFloat
    """Width of the 95 % interval at which the campaign ends."""


class DispersedRuns(StrictModel):
    """What a campaign and a study have in common: dispersed runs of a scenario, and what is recorded of each."""

    description: str = ""
    """One line for ``run --list``."""
    scenario: Name
    """A scenario file, relative to this file, or the name of a shipped scenario."""
    overrides: dict[Name, Any] = {}
    """Overrides of the scenario for all runs, by dotted key."""
    samples: SamplesConfig
    dispersions: Annotated[dict[Name, Dispersion], Field(min_length=1)]
    """Dispersions by key of the scenario, or by a free name with ``keys``."""
    success: str | None = None
    """Condition for the success of a completed run: ``METRIC < NUMBER``, several joined by ``and``."""
    truncated: Literal["count", "fail"] = "count"
    """Whether runs whose checks fail by the truncation of the step alone pass (``count``) or fail (``fail``)."""

    @field_validator("success")
    @classmethod
    def _validate_success(cls, value: str | None) -> str | None:
        if value is not None:
            conditions(value)
        return value

    @property
    def conditions(self) -> tuple[Condition, ...]:
        """Conditions for the success of a run; empty if there are none."""
        return conditions(self.success) if self.success is not None else ()


def without_duplicates(names: tuple[str, ...]) -> tuple[str, ...]:
    """The names as given.

    Raises:
        ValueError: A name is listed twice.
    """
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ValueError(f"{twice} is listed twice")
    return names


class CampaignFile(DispersedRuns):
    """A campaign: one scenario, run many times with dispersed keys."""

    campaign: Annotated[str, Field(pattern=NAME_PATTERN)]
    """Name of the campaign: letters, digits, '.', '_' and '-'."""
    metrics: Annotated[tuple[Name, ...], AfterValidator(without_duplicates)] = ()
    """Metrics of each run: paths into ``summary.json``, and those listed in docs/campaigns.md."""
    keep: KeepConfig = KeepConfig()
    limits: LimitsConfig = LimitsConfig()
    stop: StopConfig | None = None

    @property
    def kept_metrics(self) -> tuple[str, ...]:
        """All metrics that any key of the file names, without duplicates."""
        names = [*self.metrics, *(each.metric for each in self.conditions), *self.keep.worst]
        if self.stop is not None and self.stop.metric != "success":
            names.append(self.stop.metric)
        return tuple(dict.fromkeys(names))
