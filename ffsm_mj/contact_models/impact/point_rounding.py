"""Points of impacts on rims that lie almost flat, and on sides at a small angle: rounding of a state moves them far.

The contact point of a rim travels at the rate of its tilt over the tilt. A state that is transferred, as a log replay does
with a grasped object, has rotations known to rounding, so the point is known to rounding over the tilt, times the radius.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ffsm_mj.contact.features.gap_function import tilt_rounding
from ffsm_mj.contact.features.search import features
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact_models.event import Scene
from ffsm_mj.contact_models.impact.closed_pairs import ClosedPairs
from ffsm_mj.contact_models.impact.friction.tangents import tangents
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.tolerances import MERGED_M


def moved_points(touching: ClosedPairs, scene: Scene, motion: Motion) -> Iterator[ClosedPairs]:
    """Pairs in contact at the state in ``data``, with one point after the other moved by its rounding along two tangents.

    There are none in the motion of the logged system itself: its state is that of a log bit by bit.
    """
    model, data = scene.system.mj, scene.data
    for i, (pair, near) in enumerate(touching if motion.data is not data else ()):
        if not isinstance(pair, ContactPair) or len(near.points) > 1:
            continue
        share = max((tilt_rounding(each, data, moves=True) for each in features(pair, model, data, near)), default=0.0)
        # No rim is larger, and no side much longer, than the distance of the point from the middle of its geom.
        reach = share * float(np.linalg.norm(data.geom_xpos[list(pair.ids)] - near.points[0], axis=1).max())
        if reach > MERGED_M:
            for along in tangents(near.normal):
                moved = pair.at_velocities(data, replace(near, points=near.points + reach * along))
                yield [*touching[:i], (pair, moved), *touching[i + 1 :]]
