"""Stiffness and damping of servos, springs and dampers: their fastest rate, and Newton's iterations of implicit steps.

A servo of a vendor's arm may decay in 5 us: an explicit step of 1 ms diverges. In an implicit step the accelerations a_i at
the nodes are corrected by the solution of

    da_i + M^-1 (D_i sum_j W_ij da_j + K_i sum_j (W^2)_ij da_j) = r_i,   W = h A

with the residual r_i of the accelerations, and the stiffness K_i and damping D_i of what acts at node i: servos at a limit
of their force are not part of it. Rows that are held are in M^-1: closed loops, joints that stick, closed contacts. All are
those at the start of the step, but for the limits: the iterations converge to the same solution, only slower where K and D
change. Where the same servos act at all nodes, the eigenvectors of A separate the equations into those of one real node and
of one complex one (Hairer & Wanner, *Solving Ordinary Differential Equations II*, sec. IV.8).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import BoolArray, FloatArray, IntArray
from ffsm_mj.dynamics.implicit_stages import COEFFICIENTS
from ffsm_mj.dynamics.rigid_body import mass_matrix
from ffsm_mj.dynamics.springs import JointSprings
from ffsm_mj.model.actuators import servo_mask, without_force_limits
from ffsm_mj.tolerances import RANK

_LENGTH, _RATE, _ACTIVATION = 1e-4, 1e-4, 1e-4
"""Steps of differences, m or rad, m/s or rad/s, and of activations."""
_VALUES, _VECTORS = np.linalg.eig(COEFFICIENTS)
_REAL, _COMPLEX = int(np.argmin(np.abs(_VALUES.imag))), int(np.argmax(_VALUES.imag))
_PROJECTORS = _VECTORS.T[:, :, None] * np.linalg.inv(_VECTORS)[:, None, :]
"""On each eigenvector of A: two are complex, and conjugate to each other."""
_SHARES = np.stack((_PROJECTORS[_REAL].real, 2.0 * _PROJECTORS[_COMPLEX].real, -2.0 * _PROJECTORS[_COMPLEX].imag), -1)
"""Shares of what acts on the real eigenvector and of real and imaginary part of what acts on a complex one, (3, 3, 3)."""
_CONSTANT_GAIN = int(mujoco.mjtGain.mjGAIN_FIXED)
_NO_BIAS, _AFFINE_BIAS = int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE)


class StiffActuators:
    """Stiffness and damping of the servos, springs and dampers of a model."""

    def __init__(self, model: Any, data: Any, response: Callable[[FloatArray], FloatArray]) -> None:
        """Bind to a model and its data.

        Args:
            model: MuJoCo model.
            data: Its data.
            response: Accelerations by forces along some rows; see :meth:`ffsm_mj.dynamics.motion.Motion.response`.
        """
        self._model, self._data, self._response = model, data, response
        self._servos: IntArray = np.flatnonzero(servo_mask(model))
        self._springs, self._unlimited = JointSprings(model), without_force_limits(model)
        self._moments, self._unit = np.zeros((model.nout, model.nv)), np.eye(model.nv)
        limited = model.actuator_forcelimited[self._servos].astype(bool)
        self._low, self._high = np.where(limited[:, None], model.actuator_forcerange[self._servos], [-np.inf, np.inf]).T
        # Slopes of affine servos are parameters of the model. Differences would have them with rounding of the state.
        servos, biases = self._servos, model.actuator_biastype[self._servos]
        affine = (model.actuator_gaintype[servos] == _CONSTANT_GAIN) & np.isin(biases, (_NO_BIAS, _AFFINE_BIAS))
        self._curved: IntArray = np.flatnonzero(~affine)
        self._slopes = -np.where(biases == _AFFINE_BIAS, model.actuator_biasprm[servos, 1:3].T, 0.0)
        self._pattern = b""
        self._inverse: FloatArray = np.zeros((0, 0))
        self._limited_dofs = model.jnt_dofadr[model.jnt_actfrclimited.astype(bool)]
        self._dof_ranges = model.jnt_actfrcrange[model.jnt_actfrclimited.astype(bool)].T

    def update(self) -> None:
        """Evaluate stiffness, damping and mobility at the state in the data, forces current."""
        self._evaluate()
        self._mobility = self._response(self._unit)
        self._pattern = b""

    def hold(self, rows: FloatArray, response: FloatArray) -> None:
        """Take from the mobility what contacts hold.

        Args:
            rows: Rows J of their points that are held, (n, nv).
            response: Accelerations by forces along them without these contacts, (n, nv).
        """
        if len(rows):
            self._mobility = self._mobility - response.T @ np.linalg.lstsq(rows @ response.T, response, rcond=RANK)[0]
            self._pattern = b""

    def _evaluate(self) -> None:
        """Evaluate stiffness and damping."""
        model, data, servos, springs = self._model, self._data, self._servos, self._springs
        mujoco.mju_sparse2dense(
            self._moments, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind
        )
        self._rows = self._moments[servos]
        if len(self._curved):
            self._slopes[:, self._curved] = _slopes(self._unlimited, data, servos[self._curved])
            mujoco.mj_fwdActuation(model, data)
        self._spring_K, self._spring_D = np.diag(springs.stiffness(data.qpos)), np.diag(springs.damping(data.qvel))
        if springs.tendons.elastic or springs.tendons.damped:
            tendons, rows = springs.tendons, springs.tendons.rows(data)
            self._spring_K = self._spring_K + rows.T @ (tendons.stiffness(data)[:, None] * rows)
            self._spring_D = self._spring_D + rows.T @ (tendons.damping(tendons.rates(data))[:, None] * rows)

    def acting(self) -> BoolArray:
        """Which servos are within the limits of their force at the state in the data, forces current, (n,)."""
        data, force = self._data, self._data.actuator_force[self._servos]
        acting = (force > self._low) & (force < self._high)
        if len(self._limited_dofs):
            total = data.qfrc_actuator[self._limited_dofs]
            blocked = self._limited_dofs[(total <= self._dof_ranges[0]) | (total >= self._dof_ranges[1])]
            acting &= ~self._rows[:, blocked].any(axis=1)
        return np.asarray(acting)

    def correction(self, duration_s: float, residuals: FloatArray, acting: BoolArray) -> FloatArray:
        """Change of the accelerations at the nodes, (s, nv).

        Args:
            duration_s: Duration of the step.
            residuals: Accelerations under the forces at the nodes less those from which their states follow, (s, nv).
            acting: Servos within their limits at each node, (s, n).
        """
        pattern = acting.tobytes()
        if pattern != self._pattern:
            same = pattern == pattern[: acting.shape[1]] * len(acting)
            self._pattern = pattern
            self._inverse = self._separated(duration_s, acting[0]) if same else self._joint(duration_s, acting)
        return np.asarray((self._inverse @ residuals.reshape(-1)).reshape(residuals.shape))

    def _separated(self, duration_s: float, acting: BoolArray) -> FloatArray:
        """Inverse of the matrix of all nodes where the same servos act at all of them, (s nv, s nv).

        On an eigenvector of A the matrix is 1 + M^-1 (w D + w^2 K), with w = h times the eigenvalue.
        """
        K, D = self._stiffness(acting)
        by_rate, by_place = duration_s * (self._mobility @ D), duration_s**2 * (self._mobility @ K)
        real, other = _VALUES[_REAL].real, _VALUES[_COMPLEX]
        of_real = np.linalg.inv(self._unit + real * by_rate + real**2 * by_place)
        of_other = np.linalg.inv(self._unit + other * by_rate + other**2 * by_place)
        n, parts = len(of_real), np.stack((of_real, of_other.real, of_other.imag))
        blocks = (_SHARES.reshape(9, 3) @ parts.reshape(3, -1)).reshape(3, 3, n, n)
        return np.asarray(blocks.transpose(0, 2, 1, 3).reshape(3 * n, 3 * n))

    def _joint(self, duration_s: float, acting: BoolArray) -> FloatArray:
        """Inverse of the matrix of all nodes, (s nv, s nv)."""
        weights = duration_s * COEFFICIENTS
        nodes, n, square = len(weights), len(self._mobility), weights @ weights
        matrix = np.eye(nodes * n).reshape(nodes, n, nodes, n)
        for i in range(nodes):
            K, D = self._stiffness(acting[i])
            matrix[i] += np.einsum("ab,j->ajb", self._mobility @ D, weights[i])
            matrix[i] += np.einsum("ab,j->ajb", self._mobility @ K, square[i])
        return np.asarray(np.linalg.inv(matrix.reshape(nodes * n, nodes * n)), dtype=np.float64)

    def _stiffness(self, acting: BoolArray) -> tuple[FloatArray, FloatArray]:
        rows = self._rows
        K = self._spring_K + rows.T @ ((self._slopes[0] * acting)[:, None] * rows)
        return K, self._spring_D + rows.T @ ((self._slopes[1] * acting)[:, None] * rows)

    def fastest(self) -> tuple[float, float]:
        """Largest rates of the loops at the state in the data, with all servos within their limits.

        The gain of some servos, and the time constant of a muscle, depend on the control: the largest rates are those with
        the controls in the data, or all at the same end of their ranges.

        Returns:
            Of q'' = -M^-1 (K q + D q'), and with the activations as further states, 1/s.
        """
        model, data = self._model, self._data
        kept, rates = data.ctrl.copy(), []
        for controls in (
            kept,
            *np.where(model.actuator_ctrllimited.astype(bool)[:, None], model.actuator_ctrlrange, kept[:, None]).T,
        ):
            data.ctrl[:] = controls
            rates.append(self._rates())
        data.ctrl[:] = kept
        mujoco.mj_fwdActuation(model, data)
        mechanical, all_states = np.max(rates, axis=0).tolist()
        return mechanical, all_states

    def _rates(self) -> tuple[float, float]:
        """Largest rates with the controls in the data, without and with activations, 1/s."""
        self._evaluate()
        model, data, rows, servos = self._model, self._data, self._rows, self._servos
        K, D = self._stiffness(np.ones(len(servos), dtype=np.bool_))
        nv, na = model.nv, model.na
        inverse = np.linalg.inv(mass_matrix(model, data))
        system = np.zeros((2 * nv + na, 2 * nv + na))
        system[:nv, nv : 2 * nv] = np.eye(nv)
        system[nv : 2 * nv, : 2 * nv] = -inverse @ np.hstack((K, D))
        owners = np.repeat(np.arange(model.nactuator), model.actuator_actnum)
        transmission = (owners[:, None] == servos) @ rows  # transmission of the servo of each activation, (na, nv)
        for part, values, step in ((0, data.actuator_length, _LENGTH), (nv, data.actuator_velocity, _RATE)):
            slopes = _differences(self._unlimited, data, values, servos, step)[1]
            system[2 * nv :, part : part + nv] = slopes[:, None] * transmission
        for i in range(na):
            forces, slopes = _differences(self._unlimited, data, data.act, [i], _ACTIVATION)
            system[nv : 2 * nv, 2 * nv + i] = inverse @ rows.T @ forces[servos]
            system[2 * nv :, 2 * nv + i] = slopes
        of_states = [np.abs(np.linalg.eigvals(block)).max(initial=0.0) for block in (system[: 2 * nv, : 2 * nv], system)]
        return float(of_states[0]), float(of_states[1])


def _slopes(model: Any, data: Any, servos: IntArray) -> tuple[FloatArray, FloatArray]:
    """Stiffness and damping of servos along their transmissions: -dp/dl and -dp/dl', (n,) each."""
    along = ((data.actuator_length, _LENGTH), (data.actuator_velocity, _RATE))
    K, D = (-_differences(model, data, values, servos, step)[0][servos] for values, step in along)
    return K, D


def _differences(model: Any, data: Any, values: FloatArray, some: Any, step: float) -> tuple[FloatArray, FloatArray]:
    """Slopes of the forces of all actuators and of the rates of all activations by some values in the data.

    By central differences without limits, which are exact where the law is affine; servos do not act on each other.
    """
    kept, outcomes = values[some].copy(), []
    for sign in (1.0, -1.0):
        values[some] = kept + sign * step
        mujoco.mj_fwdActuation(model, data)
        outcomes.append((data.actuator_force.copy(), data.act_dot.copy()))
    values[some] = kept
    forces, rates = ((plus - minus) / (2.0 * step) for plus, minus in zip(*outcomes, strict=True))
    return forces, rates
