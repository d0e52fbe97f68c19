"""Small pieces of Markdown: templates and numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from string import Template

_TEMPLATES = Path(__file__).parent / "templates"


def filled(name: str, parts: Mapping[str, str]) -> str:
    """A page from its template, every ``$part`` filled in."""
    return Template(template(name)).substitute(parts)


def template(name: str) -> str:
    """The text of a template."""
    return (_TEMPLATES / name).read_text(encoding="utf-8")


def fixed(value: float, decimals: int) -> str:
    """A number with so many decimals; zero has no sign."""
    text = f"{value:.{max(decimals, 0)}f}"
    return text.removeprefix("-") if float(text) == 0.0 else text


def small(value: float, digits: int = 1) -> str:
    """A difference or spread by its size; what is only rounding is not told in digits."""
    if abs(value) < 1e-9:
        return "< 1e-9"
    if abs(value) >= 1e-3:
        return fixed(value, decimals_for(value, digits))
    return f"{value:.{digits - 1}e}".replace("e-0", "e-")


def decimals_for(value: float, digits: int) -> int:
    """Decimals that show so many significant digits."""
    return max(0, digits - 1 - math.floor(math.log10(abs(value)))) if value else 0
