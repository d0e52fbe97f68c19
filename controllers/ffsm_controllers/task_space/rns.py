"""Reaction null space: the base turns as it is told to, and the tip is moved by what does not turn it.

With W, the base's angular velocity per rate of the joints, B_w = W M_c^-1, Lambda_w the inverse of W M_c^-1 W^T, and
N = 1 - W^T Lambda_w B_w, which is what the base does not feel of efforts:

u = W^T Lambda_w (a_w - drift_w) + N alpha^T Gamma (a_t - drift - B W^T Lambda_w (a_w - drift_w)), a_w = -K_R ang - K_w
omega, a_t = ydd_d - Kd ed - Kp e, Gamma the damped inverse of B N alpha^T. With no gains of the base its angular velocity
stays what it is. The weighting is that of kinetic energy, where the papers have plain
pseudoinverses: both inverses are then effective inertias.

It takes more joints than the base has axes to turn about, and as many more as the output has rows for the tip to follow
exactly. Where B N alpha^T loses rank (an algorithmic singularity, far more common than a dynamic one) Gamma is damped as in
:func:`~ffsm_controllers.task_space.singularity.damped_inverse`: the tip stays behind, the base does not.

Source: Nenchev, Umetani & Yoshida 1992, Analysis of a redundant free-flying spacecraft/manipulator system, IEEE Trans.
Robot. Autom. 8(1); Nenchev & Yoshida 1999, Impact analysis and post-impact motion control issues of a free-floating space
robot subject to a force impulse, IEEE Trans. Robot. Autom. 15(3).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from ffsm_controllers.pd import Gain
from ffsm_controllers.task_space.base_rotation import BaseRotation
from ffsm_controllers.task_space.config import AttitudeAccelerations, DampedConfig, PositionAccelerations
from ffsm_controllers.task_space.damping import joint_damping
from ffsm_controllers.task_space.singularity import damped_inverse
from ffsm_controllers.task_space.task_law import TaskLaw
from ffsm_mj.controller_protocol import (
    ControllerContext,
    ControllerReport,
    Damping,
    Fault,
    FloatArray,
    Observation,
    ScenarioFaults,
    Signal,
    StrictModel,
)

_RATE = Signal("controller", "rns_base_rate_rad_s", "rad/s", "angular speed of the base")
_SINGULAR_BASE_INERTIA_KG_M2 = 1e5
"""Inertia of the base as the joints feel it above which they cannot turn it about an axis: torques for that fade out."""


class BaseTurnGains(StrictModel):
    """Feedback of angular accelerations on the attitude of the base against that at the start of the phase."""

    kp_1_s2: Gain = 0.0
    """Angular acceleration per angle, 1/s^2."""
    kd_1_s: Gain = 0.0
    """Angular acceleration per angular velocity, 1/s; 0: the angular velocity stays as it is."""


class RnsConfig(DampedConfig):
    """Reaction null space: the base first, then the tip."""

    kind: Literal["rns"]
    position: PositionAccelerations
    """Gains of the position of the tip."""
    attitude: AttitudeAccelerations | None = None
    """Gains of the attitude of the tip; left out: it is not controlled."""
    base: BaseTurnGains = BaseTurnGains()
    """Gains of the rotation of the base; left out: its angular velocity stays as it is."""


class Rns(TaskLaw):
    """Reaction null space."""

    @dataclass
    class State(TaskLaw.State):
        """With the rotation of the base and its largest rate, rad/s."""

        base: BaseRotation.State
        largest_rate: float

    Config = RnsConfig

    def __init__(self, config: RnsConfig, context: ControllerContext) -> None:
        """Resolve joints and gains.

        Raises:
            ScenarioFaults: No task, an unknown joint, or no more joints than the base has axes to turn about.
        """
        super().__init__(config, context, config.attitude, inverts=True)
        turns = config.attitude
        self._kp = self.weighted(config.position.kp_1_s2, turns.kp_1_s2 if turns else 0.0)
        self._kd = self.weighted(config.position.kd_1_s, turns.kd_1_s if turns else 0.0)
        self._gains, self._damping = config.base, config.joint_damping_N_m_s_rad
        self._base = BaseRotation(context.system, self.model)
        n, axes = len(self.model.joints.dofs), self._base.size
        if n <= axes:
            message = f"{n} joints are not more than the {axes} axes that the base turns about; nothing is left for the tip"
            raise ScenarioFaults([Fault(message, ("joints",))])
        self.directions = min(self.directions, n - axes)
        self._largest, self._largest_base = config.singular_mass_kg, _SINGULAR_BASE_INERTIA_KG_M2
        self.watch(self._largest)
        self.telemetry_signals += (_RATE,)
        self._largest_rate = 0.0

    def start(self, observation: Observation) -> None:
        """Take the references."""
        super().start(observation)
        self._base.start(observation.data)

    def effort(self, data: Any) -> FloatArray:
        """U of the law, (n,)."""
        model, base = self.model, self._base
        base.update(data)
        holds, N = self._null_space()
        first = holds.dot(-self._gains.kp_1_s2 * base.angle - self._gains.kd_1_s * base.rates - base.drift)
        first -= self._damping * N.dot(model.qd)
        reach = N.dot(model.alpha.T)
        wanted = model.target_accelerations - self._kd * model.ed - self._kp * model.e - model.drift - model.B.dot(first)
        self._largest_rate = max(self._largest_rate, float(np.linalg.norm(base.rates)))
        return np.asarray(first + reach.dot(self.damped(model.B.dot(reach), self._largest).dot(wanted)))

    def _null_space(self) -> tuple[FloatArray, FloatArray]:
        """Efforts per angular acceleration of the base, (n, axes), and N, (n, n)."""
        base = self._base
        inertia, _ = damped_inverse(base.B.dot(base.W.T), self._largest_base)
        holds = base.W.T.dot(inertia)
        return holds, np.eye(len(holds)) - holds.dot(base.B)

    def telemetry(self) -> tuple[float, ...]:
        """Errors, share, and the angular speed of the base at the last tick."""
        return (*super().telemetry(), float(np.linalg.norm(self._base.rates)))

    def summary(self) -> ControllerReport:
        """How near to a singularity it came, and how fast the base turned."""
        return {**super().summary(), "largest_base_rate_rad_s": self._largest_rate}

    def damping_at(self, data: Any) -> Damping:
        """The one that comes nearest to instability: of tip, base, or what neither feels."""
        model, base = self.model, self._base
        model.update(data)
        base.update(data)
        holds, N = self._null_space()
        reach = N.dot(model.alpha.T)
        inverse, _ = damped_inverse(model.B.dot(reach), self._largest)
        pushes = reach.dot(inverse)
        dofs, kd = model.joints.dofs, self._gains.kd_1_s
        unseen = joint_damping(model, self._damping, N - pushes.dot(model.B).dot(N))
        of_base = Damping("base.kd_1_s", dofs, np.full(len(dofs), kd), kd * holds.dot(base.W))
        return self.least_stable(pushes, self._kd, ("position.kd_1_s", "attitude.kd_1_s"), unseen, of_base)
