"""A campaign file: everything that is stated of a campaign, typed, validated and frozen."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, PositiveFloat, PositiveInt, field_validator, model_validator

from ffsm_mj.campaign.plan.dispersions import Dispersion
from ffsm_mj.campaign.plan.success import Condition, conditions
from ffsm_mj.config import StrictModel

Name = Annotated[str, Field(min_length=1)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]
_MOST_RUNS = 10_000_000


class SamplesConfig(StrictModel):
    """How the runs fill the space of what is dispersed."""

    kind: Literal["random", "lhs", "sobol", "saltelli", "grid"]
    """``random``: independent; ``lhs``: Latin hypercube; ``sobol``: scrambled Sobol points; ``saltelli``: for Sobol indices;
    ``grid``: every combination of levels."""
    n: Annotated[int, Field(ge=1, le=_MOST_RUNS)] | None = None
    """Runs; of ``sobol`` and ``saltelli`` a power of 2, which makes n (d + 2) runs; a grid has as many as its levels."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Root of all chance."""

    @model_validator(mode="after")
    def _as_many_as_the_kind_takes(self) -> SamplesConfig:
        if self.kind == "grid":
            if self.n is not None:
                raise ValueError("a grid has as many runs as combinations of its levels; leave n out")
            return self
        if self.n is None:
            raise ValueError("needs 'n', how many runs; only a grid has none")
        if self.kind in ("sobol", "saltelli") and self.n & (self.n - 1):
            below = 1 << (self.n.bit_length() - 1)
            raise ValueError(f"n must be a power of 2 for {self.kind}: {below} or {2 * below}, not {self.n}")
        return self


class KeepConfig(StrictModel):
    """Runs whose whole logs are wanted; they are run again from the design."""

    failures: Annotated[int, Field(ge=0)] = 0
    """The first so many that failed."""
    worst: dict[Name, PositiveInt] = {}
    """By metric: so many runs with its largest values."""


class LimitsConfig(StrictModel):
    """When a run, or the campaign, is given up."""

    timeout_s: PositiveFloat | None = None
    """Wall time that a run may take, s."""
    max_failed: Share = 0.5
    """The campaign stops when more than this share of its first 50 runs failed."""
    workers: PositiveInt | None = None
    """Processes; left out: as many as there are processors."""


class StopConfig(StrictModel):
    """End early, once an interval is narrow enough; it is looked at only when a power of 2 of the runs is there."""

    metric: Name
    """``success``, whose interval is that of its share, or a metric, whose interval is that of its median."""
    width: PositiveFloat
    """Width of the 95 % interval at which the campaign ends."""


class CampaignFile(StrictModel):
    """A campaign: one scenario, run many times with dispersed keys."""

    campaign: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")]
    """Its name: letters, digits, '.', '_' and '-'."""
    description: str = ""
    """One line for ``ffsm campaign run --list``."""
    scenario: Name
    """A scenario file, relative to this one, or the name of a shipped scenario."""
    overrides: dict[Name, Any] = {}
    """Values that all runs take in place of the scenario's, by dotted key."""
    samples: SamplesConfig
    dispersions: Annotated[dict[Name, Dispersion], Field(min_length=1)]
    """What is drawn: by key of the scenario, or by a name of one's own with ``keys``."""
    metrics: tuple[Name, ...] = ()
    """What is kept of each run: paths into ``summary.json``, and what docs/campaigns.md lists."""
    success: str | None = None
    """When a run that completed is a success: ``METRIC < NUMBER``, several joined by ``and``."""
    truncated: Literal["count", "fail"] = "count"
    """Runs whose checks fail by the truncation of the step alone: they ``count`` as those that pass, or ``fail``."""
    keep: KeepConfig = KeepConfig()
    limits: LimitsConfig = LimitsConfig()
    stop: StopConfig | None = None

    @field_validator("metrics")
    @classmethod
    def _each_once(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        twice = next((name for name in value if value.count(name) > 1), None)
        if twice is not None:
            raise ValueError(f"{twice} stands twice")
        return value

    @field_validator("success")
    @classmethod
    def _is_one(cls, value: str | None) -> str | None:
        if value is not None:
            conditions(value)
        return value

    @property
    def conditions(self) -> tuple[Condition, ...]:
        """What a run must fulfil to be a success; empty where nothing is asked for."""
        return conditions(self.success) if self.success is not None else ()

    @property
    def kept_metrics(self) -> tuple[str, ...]:
        """Every metric that is asked for, by whatever key, each once."""
        asked = [*self.metrics, *(each.metric for each in self.conditions), *self.keep.worst]
        if self.stop is not None and self.stop.metric != "success":
            asked.append(self.stop.metric)
        return tuple(dict.fromkeys(asked))
