"""Forces of contacts that last, as viewers draw them: an arrow for each pair that presses, from its columns in the rows."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ffsm_mj.arrays import FloatArray
from ffsm_mj.records.signals import Layout

_GROUP, _SIZE = "contact.", "_force_N"


class ForceColumns(NamedTuple):
    """Where rows have the force of a pair.

    Attributes:
        pair: Its name, as columns have it.
        size: Column of the resultant, N.
        vector: Columns of the force on the second geom, world axes, N.
        centre: Columns of the centre of pressure, world axes, m; NaN where nothing presses.
    """

    pair: str
    size: int
    vector: npt.NDArray[np.intp]
    centre: npt.NDArray[np.intp]

    def pressing(self, rows: FloatArray) -> npt.NDArray[np.bool_]:
        """In which rows the pair presses, (n,)."""
        return np.asarray(np.isfinite(rows[:, self.centre]).all(axis=1) & np.isfinite(rows[:, self.vector]).all(axis=1))


def force_columns(layout: Layout) -> list[ForceColumns]:
    """Those of all pairs of a run that may last."""
    return list(_found(layout))


def _found(layout: Layout) -> Iterator[ForceColumns]:
    for key in layout.keys:
        # A regime of somebody else's may have a force among its columns too, but not all of these.
        if key.startswith(_GROUP) and key.endswith(_SIZE) and key.removesuffix(_SIZE) + "_mode" in layout.index:
            pair = key.removeprefix(_GROUP).removesuffix(_SIZE)
            vector = layout.places(f"{_GROUP}{pair}_force_{axis}_N" for axis in "xyz")
            centre = layout.places(f"{_GROUP}{pair}_centre_{axis}_m" for axis in "xyz")
            yield ForceColumns(pair, layout.index[key], vector, centre)
