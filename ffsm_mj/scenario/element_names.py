"""Names of list elements of a scenario, by which overrides and ``extends`` address them."""

from __future__ import annotations

from typing import Any


def element_name(element: Any) -> str | None:
    """Name of an element: its ``name``, or ``<a>-<b>`` of an impact pair without one; None if it has none.

    Args:
        element: An item of a list in a scenario, as plain data before validation.
    """
    if not isinstance(element, dict):
        return None
    name = element.get("name")
    if name is None:
        geoms = element.get("geoms") or [element.get("robot_geom"), element.get("object_geom")]
        if not isinstance(geoms, list | tuple) or not all(isinstance(geom, str) for geom in geoms):
            return None
        return "-".join(geoms)
    return name if isinstance(name, str) else None
