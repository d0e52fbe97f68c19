"""Energy and momentum that closed loops exchange between subsystems, from the stages of a step.

Rows do no work on the whole system: what they give to the objects, they take from the robot. A grasped object counts as a
part of the robot (see ``balance/exchange.py``), so that a second grasp of it exchanges nothing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ffsm_mj.arrays import BoolArray, FloatArray
from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.contact_models.event import Scene
from ffsm_mj.contact_models.persistent.exchange import robot_dofs
from ffsm_mj.contact_models.state_projection import sum_exchanges
from ffsm_mj.dynamics.loops.couplings import JointCoupling
from ffsm_mj.dynamics.loops.latch import LatchedBodies
from ffsm_mj.dynamics.loops.rows import RowSource
from ffsm_mj.dynamics.motion import Motion


class LoopExchange:
    """Sums up what latches exchange in a (sub-)step.

    Attributes:
        outside: Whether latches join fixed bodies with the robot, and with objects, (2,).
        crosses: Whether rows join different subsystems.
        taken: Unit wrenches that fixed bodies take through latches, (k, 6): all six or none.
    """

    def __init__(self, scene: Scene) -> None:
        """Initialise with no latches."""
        self._scene = scene
        self.outside: BoolArray = np.zeros(2, dtype=np.bool_)
        self.taken: FloatArray = np.empty((0, 6))
        self.crosses = False
        self._stages: list[tuple[FloatArray, float]] = []

    def bind(self, motion: Motion, sources: Sequence[RowSource]) -> None:
        """Use a motion with some rows held."""
        self._motion, self._robot = motion, robot_dofs(self._scene.system, motion)
        latches = {i: each for i, each in enumerate(sources) if isinstance(each, LatchedBodies)}
        self._signs = np.array([self._sign(latch, motion.grasped_bodies) for latch in latches.values()]).reshape(-1, 3)
        self._places = [*latches]
        self.outside = np.any(self._signs[:, 1:] != 0.0, axis=0)
        self.taken = np.eye(6) if self.outside.any() else np.empty((0, 6))
        self._passes_power = bool(self._signs[:, 0].any()) or any(self._couples(each) for each in sources)
        self.crosses = bool(self._signs.any()) or self._passes_power
        self.clear()

    def _couples(self, source: RowSource) -> bool:
        """Whether a coupling of joints passes power between the robot and objects: efforts at joints pass no momentum."""
        if not isinstance(source, JointCoupling) or source.leader is None:
            return False
        robot = range(self._robot.start, self._robot.stop)
        return len({self._motion.dofs[dof] in robot for dof in (source.follower, source.leader)}) > 1

    def _sign(self, latch: LatchedBodies, grasped: frozenset[int]) -> tuple[float, float, float]:
        """Signs with which a wrench on body b is one of the robot on objects, and of fixed bodies on robot and objects."""
        system = self._scene.system
        fixed, robot = system.fixed_bodies, grasped.union(system.robot.bodies)
        a, b = latch.first, latch.second
        if a in fixed or b in fixed:
            free, sign = (b, 1.0) if a in fixed else (a, -1.0)
            if free in grasped:  # integrated with the robot, but an external force on the object
                return -sign, 0.0, sign
            return (0.0, sign, 0.0) if free in robot else (0.0, 0.0, sign)
        return float(a in robot) - float(b in robot), 0.0, 0.0

    def clear(self) -> None:
        """Discard the stages of the last step."""
        self._stages.clear()

    def add_stage(self, forces: FloatArray, generalised: FloatArray) -> None:
        """Add a stage of a step.

        Args:
            forces: Forces of all rows, (n,).
            generalised: Their generalised forces, (nv,).
        """
        loops, flight, data = self._motion.loops, self._motion.forced, self._motion.data
        if loops is None or flight is None:
            return
        wrenches = np.empty((len(self._signs), 6))
        for i, wrench in zip(self._places, wrenches, strict=True):
            point, wrench[:3], wrench[3:] = loops.wrench(i, forces)
            wrench[3:] += np.cross(point, wrench[:3])
        power = float(generalised[self._robot] @ data.qvel[self._robot])
        if flight.repeats:
            self._stages[flight.repeats] = wrenches, power
        else:
            self._stages.append((wrenches, power))

    def over(self, duration_s: float, projected: Exchange | None) -> Exchange | None:
        """Exchange in the (sub-)step, with that of the projection at its start, if any."""
        flight = self._motion.forced
        if not self.crosses or flight is None:
            return projected
        weights = duration_s * flight.weights
        # The last entry of all is the evaluation at the end of the step.
        stages = self._stages[-1 - len(weights) : -1]
        impulses = np.einsum("s,slc->lc", weights, np.array([wrenches for wrenches, _ in stages]))
        on_objects, *outside = self._signs.T @ impulses
        own = float(weights @ [power for _, power in stages])
        # Fixed bodies take no power: what the robot gains, objects that move lose.
        of_objects = 0.0 if self.outside.any() and not self._passes_power else -own
        return sum_exchanges(projected, Exchange(np.array((0.0, own, of_objects)), on_objects, np.array(outside)))
