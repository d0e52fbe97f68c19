"""Markdown of reports as HTML: what a reader sees is the text of the Markdown, whatever it contains."""

from __future__ import annotations

import re
from html.parser import HTMLParser

from ffsm_mj.report.markdown import code, escaped, html_page, markdown_table

HOSTILE = 'a|b <script>alert(1)</script> & "q" `c` *d* &lt; ![x](http://e)'


class Reader(HTMLParser):
    """Collects tags and text, as a browser reads them."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        assert not any(name in ("src", "href", "onload") and not (value or "").startswith("data:") for name, value in attrs)

    def handle_data(self, data: str) -> None:
        self.text += data


def read(markdown: str, **figures: bytes) -> Reader:
    reader = Reader()
    page = html_page(markdown, "t", figures)
    reader.feed(page[page.index("<main>") :])
    return reader


def test_any_text_is_shown_as_it_is() -> None:
    found = read(f"# {escaped(HOSTILE)}\n\n{markdown_table(('a', 'b'), [[escaped(HOSTILE), code(HOSTILE)]])}")
    assert found.tags.count("td") == 2
    assert not {"script", "img", "a"} & set(found.tags)
    # Backquotes of a text begin code, inside which entities are those of the text.
    plain = HOSTILE.replace("`", "")
    assert re.sub(r"\s+", " ", found.text).count(plain) == 2
    assert HOSTILE.replace("`", "'") in found.text


def test_blocks() -> None:
    found = read(
        "# T\n\ntext\nmore\n\n- one\n- two\n\n| a | b |\n|---|---:|\n| x | 1 |\n\n![fig](f)\n\n![other](g)", f=b"png"
    )
    wanted = ["main", "h1", "p", "ul", "li", "li", "div", "table", "thead", "tr", "th", "th", "tbody", "tr", "td", "td"]
    assert found.tags == [*wanted, "figure", "img", "figcaption", "p"]
    assert "![other](g)" in found.text
    assert "text\nmore" in found.text
