"""Implementation of ``ffsm validate``: compare published numbers and closed forms with computed ones."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from ffsm_mj.all_cores import on_all_cores
from ffsm_mj.cli.exit_codes import CHECK_FAILED, OK
from ffsm_mj.cli.progress import progress
from ffsm_mj.cli.standard_streams import Output, complain
from ffsm_mj.comparison import Verdict
from ffsm_mj.errors import InputError, unknown_name
from ffsm_mj.report.output_place import new_file, usable_folder
from ffsm_mj.report.text_table import table, wrapped
from ffsm_mj.validation.case import ComparedCase, ValidationCase, compared_case
from ffsm_mj.validation.cases import CASES, LONGEST, case_names, values_of
from ffsm_mj.validation.page import (
    HEAD,
    PAGE,
    committed_page,
    reasons,
    rows,
    stale_cases,
    stale_page,
    total,
    validation_page,
)


def validate(options: argparse.Namespace, output: Output) -> int:
    """Compute the cases and print them, write their page or check it; returns the exit code.

    Raises:
        InputError: A case is unknown, the folder cannot be used, or has no page to check.
    """
    cases = _chosen(options.cases)
    if options.page is not None:
        if options.cases:
            raise InputError("ffsm validate: --page writes all cases; leave out their names")
        usable_folder(Path(options.page))
    committed = committed_page(Path(options.check)) if options.check is not None else ""
    compared = _computed(cases)
    for case in compared if options.cases else ():
        output.say(_shown(case))
    if not options.cases:
        output.say(_summary(compared))
    output.say(wrapped(total(compared)))
    if options.page is not None:
        path = Path(options.page) / PAGE
        with new_file(path) as temporary:
            temporary.write_text(validation_page(compared), encoding="utf-8")
        output.say(f"\nwritten: {path}")
    stale = (stale_cases if options.cases else stale_page)(committed, compared) if committed else []
    for line in stale:
        complain(f"{Path(options.check) / PAGE}: {line}")
    differs = any(case.verdict is Verdict.DIFFERS for case in compared)
    return CHECK_FAILED if stale or differs else OK


def _shown(case: ComparedCase) -> str:
    """Everything about one case."""
    texts = (case.case.title, f"Source: {case.case.source}.", case.case.setting, case.case.explanation)
    head = "\n".join(wrapped(text, 2) for text in texts if text)
    lines = "".join(f"  {wrapped(line, 4)}\n" for line in reasons(case))
    return f"{head}\n\n{table(HEAD, rows(case), spare=('tolerance',))}\n{lines}"


def _summary(compared: Sequence[ComparedCase]) -> str:
    """A line for each case, by topic."""
    cells = [(case.case.topic, case.case.name, f"{case.agreeing} of {len(case.numbers)}", case.verdict) for case in compared]
    return table(("topic", "case", "agree", "verdict"), cells, spare=("topic",)) + "\n"


def _chosen(names: Sequence[str]) -> Sequence[ValidationCase]:
    """Cases of these names, all if there are none."""
    known = case_names()
    for name in names:
        if name not in known:
            raise InputError(unknown_name("case", name, known))
    return [case for case in CASES if case.name in names] if names else CASES


def _computed(cases: Sequence[ValidationCase]) -> list[ComparedCase]:
    """Cases with what they compute, on all cores."""
    names = sorted((case.name for case in cases), key=lambda name: name != LONGEST)
    with progress() as shown:
        report = shown.stage("validate", "cases", len(cases))
        values = dict(zip(names, on_all_cores(values_of, names, report), strict=True))
    return [compared_case(case, values[case.name]) for case in cases]
