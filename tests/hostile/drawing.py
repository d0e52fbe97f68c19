"""A case of any series by its number; each series of one subject has a seed of its own."""

from __future__ import annotations

from typing import NamedTuple

from tests.hostile import friction, grasps, strangers
from tests.hostile.campaigns import Files
from tests.hostile.cases import Case, case


class Logs(NamedTuple):
    """Logs of whole runs and files of a campaign, to be mutated; the campaign only where a series asks for it."""

    plain: bytes
    hit: bytes
    capture: bytes
    friction: bytes
    campaign: Files
    scene: Files


def drawn(seed: int, number: int, logs: Logs) -> Case:
    """A case; equal seeds give equal cases."""
    if seed == grasps.GRASPS:
        return grasps.drawn(number, logs.capture)
    if seed == friction.FRICTION:
        return friction.drawn(number, logs.friction)
    if seed == strangers.STRANGERS:
        return strangers.drawn(number, logs[:4], logs.campaign, logs.scene)
    return case(seed, number, (logs.plain, logs.hit))
