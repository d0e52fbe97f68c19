"""Report of a campaign: a summary for a terminal, one HTML page, the same as Markdown with figures, and tables."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ffsm_mj.analysis.run import Run, load_run
from ffsm_mj.errors import InputError, LogError
from ffsm_mj.experiments.campaign import Campaign
from ffsm_mj.experiments.comparison import compare_variants
from ffsm_mj.experiments.folder import RERUNS
from ffsm_mj.experiments.page import report_page
from ffsm_mj.experiments.results import GOOD, TableRow, as_arrow
from ffsm_mj.log.run_folder import find_log
from ffsm_mj.report.markdown import html_page
from ffsm_mj.report.output_place import folder_below, new_file

PAGE, HTML, PARQUET, CSV = "report.md", "report.html", "results.parquet", "results.csv"
FIGURES = "figures"
_MOST_REPLAYS = 100
"""Largest number of trajectories in a figure."""


def write_report(campaign: Campaign, page: Path | None = None) -> list[Path]:
    """Write the page with its figures, and the page as one HTML file and the table as Parquet and CSV in the folder.

    Args:
        campaign: The campaign, finished or not.
        page: Markdown file; its figures go to ``figures/<its name>/`` beside it. None: ``report.md`` in the folder of the
            campaign, where the HTML file is always.

    Returns:
        The written files: the HTML file, the Markdown file, figures, tables.

    Raises:
        InputError: A folder cannot be written to.
        OutputLostError: A file could not be written completely.
    """
    from ffsm_mj.experiments.figures import save_figures, save_variant_figures  # Matplotlib is slow to import

    page = page or campaign.folder.path / PAGE
    pictures = folder_below(page.parent, FIGURES, page.stem)
    results, rows = campaign.variant_results(), campaign.table_rows()
    comparison = compare_variants(results) if campaign.variants else None
    if comparison is not None:
        figures = save_variant_figures(comparison, pictures)
    else:
        figures = save_figures(results.variants[""], list(_rerun_runs(campaign)), pictures)
    shown = [(what, f"{FIGURES}/{page.stem}/{file}") for what, file in figures]
    text = report_page(results, comparison, shown)
    pages = write_pages(text, campaign.config.campaign, page, [file for _, file in shown], campaign.folder.path / HTML)
    return [*pages, *(page.parent / file for _, file in shown), *write_tables(campaign.folder.path, rows)]


def write_pages(text: str, title: str, page: Path, figures: Sequence[str], html: Path) -> list[Path]:
    """Write a page as Markdown and as one HTML file; returns both paths, the HTML file first.

    Args:
        text: The page.
        title: Its title.
        page: Markdown file.
        figures: Paths of its figures, relative to it.
        html: HTML file, which contains the figures.

    Raises:
        OutputLostError: A file could not be written completely.
    """
    with new_file(page) as place:
        place.write_text(text, encoding="utf-8")
    drawn = {file: (page.parent / file).read_bytes() for file in figures}
    with new_file(html) as place:
        place.write_text(html_page(text, title, drawn), encoding="utf-8")
    return [html, page]


def write_tables(folder: Path, rows: Sequence[TableRow]) -> list[Path]:
    """Write a table as Parquet and CSV; returns the files.

    Raises:
        OutputLostError: A file could not be written completely.
    """
    import pyarrow.csv
    import pyarrow.parquet

    table: Any = as_arrow(rows)
    if not table.num_columns:
        return []
    with new_file(folder / PARQUET) as place:
        pyarrow.parquet.write_table(table, place)
    with new_file(folder / CSV) as place:
        pyarrow.csv.write_csv(table, place)
    return [folder / PARQUET, folder / CSV]


def _rerun_runs(campaign: Campaign) -> Iterator[tuple[bool, Run]]:
    """Repeated runs whose logs exist, and whether each is good."""
    good, folder = campaign.results().frame[GOOD], campaign.folder.path / RERUNS
    folders = sorted(folder.iterdir()) if folder.is_dir() else []
    for place in [place for place in folders if place.name.isdecimal() and int(place.name) in good.index][:_MOST_REPLAYS]:
        try:
            run = load_run(find_log(place))
        except (InputError, LogError):
            continue  # it is being written, or the disk was full
        if len(run.log.rows):
            yield bool(good[int(place.name)]), run
