"""``docs/validation.md``: every case with its numbers beside ours; and what the pages of validation have in common."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from difflib import SequenceMatcher
from pathlib import Path
from string import Template

from ffsm_mj.errors import InputError, plural
from ffsm_mj.invocation import command
from ffsm_mj.report.markdown import markdown_table
from ffsm_mj.validation.case import ComparedCase, ComparedNumber, Number, Origin, Verdict, verdicts_in_words

PAGE = "validation.md"
_TEMPLATES = Path(__file__).parent / "templates"
HEAD = ("quantity", "source", "ours", "tolerance", "verdict")
_PAGE_HEAD = (*HEAD[:-1], "why this tolerance", HEAD[-1])
_SUMMARY_HEAD = ("case", "computes", "compared with", "agree", "verdict")
_TEXTS = ("why this tolerance", "computes", "compared with", "verdict")
_ORIGINS = {Origin.PUBLISHED: "with published numbers", Origin.CLOSED_FORM: "with closed forms"}


def committed_page(folder: Path, name: str = PAGE) -> str:
    """Text of a page in a folder.

    Raises:
        InputError: It cannot be read.
    """
    path = folder / name
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(
            f"{path}: cannot be read ({reason}); '{command('validate', '--page', folder)}' writes it"
        ) from error


def from_template(name: str, parts: Mapping[str, str]) -> str:
    """A page from its template, every ``$part`` replaced."""
    return Template((_TEMPLATES / name).read_text(encoding="utf-8")).substitute(parts)


def validation_page(compared: Sequence[ComparedCase]) -> str:
    """The page of all cases."""
    topics = {case.case.topic: [one for one in compared if one.case.topic is case.case.topic] for case in compared}
    parts = {
        "total": total(compared),
        "summary": "\n\n".join(f"**{topic}**\n\n{_summary(cases)}" for topic, cases in topics.items()),
        "cases": "\n\n".join("\n\n".join([f"## {topic}", *map(_section, cases)]) for topic, cases in topics.items()),
    }
    return from_template(PAGE, parts)


def total(compared: Sequence[ComparedCase]) -> str:
    """How many cases and numbers there are, and how they stand to their sources."""
    origins = Counter(case.case.origin for case in compared)
    cases = ", ".join(f"{origins[origin]} {what}" for origin, what in _ORIGINS.items())
    numbers = (number for case in compared for number in case.numbers)
    return f"{plural(len(compared), 'case')} ({cases}), {verdicts_in_words(numbers)}."


def rows(numbers: Iterable[ComparedNumber], head: Sequence[str] = HEAD) -> list[tuple[str, ...]]:
    """Compared numbers as cells of these columns; an unknown one is left empty."""
    return [tuple(_cells(number).get(name, "") for name in head) for number in numbers]


def numbers_table(numbers: Iterable[ComparedNumber], head: Sequence[str], more: Mapping[str, Mapping[str, str]]) -> str:
    """Compared numbers as a table of a page.

    Args:
        numbers: The numbers.
        head: Its columns.
        more: Cells by column and key of the number, for columns that not every page has.
    """
    lines = []
    for number in numbers:
        cells = _cells(number) | {name: column.get(number.number.key, "") for name, column in more.items()}
        if number.verdict is not Verdict.AGREES:
            cells["verdict"] = f"**{number.verdict}**"
        lines.append([cells[name] for name in head])
    return markdown_table(head, lines, texts=_TEXTS)


def reasons(numbers: Iterable[ComparedNumber]) -> list[str]:
    """Reasons of differences, each once, with the quantities that it is for."""
    explained: dict[str, list[str]] = {}
    for number in numbers:
        if number.verdict is Verdict.EXPLAINED:
            explained.setdefault(number.number.known, []).append(number.number.name)
    return [f"Difference in {', '.join(names)}: {why}." for why, names in explained.items()]


def _cells(compared: ComparedNumber) -> dict[str, str]:
    number = compared.number
    sign = "about " if number.approximate else "at most " if number.at_most else ""
    tolerance = [few(part) for part in (number.allowed, number.spread) if part]
    return {
        "quantity": number.quantity,
        "source": f"{sign}{number.text}" + (f" ({number.source})" if number.source else ""),
        "ours": ours(compared),
        "difference": small(compared.difference, 2),
        "tolerance": " + ".join(tolerance) or ("" if number.at_most else "0"),
        "why this tolerance": _why(number),
        "verdict": compared.verdict,
    }


def ours(compared: ComparedNumber) -> str:
    """Our value to the digits of the tolerance; of an error much smaller than the printed one, the power of ten above it."""
    if compared.number.at_most and compared.ours < 1e-2:
        if compared.ours > 1e-3 * compared.number.value:
            return f"{compared.ours:.1e}"
        return f"< 1e{math.ceil(math.log10(compared.ours))}" if compared.ours > 0.0 else "0"
    return fixed(compared.ours, decimals(compared.number))


def decimals(number: Number) -> int:
    """Decimals of the tolerance, and, to the fifth, one more than the source prints, two more than an approximate number."""
    if number.tolerance == 0.0:  # a count
        return max(0, number.decimals)
    shown = min(number.decimals + (2 if number.approximate or number.at_most else 1), 5)
    return max(0, shown, math.ceil(-math.log10(number.allowed) - 1e-9)) if number.allowed else max(0, shown)


def _why(number: Number) -> str:
    if number.at_most:
        return "a bound, not to be exceeded"
    if number.why:
        return number.why
    return "a unit of the last digit: approximate in the source" if number.approximate else "half a unit of the last digit"


def _summary(compared: Sequence[ComparedCase]) -> str:
    cells = [
        (f"`{case.case.name}`", case.case.title, case.case.origin, f"{case.agreeing} of {len(case.numbers)}", case.verdict)
        for case in compared
    ]
    return markdown_table(_SUMMARY_HEAD, cells, texts=_TEXTS)


def _section(compared: ComparedCase) -> str:
    case = compared.case
    parts = [f"### {case.title}", f"`ffsm validate {case.name}`. {case.setting}", f"Source: {case.source}."]
    if case.page:
        parts.append(f"The numbers are on [a page of their own]({case.page}).")
    else:
        lines = reasons(compared.numbers)
        parts.append(numbers_table(compared.numbers, _PAGE_HEAD, {}))
        parts += ["\n".join(f"- {line}" for line in lines)] if lines else []
    return "\n\n".join([*parts, *([case.explanation] if case.explanation else [])])


def stale_cases(committed: str, compared: Sequence[ComparedCase]) -> list[str]:
    """What a committed page says of these cases that their numbers do not, one line each."""
    sections = {part.partition("\n")[0]: part.strip() for part in re.split(r"\n##+ ", committed)}
    stale = []
    for case in compared:
        fresh = _section(case).removeprefix("### ")
        title = fresh.partition("\n")[0]
        if title not in sections:
            stale.append(f"{case.case.name}: no section {title!r}")
        else:
            stale += [f"{case.case.name}: {line}" for line in stale_lines(sections[title], fresh)]
    return stale


_NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w])")


def stale_lines(committed: str, fresh: str) -> list[str]:
    """Lines of a page that differ, by more than one unit of a number's last committed decimal, with the line's number."""
    old, new = committed.splitlines(), fresh.splitlines()
    stale = []
    matcher = SequenceMatcher(None, [_words(line) for line in old], [_words(line) for line in new], autojunk=False)
    for kind, i, i_end, j, j_end in matcher.get_opcodes():
        if kind == "equal":
            pairs = zip(range(i, i_end), old[i:i_end], new[j:j_end], strict=True)
            stale += [_message(number, a, b) for number, a, b in pairs if not _same_numbers(a, b)]
        else:
            stale.append(_message(i, " / ".join(old[i:i_end]), " / ".join(new[j:j_end])))
    return stale


def _message(number: int, old: str, new: str) -> str:
    return f"line {number + 1}: committed {old!r}, now {new!r}"


def _words(line: str) -> str:
    return _NUMBER.sub("#", line)


def _same_numbers(old: str, new: str) -> bool:
    pairs = zip(_NUMBER.findall(old), _NUMBER.findall(new), strict=True)
    return all(abs(float(a) - float(b)) <= 1.000001 * _unit(a) for a, b in pairs)


def _unit(text: str) -> float:
    """One unit of the last decimal; none of an integer, which counts something or is stated."""
    mantissa, _, exponent = text.lower().partition("e")
    if mantissa == text and "." not in text:
        return 0.0
    return float(10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2])))


def fixed(value: float, digits: int) -> str:
    """A number with this many decimals; zero has no sign."""
    text = f"{value:.{max(digits, 0)}f}"
    return text.removeprefix("-") if float(text) == 0.0 else text


def small(value: float, digits: int = 1) -> str:
    """A difference or spread to this many significant digits; "< 1e-9" for what is only rounding."""
    return few(value, digits) if abs(value) >= 1e-9 else "< 1e-9"


def few(value: float, digits: int = 1) -> str:
    """A number to this many significant digits."""
    if abs(value) >= 1e-3:
        return fixed(value, significant(value, digits))
    return f"{value:.{digits - 1}e}".replace("e-0", "e-")


def significant(value: float, digits: int) -> int:
    """Decimals that show this many significant digits."""
    return max(0, digits - 1 - math.floor(math.log10(abs(value)))) if value else 0
