"""Markdown of reports: its texts, numbers and tables, and a page of it as one self-contained HTML file.

A page consists of headings, paragraphs, lists, tables, code in single backquotes, and figures in paragraphs of their own.
The text may contain HTML entities but no markup: every other ``<`` is shown as it is.
"""

from __future__ import annotations

import html
import re
from base64 import b64encode
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.resources import files

from markdown_it import MarkdownIt

from ffsm_mj.errors import one_line

_FIGURE = re.compile(r"!\[(.*)\]\(([^)]*)\)")
_RULES = ("heading", "list", "table", "backticks", "entity", "escape")
_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'"


def code(name: str) -> str:
    """A name as code."""
    return "`" + one_line(name).replace("`", "'").replace("|", "\\|") + "`"


def escaped(text: str) -> str:
    """A text of unknown origin on one line, markup escaped; also for a table cell."""
    return html.escape(one_line(text), quote=False).replace("|", "\\|")


def number(value: float, digits: int = 4) -> str:
    """A number with four digits, or so many."""
    return f"{value:.{digits}g}"


def percent(share: float) -> str:
    """A fraction in percent, with three digits."""
    return f"{100 * share:.3g} %"


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]], *, texts: Sequence[str] = ()) -> str:
    """A table with the first column and columns of texts, by their heads, to the left, and numbers to the right."""
    marks = ["---" if i == 0 or name in texts else "---:" for i, name in enumerate(head)]
    lines = ["| " + " | ".join(head) + " |", "|" + "|".join(marks) + "|"]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)])


def html_page(markdown: str, title: str, figures: Mapping[str, bytes]) -> str:
    """HTML of a page, which loads nothing.

    Args:
        markdown: The page.
        title: Its title.
        figures: PNG files by their paths in the page; one that is not listed is shown as text.
    """
    style = files("ffsm_mj.report").joinpath("markdown_page.css").read_text(encoding="utf-8")
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{html.escape(one_line(title))}</title>\n<style>\n{style}</style>\n</head>\n"
        f"<body>\n<main>\n{''.join(_blocks(markdown, figures))}</main>\n</body>\n</html>\n"
    )


def _blocks(markdown: str, figures: Mapping[str, bytes]) -> Iterator[str]:
    """The text between figures by markdown-it, and the figures."""
    page = MarkdownIt("zero").enable(_RULES)
    page.add_render_rule("table_open", lambda *_: '<div class="table"><table>\n')
    page.add_render_rule("table_close", lambda *_: "</table></div>\n")
    text: list[str] = []
    for block in re.split(r"\n{2,}", markdown.strip()):
        figure = _FIGURE.fullmatch(block)
        if figure is None or figure[2] not in figures:
            text.append(block)
            continue
        yield page.render("\n\n".join(text))
        text = []
        alt, data = html.escape(html.unescape(figure[1])), b64encode(figures[figure[2]]).decode("ascii")
        caption = page.renderInline(figure[1])
        yield f'<figure><img alt="{alt}" src="data:image/png;base64,{data}"><figcaption>{caption}</figcaption></figure>\n'
    yield page.render("\n\n".join(text))
