"""Columns of a row that hold the load on a grasped object, and the arrows that viewers draw from them."""

from __future__ import annotations

from ffsm_mj.records.arrows import ArrowColumns
from ffsm_mj.records.signals import Layout, Signal

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

_LOADS = ("force on the grasped object", "torque on the grasped object about its site")
_BETWEEN = "right after an event since the previous sample"
_AT_EVENTS = (
    f"largest force on the grasped object {_BETWEEN}, under the efforts set there; 0 if there was no event",
    f"largest torque on the grasped object about its site {_BETWEEN}; 0 if there was no event",
    f"time of the largest force {_BETWEEN}; NaN if there was no event",
)
SIGNALS = (
    Signal(
        "contact", "capture_grasp", "", "number of the closed grasp among the captures of the scenario, from 1; 0 if none"
    ),
    *(
        Signal("contact", key.partition(".")[2], unit, f"{_LOADS[i // 3]}, world axes, under the efforts of this row")
        for i, (key, unit) in enumerate(LOADS.items())
    ),
    *(
        Signal(
            "contact",
            key.partition(".")[2],
            "m",
            "site of the grasped object, where the load acts; NaN if no grasp is closed",
        )
        for key in POINT
    ),
    *(
        Signal("contact", key.partition(".")[2], unit, meaning)
        for (key, unit), meaning in zip(EVENT_LOADS.items(), _AT_EVENTS, strict=True)
    ),
)
"""Columns of a grasp model."""


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
