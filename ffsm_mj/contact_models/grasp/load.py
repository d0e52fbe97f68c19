"""Load of a closed grasp: force and torque that the grasping link exerts on the grasped object.

The load of the first closed grasp, whose object is a child of the link, is MuJoCo's interface force. That of a further grasp
is the constraint force of its rows.

Load limit of a closed grasp: it opens at the first time in a step at which the load reaches the limit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.grasp.closing_condition import first_at_most_zero
from ffsm_mj.contact_models.grasp.config import LoadLimitConfig
from ffsm_mj.contact_models.grasp.grasped_motion import GraspedMotion
from ffsm_mj.contact_models.grasp.loops import LoopForces
from ffsm_mj.contact_models.interface import ForceSource
from ffsm_mj.dynamics.rigid_body import cross
from ffsm_mj.dynamics.step_path import StepPath

_AFTER_VELOCITIES = int(mujoco.mjtStage.mjSTAGE_VEL)
SAMPLED = 22
"""Values of a sample: what is closed; torque and force about a centre, that centre, the site, force and torque of others;
largest force and torque right after an event since the last sample, and its time."""
_OF_LOAD, _BETWEEN = slice(1, 19), slice(19, 22)
_NO_WRENCH = np.zeros(6)
_NO_EVENT = 0.0, 0.0, math.nan


class InterfaceLoad:
    """Force on the object and torque about its site: MuJoCo's interface force, less the forces of other contact models.

    MuJoCo's values are stored at each state, and converted for many rows at once.
    """

    def __init__(self, motion: GraspedMotion, site: FloatArray, seen: Any, others: Sequence[ForceSource] = ()) -> None:
        """Bind to the motion of a grasp.

        Args:
            motion: Its motion while closed.
            site: Position of the object's site, world axes, m: a live array, (3,).
            seen: Data of the logged system.
            others: Contact models that may exert forces on the motion: persistent contact, springs.
        """
        self._model, self._data, self._copy_efforts = motion.model, motion.data, motion.copy_efforts
        self._motion, self._site, self._seen, self._others = motion, site, seen, tuple(others)
        # MuJoCo gives cfrc_int as (torque, force) about the mass centre of the whole tree.
        self._raw = motion.interface, motion.centre, site

    def _refresh(self) -> FloatArray:
        """Update MuJoCo's interface force under the current efforts; returns the wrench of others on the object, (6,)."""
        self._copy_efforts()
        of_others = _NO_WRENCH
        # The interface force holds the object under all that acts on it: what contacts and springs exert is no load of the
        # latch.
        for contact_model in self._others:
            if contact_model.active:
                of_others = self._other_forces()
                break
        # Positions and velocities are current; efforts may have changed since, at a tick or an event.
        mujoco.mj_forwardSkip(self._model, self._data, _AFTER_VELOCITIES, 1)
        mujoco.mj_rnePostConstraint(self._model, self._data)
        return of_others

    def _other_forces(self) -> FloatArray:
        """Apply the forces of the other contact models; returns their force and torque about the site on the object, (6,).

        Reactive models recompute their forces for the current efforts: their last ``push`` was evaluated under the previous
        ones.
        """
        applied, grasped, on_object = self._data.qfrc_applied, self._motion.grasped_bodies, np.zeros(6)
        # The last stage left its forces here; those under the present efforts are put together anew.
        applied.fill(0.0)
        for contact_model in [other for other in self._others if other.active]:
            wrenches = contact_model.wrenches(self._seen)
            contact_model.add_forces(applied)
            for body, point, force, torque, _ in wrenches:
                if body in grasped:
                    on_object[:3] += force
                    # Loads are about the object's site: a force elsewhere has a moment about it.
                    on_object[3:] += torque + cross(point - self._site, force)
        return on_object

    def now(self) -> FloatArray:
        """Current force in N and torque in N m, world axes, (6,)."""
        return np.asarray(_loads(self.sample()[None])[0])

    def sample(self) -> FloatArray:
        """Current interface torque and force, their centre, the site, wrench of others, (18,)."""
        of_others = self._refresh()
        return np.concatenate((*self._raw, of_others))


class LoopLoad:
    """Force and torque about the object's site by the rows of a further grasp; see :class:`InterfaceLoad`.

    Where rows depend on each other, those of least norm.
    """

    def __init__(self, name: str, loops: LoopForces, site: FloatArray) -> None:
        """Bind to the rows of a grasp; ``site`` is the position of the object's site, world axes, m: a live array, (3,)."""
        self._name, self._loops, self._site = name, loops, site

    def now(self) -> FloatArray:
        """Current force in N and torque in N m, world axes, (6,)."""
        return self._loops.load(self._name)

    def sample(self) -> FloatArray:
        """Current values as those of :meth:`InterfaceLoad.sample`, (18,)."""
        load = self.now()
        # Rows give the force of the latch itself, about the site: no shift of the centre, and no other wrench to take away.
        return np.concatenate((load[3:], load[:3], self._site, self._site, _NO_WRENCH))


