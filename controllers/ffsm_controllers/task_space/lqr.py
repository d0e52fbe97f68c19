"""Linear quadratic regulator of the task's output, and with ``refresh`` the classical SDRE.

With the drift left out the output is a double integrator, ydd = B u. u = -R^-1 B^T K [e; ed] with K from the Riccati
equation of A = [[0, I], [0, 0]] and [0; B] minimises the integral of [e; ed]^T Q [e; ed] + u^T R u for that B. Frozen, B is
that of the start of a phase: good near there, no more than a reference on large motions. With ``refresh`` B is that of the
present tick: the state-dependent Riccati equation with the plainest factorisation, which says nothing of the drift. With Q
of two multiples q1 and q2 of the identity, S = B R^-1 B^T = V diag(s) V^T, the output then obeys ydd = drift - Kp e - Kd ed
with Kp = V diag(sqrt(q1 s)) V^T and Kd = V diag(sqrt(q2 s + 2 sqrt(q1 s))) V^T. Efforts stay bounded near singularities, as
Kp and Kd vanish along a direction that the joints no longer move. A target's acceleration is not used.

Source: Kwakernaak & Sivan 1972, Linear Optimal Control Systems; Cimen 2008, State-dependent Riccati equation (SDRE)
control: a survey, IFAC Proceedings 41(2).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from ffsm_controllers.osdre.weights import Weight, input_weight, state_weight
from ffsm_controllers.pd import Gain
from ffsm_controllers.task_space.config import AttitudeTarget, TaskLawConfig
from ffsm_controllers.task_space.damping import joint_damping, most_unstable, output_damping
from ffsm_controllers.task_space.task_law import TaskLaw
from ffsm_mj._core.riccati_doubling import Doubling, RiccatiError
from ffsm_mj.controller_protocol import (
    ControllerContext,
    ControllerError,
    Damping,
    Fault,
    FloatArray,
    Observation,
    ScenarioFaults,
)


class LqrConfig(TaskLawConfig):
    """Linear quadratic regulator on the tip as a double integrator."""

    kind: Literal["lqr"]
    Q: Weight
    """Weight of the output and its rates [e; ed], 2p numbers for a diagonal or 2p rows, regular in its position block."""
    R: Weight
    """Weight of the torques, positive definite: one number per joint for a diagonal, or rows."""
    refresh: bool = False
    """Gains for the state of every tick (the classical SDRE) in place of those for the start of the phase."""
    attitude: AttitudeTarget | None = None
    """Attitude of the tip as part of the output, p = 3 more; left out: it is not controlled."""
    joint_damping_N_m_s_rad: Gain = 0.0
    """Damping of motions of a redundant arm that the output does not feel, N m s/rad."""


class Lqr(TaskLaw):
    """Linear quadratic regulator."""

    @dataclass
    class State(TaskLaw.State):
        """With the gain, (n, 2 p); None: that of the next tick."""

        gain: FloatArray | None

    Config = LqrConfig

    def __init__(self, config: LqrConfig, context: ControllerContext) -> None:
        """Resolve joints and weights.

        Raises:
            ScenarioFaults: No task, an unknown joint, fewer joints than components of the output, or weights that give no
                unique stabilising gain.
        """
        super().__init__(config, context, config.attitude, inverts=False)
        p, n = self.model.site.size, len(self.model.joints.dofs)
        if self.directions < p:
            message = f"the robot can change {self.directions} of the {p} components of the output; leave the attitude out"
            raise ScenarioFaults([Fault(message, ("attitude",))])
        self._inverse_R = np.linalg.inv(input_weight(config.R, n))
        self._riccati = Doubling(state_weight(config.Q, p))
        self._refresh, self._damping = config.refresh, config.joint_damping_N_m_s_rad
        self._gain: FloatArray | None = None

    def start(self, observation: Observation) -> None:
        """Take the reference; the gains are those of the first tick."""
        super().start(observation)
        self._gain = None

    def effort(self, data: Any) -> FloatArray:  # noqa: ARG002
        """U of the law, (n,).

        Raises:
            ControllerError: The Riccati equation has no stabilising solution here.
        """
        model = self.model
        if self._refresh or self._gain is None:
            self._gain = self._gain_at()
        u = -self._gain.dot(np.concatenate((model.e, model.ed)))
        if self._damping > 0.0:
            u -= self._damping * self._unseen().dot(model.qd)
        return np.asarray(u)

    def _gain_at(self) -> FloatArray:
        """R^-1 B^T K with the model as it is, (n, 2 p).

        Raises:
            ControllerError: The Riccati equation has no stabilising solution here.
        """
        B, p = self.model.B, self.model.site.size
        pushes = self._inverse_R.dot(B.T)
        none = np.zeros((p, p))
        try:
            K_lower, _ = self._riccati.solve(none, none, B.dot(pushes))
        except RiccatiError as error:
            raise ControllerError(str(error)) from error
        return np.asarray(pushes.dot(K_lower))

    def _unseen(self) -> FloatArray:
        """What the output does not feel of efforts, (n, n)."""
        B = self.model.B
        return np.asarray(np.eye(B.shape[1]) - np.linalg.pinv(B).dot(B))

    def damping_at(self, data: Any) -> Damping:
        """That of the output's rates, with the gains for the state in ``data``, or of what the output does not feel."""
        model, p = self.model, self.model.site.size
        model.update(data)
        rates = self._gain_at()[:, p:]
        size = float(np.abs(rates).max())
        dampings = [
            output_damping(model, rates, "Q", size, slice(None)),
            joint_damping(model, self._damping, self._unseen()),
        ]
        return most_unstable(model, dampings)
