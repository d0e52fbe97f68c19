"""A page of Markdown as one self-contained HTML file, for the Markdown that reports of this package consist of.

That is: headings, paragraphs, lists, tables, code in single backquotes, and figures in paragraphs of their own. The text may
contain HTML entities but no markup: every other ``<`` is shown as it is.
"""

from __future__ import annotations

import html
import re
from base64 import b64encode
from collections.abc import Iterable, Iterator, Mapping
from importlib.resources import files
from itertools import groupby

from ffsm_mj.errors import one_line

_FIGURE = re.compile(r"!\[(.*)\]\(([^)]*)\)")
_CODE = re.compile(r"`([^`]*)`")
_ESCAPE = re.compile(r"\\([|*])")
_CELL_END = re.compile(r"(?<!\\)\|")
_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'"


def html_page(markdown: str, title: str, figures: Mapping[str, bytes]) -> str:
    """HTML of a page, which loads nothing.

    Args:
        markdown: The page.
        title: Its title.
        figures: PNG files by their paths in the page; one that is not listed is shown as text.
    """
    blocks = "\n".join(_blocks(markdown, figures))
    style = files("ffsm_mj.report").joinpath("markdown_page.css").read_text(encoding="utf-8")
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{html.escape(one_line(title))}</title>\n<style>\n{style}</style>\n</head>\n"
        f"<body>\n<main>\n{blocks}\n</main>\n</body>\n</html>\n"
    )


def _blocks(markdown: str, figures: Mapping[str, bytes]) -> Iterator[str]:
    for block in re.split(r"\n{2,}", markdown.strip()):
        lines = block.split("\n")
        figure = _FIGURE.fullmatch(block)
        if figure and figure[2] in figures:
            yield _figure(figure[1], figures[figure[2]])
        elif heading := re.fullmatch(r"(#{1,4}) (.*)", block):
            level = len(heading[1])
            yield f"<h{level}>{_inline(heading[2])}</h{level}>"
        elif lines[0].startswith("|") and len(lines) > 1:
            yield _table(lines)
        else:
            yield from _paragraphs(lines)


def _paragraphs(lines: Iterable[str]) -> Iterator[str]:
    for is_list, part in groupby(lines, lambda line: line.startswith("- ")):
        if is_list:
            yield f"<ul>{''.join(f'<li>{_inline(line[2:])}</li>' for line in part)}</ul>"
        else:
            yield f"<p>{_inline(' '.join(part))}</p>"


def _figure(title: str, png: bytes) -> str:
    data = b64encode(png).decode("ascii")
    alt = html.escape(html.unescape(title))
    return f'<figure><img alt="{alt}" src="data:image/png;base64,{data}"><figcaption>{_inline(title)}</figcaption></figure>'


def _table(lines: list[str]) -> str:
    """A table whose second line separates its head."""
    head, sides, *rows = ([cell.strip() for cell in _CELL_END.split(line.strip())[1:-1]] for line in lines)
    top = f"<thead><tr>{_cells(head, sides, 'th')}</tr></thead>"
    body = "\n".join(f"<tr>{_cells(row, sides, 'td')}</tr>" for row in rows)
    return f'<div class="table"><table>\n{top}\n<tbody>\n{body}\n</tbody></table></div>'


def _cells(cells: Iterable[str], sides: Iterable[str], tag: str) -> str:
    """Cells of a row; those of columns whose separator ends with a colon are numbers."""
    opening = (f'{tag} class="number"' if side.endswith(":") else tag for side in sides)
    return "".join(f"<{each}>{_inline(cell)}</{tag}>" for each, cell in zip(opening, cells, strict=False))


def _inline(text: str) -> str:
    """A line of text with its code; entities of the text stand for their characters, those of code for themselves."""
    parts = _CODE.split(_ESCAPE.sub(r"\1", text))
    return "".join(
        f"<code>{html.escape(part, quote=False)}</code>" if i % 2 else html.escape(html.unescape(part), quote=False)
        for i, part in enumerate(parts)
    )
