"""Arrows as every viewer draws them: forces and torques of a run in successive rows, and the drawn length of a vector."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ffsm_mj.arrays import FloatArray
from ffsm_mj.log.palette import FORCE, PART_OF_FORCE, TORQUE, Colour
from ffsm_mj.records.arrows import ArrowColumns
from ffsm_mj.records.header import RunHeader
from ffsm_mj.records.kinds import kinds_of

ARROW_M = (0.4, 1.5)
"""Least and greatest drawn length of an arrow at scale 1, m; between them 1 m stands for 1 N, 1 N m or 1 N s."""


class ArrowSeries(NamedTuple):
    """One arrow in successive rows.

    Attributes:
        columns: The declaration that it comes from: name and unit.
        acts: Whether it is drawn in each row: its vector and point are finite, and its magnitude is positive, (n,).
        sizes: Magnitude, (n,), in its unit.
        origins: Points at which the drawn arrow starts in world axes, (n, 3), m; zero in rows in which it is not drawn.
        vectors: Drawn vector in world axes, (n, 3), m; the arrow ends at the point of application.
    """

    columns: ArrowColumns
    acts: npt.NDArray[np.bool_]
    sizes: FloatArray
    origins: FloatArray
    vectors: FloatArray


def declared_arrows(header: RunHeader) -> list[ArrowColumns]:
    """Arrows that the contact models of a run declare through their kinds of records."""
    return [arrow for kind in kinds_of(header.kinds) if kind.arrows is not None for arrow in kind.arrows(header.layout)]


def arrow_series(columns: ArrowColumns, rows: FloatArray, scale: float) -> ArrowSeries:
    """The arrow of one declaration in some rows.

    Args:
        columns: The declaration.
        rows: Rows of the log, (n, number of signals).
        scale: Scale of markers (:func:`ffsm_mj.log.marker_scale.marker_scale`).
    """
    forces, points = rows[:, columns.vector], rows[:, columns.point]
    # The drawn length follows the vector, not the column of the magnitude: a log of unknown origin may hold any values.
    norms = np.linalg.norm(forces, axis=1)
    acts = np.isfinite(points).all(axis=1) & np.isfinite(forces).all(axis=1) & (norms > 0.0)
    vectors = np.zeros_like(forces)
    vectors[acts] = forces[acts] * drawn_length(norms[acts], scale)[:, None] / norms[acts][:, None]
    origins = np.where(acts[:, None], points - vectors, 0.0)
    return ArrowSeries(columns, acts, norms if columns.size is None else rows[:, columns.size], origins, vectors)


def arrow_colour(columns: ArrowColumns) -> Colour:
    """Colour of an arrow, of a force, a part of one or a torque, where it does not depend on the other arrows."""
    if columns.is_torque:
        return TORQUE
    return PART_OF_FORCE if columns.is_part else FORCE


def drawn_vector(direction: Sequence[float], magnitude: float, scale: float) -> FloatArray:
    """Drawn vector of an arrow, (3,), m, of its unit vector and its magnitude in N, N m or N s, at a scale of markers."""
    return np.array(direction) * drawn_length(magnitude, scale)


def drawn_length(magnitude: FloatArray | float, scale: float) -> FloatArray:
    """Drawn length of arrows in m, of their magnitudes in N, N m or N s, at a scale of markers."""
    return scale * np.clip(magnitude, *ARROW_M)
