"""Drawing a design: points of the unit cube through the inverses of the distributions."""

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
    """The design of a campaign: the same for the same arguments; of what can be extended, the first rows for any n.

    Raises:
        ScenarioFaults: A distribution is so wide that numbers have no room for it.
    """
    names = tuple(draw.name for draw in sampled_scalars)
    levels = [len(draw.distribution.levels or ()) for draw in sampled_scalars]
    points = samples(kind, n, seed, names, levels)
    values = [draw.distribution.quantiles(points[:, k], draw.mean) for k, draw in enumerate(sampled_scalars)]
    for draw, column in zip(sampled_scalars, values, strict=True):
        if not all(abs(value) <= sys.float_info.max for value in column if isinstance(value, int | float)):
            raise ScenarioFaults([Fault("goes beyond the largest numbers that there are", ("dispersions", draw.entry))])
    return Design(kind, seed, n or len(points), names, tuple(zip(*values, strict=True)), tuple(bindings))


def refuse_levels(config: CampaignFile) -> None:
    """Refuse levels where none are asked for, the lack of them where they are, and designs without end.

    Raises:
        ScenarioFaults: A line for each dispersion.
    """
    faults, grid = [], config.samples.kind == "grid"
    rows = 1 if grid else (config.samples.n or 1)
    columns = 0
    for name, dispersion in config.dispersions.items():
        for draw in sampled_scalars(name, dispersion):
            columns += 1
            levels = draw.distribution.levels
            if grid and levels is None:
                faults.append(Fault("has no levels for a grid; write values, choice or grid", ("dispersions", name)))
                break
            if not grid and draw.distribution.grid is not None:
                message = f"levels of a grid, and the samples are {config.samples.kind}; write values or uniform"
                faults.append(Fault(message, ("dispersions", name)))
            rows *= len(levels or ()) if grid else 1
    if config.samples.kind == "saltelli":
        rows *= columns + 2
    if not faults and rows > _MOST_ROWS:
        faults.append(Fault(f"makes {rows} runs; at most {_MOST_ROWS}", ("samples",)))
    if faults:
        raise ScenarioFaults(faults)


def columns(dispersions: Mapping[str, Dispersion]) -> tuple[SampledScalar, ...]:
    """What is drawn for each run, in the order of the file.

    Raises:
        ScenarioFaults: Two draws would have one name, or one stream of chance.
    """
    found: dict[int, SampledScalar] = {}
    for name, dispersion in dispersions.items():
        for draw in sampled_scalars(name, dispersion):
            other = found.setdefault(crc32(draw.name.encode()), draw)
            if other is not draw:
                same = "have one column" if other.name == draw.name else "would be drawn alike"
                raise ScenarioFaults(
                    [
                        Fault(
                            f"{draw.name} and {other.name} {same}; rename one entry, with its keys under 'keys'",
                            ("dispersions", name),
                        )
                    ]
                )
    return tuple(found.values())
