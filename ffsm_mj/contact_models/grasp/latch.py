"""One grasp of a run: whether it is armed, how near its sites have come, and what moves while it holds."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from ffsm_mj.contact_models.grasp.closing_time import Bounds, lowest
from ffsm_mj.contact_models.grasp.config import CaptureConfig
from ffsm_mj.contact_models.grasp.grasped_motion import GraspedMotion
from ffsm_mj.contact_models.grasp.load import InterfaceLoad
from ffsm_mj.contact_models.grasp.nearness import Nearness, Sites, Vectors
from ffsm_mj.contact_models.interface import ContactModel, Scene
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.dynamics.step_path import StepPath
from ffsm_mj.model.grasp import Grasp
from ffsm_mj.model.system import System

_PERHAPS = 1.01
"""A step whose chords come so near to the least so far is looked into."""


class Latch:
    """One grasp.

    Attributes:
        number: Its place among the grasps of the run, from 1.
        grasp: Its bodies and sites.
        sites: The same in the system that is logged.
        pairs: Names of the pairs at whose impact it closes.
        held: What moves while it holds.
        load: What the link puts on the object then.
        stated_bounds: Bounds under which it closes, by the name of the value in :class:`Nearness`; empty where it has none.
        armed: Whether it may close.
        least: Nearest that it has come to its bounds since it was armed, inside steps too, and when in s; None where it was
            not looked at.
    """

    def __init__(
        self,
        number: int,
        scene: Scene,
        free: Motion,
        grasp: Grasp,
        config: CaptureConfig,
        system: System,
        others: Sequence[ContactModel] = (),
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
        self.sites, self.held = Sites(scene.system, grasp), GraspedMotion(free, scene, system, grasp)
        self.load = InterfaceLoad(number, self.held, scene.data.site_xpos[self.sites.object], scene.data, others)
        self.pairs = frozenset(config.when.touch or ())
        stated = config.when.within.bounds if config.when.within is not None else ()
        self._bounds = Bounds(stated) if stated else None
        self.stated_bounds = {
            name: bound for name, bound in zip(Nearness._fields, stated, strict=False) if bound is not None
        }
        self._start: Vectors | None = None
        self._ended: tuple[float, Vectors] = math.nan, []
        self._clock = 0.0
        self.armed = False
        self.least: tuple[Nearness, float] | None = None

    @property
    def watches(self) -> bool:
        """Whether it may close anywhere on the way."""
        return self.armed and self._bounds is not None

    def arm(self, time_s: float) -> None:
        """Let it close from here on."""
        self.armed, self.least, self._start, self._clock = True, None, None, time_s

    def disarm(self) -> None:
        """Let it close no more."""
        self.armed = False

    def jumped(self) -> None:
        """The state has changed at one instant."""
        self._start = None

    def near(self) -> Nearness:
        """How near the sites are at the state in ``data``."""
        return Nearness.of(self.sites.vectors(self._data))

    def ratio(self, near: Nearness) -> float:
        """The largest value over its bound."""
        return self._bounds.ratio(near) if self._bounds is not None else 0.0

    def is_within(self) -> bool:
        """Whether its bounds hold at the state in ``data``, where a step begins."""
        if self._start is None:
            self._start = self.sites.vectors(self._data)
        return self.ratio(Nearness.of(self._start)) <= 1.0

    def was_clear(self, longest_s: float) -> bool:
        """Whether its bounds held nowhere in the step that ends at the state in ``data``; it is no longer than that."""
        if self._bounds is None or self._start is None:
            return True
        self._ended = float(self._data.time), self.sites.vectors(self._data)
        start, end = Nearness.of(self._start), Nearness.of(self._ended[1])
        return self.ratio(end) > 1.0 and not self._bounds.may_dip(start, end, longest_s)

    def first(self, path: StepPath, duration_s: float) -> float | None:
        """When its bounds first hold within so much of the last step; None where they do not."""
        return self._bounds.first(self._at(path), duration_s) if self._bounds is not None else None

    def after_substep(self, path: StepPath, duration_s: float) -> None:
        """A (sub-)step is over, ``data`` at its end: keep in mind how near it came on the way."""
        bounds, at = self._bounds, self._at(path)
        if bounds is None:
            return
        # Looked at before, unless somebody has cut the step.
        end = self._ended[1] if self._ended[0] == self._data.time else self.sites.vectors(self._data)
        if self._start is None:
            path.move_to(0.0)
            self._start = self.sites.vectors(self._data)
        self._keep(Nearness.of(self._start), 0.0)
        self._keep(Nearness.of(end), duration_s)
        if self.least is not None and bounds.lowest_between(self._start, end) < _PERHAPS * self.ratio(self.least[0]):
            dip = lowest(lambda time_s: self.ratio(at(time_s)), 0.0, duration_s)
            self._keep(at(dip), dip)
        path.move_to(duration_s)
        self._start, self._ended = end, (math.nan, [])
        self._clock += duration_s

    def _at(self, path: StepPath) -> Callable[[float], Nearness]:
        """Goes to a time of a step, and looks."""

        def at(time_s: float) -> Nearness:
            path.move_to(time_s)
            return self.near()

        return at

    def _keep(self, near: Nearness, after_s: float) -> None:
        if self.least is None or self.ratio(near) < self.ratio(self.least[0]):
            self.least = near, self._clock + after_s
