"""Sampling of a design: points of the unit cube, mapped by the inverse distribution functions."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from zlib import crc32

from ffsm_mj.campaign.plan.config import CampaignFile
from ffsm_mj.campaign.plan.design import Binding, Design
from ffsm_mj.campaign.plan.dispersions import Dispersion, SampledScalar, sampled_scalars
from ffsm_mj.campaign.plan.sampler import samples
from ffsm_mj.errors import Fault, ScenarioFaults

_MOST_ROWS = 10_000_000


def sample_design(
    kind: str, n: int, seed: int, sampled_scalars: Sequence[SampledScalar], bindings: Sequence[Binding]
) -> Design:
    """Sample the design of a campaign; equal arguments give equal designs.

    For kinds of samples that can be extended, the first rows do not depend on n.

    Raises:
        ScenarioFaults: A distribution exceeds the range of floating-point numbers.
    """
    names = tuple(scalar.name for scalar in sampled_scalars)
    levels = [len(scalar.distribution.levels or ()) for scalar in sampled_scalars]
    points = samples(kind, n, seed, names, levels)
    values = [scalar.distribution.quantiles(points[:, k], scalar.mean) for k, scalar in enumerate(sampled_scalars)]
    for scalar, column in zip(sampled_scalars, values, strict=True):
        if not all(abs(value) <= sys.float_info.max for value in column if isinstance(value, int | float)):
            raise ScenarioFaults([Fault("exceeds the range of floating-point numbers", ("dispersions", scalar.entry))])
    return Design(kind, seed, n or len(points), names, tuple(zip(*values, strict=True)), tuple(bindings))


def refuse_levels(config: CampaignFile) -> None:
    """Refuse levels without a grid, a grid without levels, and designs with too many runs.

    Raises:
        ScenarioFaults: One fault per dispersion.
    """
    faults, grid = [], config.samples.kind == "grid"
    rows = 1 if grid else (config.samples.n or 1)
    columns = 0
    for name, dispersion in config.dispersions.items():
        for scalar in sampled_scalars(name, dispersion):
            columns += 1
            levels = scalar.distribution.levels
            if grid and levels is None:
                faults.append(Fault("has no levels for a grid; write values, choice or grid", ("dispersions", name)))
                break
            if not grid and scalar.distribution.grid is not None:
                message = f"has levels of a grid, but the samples are of kind {config.samples.kind}; write values or uniform"
                faults.append(Fault(message, ("dispersions", name)))
            rows *= len(levels or ()) if grid else 1
    if config.samples.kind == "saltelli":
        rows *= columns + 2
    if not faults and rows > _MOST_ROWS:
        faults.append(Fault(f"gives {rows} runs; at most {_MOST_ROWS}", ("samples",)))
    if faults:
        raise ScenarioFaults(faults)


def columns(dispersions: Mapping[str, Dispersion]) -> tuple[SampledScalar, ...]:
    """Scalars sampled for each run, in the order of the file.

    Raises:
        ScenarioFaults: Two scalars have the same name, or the same stream of random numbers.
    """
    found: dict[int, SampledScalar] = {}
    for name, dispersion in dispersions.items():
        for scalar in sampled_scalars(name, dispersion):
            other = found.setdefault(crc32(scalar.name.encode()), scalar)
            if other is not scalar:
                same = "have one column" if other.name == scalar.name else "would have equal random numbers"
                raise ScenarioFaults(
                    [
                        Fault(
                            f"{scalar.name} and {other.name} {same}; rename one entry, with its keys under 'keys'",
                            ("dispersions", name),
                        )
                    ]
                )
    return tuple(found.values())
