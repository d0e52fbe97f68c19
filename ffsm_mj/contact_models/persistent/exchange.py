"""What persistent contacts exchange between subsystems in a (sub-)step, from its stages: energy, momentum, slip and heat.

Work and impulse are quadratures of the stage forces with the weights of the method: they have the order of the motion, and
need no evaluation at a midpoint.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ffsm_mj._core.stages import Slide, StageSums
from ffsm_mj.arrays import FloatArray
from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.cached_property import cached_property
from ffsm_mj.contact.constraint import UnilateralConstraint
from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.contact_models.persistent.contact_points import ContactPoint, point_runs
from ffsm_mj.contact_models.persistent.point_rows import PointRows
from ffsm_mj.contact_models.state_projection import sum_exchanges
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.model.system import System

if TYPE_CHECKING:
    from ffsm_mj.contact_models.impact.deepest_overlap import DeepestOverlap
    from ffsm_mj.contact_models.impact.friction_heat import FrictionHeat
    from ffsm_mj.contact_models.interface import Scene
    from ffsm_mj.contact_models.persistent.active_set import ActiveContactSet
    from ffsm_mj.contact_models.persistent.friction.report import FrictionReport


class Stage:
    """Contact forces in one stage of a step.

    Attributes:
        rows: States and Jacobians of the contact points.
        along: Forces (n, t1, t2) of each point, N, (3k,).
        power: Power of the contact forces by degree of freedom, W, (nv,).
        slide: Heat and slip of the points; None where none slides with friction.
    """

    def __init__(self, rows: PointRows, along: FloatArray, power: FloatArray, slide: Slide | None = None) -> None:
        """Store the forces; see the attributes."""
        self.rows, self.along, self.power, self.slide = rows, along, power, slide

    @property
    def forces(self) -> FloatArray:
        """Normal forces, N, (k,)."""
        return self.along[::3]

    @cached_property
    def wrenches(self) -> FloatArray:
        """Force, and moment about the world origin, on geom b of each group of points of one pair, (g, 6)."""
        return self.rows.wrenches(self.along)


@dataclass(frozen=True, eq=False)
class Shares:
    """Signs with which contact forces on geom b enter the balance of each subsystem.

    Attributes:
        from_robot: As forces of the robot on the objects, (k,).
        outside: As external forces on the robot and on the objects, (2, k).
        contact_points: The contact points; those of a pair are consecutive.
    """

    from_robot: FloatArray
    outside: FloatArray
    contact_points: Sequence[ContactPoint]

    @cached_property
    def of_groups(self) -> tuple[FloatArray, FloatArray]:
        """The same for the groups of points that are evaluated together, (g,) and (2, g)."""
        starts = [run.start for run in point_runs(self.contact_points)]
        return self.from_robot[starts], np.ascontiguousarray(self.outside[:, starts])

    @cached_property
    def pairs(self) -> list[tuple[UnilateralConstraint, list[int], int]]:
        """Each pair with its groups and its first point."""
        found: dict[UnilateralConstraint, tuple[list[int], int]] = {}
        for group, run in enumerate(point_runs(self.contact_points)):
            found.setdefault(self.contact_points[run.start].pair, ([], run.start))[0].append(group)
        return [(pair, *places) for pair, places in found.items()]

    @classmethod
    def of(cls, system: System, contact_points: Sequence[ContactPoint], grasped_bodies: frozenset[int]) -> Shares:
        """Signs for some contact points; grasped bodies count as parts of the robot (see ``balance/exchange.py``)."""
        robot = grasped_bodies.union(system.robot.bodies)
        objects = {body for tree in system.objects for body in tree.bodies} - grasped_bodies
        from_robot, outside = np.zeros(len(contact_points)), np.zeros((2, len(contact_points)))
        for i, contact in enumerate(contact_points):
            a, b = contact.pair.body_a, contact.pair.body_b
            ours = [subsystem for subsystem, bodies in enumerate((robot, objects)) if (a in bodies) != (b in bodies)]
            if len(ours) == 2:  # contact between the robot and an object
                from_robot[i] = 1.0 if a in robot else -1.0
            elif ours:  # the other body is fixed: an external force
                bodies = (robot, objects)[ours[0]]
                sign = 1.0 if b in bodies else -1.0
                # The force acts on an object although it is integrated with the robot: enter it for the object, and
                # subtract the reaction that the robot's balance would otherwise see.
                if a in grasped_bodies or b in grasped_bodies:
                    outside[1, i], from_robot[i] = sign, -sign
                else:
                    outside[ours[0], i] = sign
        return cls(from_robot, outside, contact_points)


def robot_dofs(system: System, motion: Motion) -> slice:
    """Degrees of freedom of the robot in a motion, including a grasped object."""
    model = motion.model
    root = model.body_rootid[motion.bodies[system.robot.root]]
    own = np.flatnonzero(model.body_rootid[model.dof_bodyid] == root)
    return slice(int(own[0]), int(own[-1]) + 1)


def exchanged(
    sums: StageSums, stages: Sequence[Stage], parts: FloatArray, shares: Shares, robot: slice
) -> tuple[Exchange, dict[UnilateralConstraint, float]]:
    """Energy and momentum exchanged in a step, and the time integral of the force magnitude of each pair, N s.

    A joint limit exchanges no momentum; its integral is in N m s for a hinge.

    Args:
        sums: Sums over the stages.
        stages: Contact forces by stage.
        parts: Quadrature weight of each stage, s.
        shares: Signs of the contact forces.
        robot: Degrees of freedom of the robot in the motion.
    """
    sizes = dict[UnilateralConstraint, float]()
    for pair, groups, first in shares.pairs:
        if isinstance(pair, JointLimit):
            sizes[pair] = float(parts.dot([stage.forces.item(first) for stage in stages]))
        elif len(groups) == 1:
            sizes[pair] = sums.sizes[groups[0]]
        else:
            of_pair = np.array([stage.wrenches[groups, :3].sum(axis=0) for stage in stages])
            sizes[pair] = float(parts.dot(np.linalg.norm(of_pair, axis=1)))
    return sums.exchange(*shares.of_groups, robot), sizes


class StepAccount:
    """Accounts for the last (sub-)step of the closed contacts of a scene, from its stages.

    Attributes:
        projected: Exchange by the drift projection at the start of the step; None without one.
    """

    def __init__(
        self,
        scene: Scene,
        closed: ActiveContactSet,
        friction: FrictionReport,
        heat: FrictionHeat,
        overlap: DeepestOverlap,
    ) -> None:
        """Initialise before the first step.

        Args:
            scene: The logged system and its data.
            closed: Its closed contacts.
            friction: Columns of slip and heat.
            heat: Heat of friction of the run.
            overlap: Its deepest overlap.
        """
        self._overlap = overlap
        self._system, self._active_set, self._friction, self._heat = scene.system, closed, friction, heat
        self.projected: Exchange | None = None
        closed.steady.account_to(overlap.deepest, heat.total_J)
        self._sums: StageSums
        self._last: tuple[Sequence[Stage], FloatArray]
        self._shares_cache: tuple[tuple[tuple[ContactPoint, ...], Motion], Shares, slice] | None = None

    def of_steady_step(self, duration_s: float) -> Exchange | None:
        """Energy and momentum exchanged in a step that ends in a steady state, with all that it adds to columns."""
        return None if self.projected is not None else self._active_set.steady.exchange(duration_s)

    def exchanged(self, duration_s: float) -> tuple[Exchange | None, Mapping[UnilateralConstraint, float]]:
        """Energy and momentum exchanged, and the impulse of each pair in N s."""
        closed, system, motion = self._active_set, self._system, self._active_set.motion
        if not closed.pressing:
            return self.projected, {}
        key = closed.pressing, motion
        if self._shares_cache is None or self._shares_cache[0] != key:
            self._shares_cache = (
                key,
                Shares.of(system, closed.pressing, motion.grasped_bodies),
                robot_dofs(system, motion),
            )
        stages, parts = self._last = self._stages(duration_s)
        self._sums = StageSums(stages, parts)
        booking, impulses = exchanged(self._sums, stages, parts, *self._shares_cache[1:])
        return sum_exchanges(self.projected, booking), impulses

    def add_friction(self) -> None:
        """Add work, slip and heat to their columns; :meth:`exchanged` must precede."""
        if self._rubs:
            heat_J = self._friction.add_step(self._active_set.pressing, *self._last, self._sums.total)
            if heat_J:
                self._heat.add(heat_J)

    def add_overlap(self) -> None:
        """Update the deepest overlap at the state in ``data``; joint limits have columns of their own."""
        points, rows = self._active_set.contact_points, self._active_set.decide().rows
        if points and not any(isinstance(pair, JointLimit) for pair in self._active_set.by_pair):
            self._overlap.add(points[0].pair, rows.extremes.lowest)
            return
        for contact, gap in zip(points, rows.gaps, strict=True):
            self._overlap.add(contact.pair, gap)

    def work_without_heat(self, duration_s: float) -> float:
        """Work of all contact forces on all bodies plus the heat of sliding, J; the check of the heat sums it up."""
        if not self._rubs:
            return 0.0
        stages, weights = self._stages(duration_s)
        work = [float(stage.power.sum()) for stage in stages]
        heat = [0.0 if stage.slide is None else float(stage.slide.heat.sum()) for stage in stages]
        return float(weights.dot(np.add(work, heat)))

    @property
    def _rubs(self) -> bool:
        """Whether a pair with friction was closed and contacts carried force."""
        closed = self._active_set
        return bool(closed.pressing and closed.modes.of(closed.contact_points).pairs)

    def _stages(self, duration_s: float) -> tuple[Sequence[Stage], FloatArray]:
        """Stages of the step and their quadrature weights, s; the last entry of all is the evaluation at its end."""
        flight = self._active_set.motion.forced
        assert flight is not None
        return self._active_set.stages[-1 - len(flight.weights) : -1], duration_s * flight.weights
