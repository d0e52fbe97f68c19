"""Pairs of geoms that are on one rigid body in a motion, but not in the logged system."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ffsm_mj.dynamics.loops.latch import LatchedBodies
from ffsm_mj.dynamics.motion import Motion


def rigid_pairs(logged: Any, motion: Motion, latches: Sequence[LatchedBodies] = ()) -> frozenset[frozenset[int]]:
    """Pairs of geom ids of the logged system.

    Args:
        logged: MuJoCo model of the logged system.
        motion: The motion.
        latches: Closed latches between bodies of the logged system; those that stop everything join rigid bodies.
    """
    group = [int(motion.model.body_weldid[motion.bodies[body]]) for body in range(logged.nbody)]
    for latch in latches:
        one, other = group[latch.first], group[latch.second]
        if latch.count == 6:
            group = [one if each == other else each for each in group]
    geoms, body, weld = range(logged.ngeom), logged.geom_bodyid, logged.body_weldid
    return frozenset(
        frozenset((a, b))
        for a in geoms
        for b in geoms
        if a < b and group[body[a]] == group[body[b]] and weld[body[a]] != weld[body[b]]
    )
