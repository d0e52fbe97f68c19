"""Comparison of two campaigns: run by run, over the same samples."""

from __future__ import annotations

from pathlib import Path

from ffsm_mj.campaign.campaign import Campaign
from ffsm_mj.campaign.evaluation.paired import CampaignComparison, paired_comparison
from ffsm_mj.campaign.stored_campaign import StoredCampaign


def compare_campaigns(one: StoredCampaign | str | Path, other: StoredCampaign | str | Path) -> CampaignComparison:
    """Paired differences of the metrics of two campaigns with the same samples, with bootstrap intervals.

    Args:
        one: The first campaign, or its folder.
        other: The second one; differences are second less first.

    Raises:
        InputError: A folder holds no campaign, they have no run in common, or their samples differ.
    """
    first, second = (each if isinstance(each, StoredCampaign) else Campaign.open(each) for each in (one, other))
    names = _names(first.folder.path, second.folder.path)
    return paired_comparison(first.results(), second.results(), names)


def _names(one: Path, other: Path) -> tuple[str, str]:
    """Names of two folders: as much of the end of their paths as tells them apart."""
    first, second = one.resolve().parts, other.resolve().parts
    for length in range(1, max(len(first), len(second)) + 1):
        if first[-length:] != second[-length:]:
            return "/".join(first[-length:]), "/".join(second[-length:])
    return one.name, other.name
