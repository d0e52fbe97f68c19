"""Texts and numbers in the Markdown of reports."""

from __future__ import annotations

import html

from ffsm_mj.errors import one_line


def code(name: str) -> str:
    """A name as code."""
    return "`" + one_line(name).replace("`", "'").replace("|", "\\|") + "`"


def escaped(text: str) -> str:
    """A text of unknown origin on one line, markup escaped; also for a table cell."""
    return html.escape(one_line(text), quote=False).replace("|", "\\|")


def number(value: float) -> str:
    """A number with four digits."""
    return f"{value:.4g}"


def percent(share: float) -> str:
    """A fraction in percent, with three digits."""
    return f"{100 * share:.3g} %"
