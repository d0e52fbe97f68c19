"""Forces of contact points in given modes at one state, and whether these are valid."""

from __future__ import annotations

from typing import NamedTuple

from ffsm_mj.arrays import FloatArray, IntArray


class Solution(NamedTuple):
    """Forces in given modes at one state.

    Attributes:
        kinds: Modes, (k,).
        directions: Directions of slip along (t1, t2), (k, 2).
        forces: Forces (n, t1, t2), N, (k, 3).
        accelerations: Relative accelerations (n, t1, t2), m/s^2, (k, 3).
        validity: Least margin of all conditions, m/s^2; negative if one is violated.
        exact: The same without the excess over the limit of friction up to which points stick: zero at the limit.
        releases: Whether the condition violated most is that limit.
    """

    kinds: IntArray
    directions: FloatArray
    forces: FloatArray
    accelerations: FloatArray
    validity: float
    exact: float
    releases: bool

    @property
    def valid(self) -> bool:
        """Whether all conditions hold."""
        return self.validity >= 0.0
