"""Buffer of sampled MuJoCo arrays, from which the balance of a block of samples is computed at once."""

from __future__ import annotations

from typing import Any

import numpy as np

from ffsm_mj._core.tick import BlockSampler, Sampler
from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.rigid_body import subtree_momenta
from ffsm_mj.model.system import System


class SampleBuffer:
    """Copies of MuJoCo's arrays at up to ``room`` states.

    Attributes:
        on_sample: Appends the current state; ``used`` is the number of samples in the buffer.
        h: Generalised momenta, (room, nv).
        rates: Generalised velocities, (room, nv).
        jacp: Jacobians of the frame of the robot's base, (room, 3, nv).
        jacr: Their angular parts, (room, 3, nv).
        position: Positions of that frame, (room, 3), m.
        accounts: Balance terms, then the values of the grasped object, (room, number of both).
    """

    def __init__(self, system: System, data: Any, room: int, momentum: FloatArray, accounts: FloatArray) -> None:
        """Bind to live arrays; the buffer is empty.

        Args:
            system: Robot and objects.
            data: Their state.
            room: Capacity in samples.
            momentum: M qdot, kept current by the caller, (nv,).
            accounts: Balance terms, then the values of the grasped object, (number of both,).
        """
        model, root = system.mj, system.robot.root
        self._mass = model.body_subtreemass
        sampler = Sampler(model, data, base=root)
        live = (
            *(data.subtree_linvel, data.subtree_com, data.subtree_angmom, sampler.jacp, sampler.jacr),
            *(data.xpos[root], momentum, data.qvel, accounts),
        )
        tables = [np.empty((room, *array.shape)) for array in live]
        self._velocity, self._centre, self._spin, self.jacp, self.jacr, *rest = tables
        self.position, self.h, self.rates, self.accounts = rest
        sampler.copy(list(zip(live, tables, strict=True)))
        self.on_sample = BlockSampler(sampler)

    def empty(self) -> slice:
        """Empty the buffer; returns the lines that were used, whose values stay until the next sample."""
        used, self.on_sample.used = slice(0, self.on_sample.used), 0
        return used

    def momenta(self, root: int, used: slice) -> FloatArray:
        """Momenta of the subtree of a body at the sampled states, (n, 6)."""
        at = (used, root)
        return subtree_momenta(float(self._mass[root]), self._velocity[at], self._centre[at], self._spin[at])
