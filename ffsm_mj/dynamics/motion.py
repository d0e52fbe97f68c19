"""Motion: integration of a model, step by step or along the path of the last step, and prediction by it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np

from ffsm_mj._core.fields import FieldForces
from ffsm_mj._core.steppers import ActuatorPower, ForcedStepper, FreeStepper
from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.dynamics.actuators import Activations, DeadBands, ExternalServos, ForceLimits
from ffsm_mj.dynamics.loops.closed_loops import ClosedLoops, RowSource
from ffsm_mj.dynamics.loops.equalities import equalities_of
from ffsm_mj.dynamics.loops.latch import LatchedBodies
from ffsm_mj.dynamics.springs import JointSprings
from ffsm_mj.dynamics.step_path import StepPath, time_step
from ffsm_mj.dynamics.stiff_actuators import StiffActuators
from ffsm_mj.model.actuators import external_servos, has_servos, thruster_ids
from ffsm_mj.model.system import System, Tree, has_springs_or_dampers
from ffsm_mj.tolerances import DAMPER_STEP, MECHANISM_RANK, MODE_STEP

Push = Callable[[Any], object]
"""Adds generalised forces to ``data.qfrc_applied``; positions and velocities in ``data`` are current."""


class Motion:
    """Integrates a model, free or under applied forces that depend on its state.

    Attributes:
        model: MuJoCo model, with RK4.
        data: Its data.
        momentum: Generalised momentum M qdot at the state in ``data``, (nv,).
        momenta: This array, and those of other motions that follow this one: all that a move along the path may change.
        path: The last step as a path.
        stepper: Stepper in use; it accumulates the motion bound.
        forced_stepper: The same, while forces are applied; None without any.
        bodies: Id in this model of each body of the logged system.
        dofs: Index in this model of each degree of freedom of the logged system; -1 for one that it does not have.
        pushes: Applied forces in its stages that depend on the state alone.
        grasp: Name of the grasp whose object is a child of a link in this model; empty for the motion of the logged system
            itself.
        grasps: Names of all closed grasps: this one first, then those held by rows in the order in which they closed.
        grasped_object: The object that is a child of a link, as a tree of the logged system; None if there is none.
        loops: Closed loops: latches, and coordinates that dry friction keeps at rest, held by rows in this model; None
            without any.
        activations: Activations of the actuators; None without any.
        stiff: Stiffness of the actuators in implicit steps; None: steps are explicit unless contacts need implicit ones.
        power: Power of the actuators, whose work the stages of a step integrate; None without servos.
        field: External fields, whose work and impulses the stages of a step integrate; None without any.
        force_limits: Limits of their forces, and dead bands of tendons; None without servos and bands.
        rubs: Whether joints have dry friction, so that ``loops`` change as these come to rest and begin to slide.
        disabled: Pairs of the system's geoms that closed grasps join to one rigid body.
    """

    grasp = ""
    grasps: tuple[str, ...] = ()
    grasped_object: Tree | None = None
    rubs = False
    disabled: frozenset[frozenset[int]] = frozenset()

    def __init__(self, model: Any, data: Any, power: tuple[ActuatorPower, ForceLimits] | None = None) -> None:
        """Start at the state in ``data`` (all derived quantities current).

        Args:
            model: MuJoCo model, with RK4.
            data: Its data.
            power: Integrates the work of the actuators over the stages of each step, and the limits of their forces; None
                without servos.
        """
        self.model, self.data = model, data
        self.momentum, self.path = np.empty(model.nv), StepPath(model, data)
        self.momenta: tuple[FloatArray, ...] = (self.momentum,)
        self.bodies: Sequence[int] = range(model.nbody)
        self.dofs: Sequence[int] = range(model.nv)
        self.pushes: Sequence[Push] = ()
        self.loops: ClosedLoops | None = None
        self.power: ActuatorPower | None = power[0] if power is not None else None
        self.field: FieldForces | None = None
        self._bands = DeadBands(model, data) or None
        limits = power[1] if power is not None else None
        self.force_limits = ForceLimits(model, data) if limits is None and self._bands is not None else limits
        self.stiff: StiffActuators | None = None
        activations = Activations(model, data) if has_servos(model) else None
        self.activations = activations or None
        self._unpushed = self.stepper = self._stepper_without_pushes()
        self._usual_s, self._free_integrate = model.opt.timestep, self.path.integrate
        self.forced_stepper: ForcedStepper | None = None

    def _stepper_without_pushes(self) -> FreeStepper:
        """Stepper while no forces are applied. The work of servos follows from stages, which MuJoCo's own step hides."""
        if self.power is None:
            free = FreeStepper(self.model, self.data, self.path.start, self.momentum)
            free.bands = self._bands
            return free
        stepper = ForcedStepper(self.model, self.data, self.path.start, self.momentum, (), None, self.power)
        stepper.activations, stepper.bands = self.activations, self._bands
        self.path.integrate = stepper.integrate
        return stepper

    def make_implicit(self) -> None:
        """Make implicit steps from now on: servos, springs or dampers are too fast for explicit ones."""
        self.stiff = StiffActuators(self.model, self.data, self.response)
        for stepper in (self._unpushed, self.stepper):
            if isinstance(stepper, ForcedStepper):
                stepper.stiff = self.stiff

    @property
    def is_solved(self) -> bool:
        """Whether the equations of the last step were solved: those of an explicit step always are."""
        return not isinstance(self.stepper, ForcedStepper) or self.stepper.solved

    @property
    def grasped_bodies(self) -> frozenset[int]:
        """Bodies of the grasped object in the logged system; they count as parts of the robot."""
        return frozenset(self.grasped_object.bodies) if self.grasped_object is not None else frozenset()

    def push_with(self, pushes: Sequence[Push], answers: Sequence[Push] = (), *, of_system: bool = True) -> None:
        """Set the applied forces of the coming steps, and update derived quantities.

        Args:
            pushes: Forces that depend on the state alone.
            answers: Reactive forces, which depend on all others and are evaluated after them.
            of_system: Whether forces are evaluated from the state of the logged system, which then follows in each stage.
        """
        self.pushes = tuple(pushes)
        if every := (*pushes, *answers):
            follow = self.follow if of_system and type(self).follow is not Motion.follow else None
            pushed = ForcedStepper(self.model, self.data, self.path.start, self.momentum, every, follow, self.power)
            pushed.stiff, pushed.activations, pushed.bands = self.stiff, self.activations, self._bands
            pushed.field = self.field
            self.stepper, self.forced_stepper, self.path.integrate = pushed, pushed, pushed.integrate
            pushed.refresh()
        elif self.stepper is not self._unpushed:
            self.stepper, self.forced_stepper, self.path.integrate = self._unpushed, None, self._free_integrate
            clear_applied_forces(self.model, self.data)

    def push_without_contacts(self, data: Any) -> None:
        """Apply all forces except those of persistent contact, and update derived quantities.

        Args:
            data: Data of the motion, or a copy of it if no loop is closed; positions and velocities current.
        """
        data.qfrc_applied.fill(0.0)
        mujoco.mj_forward(self.model, data)
        for push in self.pushes:
            push(data)
        if self.loops is not None:
            force = data.qfrc_passive - data.qfrc_bias + data.qfrc_actuator + data.qfrc_applied
            data.qfrc_applied[:] += self.loops.generalised(force)
        if self.pushes or self.loops is not None:
            mujoco.mj_forward(self.model, data)

    def constrained(self, J: FloatArray) -> FloatArray:
        """Rows J of velocities as they are with the closed loops; J itself without any, (m, nv).

        With them and the mass matrix, impulses along J change velocities by Mc^-1 J^T: those that keep the loops closed.
        """
        return J if self.loops is None or not self.loops.sources else self.loops.projected(J)

    def response(self, J: FloatArray) -> FloatArray:
        """J M^-1, (m, nv): accelerations by forces along rows, with closed loops and joints that stick held."""
        if self.loops is not None:
            return self.loops.response(J)
        response = np.empty_like(J)
        mujoco.mj_solveM(self.model, self.data, response, J)
        return response

    def refresh_forces(self) -> None:
        """Evaluate the applied forces at the state in ``data`` again, after it was set; no effect if there are none."""
        if self.forced_stepper is not None:
            self.forced_stepper.refresh()

    def model_rates(self, rates: FloatArray) -> FloatArray:
        """Rates of this model for those of the logged system, (nv,): the same for the motion of that system itself."""
        return rates

    def follow(self) -> None:
        """Transfer positions and velocities to the logged system; no effect for the motion of that system itself."""

    def sync_from_system(self) -> None:
        """Start from the state of the logged system; no effect for the motion of that system itself."""

    def go_to(self, qpos: FloatArray, qvel: FloatArray) -> None:
        """Set another state and update derived quantities; the logged system follows."""
        self.data.qpos[:], self.data.qvel[:] = qpos, qvel
        mujoco.mj_forward(self.model, self.data)
        self.path.on_event_located()

    def step(self, duration_s: float) -> bool:
        """Integrate for a time and update derived quantities; returns whether the motion bound excludes any event."""
        if duration_s == self._usual_s:
            return self.stepper.step(duration_s)
        with time_step(self.model, duration_s):
            return self.stepper.step(duration_s)


