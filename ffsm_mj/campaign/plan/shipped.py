"""Paths of campaign files, and names of the shipped campaigns."""

from __future__ import annotations

import os
from pathlib import Path

from ffsm_mj.errors import InputError, unknown_name
from ffsm_mj.scenario.shipped import scenarios_dir
from ffsm_mj.similar_names import similar_file
from ffsm_mj.yaml.parser import read_node


def campaigns_dir() -> Path:
    """Folder of the shipped campaigns; the shipped scenarios are in its parent."""
    return scenarios_dir() / "campaigns"


def campaign_names() -> tuple[str, ...]:
    """Names that ``ffsm campaign run NAME`` accepts, sorted."""
    return tuple(sorted(path.stem for path in campaigns_dir().glob("*.yaml")))


def campaign_path(campaign: str | Path) -> Path:
    """Path of a campaign file from a path or the name of a shipped campaign.

    Raises:
        InputError: The text is neither a file nor the name of a shipped campaign.
    """
    text = str(campaign)
    if os.path.exists(text) and text not in campaign_names():
        return Path(campaign)
    if text.endswith((".yaml", ".yml")) or "/" in text:
        raise InputError(f"{text}: no such campaign file{similar_file(Path(text))}")
    if text not in campaign_names():
        raise InputError(f"{text}: no such file, and {unknown_name('shipped campaign', text, campaign_names())}")
    return campaigns_dir() / f"{text}.yaml"


def is_campaign(given: str | Path) -> bool:
    """Whether a path or name is that of a campaign, not of a scenario."""
    try:
        return os.path.isfile(path := campaign_path(given)) and "campaign" in read_node(path).value
    except InputError:
        return False  # it is then read as a scenario, which reports the fault
