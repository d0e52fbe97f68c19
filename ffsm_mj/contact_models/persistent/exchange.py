"""What persistent contacts exchange between subsystems in a (sub-)step, from its stages: energy, momentum, slip and heat.

Work and impulse are quadratures of the stage forces with the weights of the method: they have the order of the motion, and
need no evaluation at a midpoint.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ffsm_mj._core.rows import PointRows
from ffsm_mj._core.stages import Slide, StageSums
from ffsm_mj.arrays import FloatArray
from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.cached_property import cached_property
from ffsm_mj.contact.pairs import UnilateralConstraint
from ffsm_mj.contact_models.persistent.contact_points import ContactPoint, point_runs
from ffsm_mj.contact_models.state_projection import exchange_signs
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.model.system import System


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
        groups: dict[UnilateralConstraint, tuple[list[int], int]] = {}
        for group, run in enumerate(point_runs(self.contact_points)):
            groups.setdefault(self.contact_points[run.start].pair, ([], run.start))[0].append(group)
        return [(pair, *places) for pair, places in groups.items()]

    @classmethod
    def of(cls, system: System, contact_points: Sequence[ContactPoint], grasped_bodies: frozenset[int]) -> Shares:
        """Signs for some contact points; grasped bodies count as parts of the robot (see ``balance/exchange.py``)."""
        bodies = [(contact.pair.body_a, contact.pair.body_b) for contact in contact_points]
        signs = np.array([exchange_signs(system, *both, grasped_bodies) for both in bodies]).reshape(-1, 3).T
        return cls(np.ascontiguousarray(signs[0]), np.ascontiguousarray(signs[1:]), contact_points)


def robot_dofs(system: System, motion: Motion) -> slice:
    """Degrees of freedom of the robot in a motion, including a grasped object."""
    model = motion.model
    root = model.body_rootid[motion.bodies[system.robot.root]]
    # MuJoCo numbers degrees of freedom depth first: those of one tree are consecutive.
    flags = np.flatnonzero(model.body_rootid[model.dof_bodyid] == root)
    return slice(int(flags[0]), int(flags[-1]) + 1)


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
        # A limit acts along its joint alone: its force has no wrench.
        if pair.is_limit:
            # Limits only push: the integral of the magnitude is that of the force.
            sizes[pair] = float(parts.dot([stage.forces.item(first) for stage in stages]))
        elif len(groups) == 1:
            sizes[pair] = sums.sizes[groups[0]]
        else:
            # The norm of the resultant, not the sum of norms: in one pair forces at different features may oppose each
            # other.
            of_pair = np.array([stage.wrenches[groups, :3].sum(axis=0) for stage in stages])
            sizes[pair] = float(parts.dot(np.linalg.norm(of_pair, axis=1)))
    return sums.exchange(*shares.of_groups, robot), sizes
