"""Contact forces with friction in the stages of a step, in modes that are frozen for the step."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ffsm_mj._core.stages import Slide
from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.contact_models.persistent.exchange import Stage
from ffsm_mj.contact_models.persistent.friction.decision import slip_directions
from ffsm_mj.contact_models.persistent.friction.stage_equation import StageEquation
from ffsm_mj.dynamics.implicit_stages import ImplicitStep

if TYPE_CHECKING:
    from ffsm_mj._core.contacts import FrictionState


def stage_of(here: FrictionState, directions: FloatArray | None = None) -> tuple[Stage, FloatArray]:
    """Contact forces in a stage.

    Args:
        here: The points that slide or stick, at the state of the stage.
        directions: Directions of slip along the tangents, (k, 2); None for those of the slips at the state.

    Returns:
        The stage, and the generalised contact forces, (nv,).
    """
    rows, modes = here.rows, here.modes
    if directions is None or not modes.any_slides:
        return here.stage_here()
    forces, u = here.problem.forces(modes.kinds, directions), rows.slips
    along = forces.reshape(-1)
    generalised = along.dot(rows.J)
    heat = -np.sum(forces[:, 1:] * u, axis=1) * modes.slides
    slip_speeds = np.hypot(u[:, 0], u[:, 1]) * modes.slides
    return Stage(rows, along, generalised * rows.qvel, Slide(heat, slip_speeds)), generalised


def _directions_at(here: FrictionState) -> tuple[FloatArray, FloatArray]:
    """Directions of slip at a state, and at the start of the step, along the tangents, (k, 2)."""
    rows, modes = here.rows, here.modes
    at_start = modes.start_directions(rows.axes)
    return slip_directions(here.problem, rows.slips, at_start, modes.slides, modes.straight)[0], at_start


class _Node(NamedTuple):
    """The points at a node, the directions of slip assumed there, (k, 2), and the forces (n, t1, t2), N, (k, 3)."""

    here: FrictionState
    directions: FloatArray
    forces: FloatArray


class ImplicitSlips:
    """Slips of the points that slide at the nodes of an implicit step.

    See :class:`~ffsm_mj.dynamics.implicit_stages.StiffForces`.
    """

    def __init__(self, here: FrictionState) -> None:
        """Begin at the first evaluation of the first node."""
        modes = here.modes
        self._free: IntArray = np.flatnonzero(modes.slides & ~here.problem.lines & ~modes.straight)
        self._nodes: dict[int, _Node] = {}

    def stage_of(self, here: FrictionState, node: int) -> tuple[Stage, FloatArray]:
        """Contact forces in a node, with the directions of slip that were found last; see :func:`stage_of`."""
        known, (directions, at_start) = self._nodes.get(node), _directions_at(here)
        # Slip at the start of a slide is rounding without direction; that of its start is the estimate.
        directions[self._free] = (at_start if known is None else known.directions)[self._free]
        stage, generalised = stage_of(here, directions)
        self._nodes[node] = _Node(here, directions, stage.along.reshape(-1, 3))
        return stage, generalised

    def corrections(self, step: ImplicitStep, accelerations: FloatArray) -> FloatArray | None:
        """Changes of the accelerations with the directions of slip that solve the equations of the step."""
        nodes, free = [node for _, node in sorted(self._nodes.items())], self._free
        if not len(free):
            return np.zeros_like(accelerations)
        velocities, m = step.start_rates + step.weights.dot(accelerations), len(free)
        across = (3 * free[:, None] + np.array((1, 2))).ravel()
        slips = np.array([node.here.rows.J[across].dot(qvel) for node, qvel in zip(nodes, velocities, strict=True)])
        problems = [node.here.problem for node in nodes]
        rates = [
            problem.b[across] + problem.G[across].dot(node.forces.ravel())
            for problem, node in zip(problems, nodes, strict=True)
        ]
        p = (slips - step.weights.dot(np.array(rates))).reshape(-1, m, 2)
        equation = StageEquation(problems, nodes[0].here.modes.kinds, free, p, step.weights)
        found = equation.solve(np.array([node.directions for node in nodes]))
        if found is None:
            return None
        changes = []
        for i, (node, forces, directions) in enumerate(zip(nodes, *found, strict=True)):
            self._nodes[i] = node._replace(directions=directions)
            changes.append((forces - node.forces).ravel().dot(node.here.rows.response))
        return np.array(changes)
