"""Output- and state-dependent Riccati equation control of the tip (paper section 3, design section 5).

The reduced dynamics are exact for any momentum; A comes in two parameterizations, because the paper prints one (30) and its
figures were made with the other. ``output_stack`` depends on where the world's origin is, ``velocity`` does not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Literal

import mujoco
import numpy as np
from pydantic import Field

from controllers.joints import driven_joints
from controllers.osdre_planar import feedback, tip_state
from controllers.riccati import BlockRiccati, PlanarRiccati, RiccatiError
from ffsm_mj.config import StrictModel
from ffsm_mj.controller_protocol import Command, ControllerContext, Observation
from ffsm_mj.errors import ControllerError, Fault, ScenarioFaults
from ffsm_mj.model import FloatArray, IntArray
from ffsm_mj.signals import Signal

Weight = tuple[float, ...] | tuple[tuple[float, ...], ...]


class OsdreConfig(StrictModel):
    """OSDRE regulation of the task's tip to its target."""

    kind: Literal["osdre"]
    joints: tuple[str, ...] | None = None
    """Joints to drive; left out: every motor-driven joint of the robot but those of the base."""
    Q: Weight
    """Weight of the output stack [y; ydot], 2p numbers for a diagonal or 2p rows; its position block must be regular."""
    R: Weight
    """Weight of the torques, positive definite: one number per joint for a diagonal, or rows."""
    parameterization: Literal["output_stack", "velocity"] = "output_stack"
    """Lower block of A: ``output_stack`` d z^+ (the paper's runs), ``velocity`` [0, d ydot^+] (the paper's print)."""
    null_space_damping: Annotated[float, Field(ge=0.0)] = 0.0
    """Damping of motions of a redundant arm that do not move the output, N m s/rad; the output does not feel it."""


class Osdre:
    """OSDRE law. Attributes of the last tick are in ``telemetry``."""

    Config = OsdreConfig
    telemetry_signals: ClassVar[tuple[Signal, ...]] = (
        Signal("controller", "osdre_error_m", "m", "distance of the output from its target"),
        Signal("controller", "osdre_riccati_residual", "", "residual of the Riccati equation over its largest term"),
        Signal("controller", "osdre_riccati_fallback", "", "1 where the robust Riccati solver was needed"),
        Signal(
            "controller", "osdre_smallest_gain", "", "smallest singular value of alpha M_c^-1: condition 1 holds while > 0"
        ),
    )

    def __init__(self, config: OsdreConfig, context: ControllerContext) -> None:
        """Resolve joints and check the weights.

        Raises:
            ScenarioFaults: No task, an unknown joint, or weights that give no unique stabilising gain.
        """
        if context.task is None:
            raise ScenarioFaults([Fault("osdre needs a 'task' with tip, axes and target", ("kind",))])
        system, self._task = context.system, context.task
        self._model = system.mj
        self._joints = driven_joints(system, config.joints)
        self._axes = np.array(self._task.axes)
        self._actuators = _slice_if_contiguous(self._joints.actuators)
        axes, target = self._task.axes, self._task.target_m.tolist()
        self._plane, self._target = (axes[0], axes[-1]), (target[0], target[-1])
        self._tip_body = int(self._model.site_bodyid[self._task.tip_site])
        p = len(self._task.axes)
        if p > len(self._joints.dofs):
            raise ScenarioFaults(
                [Fault(f"{p} outputs need at least {p} joints, there are {len(self._joints.dofs)}", ("joints",))]
            )
        Q = _state_weight(config.Q, p)
        self._damping = config.null_space_damping
        self._whole_stack = config.parameterization == "output_stack"
        nv = self._model.nv
        self._jacobians, self._W = np.empty((6, nv)), np.empty((p, nv))
        self._jacp, self._jac_dot = self._jacobians[:3], self._jacobians[3:]
        # The rows of the output: a view where its axes are contiguous, filled at each tick where they are not.
        self._contiguous = axes == tuple(range(axes[0], axes[0] + p))
        self._J = self._jacp[axes[0] : axes[0] + p] if self._contiguous else np.empty((p, nv))
        # Products with these pick the driven joints, faster than an index does.
        self._driven = np.eye(nv)[self._joints.dofs]
        self._driven_R = np.linalg.inv(_input_weight(config.R, len(self._joints.dofs))) @ self._driven
        self._both = np.vstack((self._driven, self._driven_R))
        self._data: Any = None
        self._riccati = PlanarRiccati(Q) if p == 2 else BlockRiccati(Q)
        self._report: tuple[float, ...] = (np.nan,) * len(self.telemetry_signals)

    def start(self, observation: Observation) -> None:  # noqa: ARG002
        """The law has no memory; the Riccati solver starts cold."""
        self._riccati.forget()

    def control(self, observation: Observation, command: Command) -> None:
        """Command u = -R^-1 B^T K [y - y_d; ydot], paper (32).

        Raises:
            ControllerError: The Riccati equation has no stabilising solution at this state.
        """
        if observation.data is not self._data:
            self._bind(observation.data)
        self._output_dynamics()
        try:
            riccati = self._riccati
            u = self._planar_law(riccati) if isinstance(riccati, PlanarRiccati) else self._law(riccati)
        except RiccatiError as error:
            raise ControllerError(f"OSDRE at t = {observation.time_s:.6g} s: {error}") from error
        if self._damping > 0.0:
            B_lower, brake = self._W @ self._driven.T, self._damping * self._qvel[self._joints.dofs]
            u -= brake - np.linalg.pinv(B_lower) @ (B_lower @ brake)
        command.drive(self._actuators, u)

    def _bind(self, data: Any) -> None:
        """Keep views of MuJoCo's arrays: looking them up costs more than reading them."""
        self._data, self._point = data, data.site_xpos[self._task.tip_site]
        self._qvel, self._qfrc_bias, self._qfrc_passive = data.qvel, data.qfrc_bias, data.qfrc_passive

    def _output_dynamics(self) -> None:
        """Jacobians of the tip and W = J M^-1 at the current state: ydd = Jdot qdot - W c + W u.

        The part of W on the driven joints is alpha M_c^-1, the elimination of the other dofs (22), done by MuJoCo's
        factorisation of M.
        """
        model, data = self._model, self._data
        mujoco.mj_jacSite(model, data, self._jacp, None, self._task.tip_site)
        mujoco.mj_jacDot(model, data, self._jac_dot, None, self._point, self._tip_body)
        if not self._contiguous:
            self._J[:] = self._jacp[self._axes]
        mujoco.mj_solveM(model, data, self._W, self._J)

    def _planar_law(self, riccati: PlanarRiccati) -> FloatArray:
        """The law for two outputs, mostly in floats."""
        force = self._qfrc_bias - self._qfrc_passive
        tip = tip_state(
            self._W,
            self._jacobians,
            force,
            self._qvel,
            self._point,
            self._both,
            self._plane,
            self._target,
            self._whole_stack,
        )
        blocks, residual, fallback = riccati.solve(tip.A21, tip.A22, tip.S, tip.axes)
        self._report = (math.hypot(*tip.error), residual, float(fallback), tip.smallest_gain)
        return tip.gain.dot(feedback(blocks, tip.error, tip.y_dot, tip.axes))  # type: ignore[no-any-return]

    def _law(self, riccati: BlockRiccati) -> FloatArray:
        """The law for any number of outputs."""
        B_lower, BR, axes = self._W.dot(self._driven.T), self._W.dot(self._driven_R.T), self._axes
        y, y_dot = self._point[axes], self._J.dot(self._qvel)
        drift = self._jac_dot[axes].dot(self._qvel) - self._W.dot(self._qfrc_bias - self._qfrc_passive)
        A21, A22 = np.zeros((len(y), len(y))), np.outer(drift, y_dot)
        square = float(y_dot.dot(y_dot))
        if self._whole_stack:
            A21, square = np.outer(drift, y), square + float(y.dot(y))
        scale = 1.0 / square if square > 0.0 else 0.0
        K_lower, residual, fallback = riccati.solve(scale * A21, scale * A22, BR.dot(B_lower.T))
        error = y - self._task.target_m
        smallest = float(np.linalg.svd(B_lower, compute_uv=False)[-1])
        self._report = (math.sqrt(error.dot(error)), residual, float(fallback), smallest)
        return -K_lower.dot(np.concatenate((error, y_dot))).dot(BR)  # type: ignore[no-any-return]

    def telemetry(self) -> Sequence[float]:
        """Error, Riccati residual, fallback, smallest gain of the last tick."""
        return self._report


