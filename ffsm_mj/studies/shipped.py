"""Paths of study files, and names of the shipped studies."""

from __future__ import annotations

from ffsm_mj.campaign.plan.shipped import ShippedFiles

STUDIES = ShippedFiles("study", "studies")
