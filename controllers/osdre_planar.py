"""What OSDRE needs of the state for two outputs: a few array products, then floats; one call where numba compiles it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from controllers.riccati_planar import Matrix
from ffsm_mj.compiled import compiled
from ffsm_mj.model import FloatArray

Pair = tuple[float, float]


class Tip(NamedTuple):
    """What the law needs of the state, in floats.

    Attributes:
        error: Distance of the output from its target, along its axes.
        y_dot: Its velocity.
        A21: Lower left block of A.
        A22: Lower right block of A.
        S: alpha M_c^-1 R^-1 (alpha M_c^-1)^T.
        smallest_gain: Smallest singular value of alpha M_c^-1.
    """

    error: Pair
    y_dot: Pair
    A21: Matrix
    A22: Matrix
    S: Matrix
    smallest_gain: float


@compiled
def tip_state(
    W: FloatArray,
    jacobians: FloatArray,
    force: FloatArray,
    qvel: FloatArray,
    point: FloatArray,
    driven: FloatArray,
    driven_R: FloatArray,
    axes: tuple[int, int],
    target: Pair,
    whole_stack: bool,
) -> Tip:
    """Errors, factorised dynamics and gains of two outputs.

    Args:
        W: J M^-1, (2, nv).
        jacobians: Jacobian of the tip over its rate, (6, nv).
        force: Bias minus passive forces, (nv,).
        qvel: Rates, (nv,).
        point: The tip, (3,).
        driven: Columns of the identity that pick the driven joints, (nv, n).
        driven_R: The same times R^-1, (nv, n).
        axes: World axes of the outputs.
        target: Target along them.
        whole_stack: A = d z^+ instead of [0, d ydot^+].
    """
    B, BR = np.dot(W, driven), np.dot(W, driven_R)
    S, gains = np.dot(BR, B.T), np.dot(B, B.T)
    rates, bias = np.dot(jacobians, qvel), np.dot(W, force)
    i, j = axes
    y0, y1, v0, v1 = float(point[i]), float(point[j]), float(rates[i]), float(rates[j])
    d0, d1 = float(rates[3 + i]) - float(bias[0]), float(rates[3 + j]) - float(bias[1])
    # d z^+ or [0, d ydot^+], with v^+ = v^T / |v|^2, zero at zero.
    square = v0 * v0 + v1 * v1
    if whole_stack:
        square += y0 * y0 + y1 * y1
    scale = 1.0 / square if square > 0.0 else 0.0
    b0, b1 = d0 * scale, d1 * scale
    A22 = (b0 * v0, b0 * v1, b1 * v0, b1 * v1)
    A21 = (b0 * y0, b0 * y1, b1 * y0, b1 * y1) if whole_stack else (0.0, 0.0, 0.0, 0.0)
    s1 = float(S[0, 1])
    # det / largest keeps the digits of the smallest singular value where it is small.
    a, b, d = float(gains[0, 0]), float(gains[0, 1]), float(gains[1, 1])
    half, det = 0.5 * (a + d), max(a * d - b * b, 0.0)
    largest = half + math.sqrt(max(half * half - det, 0.0))
    smallest = math.sqrt(det / largest) if largest > 0.0 else 0.0
    error = (y0 - target[0], y1 - target[1])
    return Tip(error, (v0, v1), A21, A22, (float(S[0, 0]), s1, s1, float(S[1, 1])), smallest)