class LoadSampler:
    """Samples what is closed and its load, and the largest load right after events between samples.

    Attributes:
        between: Largest force in N and torque in N m right after an event since the last sample, and its time in s.
    """

    def __init__(self, values: FloatArray) -> None:
        """Bind to the array that receives a sample, (SAMPLED,)."""
        self._values, self.between = values, _NO_EVENT

    def get_state(self) -> tuple[float, float, float]:
        """The largest load between samples."""
        return self.between

    def set_state(self, state: Any) -> None:
        """Go on with a largest load."""
        force, torque, at_s = state
        self.between = force, torque, at_s

    def after_event(self, load: InterfaceLoad | LoopLoad, time_s: float) -> None:
        """Update the largest load after an event, under the efforts set there."""
        force, torque = (math.hypot(*part.tolist()) for part in np.split(load.now(), 2))
        greatest, turning, at_s = self.between
        # Of equal loads the first one keeps its time.
        self.between = max(force, greatest), max(torque, turning), at_s if force <= greatest else time_s

    def take(self, closed: int, load: InterfaceLoad | LoopLoad | None) -> None:
        """Take a sample: what is closed, as a number, and its load; 0 and None if no grasp is."""
        self._values[0], self._values[_OF_LOAD] = closed, load.sample() if load is not None else 0.0
        self._values[_BETWEEN] = self.between
        self.between = _NO_EVENT


def load_rows(samples: FloatArray) -> FloatArray:
    """Rows of samples: what is closed, force, torque, site (NaN if open), largest after events, (n, 13).

    Args:
        samples: Values of :class:`LoadSampler`, (n, SAMPLED).
    """
    loads = samples[:, _OF_LOAD]
    # An open grasp has no point at which a force acts: NaN, not the origin.
    number, site = samples[:, :1], np.where(samples[:, :1] > 0.0, loads[:, 9:12], np.nan)
    return np.concatenate((number, _loads(loads), site, samples[:, _BETWEEN]), axis=1)


def _loads(raw: FloatArray) -> FloatArray:
    """Forces and torques about the site, (n, 6).

    Args:
        raw: Torques and forces about a centre, that centre, the site, wrenches of others on the object, (n, 18).
    """
    torque, force, centre, site = np.split(raw[:, :12], 4, axis=1)
    return np.concatenate((force, torque + np.cross(centre - site, force)), axis=1) - raw[:, 12:]


_NEAR = 0.9
"""A step is searched inside if the ratio of load to limit exceeds this at one of its ends.

A load that swings by A limits with h w <= MODE_STEP exceeds that at both ends by A (h w)^2 / 8 = 0.011 A at most. To reach
the limit from nine tenths at both ends it would have to swing by nine limits, and would reach it outside the step as well.
"""


class LoadLimit:
    """Limits on force and torque between link and object."""

    def __init__(self, config: LoadLimitConfig, load: Callable[[], FloatArray]) -> None:
        """Bind to the load of a grasp: force in N and torque in N m now, (6,)."""
        self._limits, self._load = (config.force_N, config.torque_N_m), load
        self._start = 0.0

    def load(self) -> tuple[float, float]:
        """Force in N and torque in N m at the current state and efforts, as norms."""
        values = self._load().tolist()
        return math.hypot(*values[:3]), math.hypot(*values[3:])

    def ratio(self) -> float:
        """Largest ratio of load to limit at the current state and efforts."""
        return max(size / limit for size, limit in zip(self.load(), self._limits, strict=True) if limit is not None)

    def is_reached(self) -> bool:
        """Whether it is reached at the start of a step."""
        self._start = self.ratio()
        # The load may jump at a tick or an event without a root: efforts are constant over a tick.
        return self._start >= 1.0

    def was_clear(self) -> bool:
        """Whether the load stayed well below it in the last step, by its ends."""
        # Efforts are constant within a step: the load is smooth, as the motion is that the step resolves.
        return max(self._start, self.ratio()) < _NEAR

    def first(self, path: StepPath, duration_s: float) -> float | None:
        """First time within ``duration_s`` of the last step at which it is reached; None if it is not."""

        def margin(time_s: float) -> float:
            path.move_to(time_s)
            return 1.0 - self.ratio()

        return first_at_most_zero(margin, duration_s)
