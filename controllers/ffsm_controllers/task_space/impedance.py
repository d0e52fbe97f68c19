"""Cartesian impedance: the tip behaves as a mass on a spring and a damper that are fixed to a target, which may move.

With Lambda, the inverse of alpha M_c^-1 alpha^T, as the mass: Lambda (ydd - ydd_d) + D ed + K e = F_ext. The inertia stays
that of the free-floating robot at its tip, so no force has to be measured; base and momentum are compensated: u = alpha^T
(Lambda (ydd_d - drift) - D ed - K e) + (1 - alpha^T Lambda B) u_0, u_0 = -D_q qd. D follows from a damping ratio zeta: with
Lambda = Q Q^T and K = Q V diag(k) V^T Q^T it is Q V diag(2 zeta sqrt(k)) V^T Q^T, so that every mode at the present state
has this damping ratio. The wrench of spring and damper is bounded as a whole, in its direction. Lambda is damped near
singularities, see :func:`~ffsm_controllers.task_space.singularity.damped_inverse`.

The spring tells what a lasting contact feels. At a rigid impact the law has no part: forces of springs and dampers do
nothing in no time, and the impulse is that of M alone.

Source: Hogan 1985, Impedance control, J. Dyn. Syst. Meas. Control 107(1); Albu-Schaeffer, Ott, Frese & Hirzinger 2003,
Cartesian impedance control of redundant robots, ICRA (damping from a ratio); on the reduced dynamics of the free-floating
robot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, PositiveFloat, model_validator

from ffsm_controllers.task_space.config import AttitudeTarget, DampedConfig, object_site
from ffsm_controllers.task_space.damping import joint_damping, most_unstable, output_damping
from ffsm_controllers.task_space.singularity import damped_inverse
from ffsm_controllers.task_space.task_law import TaskLaw
from ffsm_mj.controller_protocol import (
    ControllerContext,
    ControllerReport,
    Damping,
    FloatArray,
    MovingFrame,
    Signal,
    StrictModel,
)

_FORCE = Signal("controller", "impedance_force_N", "N", "size of the force of spring and damper, after its bound")
_TORQUE = Signal("controller", "impedance_torque_N_m", "N m", "size of the torque of spring and damper, after its bound")


class PositionSpring(StrictModel):
    """Spring on the position of the tip."""

    stiffness_N_m: PositiveFloat
    """Force per distance, N/m."""
    max_force_N: PositiveFloat | None = None
    """Bound on the force of spring and damper, N: the whole wrench is scaled down to keep it; left out: no bound."""


class AttitudeSpring(AttitudeTarget):
    """Spring on the attitude of the tip."""

    stiffness_N_m_rad: PositiveFloat
    """Torque per angle, N m/rad."""
    max_torque_N_m: PositiveFloat | None = None
    """Bound on the torque of spring and damper, N m: the whole wrench is scaled down to keep it; left out: no bound."""


class ImpedanceConfig(DampedConfig):
    """Cartesian impedance: spring and damper between the tip and its target."""

    kind: Literal["impedance"]
    position: PositionSpring
    """Spring on the position."""
    attitude: AttitudeSpring | None = None
    """Spring on the attitude; left out: it is not controlled."""
    damping_ratio: PositiveFloat = 1.0
    """Damping ratio of every mode of the tip; 1 is critical."""
    object_site: Annotated[str, Field(min_length=1)] | None = None
    """Site of an object that the tip is to be at, in place of the target of the task; its frame is that of the attitude."""
    offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """With ``object_site``: where the tip is to be in the frame of that site, m."""

    @model_validator(mode="after")
    def _has_one_target(self) -> ImpedanceConfig:
        if self.object_site is None and self.offset_m != (0.0, 0.0, 0.0):
            raise ValueError("'offset_m' has no effect without 'object_site'; leave it out")
        if self.object_site is not None and self.attitude is not None and self.attitude.target is not None:
            raise ValueError("has both 'object_site' and 'attitude.target'; leave one of them out")
        return self


class Impedance(TaskLaw):
    """Cartesian impedance. While the object of the site to follow is held, the law only damps the joints."""

    @dataclass
    class State(TaskLaw.State):
        """With the sizes of force and torque at the last tick, and the number of ticks, and of those at a bound."""

        sizes: tuple[float, float]
        limited: int
        ticks: int

    Config = ImpedanceConfig

    def __init__(self, config: ImpedanceConfig, context: ControllerContext) -> None:
        """Resolve joints, gains and the site to follow.

        Raises:
            ScenarioFaults: No task, an unknown name, or fewer joints than components of the output.
        """
        super().__init__(config, context, config.attitude, inverts=True)
        turns = config.attitude
        self._stiffness = np.diag(self.weighted(config.position.stiffness_N_m, turns.stiffness_N_m_rad if turns else 0.0))
        self._ratio, self._damping = config.damping_ratio, config.joint_damping_N_m_s_rad
        self._most = config.position.max_force_N, turns.max_torque_N_m if turns else None
        self._largest = config.singular_mass_kg
        self.watch(self._largest)
        self.telemetry_signals += (_FORCE, *((_TORQUE,) if turns is not None else ()))
        self._sizes, self._limited, self._ticks = (math.nan, math.nan), 0, 0
        self._moving: MovingFrame | None = None
        self._holds = False
        if config.object_site is not None:
            site, grasp = object_site(context.system, config.object_site), context.system.grasp
            self.model.motion = None
            self._moving = MovingFrame(context.system.mj, site, np.array(config.offset_m))
            self._holds = grasp is not None and context.system.mj.site(site).name.startswith(f"{grasp.tree}/")

    def _observe(self, data: Any, pushed: FloatArray | None) -> None:
        """Bring the task model up to date, with the target where the site of the object is."""
        model, moving = self.model, self._moving
        if moving is None:
            model.update(data, pushed)
            return
        moving.update(data)
        rows = model.site.rows
        model.target_m, model.target_rates = moving.point[rows[: self.positions]], moving.rates[rows]
        if self.turns:
            model.target_frame = moving.frame
        model.update(data, pushed)
        accelerations = moving.accelerations(model.coasting)
        if self.turns:
            accelerations[3:] += moving.relative_turn(model.ed[self.positions :])
        model.target_accelerations = accelerations[rows]

    def effort(self, data: Any) -> FloatArray:  # noqa: ARG002
        """U of the law, (n,)."""
        model = self.model
        damped = -self._damping * model.qd
        if self._holds:
            return np.asarray(damped)
        inertia = self.damped(model.B.dot(model.alpha.T), self._largest)
        wrench = self._bounded(-self._stiffness.dot(model.e) - self._damper(inertia).dot(model.ed))
        feedforward = inertia.dot(model.target_accelerations - model.drift - model.B.dot(damped))
        return np.asarray(damped + (feedforward + wrench).dot(model.alpha))

    def _damper(self, inertia: FloatArray) -> FloatArray:
        """D for an inertia, (p, p)."""
        values, directions = np.linalg.eigh(inertia)
        root = np.sqrt(values)
        Q, back = directions * root, (directions / root).T
        squares, modes = np.linalg.eigh(back.dot(self._stiffness).dot(back.T))
        whole = Q.dot(modes)
        return np.asarray((whole * (2.0 * self._ratio * np.sqrt(squares))).dot(whole.T))

    def _bounded(self, wrench: FloatArray) -> FloatArray:
        """The wrench, scaled down as a whole to keep the bounds on its force and its torque."""
        k = self.positions
        sizes = math.hypot(*wrench[:k].tolist()), math.hypot(*wrench[k:].tolist())
        shares = [most / size for size, most in zip(sizes, self._most, strict=True) if most is not None and size > most]
        share = min(shares, default=1.0)
        self._sizes = share * sizes[0], share * sizes[1]
        self._ticks, self._limited = self._ticks + 1, self._limited + bool(shares)
        return wrench if share == 1.0 else share * wrench

    def telemetry(self) -> tuple[float, ...]:
        """Errors, share, force and torque at the last tick."""
        return (*super().telemetry(), *self._sizes[: 2 if self.turns else 1])

    def summary(self) -> ControllerReport:
        """How near to a singularity it came, and how often the wrench was at its bound."""
        values = {**super().summary()}
        if any(most is not None for most in self._most):
            values["share_of_ticks_at_the_bound"] = self._limited / max(self._ticks, 1)
        return values

    def damping_at(self, data: Any) -> Damping:
        """The damper's, or that of what the output does not feel."""
        model = self.model
        model.update(data)
        inertia, _ = damped_inverse(model.B.dot(model.alpha.T), self._largest)
        pushes = model.alpha.T.dot(self._damper(inertia))
        unseen = np.eye(len(model.qd)) - inertia.dot(model.alpha).T.dot(model.B)
        return most_unstable(
            model,
            [
                output_damping(model, pushes, "damping_ratio", self._ratio, slice(None)),
                joint_damping(model, self._damping, unseen),
            ],
        )
