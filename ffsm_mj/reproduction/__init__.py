"""The reproduction report: the paper's numbers beside ours, written and kept current by ``ffsm reproduce``."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.comparison import Verdict
from ffsm_mj.errors import InputError
from ffsm_mj.invocation import command
from ffsm_mj.report.output_place import usable_folder, writing
from ffsm_mj.report.text_table import table
from ffsm_mj.reproduction.appendix_page import appendix_page
from ffsm_mj.reproduction.cases import (
    LONG_BASELINE,
    LONG_FREE_FLYING,
    LONG_SLOW,
    all_cases,
    paper_case,
    run_cases,
)
from ffsm_mj.reproduction.current import stale_lines
from ffsm_mj.reproduction.drift import drift
from ffsm_mj.reproduction.inputs import stated_inputs
from ffsm_mj.reproduction.judged import judge
from ffsm_mj.reproduction.once import measured_once, refreshed
from ffsm_mj.reproduction.page import PAGE, Report, reproduction_page
from ffsm_mj.reproduction.printed import PAPER_FIGURES

APPENDIX_PAGE = "appendix-a.md"
FIGURES = "figures"
_LONG_RUNS = {
    "baseline, no thrusters": LONG_BASELINE,
    "slow impact, no thrusters": LONG_SLOW,
    "free-flying: thrusters in the pause, then at rest": LONG_FREE_FLYING,
}


@dataclass(frozen=True)
class Reproduction:
    """The report.

    Attributes:
        report: Its content.
        pages: Text by file name.
        runs: How many runs were made.
        wall_s: How long all of it took.
    """

    report: Report
    pages: dict[str, str]
    runs: int
    wall_s: float

    def text(self) -> str:
        """How many printed numbers of each section have which verdict, for a terminal."""
        counts: dict[str, Counter[Verdict]] = {}
        for c in self.report.judged:
            for section in (c.number.section, "all"):
                counts.setdefault(section, Counter())[c.verdict] += 1
        counts["all"] = counts.pop("all")  # last
        rows = [(section, *(str(found[verdict]) for verdict in Verdict)) for section, found in counts.items()]
        head = f"Nekoo, Sharf & Ollero 2024: every printed result beside ours; {self.runs} runs in {self.wall_s:.0f} s"
        return f"{head}\n\n{table(('section', *Verdict), rows)}"

    def write(self, folder: Path) -> Sequence[Path]:
        """Write pages and figures; returns the files.

        Raises:
            InputError: The folder cannot be written to.
            OutputLostError: A page or a figure could not be written to its end.
        """
        from ffsm_mj.report import plots
        from ffsm_mj.reproduction.figures import save_drift, save_study

        study, long = folder / FIGURES / "reproduction-study.png", folder / FIGURES / "reproduction-drift.png"
        usable_folder(folder / FIGURES)
        with writing(folder):
            for name, text in self.pages.items():
                (folder / name).write_text(text, encoding="utf-8")
            save_study(self.report.judged, self.report.results, study)
            save_drift(self.report.drifts, long)
        for scenario, names in _figure_names().items():
            run = self.report.results[paper_case(scenario)].run
            if run is not None:
                plots.save(run, folder / FIGURES / scenario, names, ("svg",))
        return [*(folder / name for name in self.pages), folder / FIGURES]

    def stale(self, folder: Path) -> list[str]:
        """What pages in a folder say that these runs do not, one line each.

        Raises:
            InputError: A page cannot be read.
        """
        return _stale(folder, self.pages)


def committed_pages(folder: Path) -> dict[str, str]:
    """Text of the pages in a folder by file name.

    Raises:
        InputError: A page cannot be read.
    """
    pages = {}
    for name in (PAGE, APPENDIX_PAGE):
        try:
            pages[name] = (folder / name).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            reason = getattr(error, "strerror", None) or error
            raise InputError(
                f"{folder / name}: cannot be read ({reason}); '{command('reproduce', '--out', folder)}' writes it"
            ) from error
    return pages


def stale_once(folder: Path, report: Callable[[int, int], None] | None = None) -> list[str]:
    """What pages in a folder say that each scenario, run once, does not, one line each; see :func:`reproduce`.

    Raises:
        InputError: A page cannot be read.
    """
    committed = committed_pages(folder)
    page = refreshed(committed[PAGE], measured_once(report))
    return _stale(folder, {PAGE: page, APPENDIX_PAGE: appendix_page()})


def _stale(folder: Path, pages: Mapping[str, str]) -> list[str]:
    committed = committed_pages(folder)
    return [f"{folder / name}: {line}" for name, text in pages.items() for line in stale_lines(committed[name], text)]


def _figure_names() -> dict[str, list[str]]:
    """Names of our figures by scenario, one for each of the paper's."""
    names: dict[str, list[str]] = {}
    for figure in PAPER_FIGURES:
        names.setdefault(figure.scenario, []).append(figure.name)
    return names


def reproduce(report: Callable[[int, int], None] | None = None) -> Reproduction:
    """Make every run and the pages; ``report`` is told how many runs of how many are done."""
    started = time.perf_counter()
    results = run_cases(all_cases(), report)
    system = prepare("baseline").system
    drifts = {}
    for name, case in _LONG_RUNS.items():
        run = results[case].run
        if run is not None:
            drifts[name] = drift(run, system)
    figures = {
        scenario: {name: f"{FIGURES}/{scenario}/{name}.svg" for name in names} for scenario, names in _figure_names().items()
    }
    content = Report(judge(results), results, drifts, stated_inputs(), figures)
    pages = {PAGE: reproduction_page(content), APPENDIX_PAGE: appendix_page()}
    return Reproduction(content, pages, len(results), time.perf_counter() - started)
