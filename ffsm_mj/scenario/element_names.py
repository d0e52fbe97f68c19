"""Names of list elements of a scenario, by which overrides and ``extends`` address them."""

from __future__ import annotations

from typing import Any


def element_name(element: Any) -> str | None:
    """Name of an element: its ``name``, or ``<a>-<b>`` of a contact rule without one; None if it has none.

    Args:
        element: An item of a list in a scenario, as plain data before validation.
    """
    if not isinstance(element, dict):
        return None
    name = element.get("name")
    if name is None:
        sides = element.get("between")
        if not isinstance(sides, list | tuple) or not all(isinstance(side, str) for side in sides):
            return None
        return "-".join("all" if side == "*" else side.removesuffix("/*") for side in sides)
    return name if isinstance(name, str) else None
