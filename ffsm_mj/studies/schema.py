"""JSON Schema of study files, for editors."""

from __future__ import annotations

from typing import Any

from ffsm_mj.studies.config import StudyFile


def study_schema() -> dict[str, Any]:
    """Schema of a study file."""
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema"}
    return head | StudyFile.model_json_schema() | {"title": "ffsm-mj study"}
