"""Forces of contacts that last, and the load on a held object, as viewers draw them: arrows, from columns in the rows."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ffsm_mj.arrays import FloatArray
from ffsm_mj.records.signals import CAPTURE_CENTRE, CAPTURE_LOADS, Layout

_GROUP, _SIZE = "contact.", "_force_N"


class ForceColumns(NamedTuple):
    """Where rows have the force of a pair, or force or torque of a grasp.

    Attributes:
        pair: Its name, as columns have it; ``capture`` and ``capture_torque``.
        vector: Columns of the force on the second geom, or of the load on the held object, world axes.
        centre: Columns of the centre of pressure, or of the object's site, world axes, m; NaN where nothing acts.
        size: Column of the resultant where there is one.
        unit: N, or N m.
    """

    pair: str
    vector: npt.NDArray[np.intp]
    centre: npt.NDArray[np.intp]
    size: int | None = None
    unit: str = "N"

    @property
    def turns(self) -> bool:
        """Whether it is a torque."""
        return self.unit != "N"

    def sizes(self, rows: FloatArray) -> FloatArray:
        """Of the force or torque, (n,)."""
        return np.asarray(np.linalg.norm(rows[:, self.vector], axis=1) if self.size is None else rows[:, self.size])

    def pressing(self, rows: FloatArray) -> npt.NDArray[np.bool_]:
        """In which rows it acts, (n,)."""
        return np.asarray(np.isfinite(rows[:, self.centre]).all(axis=1) & np.isfinite(rows[:, self.vector]).all(axis=1))


def force_columns(layout: Layout) -> list[ForceColumns]:
    """Those of all pairs of a run that may last, and of what it may hold."""
    return [*_found(layout), *_of_captures(layout)]


def _of_captures(layout: Layout) -> Iterator[ForceColumns]:
    loads = [*CAPTURE_LOADS]
    if {*loads, *CAPTURE_CENTRE} <= layout.index.keys():
        centre = layout.places(CAPTURE_CENTRE)
        yield ForceColumns("capture", layout.places(loads[:3]), centre)
        yield ForceColumns("capture_torque", layout.places(loads[3:]), centre, unit="N m")


def _found(layout: Layout) -> Iterator[ForceColumns]:
    for key in layout.keys:
        # A contact model of somebody else's may have a force among its columns too, but not all of these.
        if key.startswith(_GROUP) and key.endswith(_SIZE) and key.removesuffix(_SIZE) + "_mode" in layout.index:
            pair = key.removeprefix(_GROUP).removesuffix(_SIZE)
            vector = layout.places(f"{_GROUP}{pair}_force_{axis}_N" for axis in "xyz")
            centre = layout.places(f"{_GROUP}{pair}_centre_{axis}_m" for axis in "xyz")
            yield ForceColumns(pair, vector, centre, layout.index[key])
