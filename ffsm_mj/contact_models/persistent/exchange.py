"""What lasting contacts move between the subsystems in a (sub-)step, by the stages of the step itself.

The work and impulse of forces that are known in each stage of a Runge-Kutta step are integrals of the same order as the
motion, with its own weights; nothing has to be asked at a midpoint.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from operator import mul
from typing import NamedTuple

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact_models.persistent.rows import ContactPoint, ContactRows
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.model.system import System

Wrench = tuple[float, float, float, float, float, float]
"""Force and moment about the world origin."""


class Stage(NamedTuple):
    """What was asked in one stage.

    Attributes:
        rows: Where the contacts are.
        forces: Theirs, N, (k,).
        power: What they give to each dof, W, (nv,).
    """

    rows: ContactRows
    forces: FloatArray
    power: FloatArray


class Shares(NamedTuple):
    """How the forces on b of some contacts count.

    Attributes:
        from_robot: As forces of the robot on the objects, (k,).
        outside: As forces from outside, on the robot and on the objects, (2, k).
        of_pairs: Which of them are whose.
    """

    from_robot: FloatArray
    outside: FloatArray
    of_pairs: dict[ContactPair, list[int]]

    @classmethod
    def of(cls, system: System, touches: Sequence[ContactPoint], carried: frozenset[int]) -> Shares:
        """Those of some touches, with some bodies of objects carried as parts of the robot (see ``balance/exchange.py``)."""
        robot = carried.union(system.robot.bodies)
        objects = {body for tree in system.objects for body in tree.bodies} - carried
        from_robot, outside = np.zeros(len(touches)), np.zeros((2, len(touches)))
        of_pairs: dict[ContactPair, list[int]] = {}
        for i, touch in enumerate(touches):
            of_pairs.setdefault(touch.pair, []).append(i)
            a, b = touch.pair.body_a, touch.pair.body_b
            ours = [subsystem for subsystem, bodies in enumerate((robot, objects)) if (a in bodies) != (b in bodies)]
            if len(ours) == 2:  # of the robot and an object
                from_robot[i] = 1.0 if a in robot else -1.0
            elif ours:  # the other is fixed
                bodies = (robot, objects)[ours[0]]
                sign = 1.0 if b in bodies else -1.0
                if a in carried or b in carried:
                    outside[1, i], from_robot[i] = sign, -sign
                else:
                    outside[ours[0], i] = sign
        return cls(from_robot, outside, of_pairs)


def robot_dofs(system: System, motion: Motion) -> slice:
    """Dofs of the robot in what moves, with all that it carries there."""
    model = motion.model
    root = model.body_rootid[motion.bodies[system.robot.root]]
    own = np.flatnonzero(model.body_rootid[model.dof_bodyid] == root)
    return slice(int(own[0]), int(own[-1]) + 1)


def exchanged(
    stages: Sequence[Stage], parts: FloatArray, shares: Shares, robot: slice
) -> tuple[Exchange, dict[ContactPair, float]]:
    """What the contacts of the stages of a step exchanged, and the integral of the size of each pair's force, N s.

    Args:
        stages: In their order.
        parts: Time that each counts for, s.
        shares: Of the contacts.
        robot: The robot's dofs in what moves.
    """
    on_b = [wrenches(stage.rows, stage.forces) for stage in stages]
    work = parts.dot(np.array([stage.power for stage in stages])).tolist()
    total, own = sum(work), sum(work[robot])
    weights, sizes = parts.tolist(), dict.fromkeys(shares.of_pairs, 0.0)
    for part, pushed in zip(weights, on_b, strict=True):
        for pair, mine in shares.of_pairs.items():
            sizes[pair] += part * _size([pushed[i] for i in mine])
    # Plain sums: arrays of a few numbers cost more.
    columns = [zip(*of_touch, strict=True) for of_touch in zip(*on_b, strict=True)]
    impulses = np.array([[sum(map(mul, weights, column)) for column in six] for six in columns])
    energy = np.array((total, own, total - own))
    return Exchange(energy, shares.from_robot.dot(impulses), shares.outside.dot(impulses)), sizes


def wrenches(rows: ContactRows, forces: FloatArray) -> list[Wrench]:
    """Force and moment about the world origin on b of each contact."""
    out = []
    for here, force in zip(rows.held, forces.tolist(), strict=True):
        (x, y, z), (a, b, c) = here.normal.tolist(), here.point.tolist()
        x, y, z = force * x, force * y, force * z
        out.append((x, y, z, b * z - c * y, c * x - a * z, a * y - b * x))
    return out


def _size(wrenches: Sequence[Wrench]) -> float:
    """Of the sum of the forces of some wrenches."""
    total = wrenches[0] if len(wrenches) == 1 else [*map(sum, zip(*wrenches, strict=True))]
    return math.hypot(*total[:3])
