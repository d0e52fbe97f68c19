"""``ffsm reproduce --check``: each scenario once, as the paper ran it, and whether the committed pages say the same.

What only other runs can tell (spreads over step sizes, the impact declared at a step, the long runs) is taken from the page.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping
from string import Template

from ffsm_mj.report.text_table import markdown_table
from ffsm_mj.reproduction.cases import SCENARIOS, paper_case, run_cases
from ffsm_mj.reproduction.inputs import stated_inputs
from ffsm_mj.reproduction.judged import StudiedNumber
from ffsm_mj.reproduction.markdown import template
from ffsm_mj.reproduction.measure import Measures
from ffsm_mj.reproduction.page import INPUTS_HEAD, PAGE, judged_cells
from ffsm_mj.reproduction.printed import PRINTED, PrintedNumber


def measured_once(report: Callable[[int, int], None] | None = None) -> dict[str, Measures]:
    """What each scenario comes to; ``report`` is told how many runs of how many are done."""
    results = run_cases([paper_case(name) for name in SCENARIOS], report)
    return {case.scenario: result.values for case, result in results.items()}


def refreshed(committed: str, values: Mapping[str, Measures]) -> str:
    """A committed page with what the runs tell anew: our numbers, their differences and verdicts, and the inputs."""
    lines = committed.splitlines()
    for printed in PRINTED:
        row = _row(lines, printed)
        if row is None:
            lines.append(f"no row for {printed.quantity} of section {printed.section}")
            continue
        cells = lines[row].strip("| ").split(" | ")
        judged = StudiedNumber(printed, values[printed.scenario][printed.key], _spread(cells[-2]))
        fresh = judged_cells(judged, declared=False)
        lines[row] = "| " + " | ".join([*fresh[:3], *cells[3:-3], fresh[-3], cells[-2], fresh[-1]]) + " |"
    lines += [f"not in the page: {line}" for line in _inputs() if line not in lines]
    return "\n".join([*lines, *(f"not in the page: {text!r}" for text in _missing_texts(committed))])


def _row(lines: list[str], printed: PrintedNumber) -> int | None:
    """Where the page tells of a printed number."""
    section = ""
    for i, line in enumerate(lines):
        if line.startswith("## "):
            section = line.removeprefix("## ")
        if section.startswith(printed.section) and line.startswith(f"| {printed.quantity} |"):
            return i
    return None


def _spread(tolerance: str) -> float:
    """How far our value moves, as the page gives it beside what the print leaves open; what is only rounding is nothing."""
    text = tolerance.partition(" + ")[2]
    return 0.0 if text.startswith("<") else float(text)


def _inputs() -> list[str]:
    return markdown_table(INPUTS_HEAD, stated_inputs()).splitlines()


def _missing_texts(committed: str) -> list[str]:
    """Words of the page's template that the page does not have."""
    words = Template(template(PAGE)).substitute(defaultdict(lambda: "\0")).split("\0")
    return [text.strip() for text in words if text.strip() not in committed]
