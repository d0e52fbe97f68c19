"""``docs/validation.md``: every case with its numbers beside ours."""

from __future__ import annotations

import math
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
_SUMMARY_HEAD = ("case", "about", "compared with", "numbers", "verdict")


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
    parts = {"total": total(compared), "summary": _summary(compared), "cases": "\n\n".join(map(_section, compared))}
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
    """Numbers of a case, as cells."""
    return [
        (number.number.quantity, _source(number.number), ours(number), _tolerance(number.number), number.verdict)
        for number in case.numbers
    ]


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
    sections = {part.partition("\n")[0]: part.strip() for part in committed.split("\n## ")}
    found = []
    for case in compared:
        fresh = _section(case).removeprefix("## ")
        title = fresh.partition("\n")[0]
        if title not in sections:
            found.append(f"{case.case.name}: no section {title!r}")
        else:
            found += [f"{case.case.name}: {line}" for line in stale_lines(sections[title], fresh)]
    return found


def _summary(compared: Sequence[ComparedCase]) -> str:
    cells = [(f"`{case.case.name}`", case.case.title, case.case.origin, _count(case), case.verdict) for case in compared]
    return markdown_table(_SUMMARY_HEAD, cells)


def _count(case: ComparedCase) -> str:
    agree = sum(number.verdict is Verdict.AGREES for number in case.numbers)
    return f"{agree} of {len(case.numbers)}"


def _section(compared: ComparedCase) -> str:
    case = compared.case
    reasons = _reasons(compared)
    parts = [
        f"## {case.title}",
        f"`ffsm validate {case.name}`. {case.setting}",
        f"Source: {case.source}.",
        markdown_table(
            HEAD, [(*row[:-1], f"**{row[-1]}**" if row[-1] != Verdict.AGREES else row[-1]) for row in rows(compared)]
        ),
        *([reasons] if reasons else []),
        *([case.explanation] if case.explanation else []),
    ]
    return "\n\n".join(parts)


def _reasons(compared: ComparedCase) -> str:
    """Reasons of tolerances and of differences, each once with the quantities that it is for."""
    reasons: dict[str, list[str]] = {}
    for number in compared.numbers:
        if number.verdict is Verdict.EXPLAINED:
            reasons.setdefault(f"Differs: {number.number.known}.", []).append(number.number.name)
    return "\n".join(f"- {', '.join(names)}. {why}" for why, names in reasons.items())


def _source(number: Number) -> str:
    return f"at most {number.text}" if number.at_most else number.text


def _tolerance(number: Number) -> str:
    if number.at_most:
        return ""
    size = f"{number.allowed:.1g}".replace("e-0", "e-")
    return f"{size}: {number.why}" if number.why else size


def _decimals(number: Number) -> int:
    """Decimals of the tolerance, and, to the fifth, one more than the source prints."""
    shown = min(number.decimals + 1, 5)
    return max(0, shown, math.ceil(-math.log10(number.allowed) - 1e-9)) if number.allowed else max(0, shown)
