"""Links between pages hold where they are read as files, on GitHub; ``make docs`` judges those of the site."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PAGES = [*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")]
LINK = re.compile(r"\]\((?!https?:)([^)#\s]*)(?:#([^)\s]*))?\)")


def headings(page):
    """Anchors that GitHub gives the headings of a page: lower case, hyphens for spaces, no other punctuation."""
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    titles = re.findall(r"^#+ (.*)$", text, flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).strip().replace(" ", "-") for title in titles}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    for place, anchor in LINK.findall(page.read_text()):
        target = (page.parent / place).resolve() if place else page
        assert target.is_relative_to(ROOT), place
        assert target.exists(), place
        assert not anchor or anchor in headings(target), f"{place}#{anchor}"
        inside = target.is_relative_to(ROOT / "docs") if page.parent.name == "docs" else True
        assert inside, f"{place}: the site has the pages of docs/ only"
