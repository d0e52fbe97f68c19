"""Output- and state-dependent Riccati equation control of the tip (paper section 3, design section 5).

The reduced dynamics are exact for any momentum; A comes in two parameterizations, because the paper prints one (30) and its
figures were made with the other. ``output_stack`` depends on where the world's origin is, ``velocity`` does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Literal

import mujoco
import numpy as np
from pydantic import Field

from controllers.joints import driven_joints
from controllers.riccati import PlanarRiccati, RiccatiError, solve_care
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
        self._axes = _slice_if_contiguous(np.array(self._task.axes))
        self._dofs = _slice_if_contiguous(self._joints.dofs)
        self._actuators = _slice_if_contiguous(self._joints.actuators)
        self._target = self._task.target_m.tolist()
        self._tip_body = int(self._model.site_bodyid[self._task.tip_site])
        p = len(self._task.axes)
        if p > len(self._joints.dofs):
            raise ScenarioFaults(
                [Fault(f"{p} outputs need at least {p} joints, there are {len(self._joints.dofs)}", ("joints",))]
            )
        self._Q = _state_weight(config.Q, p)
        self._R_inverse = np.linalg.inv(_input_weight(config.R, len(self._joints.dofs)))
        self._damping = config.null_space_damping
        self._whole_stack = config.parameterization == "output_stack"
        nv = self._model.nv
        self._jacp, self._jac_dot = np.empty((3, nv)), np.empty((3, nv))
        self._J, self._W, self._bias = np.empty((p, nv)), np.empty((p, nv)), np.empty(nv)
        self._planar = PlanarRiccati(self._Q) if p == 2 else None
        self._report: tuple[float, ...] = (np.nan,) * len(self.telemetry_signals)

    def start(self, observation: Observation) -> None:  # noqa: ARG002
        """The law has no memory; the Riccati solver starts cold."""
        if self._planar is not None:
            self._planar.forget()

    def control(self, observation: Observation, command: Command) -> None:
        """Command u = -R^-1 B^T K [y - y_d; ydot], paper (32).

        Raises:
            ControllerError: The Riccati equation has no stabilising solution at this state.
        """
        data = observation.data
        B_lower, drift, y, y_dot = self._output_dynamics(data)
        try:
            if self._planar is not None:
                u = self._planar_law(self._planar, B_lower, drift, y, y_dot)
            else:
                u = self._law(B_lower, drift, y, y_dot)
        except RiccatiError as error:
            raise ControllerError(f"OSDRE at t = {observation.time_s:.6g} s: {error}") from error
        if self._damping > 0.0:
            brake = self._damping * data.qvel[self._joints.dofs]
            u -= brake - np.linalg.pinv(B_lower) @ (B_lower @ brake)
        command.drive(self._actuators, u)

    def _output_dynamics(self, data: Any) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """(alpha M_c^-1, drift d, y, ydot) at the current state: ydd = d + alpha M_c^-1 u.

        With the rows W = J M^-1 of the whole robot, alpha M_c^-1 is their part on the driven joints and d = Jdot qdot - W c:
        the elimination of the other dofs (22), done by MuJoCo's factorisation of M.
        """
        model, site = self._model, self._task.tip_site
        axes = self._axes
        point = data.site_xpos[site]
        mujoco.mj_jacSite(model, data, self._jacp, None, site)
        mujoco.mj_jacDot(model, data, self._jac_dot, None, point, self._tip_body)
        J = self._jacp[axes] if isinstance(axes, slice) else self._jacp.take(axes, axis=0, out=self._J)
        mujoco.mj_solveM(model, data, self._W, J)
        np.subtract(data.qfrc_bias, data.qfrc_passive, out=self._bias)
        qvel = data.qvel
        drift = self._jac_dot[axes] @ qvel - self._W @ self._bias
        return self._W[:, self._dofs], drift, point[axes], J @ qvel

    def _planar_law(
        self, riccati: PlanarRiccati, B_lower: FloatArray, drift: FloatArray, y: FloatArray, y_dot: FloatArray
    ) -> FloatArray:
        """The law for two outputs, in floats."""
        y0, y1 = y.tolist()
        v0, v1 = y_dot.tolist()
        d0, d1 = drift.tolist()
        speed = v0 * v0 + v1 * v1
        square = y0 * y0 + y1 * y1 + speed if self._whole_stack else speed
        scale = 1.0 / square if square > 0.0 else 0.0
        a0, a1 = (d0 * scale, d1 * scale) if self._whole_stack else (0.0, 0.0)
        A21 = (a0 * y0, a0 * y1, a1 * y0, a1 * y1)
        b0, b1 = d0 * scale, d1 * scale
        A22 = (b0 * v0, b0 * v1, b1 * v0, b1 * v1)
        BR = B_lower @ self._R_inverse
        (s0, s1), (_, s3) = (BR @ B_lower.T).tolist()
        P2, P3, residual, fallback = riccati.solve(A21, A22, (s0, s1, s1, s3))
        e0, e1 = y0 - self._target[0], y1 - self._target[1]
        w0 = P2[0] * e0 + P2[2] * e1 + P3[0] * v0 + P3[1] * v1
        w1 = P2[1] * e0 + P2[3] * e1 + P3[2] * v0 + P3[3] * v1
        self._report = ((e0 * e0 + e1 * e1) ** 0.5, residual, float(fallback), _smallest_singular_value(B_lower))
        return np.asarray(BR[0] * -w0 - BR[1] * w1)

    def _law(self, B_lower: FloatArray, drift: FloatArray, y: FloatArray, y_dot: FloatArray) -> FloatArray:
        """The law for any number of outputs."""
        p = len(y)
        A, S = np.zeros((2 * p, 2 * p)), np.zeros((2 * p, 2 * p))
        A[:p, p:] = np.eye(p)
        if self._whole_stack:
            A[p:] = np.outer(drift, _pseudo_inverse(np.concatenate((y, y_dot))))
        else:
            A[p:, p:] = np.outer(drift, _pseudo_inverse(y_dot))
        S[p:, p:] = B_lower @ self._R_inverse @ B_lower.T
        solution = solve_care(A, S, self._Q)
        error = y - self._task.target_m
        smallest = float(np.linalg.svd(B_lower, compute_uv=False)[-1])
        self._report = (float(np.linalg.norm(error)), solution.residual, float(solution.fallback), smallest)
        return np.asarray(-self._R_inverse @ (B_lower.T @ (solution.K[p:] @ np.concatenate((error, y_dot)))))

    def telemetry(self) -> Sequence[float]:
        """Error, Riccati residual, fallback, smallest gain of the last tick."""
        return self._report


def _slice_if_contiguous(indices: IntArray) -> slice | IntArray:
    """A slice gives a view, an index array a copy that costs five times as much."""
    if np.all(np.diff(indices) == 1):
        return slice(int(indices[0]), int(indices[-1]) + 1)
    return indices


def _pseudo_inverse(v: FloatArray) -> FloatArray:
    """v^+ = v^T / |v|^2, zero at zero."""
    square = float(v @ v)
    return v / square if square > 0.0 else np.zeros_like(v)


def _smallest_singular_value(B: FloatArray) -> float:
    """Smaller singular value of a matrix of two rows: det / largest keeps its digits where it is small."""
    first, second = B.tolist()
    a = sum([x * x for x in first])
    b = sum([x * y for x, y in zip(first, second, strict=True)])
    d = sum([y * y for y in second])
    half = 0.5 * (a + d)
    largest = half + (max(half * half - (a * d - b * b), 0.0)) ** 0.5
    return (max(a * d - b * b, 0.0) / largest) ** 0.5 if largest > 0.0 else 0.0


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
