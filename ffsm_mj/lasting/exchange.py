"""What lasting contacts move between the parties in a (sub-)step, by the stages of the step itself.

The work and impulse of forces that are known in each stage of a Runge-Kutta step are integrals of the same order as the
motion, with its own weights; nothing has to be asked at a midpoint.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.exchange import Booking
from ffsm_mj.lasting.rows import Rows, Touch
from ffsm_mj.model.system import System

WEIGHTS = (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0)
"""Of the stages of a Runge-Kutta step of order four."""


class Stage(NamedTuple):
    """One stage: where the contacts are, their forces in N, (k,), and the generalised velocity, (nv,)."""

    rows: Rows
    forces: FloatArray
    qvel: FloatArray


class Shares(NamedTuple):
    """How the force on b of each contact counts: from the robot on the objects; from outside on the robot and on them."""

    from_robot: FloatArray
    outside: FloatArray

    @classmethod
    def of(cls, system: System, touches: Sequence[Touch]) -> Shares:
        """Those of some touches, (k,) and (2, k)."""
        robot, objects = set(system.robot.bodies), {body for tree in system.objects for body in tree.bodies}
        from_robot, outside = np.zeros(len(touches)), np.zeros((2, len(touches)))
        for i, touch in enumerate(touches):
            a, b = touch.pair.body_a, touch.pair.body_b
            ours = [party for party, bodies in enumerate((robot, objects)) if (a in bodies) != (b in bodies)]
            if len(ours) == 2:  # of the robot and an object
                from_robot[i] = 1.0 if a in robot else -1.0
            elif ours:  # the other is fixed
                bodies = (robot, objects)[ours[0]]
                outside[ours[0], i] = 1.0 if b in bodies else -1.0
        return cls(from_robot, outside)


def booked(stages: Sequence[Stage], duration_s: float, robot: slice, shares: Shares) -> Booking:
    """Energy and impulses that the contacts of the four stages of a step exchanged.

    Args:
        stages: In their order.
        duration_s: Length of the step.
        robot: The robot's dofs.
        shares: Of the contacts.
    """
    energy, impulse, outside = np.zeros(3), np.zeros(6), np.zeros((2, 6))
    for weight, (rows, forces, qvel) in zip(WEIGHTS, stages, strict=True):
        on_b = wrenches(rows, weight * duration_s * forces)
        pushed = forces.dot(rows.J) * qvel
        own = pushed[robot].sum()
        total = pushed.sum()
        energy += (weight * duration_s) * np.array((total, own, total - own))
        impulse += shares.from_robot.dot(on_b)
        outside += shares.outside.dot(on_b)
    return Booking(energy, impulse, outside)


def wrenches(rows: Rows, forces: FloatArray) -> FloatArray:
    """Force and moment about the world origin on b of each contact, (k, 6)."""
    out = np.empty((len(forces), 6))
    for i, (here, force) in enumerate(zip(rows.held, forces.tolist(), strict=True)):
        x, y, z = (force * here.normal).tolist()
        a, b, c = here.point.tolist()
        out[i] = x, y, z, b * z - c * y, c * x - a * z, a * y - b * x
    return out
