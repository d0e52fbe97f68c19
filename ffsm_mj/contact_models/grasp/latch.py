"""One grasp of a run: arming, closing condition, closest approach, and its load while it is closed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ffsm_mj._core.closing import Norms, RelativeMotion
from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.grasp.closing_condition import At, Bounds, ClosestApproach, Sites
from ffsm_mj.contact_models.grasp.config import GraspConfig
from ffsm_mj.contact_models.grasp.grasped_motion import GraspedMotion
from ffsm_mj.contact_models.grasp.latch_joints import axis_angle_rad
from ffsm_mj.contact_models.grasp.load import InterfaceLoad, LoadLimit, LoopLoad
from ffsm_mj.contact_models.grasp.loops import LoopForces
from ffsm_mj.contact_models.interface import ForceSource, Replayable, Scene
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.dynamics.step_path import StepPath
from ffsm_mj.model.grasp import Grasp
from ffsm_mj.model.system import System
from ffsm_mj.state import entries


class Latch:
    """One grasp.

    Attributes:
        number: Its number among the grasps of the run, from 1.
        grasp: Its bodies and sites.
        sites: The sites in the logged system.
        contacts: Names of the contact rules and pairs whose impact closes it.
        grasped_motion: The motion in which its object is a child of the link; None between two objects, which rows keep.
        load: Load of the link on the object while it is closed, by whatever holds it.
        limit: Load at which it opens; None: it bears any.
        armed: Whether it may close.
        closest: Closest approach to its bounds since it was armed; None without bounds.
    """

    @dataclass
    class State:
        """Whether it is armed, and its closest approach since."""

        armed: bool
        closest: Any

    def __init__(
        self,
        number: int,
        scene: Scene,
        free: Motion,
        grasp: Grasp,
        config: GraspConfig,
        system: System | None,
        loops: LoopForces,
        others: Sequence[ForceSource] = (),
    ) -> None:
        """Initialise it disarmed and open.

        Args:
            number: Its number among the grasps of the run, from 1.
            scene: The logged system and its data.
            free: Its motion.
            grasp: Its bodies and sites.
            config: Its configuration in the scenario.
            system: The system in which its object is a child of the link, with a model owned by the run; None for a grasp
                between two objects.
            loops: Rows of further grasps.
            others: Contact models that may exert forces on the grasped object, with ``loops``.
        """
        self.number, self.grasp, self._data = number, grasp, scene.data
        self.sites = Sites(scene.system, grasp)
        self.grasped_motion = GraspedMotion(free, scene, system, grasp) if system is not None else None
        site = scene.data.site_xpos[self.sites.object]
        # Two ways to the load: the interface force of a child body, the constraint forces of rows. Which one holds changes
        # as others close and open.
        self._of_child = (
            InterfaceLoad(self.grasped_motion, site, scene.data, others) if self.grasped_motion is not None else None
        )
        self._of_rows = LoopLoad(grasp.name, loops, site)
        self._others = tuple(other for other in others if isinstance(other, Replayable))
        self.load: InterfaceLoad | LoopLoad = self._of_child or self._of_rows
        self.limit = LoadLimit(config.load_limit, self._load_now) if config.load_limit is not None else None
        self.contacts = frozenset(config.when.touch or ())
        stated = config.when.within.bounds if config.when.within is not None else ()
        self._bounds = Bounds(stated) if stated else None
        self._step_start: RelativeMotion | None = None
        self._step_end: tuple[float, RelativeMotion] | None = None
        self.armed = False
        self.closest: ClosestApproach | None = None

    def get_state(self) -> State:
        """Whether it is armed, and what it has seen since."""
        return self.State(self.armed, None if self.closest is None else self.closest.get_state())

    def set_state(self, state: Any) -> None:
        """Go on from a state."""
        values = entries(state, ("armed", "closest"), f"grasp {self.grasp.name}")
        # What was seen in the step before belongs to another state; it is evaluated anew where it is missing.
        self.armed, self._step_start, self._step_end = bool(values["armed"]), None, None
        self.closest = None
        if values["closest"] is not None and self._bounds is not None:
            self.closest = ClosestApproach(self._bounds, math.nan)
            self.closest.set_state(values["closest"])

    @property
    def watches(self) -> bool:
        """Whether it may close at any time in a step: it is armed and has bounds."""
        return self.armed and self._bounds is not None

    def arm(self, time_s: float) -> None:
        """Arm the latch: it may close from now on."""
        self.armed, self._step_start = True, None
        # A grasp that waits for an impact has no approach to measure.
        self.closest = ClosestApproach(self._bounds, time_s) if self._bounds is not None else None

    def disarm(self) -> None:
        """Disarm the latch."""
        self.armed = False

    def end_approach(self) -> ClosestApproach | None:
        """Closest approach to its bounds up to the state in ``data``; None without bounds."""
        if self.closest is not None:
            self.closest.add_end(self.sites.at(self._data))
        return self.closest

    def _load_now(self) -> FloatArray:
        return self.load.now()

    def load_accuracy(self) -> dict[str, float]:
        """How far rounding of the state in ``data`` changes its load through contact forces, by field of a record."""
        load = self.load.now()
        # Contact forces answer the state through normals that are known to 1e-10 only: the load varies with them, and the
        # comparison of a replay has to allow for that.
        varied = [self.load.now() - load for other in self._others if other.active for _ in other.varied_forces()]
        force, torque = np.linalg.norm(np.reshape(varied, (-1, 2, 3)), axis=2).sum(axis=0).tolist()
        return {"force_N": force, "torque_N_m": torque}

    def hold_by_rows(self, by_rows: bool) -> None:
        """Tell whether rows hold it from now on, and not an object that is a child of the link."""
        self.load = self._of_rows if by_rows or self._of_child is None else self._of_child

    def axis_angle_rad(self) -> float:
        """Angle between the axis of the latch and the same axis of the object's site; 0 for kinds without one."""
        return axis_angle_rad(self._data, self.sites, self.grasp.joint)

    def clear_path(self) -> None:
        """Discard the start of the step: the state changed discontinuously."""
        self._step_start = None

    def ratio(self, norms: Norms) -> float:
        """Largest ratio of a value to its bound; the condition holds at 1 or below."""
        return self._bounds.ratio(norms) if self._bounds is not None else 0.0

    def is_within(self) -> bool:
        """Whether its bounds hold at the state in ``data``, at the start of a step, or are exceeded by rounding at most.

        Sites may come to rest at a bound, and several grasps reach theirs at one instant: rounding closes none or all.
        """
        if self._step_start is None:
            self._step_start = self.sites.at(self._data)
        ratio = self.ratio(self._step_start.norms)
        # The rounding is evaluated only near the bound: far from it the answer is known.
        return ratio <= 1.0 or (ratio < 2.0 and ratio <= 1.0 + self.ratio(self.sites.rounding()))

    def was_clear(self, longest_s: float) -> bool:
        """Whether its bounds hold neither at the end of the last step, of at most ``longest_s``, nor seem to inside it.

        Values between the ends are bounded by the relative speeds at these, as ``Bounds.may_dip`` says.
        """
        # Without bounds nothing closes inside a step; without a start it was not watched in this one.
        if self._bounds is None or self._step_start is None:
            return True
        _, end = self._step_end = float(self._data.time), self.sites.at(self._data)
        # Both ends outside is not enough: a fast pass may satisfy all bounds between them.
        return self.ratio(end.norms) > 1.0 and not self._bounds.may_dip(self._step_start, end, longest_s)

    def first(self, path: StepPath, duration_s: float) -> float | None:
        """First time at which its bounds hold within ``duration_s`` of the last step; None if they do not."""
        return self._bounds.first(self._along(path), duration_s) if self._bounds is not None else None

    def after_substep(self, path: StepPath, duration_s: float) -> None:
        """Update the closest approach over a finished (sub-)step; ``data`` is at its end."""
        if self.closest is None:
            return
        # was_clear() has evaluated the end of the step, unless an event of another model shortened it since.
        last = self._step_end
        end = last[1] if last is not None and last[0] == self._data.time else self.sites.at(self._data)
        rounding, at = self.sites.rounding(), self._along(path)
        # After an event or an arming the start has not been evaluated: the path can go back to it.
        start = at(0.0) if self._step_start is None else self._step_start
        self.closest.add_step(start, end, at, duration_s, rounding)
        # The approach was looked at along the path: the state goes back to the end of the step.
        path.move_to(duration_s)
        self._step_start, self._step_end = end, None

    def _along(self, path: StepPath) -> At:
        """Return a function that evaluates the relative motion at a time of the step."""

        def at(time_s: float) -> RelativeMotion:
            path.move_to(time_s)
            return self.sites.at(self._data)

        return at