def actuator_power(
    system: System,
    model: Any,
    data: Any,
    trees: IntArray | None = None,
    work: FloatArray | None = None,
    impulse: FloatArray | None = None,
) -> tuple[ActuatorPower, ForceLimits] | None:
    """Power of the actuators of a system, for its motion or that with a grasped object, and the limits of their forces.

    Args:
        system: The logged system.
        model: Model of the motion.
        data: Data of the motion.
        trees: Tree in this system of each degree of freedom of the motion, (nv,); None: it is the motion of this system.
        work: Receives the work in a step, J, (number of trees,); None: an array of its own.
        impulse: Receives the impulse of servos that act from outside, (number of trees, 6); likewise.

    Returns:
        None: there are no servos, and displacements give the work.
    """
    if not has_servos(system.mj):
        return None
    of_actuators, external = np.array(system.actuator_trees, dtype=np.intp), external_servos(system.mj)
    ids = np.concatenate((thruster_ids(system.mj), external))
    apart = np.stack((ids, of_actuators[ids]))
    trees, work = (
        system.dof_trees if trees is None else trees,
        np.zeros(len(system.trees)) if work is None else work,
    )
    limits = ForceLimits(model, data)
    outside = None
    if external.size:
        impulse = np.zeros((len(system.trees), 6)) if impulse is None else impulse
        outside = ExternalServos(model, data, external, of_actuators[external], impulse)
    return ActuatorPower(data, trees, apart, work, limits, outside), limits


