"""A scene at t = 0, as viewers show it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.reach import Reach
from ffsm_mj.model.system import System


class NamedPoint(NamedTuple):
    """A point in world axes, (3,), m, and what it is."""

    name: str
    point_m: FloatArray


class CheckedPair(NamedTuple):
    """A pair of geoms whose contacts are resolved: its name, geom ids, coefficients of restitution and of friction."""

    name: str
    geoms: tuple[int, int]
    restitution: float
    mu: float


@dataclass(frozen=True, kw_only=True)
class InitialScene:
    """A scene at t = 0.

    Attributes:
        name: Name of the scenario.
        system: Robot and objects.
        data: MuJoCo data at t = 0, all derived quantities current.
        targets: Targets of the tip and of phases.
        centres: Centres of mass.
        reaches: Reach of each tip.
        pairs: Pairs of geoms whose contacts are resolved.
        ignored: Geom ids of ignored pairs.
        lines: Text shown beside the scene.
    """

    name: str
    system: System
    data: Any
    targets: Sequence[NamedPoint]
    centres: Sequence[NamedPoint]
    reaches: Sequence[Reach]
    pairs: Sequence[CheckedPair]
    ignored: frozenset[frozenset[int]]
    lines: Sequence[str]
