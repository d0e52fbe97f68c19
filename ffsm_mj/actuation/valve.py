"""Valve of an on-off thruster: a Schmitt trigger with a minimum on-time."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ffsm_mj.actuation.actuator_config import OnOffConfig
from ffsm_mj.state import Stateful
from ffsm_mj.tolerances import SCHEDULED_S


class Valve(Stateful):
    """Valve of an on-off thruster, with its state.

    Attributes:
        firing: Direction in which it fires, 1 or -1, or 0 while it is closed.
    """

    @dataclass
    class State:
        """Direction in which it fires, and since when, s."""

        firing: float
        lit_at_s: float

    def __init__(self, config: OnOffConfig) -> None:
        """Shut."""
        self._force, self._threshold, self._min_on_s = config.force_N, config.threshold_N, config.min_on_time_s
        self._release = config.threshold_N if config.release_N is None else config.release_N
        self.firing, self._lit_at_s = 0.0, 0.0

    def fire(self, wanted: float, lower: float, upper: float, time_s: float) -> float:
        """Update the valve and return its force.

        It opens above the threshold, and stays open above the release or for its minimum on-time.
        """
        size = abs(wanted)
        sign = math.copysign(1.0, wanted)
        stays = self.firing == sign and size >= self._release and size > 0.0
        held = self.firing != 0.0 and time_s - self._lit_at_s < self._min_on_s - SCHEDULED_S
        firing = self.firing if stays or held else sign if size > self._threshold else 0.0
        if not lower <= firing * self._force <= upper:
            firing = 0.0  # a one-sided thruster never fires backwards
        if firing not in (0.0, self.firing):
            self._lit_at_s = time_s
        self.firing = firing
        return firing * self._force

    def shut(self) -> float:
        """Close the valve for loss of power; return its force."""
        self.firing = 0.0
        return 0.0

    def stand(self, force: float, time_s: float) -> float:
        """Restore the state that a force implies, from a time on; return the force."""
        firing = math.copysign(1.0, force) if force else 0.0
        if firing not in (0.0, self.firing):
            self._lit_at_s = time_s
        self.firing = firing
        return firing * self._force
