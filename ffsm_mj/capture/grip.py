"""One grasp of a run: whether it is armed, how near its sites have come, and what moves while it holds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ffsm_mj.capture.config import CaptureConfig
from ffsm_mj.capture.held import Held
from ffsm_mj.capture.load import InterfaceLoad
from ffsm_mj.capture.nearness import Nearness, Sites
from ffsm_mj.capture.passing import Bounds
from ffsm_mj.contact.regimes import Regime, Scene
from ffsm_mj.model.grasp import Grasp
from ffsm_mj.model.system import System
from ffsm_mj.motion.motion import Motion


class Grip:
    """One grasp.

    Attributes:
        number: Its place among the grasps of the run, from 1.
        grasp: Its bodies and sites.
        sites: The same in the system that is logged.
        pairs: Names of the pairs at whose impact it closes.
        held: What moves while it holds.
        load: What the link puts on the object then.
        armed: Whether it may close.
        least: Nearest that it has come to its bounds since it was armed, and when in s; None where it was not looked at.
    """

    def __init__(
        self,
        number: int,
        scene: Scene,
        free: Motion,
        grasp: Grasp,
        config: CaptureConfig,
        system: System,
        others: Sequence[Regime] = (),
    ) -> None:
        """It is not armed.

        Args:
            number: Its place among the grasps of the run, from 1.
            scene: The system that is logged.
            free: Its motion.
            grasp: Its bodies and sites.
            config: What the scenario says of it.
            system: The one in which it holds, with a model of the run's own.
            others: Who may push what is held.
        """
        self.number, self.grasp, self._data = number, grasp, scene.data
        self.sites, self.held = Sites(scene.system, grasp), Held(free, scene, system, grasp)
        self.load = InterfaceLoad(number, self.held, scene.data.site_xpos[self.sites.object], scene.data, others)
        self.pairs = frozenset(config.when.touch or ())
        self._bounds = Bounds(config.when.within.bounds) if config.when.within is not None else None
        self._start: Nearness | None = None
        self.armed = False
        self.least: tuple[Nearness, float] | None = None

    @property
    def watches(self) -> bool:
        """Whether it may close anywhere on the way."""
        return self.armed and self._bounds is not None

    def arm(self) -> None:
        """Let it close; where it is armed already nothing changes."""
        if not self.armed:
            self.armed, self.least = True, None

    def near(self) -> Nearness:
        """How near the sites are at the state in ``data``."""
        return self.sites.nearness(self._data)

    def ratio(self, near: Nearness) -> float:
        """The largest value over its bound."""
        return self._bounds.ratio(near) if self._bounds is not None else 0.0

    def is_within(self) -> bool:
        """Whether its bounds hold at the state in ``data``, where a step begins."""
        self._start = self._kept()
        return self.ratio(self._start) <= 1.0

    def was_clear(self, longest_s: float) -> bool:
        """Whether its bounds held nowhere in the step that ends at the state in ``data``; it is no longer than that."""
        start, end = self._start, self._kept()
        if self._bounds is None or start is None:
            return True
        return self.ratio(end) > 1.0 and not self._bounds.may_dip(start, end, longest_s)

    def first(self, path: Any, duration_s: float) -> float | None:
        """When its bounds first hold within so much of the last step; None where they do not."""

        def at(time_s: float) -> Nearness:
            path.move_to(time_s)
            return self.near()

        return self._bounds.first(at, duration_s) if self._bounds is not None else None

    def _kept(self) -> Nearness:
        """How near the sites are, the nearest kept in mind."""
        near = self.near()
        if self.least is None or self.ratio(near) < self.ratio(self.least[0]):
            self.least = near, float(self._data.time)
        return near
