"""A contact that lasts, as a control law sees it."""

from __future__ import annotations

from typing import NamedTuple

from ffsm_mj.arrays import FloatArray


class ActiveContact(NamedTuple):
    """A closed pair of geoms, under the efforts that are held when the law is asked.

    Attributes:
        pair: Its name in the scenario, or the names of its geoms.
        force_N: Resultant force on the second geom in world axes, N, (3,); zero where it is closed and nothing presses.
        point_m: Centre of pressure, where nothing presses the centre of the points that touch, world axes, m, (3,).
        normal: Mean unit normal from the first geom to the second in world axes, (3,).
    """

    pair: str
    force_N: FloatArray
    point_m: FloatArray
    normal: FloatArray
