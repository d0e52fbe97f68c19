"""Implementation of ``ffsm validate``: compare published numbers and closed forms with computed ones."""

from __future__ import annotations

import argparse
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from ffsm_mj.all_cores import on_all_cores
from ffsm_mj.cli.exit_codes import CHECK_FAILED, OK
from ffsm_mj.cli.measured import validate_measured
from ffsm_mj.cli.progress import Stage
from ffsm_mj.cli.standard_streams import Output, complain
from ffsm_mj.errors import InputError, plural, unknown_name
from ffsm_mj.report.output_place import new_file, usable_folder
from ffsm_mj.report.terminal import table
from ffsm_mj.validation.case import ComparedCase, ValidationCase, Verdict, compared_case
from ffsm_mj.validation.cases import CASES, LONGEST, case_names, seed_paper, values_of
from ffsm_mj.validation.cases.seed_paper import page as paper
from ffsm_mj.validation.cases.seed_paper.runs import THRESHOLD, PaperRun, Result, all_runs, perform
from ffsm_mj.validation.measured.groups import GROUPS
from ffsm_mj.validation.page import (
    HEAD,
    PAGE,
    committed_page,
    reasons,
    rows,
    stale_cases,
    stale_lines,
    total,
    validation_page,
)


def validate(options: argparse.Namespace, output: Output) -> int:
    """Compute the cases and print them, write their pages or check them; returns the exit code.

    Raises:
        InputError: A case is unknown, the folder cannot be used, or has no page to check.
    """
    names, folder = options.cases, Path(options.page or options.check or ".")
    if any(name in GROUPS for name in names):
        return validate_measured(options, output)
    if options.data is not None:
        raise InputError(f"ffsm validate: --data belongs to one of {', '.join(GROUPS)}")
    cases, of_paper = _chosen(names), not names or seed_paper.GROUP in names
    _refuse(options, of_paper=of_paper)
    pages = (*(() if names == [seed_paper.GROUP] else (PAGE,)), *(paper.PAGES if of_paper else ()))
    committed = {page: committed_page(folder, page) for page in pages if options.check is not None}
    every = options.page is not None or options.long
    runs = all_runs() if every else (THRESHOLD,) if committed and of_paper else ()
    with output.progress() as stage:
        results = _performed(cases, runs, stage)
    compared = [compared_case(case, results[_task(case.name)].values) for case in cases]
    output.say("\n".join(map(_shown, compared)) if names else _summary(compared))
    output.say(total(compared))
    if not names:
        output.say(f"Not run: {', '.join(GROUPS)}, which compare with data that are not shipped (--data).")
    fresh = {} if names else {PAGE: validation_page(compared)}
    if of_paper and (every or committed):
        fresh |= paper.pages(results, committed.get(seed_paper.PAGE, ""))
    if options.page is not None:
        _write(folder, fresh)
        figures = paper.save_figures(folder, results)
        output.say(f"\nwritten: {', '.join(str(path) for path in (*(folder / page for page in fresh), figures))}")
    stale = [(page, line) for page in committed if page in fresh for line in stale_lines(committed[page], fresh[page])]
    if PAGE in committed and PAGE not in fresh:
        stale += [(PAGE, line) for line in stale_cases(committed[PAGE], compared)]
    for page, line in stale:
        complain(f"{folder / page}: {line}")
    if committed:
        old = f"{plural(len(stale), 'line')} not current"
        output.say(f"\n{folder}: {old if stale else 'current'}")
    return CHECK_FAILED if stale or any(case.verdict is Verdict.DIFFERS for case in compared) else OK


def _refuse(options: argparse.Namespace, *, of_paper: bool) -> None:
    """Refuse options that do not go together, and a folder that cannot be used.

    Raises:
        InputError: One of these.
    """
    if options.long and not of_paper:
        raise InputError(f"ffsm validate: --long has no effect without {seed_paper.GROUP}")
    if options.page is not None:
        if options.cases not in ([], [seed_paper.GROUP]):
            raise InputError(f"ffsm validate: --page writes the pages of all cases, or of {seed_paper.GROUP}")
        usable_folder(Path(options.page))


def _write(folder: Path, pages: Mapping[str, str]) -> None:
    for name, text in pages.items():
        with new_file(folder / name) as temporary:
            temporary.write_text(text, encoding="utf-8")


def _shown(case: ComparedCase) -> str:
    """Everything about one case."""
    texts = (case.case.title, f"Source: {case.case.source}.", case.case.setting, case.case.explanation)
    head = "\n".join(text for text in texts if text)
    lines = "".join(f"  {_unlinked(line)}\n" for line in reasons(case.numbers))
    return f"{head}\n\n{table(HEAD, rows(case.numbers), spare=('tolerance',))}\n{lines}"


def _unlinked(markdown: str) -> str:
    """A line of a page without the addresses of its links."""
    return re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", markdown)


def _summary(compared: Sequence[ComparedCase]) -> str:
    """A line for each case, by topic."""
    cells = [(case.case.topic, case.case.name, f"{case.agreeing} of {len(case.numbers)}", case.verdict) for case in compared]
    return table(("topic", "case", "agree", "verdict"), cells, spare=("topic",)) + "\n"


def _chosen(names: Sequence[str]) -> Sequence[ValidationCase]:
    """Cases of these names or groups, all if there are none."""
    known = (seed_paper.GROUP, *case_names(), *GROUPS)
    for name in names:
        if name not in known:
            raise InputError(unknown_name("case", name, known))
    grouped = seed_paper.CASES if seed_paper.GROUP in names else ()
    return [case for case in CASES if case.name in names or case in grouped] if names else CASES


def _task(name: str) -> str | PaperRun:
    """What computes a case: its name, or a run that the page of the seed paper also needs."""
    return seed_paper.RUNS.get(name, name)


def _performed(cases: Sequence[ValidationCase], runs: Sequence[PaperRun], stage: Stage) -> dict[str | PaperRun, Result]:
    """Results of cases, and of runs of the seed paper, on all cores."""
    tasks = sorted(dict.fromkeys((*runs, *(_task(case.name) for case in cases))), key=lambda task: task != LONGEST)
    report = stage("validate", "cases", len(tasks))
    return dict(zip(tasks, on_all_cores(_perform, tasks, report), strict=True))


def _perform(task: str | PaperRun) -> Result:
    return Result(values_of(task)) if isinstance(task, str) else perform(task)