def _slice_if_contiguous(indices: IntArray) -> slice | IntArray:
    """A slice of an array is written five times as fast as an index into it."""
    if np.all(np.diff(indices) == 1):
        return slice(int(indices[0]), int(indices[-1]) + 1)
    return indices


def _matrix(weight: Weight, size: int, key: str, of: str) -> FloatArray:
    """Weight as a symmetric matrix.

    Raises:
        ScenarioFaults: Wrong size, or not symmetric.
    """
    rows = [row if isinstance(row, tuple) else (row,) for row in weight]
    flat = not any(isinstance(row, tuple) for row in weight)
    if len(rows) != size or (not flat and any(len(row) != size for row in rows)):
        raise ScenarioFaults([Fault(f"must be {size} numbers (a diagonal) or {size} rows of {size}, {of}", (key,))])
    matrix = np.diag(np.array(weight)) if flat else np.array(rows)
    if not np.array_equal(matrix, matrix.T):
        raise ScenarioFaults([Fault("must be symmetric", (key,))])
    return np.asarray(matrix, dtype=np.float64)


def _state_weight(weight: Weight, p: int) -> FloatArray:
    Q = _matrix(weight, 2 * p, "Q", f"for {p} outputs and their rates")
    eigenvalues = np.linalg.eigvalsh(Q)
    if eigenvalues[0] < -1e-12 * max(eigenvalues[-1], 0.0):
        raise ScenarioFaults(
            [Fault(f"must be positive semidefinite; its smallest eigenvalue is {eigenvalues[0]:.3g}", ("Q",))]
        )
    position = np.linalg.eigvalsh(Q[:p, :p])
    if position[0] <= 1e-12 * position[-1] or position[-1] <= 0.0:
        message = (
            "its position block must be regular, or no gain brings the tip to the target; raise its first diagonal entries"
        )
        raise ScenarioFaults([Fault(message, ("Q",))])
    return Q


def _input_weight(weight: Weight, count: int) -> FloatArray:
    R = _matrix(weight, count, "R", "one per driven joint")
    smallest = np.linalg.eigvalsh(R)[0]
    if smallest <= 0.0:
        raise ScenarioFaults([Fault(f"must be positive definite; its smallest eigenvalue is {smallest:.3g}", ("R",))])
    return R
