"""What the link puts on the object that it holds, and what that gives to the object over a step."""

from __future__ import annotations

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.capture.held import Held
from ffsm_mj.contact.exchange import Booking
from ffsm_mj.contact.regimes import Scene
from ffsm_mj.model.system import Tree

_AFTER_VELOCITIES = int(mujoco.mjtStage.mjSTAGE_VEL)


def interface_load(held: Held, site_m: FloatArray, ctrl: FloatArray) -> tuple[float, ...]:
    """Force on the object and its torque about a point under some efforts: Newton and Euler of all its bodies.

    Args:
        held: What moves, at its state.
        site_m: The point, world axes, m, (3,).
        ctrl: Efforts as MuJoCo has them, (nu,).

    Returns:
        Force in N, torque in N m, world axes, six numbers.
    """
    model, data = held.model, held.data
    data.ctrl[:] = ctrl
    mujoco.mj_forwardSkip(model, data, _AFTER_VELOCITIES, 1)
    mujoco.mj_rnePostConstraint(model, data)
    a, b, c, x, y, z = held.interface.tolist()  # torque about the mass centre of the whole tree, force
    (i, j, k), (p, q, r) = held.centre.tolist(), site_m.tolist()
    i, j, k = i - p, j - q, k - r
    return x, y, z, a + j * z - k * y, b + k * x - i * z, c + i * y - j * x


class ObjectAccount:
    """Energy and momentum of the object that is held: in a step it is pushed by the link alone."""

    def __init__(self, scene: Scene, tree: Tree, held: Held, momentum: FloatArray) -> None:
        """Bind to what is logged.

        Args:
            scene: The system and its data.
            tree: The object.
            held: What moves.
            momentum: Where M qdot of the system is kept current, (nv,).
        """
        self._rates, self._placing, self._momentum = scene.data.qvel[tree.dofs], held.placing, momentum
        self._own, self._data = momentum[tree.dofs], scene.data
        self._at, self._before = b"", np.zeros(7)

    def begin(self) -> None:
        """A (sub-)step begins at the state in ``data``: mostly that in which the last one ended."""
        if self._at != self._state():
            self._before = self._now()

    def end(self) -> Booking:
        """It has ended: what the object gained the link gave, and took from the robot."""
        now = self._now()
        gained, self._before, self._at = now - self._before, now, self._state()
        energy = float(gained[0])
        return Booking(np.array((0.0, -energy, energy)), gained[1:])

    def _state(self) -> bytes:
        return bytes(self._data.qpos.tobytes() + self._data.qvel.tobytes())

    def _now(self) -> FloatArray:
        """Kinetic energy in J, and (P, L about the origin), (7,)."""
        return np.concatenate(((0.5 * float(self._own.dot(self._rates)),), self._placing.momentum(self._momentum)))
