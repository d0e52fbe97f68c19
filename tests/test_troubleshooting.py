"""``docs/troubleshooting.md`` follows the code: messages that it quotes exist, outcomes of runs are all there."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import pytest

from ffsm_mj.records.events import Outcome

ROOT = Path(__file__).parent.parent
PAGE = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
FIRST_CELLS = re.findall(r"^\| (`.*?) \| ", PAGE, flags=re.MULTILINE)
OUTCOMES = {str(outcome) for outcome in Outcome}
QUOTED = [code for cell in FIRST_CELLS if "(of " not in cell for code in re.findall(r"`([^`]+)`", cell)]
GAP = "\0"
"""Stands for what a message fills in."""


@cache
def messages():
    """Texts of the product and of its build without docstrings and comments, with gaps for what is filled in."""
    sources = [ROOT / "hatch_build.py", *(ROOT / "ffsm_mj").rglob("*.py"), *(ROOT / "controllers").rglob("*.py")]
    text = "\n".join(source.read_text(encoding="utf-8") for source in sources)
    text = re.sub(r'""".*?"""|^ *#.*?$', "", text, flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r'["\']\s*\n\s*[fr]?["\']', "", text)  # literals that stand below each other are one text
    return re.sub(r'\{[^{}"\n]*\}', GAP, text)  # with quotation marks in them they are mappings of the source


def exists(quoted):
    """Whether a message of the product has these words in this order, and gaps where the page has three dots."""
    parts = [re.escape(part.strip()) for part in quoted.split("...")]
    return re.search(rf"[^\n]*{GAP}[^\n]*".join(part for part in parts if part), messages()) is not None


@pytest.mark.parametrize("quoted", [code for code in QUOTED if code not in OUTCOMES])
def test_the_code_has_each_message(quoted):
    assert exists(quoted)


def test_a_message_that_is_gone_is_noticed():
    assert exists("impacts; raise impact.max_impacts to continue")
    assert not exists("impacts; raise impact.most_impacts to continue")
    assert exists("the root body ... has no joint, so it cannot float")
    assert not exists("the root body has no joint, so it cannot float")
    assert not exists("the root body ... has no joints, so it cannot float")


def test_every_outcome_but_success_has_an_entry():
    assert {code for code in QUOTED if code in OUTCOMES} == OUTCOMES - {"completed"}


def test_the_page_has_messages():
    assert len(QUOTED) > 60
