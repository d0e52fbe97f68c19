"""Sensitivities in the folder of a run: what ``ffsm run`` found for the ``uncertainties`` of its scenario."""

from __future__ import annotations

import html
import json
from typing import Any

from ffsm_mj.analysis.run import Run
from ffsm_mj.errors import one_line
from ffsm_mj.log.run_folder import SUMMARY

KEY = "sensitivity"
"""Key of ``summary.json``."""
_MOST = 50


def stated_sensitivity(run: Run) -> list[str]:
    """Sentences of ``summary.json`` beside the log of a run; none where there are none. They are not recomputed."""
    if run.path is None:
        return []
    try:
        summary: Any = json.loads((run.path.parent / SUMMARY).read_text(encoding="utf-8"))
        sentences = summary[KEY]["sentences"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return []
    if not isinstance(sentences, list):
        return []
    return [one_line(each) for each in sentences[:_MOST] if isinstance(each, str)]


def sensitivity_html(run: Run) -> str:
    """The sentences as a section of the page; empty where there are none."""
    sentences = stated_sensitivity(run)
    if not sentences:
        return ""
    lines = "\n".join(f"<li>{html.escape(sentence)}</li>" for sentence in sentences)
    note = '<p class="note">From runs at both sides of each standard deviation.</p>'
    return f"<h2>Uncertainties</h2>\n<ul>\n{lines}\n</ul>\n{note}"
