"""The groups of measured impacts by name, and their page: what was computed, and from what; or that it was not run."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from ffsm_mj.errors import InputError
from ffsm_mj.report.markdown import markdown_table
from ffsm_mj.report.output_place import new_file, usable_folder
from ffsm_mj.report.terminal import table
from ffsm_mj.validation.measured import cube, ellipse, sphere
from ffsm_mj.validation.measured.figures import save_figure
from ffsm_mj.validation.measured.source import DataSource, GroupReport, Progress
from ffsm_mj.validation.page import from_template

PAGE = "measured-impacts.md"


@dataclass(frozen=True)
class MeasuredGroup:
    """A set of measured impacts that is compared with computed ones.

    Attributes:
        title: What it is about.
        source: Where its data are.
        report: Computes the report from a copy of the repository, with a progress, briefly or at length.
        figure: Caption of its figure.
    """

    title: str
    source: DataSource
    report: Callable[[Path, Progress, bool], GroupReport]
    figure: str


GROUPS: Mapping[str, MeasuredGroup] = {
    "measured-ellipse": MeasuredGroup(
        "Planar impacts of an ellipse",
        ellipse.SOURCE,
        lambda folder, stage, _: ellipse.report(folder, stage),
        "Share of the judged impacts with a smaller error E.",
    ),
    "measured-cube": MeasuredGroup(
        "Tosses of a cube",
        cube.SOURCE,
        lambda folder, stage, long: cube.report(folder, stage, long=long),
        "Error of position after the end of free flight, medians over tosses.",
    ),
    "measured-sphere": MeasuredGroup(
        "Oblique impacts of spheres",
        sphere.SOURCE,
        lambda folder, stage, _: sphere.report(folder, stage),
        "Ratio of tangential speeds by the angle of the impact from the normal: measured (points), and by the laws.",
    ),
}


def not_run(name: str) -> str:
    """What says that a group was not run, and what it needs."""
    return f"Not run: `ffsm validate {name} --data DIR` computes it from a copy of {GROUPS[name].source.named}."


def in_words(name: str, report: GroupReport) -> str:
    """A report for a terminal."""
    source = GROUPS[name].source
    lines = [GROUPS[name].title, f"Data: {source.named}. {source.citation}. Licence: {source.licence}.", ""]
    lines += [f"SHA-256 {value}  {file}" for file, value in report.digests.items()]
    lines += ["", *(f"Note: {notice}." for notice in (*report.versions, *report.notices))]
    lines += [f"FAILED: {failure}." for failure in report.failures]
    for one in report.tables:
        lines += ["", one.title, table(one.head, one.rows)] + ([f"  {one.note}"] if one.note else [])
    if not report.versions:  # claims are about the data that were examined
        lines += ["", "May be claimed:", *(f"- {claim}" for claim in report.may)]
        lines += ["May not be claimed:", *(f"- {claim}" for claim in report.may_not)]
    return "\n".join(lines)


def write_page(folder: Path, name: str, report: GroupReport) -> list[Path]:
    """Write the section of a group and its figure; other sections stay as they are, or say that they were not run.

    Raises:
        InputError: The folder cannot be used, or the data are of another version than that which the page is about.
    """
    if report.versions:
        raise InputError([f"{line}; the page is about that commit" for line in report.versions])
    usable_folder(folder)
    figure = save_figure(name, report.curves, folder)
    page = folder / PAGE
    old = page.read_text(encoding="utf-8") if page.is_file() else ""
    with new_file(page) as temporary:
        temporary.write_text(page_of(old, {name: _section(name, report)}), encoding="utf-8")
    return [page, figure]


def page_of(old: str, sections: Mapping[str, str]) -> str:
    """The page with new sections of some groups; those of the others are as in the page before, or not run."""
    texts = {name: sections.get(name) or _old_section(old, name) for name in GROUPS}
    return from_template(
        PAGE, {name.replace("-", "_"): f"{_begin(name)}\n\n{text}\n\n{_END}" for name, text in texts.items()}
    )


_END = "<!-- end -->"


def _begin(name: str) -> str:
    return f"<!-- {name} -->"


def _old_section(page: str, name: str) -> str:
    """The section of a group in a page that was written before."""
    section = re.search(f"{re.escape(_begin(name))}\n\n(.*?)\n\n{re.escape(_END)}", page, re.DOTALL)
    return section[1] if section else f"## {GROUPS[name].title}\n\n{not_run(name)}"


def _section(name: str, report: GroupReport) -> str:
    group = GROUPS[name]
    source = group.source
    files = "\n".join(f"- `{file}`: SHA-256 `{value}`" for file, value in report.digests.items())
    parts = [
        f"## {group.title}",
        f"`ffsm validate {name} --data DIR`, DIR a copy of {source.named} (licence: {source.licence}).",
        f"{source.citation}.",
        files,
        *(f"{notice}." for notice in report.notices),
        *(f"**Failed**: {failure}." for failure in report.failures),
    ]
    for one in report.tables:
        parts += [f"### {one.title}", markdown_table(one.head, one.rows)] + ([one.note] if one.note else [])
    parts += [f"![{group.figure}](figures/{name}.png)"]
    parts += ["### What may be claimed", "\n".join(f"- {claim}" for claim in report.may) if report.may else "Nothing."]
    parts += ["### What may not", "\n".join(f"- {claim}" for claim in report.may_not)]
    return "\n\n".join(parts)
