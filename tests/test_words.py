"""Words that the project does not use: as parts of identifiers, and as phrases in docstrings, messages and pages.

An identifier is banned with each of its words: ``held_rows`` and ``HeldRows`` for ``held``. A word of the list does not say
what a thing is (``found``, ``each``, ``here``), or is another word for a thing that has a term in the field.
"""

from __future__ import annotations

import io
import re
import tokenize
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
SOURCES = [
    path
    for folder in ("ffsm_mj", "controllers")
    for kind in ("py", "pyi", "pyx", "pxd")
    for path in (ROOT / folder).rglob(f"*.{kind}")
]
PAGES = [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]

SAY_NOTHING = {"held", "found", "each", "own", "here", "made", "told", "taken", "given", "telling", "carried"}
OTHER_WORDS = {
    "flight": "step, motion; free flight is motion without contact",
    "flown": "after_substep",
    "fly": "step",
    "party": "subsystem",
    "belief": "controller model",
    "encounter": "event",
    "closure": "active set, closed loop",
    "regime": "contact model",
    "ledger": "balance",
    "audit": "check",
    "recount": "log replay",
    "retrace": "log replay",
    "capture": "grasp",
    "starter": "template",
}
TERMS = re.compile("free_?flight|FileNotFoundError|PackageNotFoundError|__closure__|capture_output", re.IGNORECASE)
"""Names of the field, of Python and of libraries, which contain a banned word."""
SCENARIOS = {"capture", "capture_planar"}
"""Functions named like the environments that they are for; ``capture`` is a method of rich too."""

PHRASES = {
    r"\btold of\b": "reported to",
    r"\bflown\b": "simulated, stepped",
    r"\bregime\b": "contact model",
    r"\b(booked|bookkeeping|ledger)\b": "entered in the balance",
    r"\brecount(ed|s)?\b": "replayed",
    r"\b(what is told|so many of so many)\b": "a subject and a verb",
    r"\bheld down\b": "pressed",
}


def identifiers(path: Path) -> set[str]:
    """Names in a source file; those in strings do not count."""
    source = path.read_text()
    if path.suffix in (".py", ".pyi"):
        return {
            token.string for token in tokenize.generate_tokens(io.StringIO(source).readline) if token.type == tokenize.NAME
        }
    return set(re.findall(r"[A-Za-z_]\w*", re.sub(r'"""(.|\n)*?"""|#.*|"[^"\n]*"', "", source)))


def words(identifier: str) -> set[str]:
    """Its words: ``HeldRows`` and ``held_rows`` have the same."""
    return {word.lower() for word in re.findall(r"[A-Z]?[a-z0-9]+|[A-Z]+", TERMS.sub("", identifier))}


def test_words_of_an_identifier():
    assert words("HeldRows") == words("_held_rows") == {"held", "rows"}
    assert words("MjSpecRows2") == {"mj", "spec", "rows2"}
    assert words("_free_flight_s") == {"s"}
    assert words("flight_s") == {"flight", "s"}


def test_identifiers_say_what_a_thing_is():
    banned = SAY_NOTHING | {*OTHER_WORDS}
    uses = {
        f"{path.relative_to(ROOT)}: {name}"
        for path in SOURCES
        for name in identifiers(path)
        if name not in SCENARIOS and words(name) & banned
    }
    assert not uses, f"{len(uses)} names, e.g. {sorted(uses)[:20]}; instead: {OTHER_WORDS}"


@pytest.mark.parametrize("phrase", PHRASES)
def test_pages_and_docstrings_use_the_words_of_the_field(phrase):
    uses = Counter(
        {
            str(path.relative_to(ROOT)): len(re.findall(phrase, path.read_text(), flags=re.IGNORECASE))
            for path in (*SOURCES, *PAGES)
        }
    )
    assert not +uses, f"{+uses}; instead: {PHRASES[phrase]}"
