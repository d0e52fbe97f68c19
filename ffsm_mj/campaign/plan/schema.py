"""JSON Schema of campaign files, for editors."""

from __future__ import annotations

from typing import Any

from ffsm_mj.campaign.plan.config import CampaignFile


def campaign_schema() -> dict[str, Any]:
    """Schema of a campaign file."""
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema"}
    return head | CampaignFile.model_json_schema() | {"title": "ffsm-mj campaign"}
