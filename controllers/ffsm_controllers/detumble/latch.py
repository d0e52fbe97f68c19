"""Load of a closed grasp under given accelerations, and how much of a change of them it bears."""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np

from ffsm_controllers.detumble.config import LatchLoad
from ffsm_mj.controller_protocol import Fault, FloatArray, ScenarioFaults, System

_SHARE = 0.5
"""Share of the load limit of a grasp that is used where the scenario states nothing."""
_MARGIN = 1.02
"""Where the rotation alone loads the grasp beyond the bound, only slowing it down helps: this much more is accepted."""


class GraspLoad:
    """Force and torque of the link on the grasped object, by inverse dynamics of the object.

    Attributes:
        force_N: Greatest allowed force, N.
        torque_N_m: Greatest allowed torque about the object's site, N m.
    """

    def __init__(self, config: LatchLoad | None, system: System) -> None:
        """Find the bounds.

        Raises:
            ScenarioFaults: A share of the load limit of a grasp that has none.
        """
        grasp = system.grasp
        self.force_N = self.torque_N_m = math.inf
        self._model = system.mj
        if grasp is None:
            return
        share = _SHARE if config is None else config.share
        if config is not None:
            self.force_N, self.torque_N_m = config.force_N or math.inf, config.torque_N_m or math.inf
            if share is not None and not math.isfinite(min(grasp.max_force_N, grasp.max_torque_N_m)):
                message = f"{grasp.name!r} has no 'load_limit' to take a share of; state force_N or torque_N_m"
                raise ScenarioFaults([Fault(message, ("latch", "share"))])
        if share is not None:
            self.force_N = min(self.force_N, share * grasp.max_force_N)
            self.torque_N_m = min(self.torque_N_m, share * grasp.max_torque_N_m)
        self._body, self._site = system.mj.body(grasp.root).id, system.mj.site(grasp.object_site).id
        self._scratch = mujoco.MjData(system.mj)
        self._root = int(system.mj.body_rootid[self._body])

    @property
    def is_bounded(self) -> bool:
        """Whether there is a bound."""
        return math.isfinite(self.force_N) or math.isfinite(self.torque_N_m)

    def update(self, data: Any) -> None:
        """Take a state."""
        scratch = self._scratch
        scratch.qpos[:], scratch.qvel[:] = data.qpos, data.qvel
        mujoco.mj_fwdPosition(self._model, scratch)
        mujoco.mj_fwdVelocity(self._model, scratch)

    def at(self, accelerations: FloatArray) -> FloatArray:
        """Force in N and torque about the object's site in N m under accelerations of all dofs, world axes, (6,)."""
        scratch = self._scratch
        scratch.qacc[:] = accelerations
        mujoco.mj_rnePostConstraint(self._model, scratch)
        torque, force = np.split(scratch.cfrc_int[self._body], 2)
        lever = scratch.subtree_com[self._root] - scratch.site_xpos[self._site]
        return np.concatenate((force, torque + np.cross(lever, force)))

    def share(self, load: FloatArray, change: FloatArray, alone: float) -> float:
        """Greatest share in [0, 1] of a change of the load that the bounds allow.

        Args:
            load: Load without the change, (6,).
            change: Change of it, (6,).
            alone: Largest ratio of load to bound without wheels and thrusters.
        """
        bound = max(1.0, _MARGIN * alone)
        return min(
            _largest_share(load[:3], change[:3], bound * self.force_N),
            _largest_share(load[3:], change[3:], bound * self.torque_N_m),
        )

    def ratio(self, load: FloatArray) -> float:
        """Largest ratio of a load to its bounds."""
        force, torque = (math.hypot(*part.tolist()) for part in np.split(load, 2))
        return max(force / self.force_N, torque / self.torque_N_m)


def _largest_share(a: FloatArray, b: FloatArray, bound: float) -> float:
    """Greatest s in [0, 1] with |a + s b| <= bound; 0 if there is none."""
    square, half, rest = float(b @ b), float(a @ b), float(a @ a) - bound * bound
    if not math.isfinite(bound) or rest + 2.0 * half + square <= 0.0:
        return 1.0
    if rest >= 0.0 or square == 0.0:
        return 0.0
    # Both terms of the numerator have one sign in the stable form of the root.
    root = math.sqrt(half * half - square * rest)
    return -rest / (half + root) if half > 0.0 else (root - half) / square
