"""What moves: a model and its data, step by step, or along the path of the last step."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.compiled import fastest
from ffsm_mj.dynamics.forced_stepper import ForcedStepper, Push, clear_applied_forces
from ffsm_mj.dynamics.free_stepper import FreeStepper
from ffsm_mj.dynamics.step_path import StepPath, time_step
from ffsm_mj.model.system import Tree


class Motion:
    """Steps of a model, free or pushed by forces that depend on its state.

    Attributes:
        model: MuJoCo model, with RK4.
        data: Its data.
        momentum: Generalised momentum M qdot at the state in ``data``, (nv,).
        room: For whoever asks for Jacobians of it, four of (3, nv).
        path: The last step.
        flight: Makes the steps and keeps account of their length.
        bodies: Id in this model of each body of the system that it stands for.
        pushes: Forces besides the efforts that act in its stages and depend on the state alone.
        grasp: Name of the grasp that holds an object while it moves; empty where it is the system itself.
        carried: The object that it holds, as the system has it; None where it holds none.
        rigid: Pairs of the system's geoms that cannot move against each other in it, though they can in the system.
    """

    grasp = ""
    carried: Tree | None = None
    rigid: frozenset[frozenset[int]] = frozenset()

    def __init__(self, model: Any, data: Any) -> None:
        """Begin at the state in ``data`` (all derived quantities current)."""
        self.model, self.data = model, data
        self.momentum, self.path = np.empty(model.nv), StepPath(model, data)
        self.jacobian_buffers = tuple(np.empty((4, 3, model.nv)))
        self.bodies: Sequence[int] = range(model.nbody)
        self.pushes: Sequence[Push] = ()
        self._usual_s, self._free_integrate = model.opt.timestep, self.path.integrate
        self._unpushed = self.flight = fastest(FreeStepper)(model, data, self.path.start, self.momentum)

    @property
    def carried_bodies(self) -> frozenset[int]:
        """Bodies of the system that are parts of the robot in it, though they are an object's."""
        return frozenset(self.carried.bodies) if self.carried is not None else frozenset()

    def push_with(self, pushes: Sequence[Push], answers: Sequence[Push] = ()) -> None:
        """Let forces act in every stage of the coming steps, and no others; derived quantities follow.

        Args:
            pushes: Those that depend on the state alone.
            answers: Those that answer all others, asked after them.
        """
        self.pushes = tuple(pushes)
        if every := (*pushes, *answers):
            pushed = ForcedStepper(self.model, self.data, self.path.start, self.momentum, every, self.follow)
            self.flight, self.path.integrate = pushed, pushed.integrate
            pushed.refresh()
        elif self.flight is not self._unpushed:
            self.flight, self.path.integrate = self._unpushed, self._free_integrate
            clear_applied_forces(self.model, self.data)

    def follow(self) -> None:
        """Bring what this stands for to the state in ``data``, positions and velocities: nothing where it is that itself."""

    def sync_from_system(self) -> None:
        """Go on from the state of what this stands for, derived quantities current: nothing where it is that itself."""

    def go_to(self, qpos: FloatArray, qvel: FloatArray) -> None:
        """Be at another state, derived quantities current; what this stands for follows."""
        self.data.qpos[:], self.data.qvel[:] = qpos, qvel
        mujoco.mj_forward(self.model, self.data)
        self.path.on_event_located()

    def step(self, duration_s: float) -> bool:
        """Integrate for a time, refresh derived quantities; says whether nothing that is watched can have happened."""
        if duration_s == self._usual_s:
            return self.flight.step(duration_s)
        with time_step(self.model, duration_s):
            return self.flight.step(duration_s)
