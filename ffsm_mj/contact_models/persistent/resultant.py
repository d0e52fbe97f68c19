"""Resultant contact force of a pair at one state, and its centre of pressure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact_models.persistent.rows import ContactPoint, PointRows


class Resultant(NamedTuple):
    """Resultant contact force of a pair at one state.

    Attributes:
        force: Force on geom b, N, (3,).
        centre: Centre of pressure; mean of the contact points if none carries force, m, (3,).
        normal: Mean unit normal, (3,).
        points: Number of contact points.
        mode: Their features.
    """

    force: FloatArray
    centre: FloatArray
    normal: FloatArray
    points: int
    mode: str

    @property
    def size(self) -> float:
        """Norm of the force, N."""
        return math.hypot(*self.force.tolist())


def resultant(
    contact_points: Sequence[ContactPoint],
    rows: PointRows,
    forces: FloatArray,
    pair: ContactPair,
    friction: FloatArray | None = None,
) -> Resultant:
    """Resultant over the contact points of one pair, of normal forces (k,) and friction forces (k, 3)."""
    mine = [i for i, contact in enumerate(contact_points) if contact.pair is pair]
    if len(mine) == 1:  # the usual case, evaluated in every stage
        only, here = mine[0], rows.states[mine[0]]
        force = forces[only] * here.normal if friction is None else forces[only] * here.normal + friction[only]
        return Resultant(force, here.point, here.normal, 1, contact_points[only].feature.name)
    part = slice(mine[0], mine[-1] + 1) if mine else slice(0)  # the points of a pair are consecutive
    normals, points, pushed = rows.normals[part], rows.points[part], forces[part]
    total = float(pushed.sum())
    weights = pushed / total if total > 0.0 else np.full(len(mine), 1.0 / max(1, len(mine)))
    normal = weights @ normals
    length = math.hypot(*normal.tolist())
    names = " + ".join(dict.fromkeys(contact_points[i].feature.name for i in mine))
    force = pushed @ normals if friction is None else pushed @ normals + friction[part].sum(axis=0)
    return Resultant(force, weights @ points, normal / length if length else normal, len(mine), names)
