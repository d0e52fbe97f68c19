"""Report of a study: one HTML page, the same page as Markdown with its figures, and the table for other tools."""

from __future__ import annotations

from pathlib import Path

from ffsm_mj.campaign.report.report import FIGURES, HTML, PAGE, write_pages, write_tables
from ffsm_mj.report.output_place import folder_below
from ffsm_mj.studies.comparison import compare_variants
from ffsm_mj.studies.study import Study


def write_study_report(study: Study, page: Path | None = None) -> list[Path]:
    """Write the pages with their figures, and the table of all variants as Parquet and CSV in the folder of the study.

    Args:
        study: The study, finished or not.
        page: Markdown file; its figures go to ``figures/<its name>/`` beside it. None: ``report.md`` in the folder of the
            study, where the HTML file is always.

    Returns:
        The written files: the HTML file, the Markdown file, figures, tables.

    Raises:
        InputError: A folder cannot be written to.
        OutputLostError: A file could not be written completely.
    """
    from ffsm_mj.studies.figures import save_figures  # Matplotlib is slow to import
    from ffsm_mj.studies.page import study_page

    results = study.results()
    comparison = compare_variants(results)
    page = page or study.folder.path / PAGE
    made = save_figures(results, comparison, folder_below(page.parent, FIGURES, page.stem))
    shown = [(what, f"{FIGURES}/{page.stem}/{file}") for what, file in made]
    text = study_page(results, comparison, shown)
    pages = write_pages(text, study.config.study, page, [file for _, file in shown], study.folder.path / HTML)
    return [*pages, *(page.parent / file for _, file in shown), *write_tables(study.folder.path, study.table_rows())]
