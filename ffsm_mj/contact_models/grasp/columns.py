"""Columns of a row that hold the load on a grasped object, and the arrows that viewers draw from them."""

from __future__ import annotations

from ffsm_mj.records.arrows import ArrowColumns
from ffsm_mj.records.signals import Layout

CLOSED_GRASP = "contact.capture_grasp"
"""Column of the number of the closed grasp, from 1; 0 if none."""
LOADS = {
    **{f"contact.capture_force_{x}_N": "N" for x in "xyz"},
    **{f"contact.capture_torque_{x}_N_m": "N m" for x in "xyz"},
}
"""Columns of the load on a grasped object, with units."""
POINT = tuple(f"contact.capture_centre_{x}_m" for x in "xyz")
"""Columns of its point of application, the object's site; NaN if no object is grasped."""
EVENT_LOADS = {
    "contact.capture_event_force_N": "N",
    "contact.capture_event_torque_N_m": "N m",
    "contact.capture_event_s": "s",
}
"""Greatest load on a grasped object right after an event since the last sample, and its time; units by column."""


def load_arrows(layout: Layout) -> list[ArrowColumns]:
    """Force and torque on the grasped object, at its site; none if the run has no grasps."""
    loads = [*LOADS]
    if not {*loads, *POINT} <= layout.index.keys():
        return []
    point = layout.places(POINT)
    return [
        ArrowColumns("capture", "force on the grasped object", layout.places(loads[:3]), point),
        ArrowColumns("capture_torque", "torque on the grasped object", layout.places(loads[3:]), point, unit="N m"),
    ]
