"""Work of joint efforts held over a step: force times displacement, exactly."""

from __future__ import annotations

from typing import Any

from ffsm_mj.arrays import FloatArray


class JointWork:
    """Accumulates the work of each (sub-)step."""

    def __init__(self, data: Any, on_joint: FloatArray, external: FloatArray, account: FloatArray) -> None:
        """Bind to the actuators.

        Args:
            data: MuJoCo data.
            on_joint: 1 for an actuator that drives a joint, else 0, (nu,).
            external: 1 for an actuator whose reaction acts on the world, else 0, (nu,).
            account: Its first entry receives the work, J.
        """
        self._held, self._length, self._force = data.ctrl, data.actuator_length, data.actuator_force
        self._on_joint, self._all_on_joints = on_joint, bool(on_joint.all())
        self._external, self._account = external.nonzero()[0].tolist(), account
        self._working = False

    def open(self) -> bool:
        """Begin a step; return whether an effort held during it is external."""
        ctrl = self._held.tolist()
        self._working = any(ctrl)
        if not self._working:
            return False
        self._length_0 = self._length.copy()
        return any(map(ctrl.__getitem__, self._external))

    def close(self) -> None:
        """End the step."""
        if self._working:
            force = self._force if self._all_on_joints else self._force * self._on_joint
            self._account[0] += force.dot(self._length - self._length_0)
