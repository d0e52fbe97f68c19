"""What the link puts on the object that it holds."""

from __future__ import annotations

import mujoco

from ffsm_mj.arrays import FloatArray
from ffsm_mj.capture.held import Held

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
