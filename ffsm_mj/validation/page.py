"""``docs/validation.md``: every case with its numbers beside ours."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from string import Template

from ffsm_mj.comparison import ComparedNumber, Number, Verdict, verdicts_in_words
from ffsm_mj.errors import InputError
from ffsm_mj.invocation import command
from ffsm_mj.report.text_table import markdown_table
from ffsm_mj.reproduction.current import stale_lines
from ffsm_mj.validation.case import ComparedCase, Origin

PAGE = "validation.md"
_TEMPLATE = Path(__file__).parent / "templates" / PAGE
HEAD = ("quantity", "source", "ours", "tolerance", "verdict")
_PAGE_HEAD = (*HEAD[:-1], "why this tolerance", HEAD[-1])
_SUMMARY_HEAD = ("case", "computes", "compared with", "agree", "verdict")


def committed_page(folder: Path) -> str:
    """Text of the page in a folder.

    Raises:
        InputError: It cannot be read.
    """
    path = folder / PAGE
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(
            f"{path}: cannot be read ({reason}); '{command('validate', '--page', folder)}' writes it"
        ) from error


def validation_page(compared: Sequence[ComparedCase]) -> str:
    """The page of all cases."""
    topics = {case.case.topic: [each for each in compared if each.case.topic is case.case.topic] for case in compared}
    parts = {
        "total": total(compared),
        "summary": "\n\n".join(f"**{topic}**\n\n{_summary(cases)}" for topic, cases in topics.items()),
        "cases": "\n\n".join("\n\n".join([f"## {topic}", *map(_section, cases)]) for topic, cases in topics.items()),
    }
    return Template(_TEMPLATE.read_text(encoding="utf-8")).substitute(parts)


def total(compared: Sequence[ComparedCase]) -> str:
    """How many cases and numbers there are, and how they stand to their sources."""
    origins = Counter(case.case.origin for case in compared)
    cases = ", ".join(f"{origins[origin]} {what}" for origin, what in _ORIGINS.items())
    plural = "" if len(compared) == 1 else "s"
    numbers = (number for case in compared for number in case.numbers)
    return f"{len(compared)} case{plural} ({cases}), {verdicts_in_words(numbers)}."


_ORIGINS = {Origin.PUBLISHED: "with published numbers", Origin.CLOSED_FORM: "with closed forms"}


def rows(case: ComparedCase) -> list[tuple[str, ...]]:
    """Numbers of a case, as cells of ``HEAD``."""
    return [
        (number.number.quantity, _source(number.number), ours(number), _allowed(number.number), number.verdict)
        for number in case.numbers
    ]


def reasons(case: ComparedCase) -> list[str]:
    """Reasons of differences, each once, with the quantities that it is for."""
    found: dict[str, list[str]] = {}
    for number in case.numbers:
        if number.verdict is Verdict.EXPLAINED:
            found.setdefault(number.number.known, []).append(number.number.name)
    return [f"Difference in {', '.join(names)}: {why}." for why, names in found.items()]


def ours(compared: ComparedNumber) -> str:
    """Our value to the digits of the tolerance; of an error much smaller than the printed one, the power of ten above it."""
    if compared.number.at_most and compared.ours < 1e-2:
        if compared.ours > 1e-3 * compared.number.value:
            return f"{compared.ours:.1e}"
        return f"< 1e{math.ceil(math.log10(compared.ours))}" if compared.ours > 0.0 else "0"
    decimals = _decimals(compared.number)
    text = f"{compared.ours:.{decimals}f}"
    return text.removeprefix("-") if float(text) == 0.0 else text


def stale_page(committed: str, compared: Sequence[ComparedCase]) -> list[str]:
    """What a committed page says that the numbers of all cases do not, one line each."""
    return stale_lines(committed, validation_page(compared))


def stale_cases(committed: str, compared: Sequence[ComparedCase]) -> list[str]:
    """What a committed page says of these cases that their numbers do not, one line each."""
    sections = {part.partition("\n")[0]: part.strip() for part in re.split(r"\n##+ ", committed)}
    found = []
    for case in compared:
        fresh = _section(case).removeprefix("### ")
        title = fresh.partition("\n")[0]
        if title not in sections:
            found.append(f"{case.case.name}: no section {title!r}")
        else:
            found += [f"{case.case.name}: {line}" for line in stale_lines(sections[title], fresh)]
    return found


def _summary(compared: Sequence[ComparedCase]) -> str:
    cells = [
        (f"`{case.case.name}`", case.case.title, case.case.origin, f"{case.agreeing} of {len(case.numbers)}", case.verdict)
        for case in compared
    ]
    return markdown_table(_SUMMARY_HEAD, cells, texts=("case", "computes", "compared with", "verdict"))


def _section(compared: ComparedCase) -> str:
    case = compared.case
    found = reasons(compared)
    parts = [
        f"### {case.title}",
        f"`ffsm validate {case.name}`. {case.setting}",
        f"Source: {case.source}.",
        markdown_table(_PAGE_HEAD, _page_rows(compared), texts=("quantity", "why this tolerance", "verdict")),
        *(["\n".join(f"- {line}" for line in found)] if found else []),
        *([case.explanation] if case.explanation else []),
    ]
    return "\n\n".join(parts)


def _page_rows(compared: ComparedCase) -> list[tuple[str, ...]]:
    return [
        (*cells, _why(number.number), verdict if verdict == Verdict.AGREES else f"**{verdict}**")
        for (*cells, verdict), number in zip(rows(compared), compared.numbers, strict=True)
    ]


def _source(number: Number) -> str:
    text = f"at most {number.text}" if number.at_most else number.text
    return f"{text} ({number.source})" if number.source else text


def _allowed(number: Number) -> str:
    return "" if number.at_most else f"{number.allowed:.1g}".replace("e-0", "e-")


def _why(number: Number) -> str:
    if number.at_most:
        return "a bound, not to be exceeded"
    if number.why:
        return number.why
    return "a unit of the last digit: approximate in the source" if number.approximate else "half a unit of the last digit"


def _decimals(number: Number) -> int:
    """Decimals of the tolerance, and, to the fifth, one more than the source prints."""
    if number.tolerance == 0.0:  # a count
        return max(0, number.decimals)
    shown = min(number.decimals + 1, 5)
    return max(0, shown, math.ceil(-math.log10(number.allowed) - 1e-9)) if number.allowed else max(0, shown)
