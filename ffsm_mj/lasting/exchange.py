"""What lasting contacts move between the parties in a (sub-)step, by the stages of the step itself.

The work and impulse of forces that are known in each stage of a Runge-Kutta step are integrals of the same order as the
motion, with its own weights; nothing has to be asked at a midpoint.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.exchange import Booking
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.lasting.rows import Rows, Touch
from ffsm_mj.model.system import System
from ffsm_mj.motion.pushed_flight import WEIGHTS

Wrench = tuple[float, float, float, float, float, float]
"""Force and moment about the world origin."""


class Stage(NamedTuple):
    """What was asked in one stage.

    Attributes:
        rows: Where the contacts are.
        forces: Theirs, N, (k,).
        generalised: The same by dof, (nv,).
        qvel: Generalised velocity, (nv,).
    """

    rows: Rows
    forces: FloatArray
    generalised: FloatArray
    qvel: FloatArray


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
    def of(cls, system: System, touches: Sequence[Touch]) -> Shares:
        """Those of some touches."""
        robot, objects = set(system.robot.bodies), {body for tree in system.objects for body in tree.bodies}
        from_robot, outside = np.zeros(len(touches)), np.zeros((2, len(touches)))
        of_pairs: dict[ContactPair, list[int]] = {}
        for i, touch in enumerate(touches):
            of_pairs.setdefault(touch.pair, []).append(i)
            a, b = touch.pair.body_a, touch.pair.body_b
            ours = [party for party, bodies in enumerate((robot, objects)) if (a in bodies) != (b in bodies)]
            if len(ours) == 2:  # of the robot and an object
                from_robot[i] = 1.0 if a in robot else -1.0
            elif ours:  # the other is fixed
                bodies = (robot, objects)[ours[0]]
                outside[ours[0], i] = 1.0 if b in bodies else -1.0
        return cls(from_robot, outside, of_pairs)


def booked(
    stages: Sequence[Stage], duration_s: float, robot: slice, shares: Shares
) -> tuple[Booking, dict[ContactPair, float]]:
    """What the contacts of the four stages of a step exchanged, and the integral of the size of each pair's force, N s.

    Args:
        stages: In their order.
        duration_s: Length of the step.
        robot: The robot's dofs.
        shares: Of the contacts.
    """
    parts, on_b = duration_s * WEIGHTS, [wrenches(stage.rows, stage.forces) for stage in stages]
    forces, rates = np.array([stage.generalised for stage in stages]), np.array([stage.qvel for stage in stages])
    work = parts.dot(forces * rates).tolist()
    total, own = math.fsum(work), math.fsum(work[robot])
    energy = np.array((total, own, total - own))
    impulses = np.array(on_b).transpose(1, 2, 0).dot(parts)
    sizes = {
        pair: sum(part * _size([pushed[i] for i in mine]) for part, pushed in zip(parts.tolist(), on_b, strict=True))
        for pair, mine in shares.of_pairs.items()
    }
    return Booking(energy, shares.from_robot.dot(impulses), shares.outside.dot(impulses)), sizes


def wrenches(rows: Rows, forces: FloatArray) -> list[Wrench]:
    """Force and moment about the world origin on b of each contact."""
    out = []
    for here, force in zip(rows.held, forces.tolist(), strict=True):
        (x, y, z), (a, b, c) = here.normal.tolist(), here.point.tolist()
        x, y, z = force * x, force * y, force * z
        out.append((x, y, z, b * z - c * y, c * x - a * z, a * y - b * x))
    return out


def _size(wrenches: Sequence[Wrench]) -> float:
    """Of the sum of the forces of some wrenches."""
    x, y, z, *_ = wrenches[0] if len(wrenches) == 1 else map(sum, zip(*wrenches, strict=True))
    return math.hypot(x, y, z)