def clear_applied_forces(model: Any, data: Any) -> None:
    """Remove all applied forces, and update derived quantities."""
    data.qfrc_applied.fill(0.0)
    mujoco.mj_forward(model, data)


def rigid_pairs(logged: Any, motion: Motion, latches: Sequence[LatchedBodies] = ()) -> frozenset[frozenset[int]]:
    """Pairs of geom ids of the logged system.

    Args:
        logged: MuJoCo model of the logged system.
        motion: The motion.
        latches: Closed latches between bodies of the logged system; those that stop everything join rigid bodies.
    """
    group = [int(motion.model.body_weldid[motion.bodies[body]]) for body in range(logged.nbody)]
    for latch in latches:
        one, other = group[latch.first], group[latch.second]
        if latch.count == 6:
            group = [one if member == other else member for member in group]
    geoms, body, weld = range(logged.ngeom), logged.geom_bodyid, logged.body_weldid
    return frozenset(
        frozenset((a, b))
        for a in geoms
        for b in geoms
        if a < b and group[body[a]] == group[body[b]] and weld[body[a]] != weld[body[b]]
    )


_TURN = 0.05
"""Largest product of rates and sub-step, rad: RK4 then errs by some 1e-9 of a turn per sub-step."""
_MOST_STEPS = 200
"""Largest number of sub-steps for rates alone; springs and dampers need theirs, or RK4 is unstable."""


def predict(model: Any, data: Any, duration_s: float, field: FieldForces | None = None) -> None:
    """Integrate state and time in ``data`` under its ``ctrl``, without contact forces; derived quantities are not updated.

    Args:
        model: MuJoCo model, with RK4.
        data: Its data.
        duration_s: How far ahead, s; nothing is done unless it is positive.
        field: External fields, which have the time in ``data``; None: there are none.
    """
    if not duration_s > 0.0:
        return
    fastest = max(map(abs, data.qvel.tolist()), default=0.0)
    steps = min(max(1, math.ceil(duration_s * fastest / _TURN)), _MOST_STEPS)
    if has_springs_or_dampers(model):
        mujoco.mj_fwdPosition(model, data)
        mode, decay = JointSprings(model).fastest(model, data)
        steps = max(steps, math.ceil(duration_s * max(mode.rate / MODE_STEP, decay.rate / DAMPER_STEP)))
    sources = [equality.source for equality in equalities_of(model)]
    if sources or field is not None:
        _predict_under_forces(model, data, sources, field, duration_s / steps, steps)
        return
    with time_step(model, duration_s / steps):
        for _ in range(steps):
            mujoco.mj_step(model, data)


def _predict_under_forces(
    model: Any, data: Any, sources: Sequence[RowSource], field: FieldForces | None, step_s: float, steps: int
) -> None:
    """The same with equality constraints or external fields."""
    mujoco.mj_forward(model, data)
    motion = Motion(model, data)
    loops = motion.loops = ClosedLoops(model, data, sources, rank=MECHANISM_RANK) if sources else None
    motion.push_with([] if field is None else [field.push], [] if loops is None else [lambda _: loops.push()])
    for _ in range(steps):
        if loops is not None:
            loops.choose()
        motion.step(step_s)
    clear_applied_forces(model, data)
