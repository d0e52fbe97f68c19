"""What OSDRE needs of the state for two outputs: a few array products, then floats; one call where numba compiles it."""

from __future__ import annotations

import math
from typing import NamedTuple

from controllers.riccati_planar import Blocks, Matrix, Pair, principal_axes
from ffsm_mj.compiled import compiled
from ffsm_mj.model import FloatArray


class Tip(NamedTuple):
    """What the law needs of the state of two outputs, along the principal axes of S = alpha M_c^-1 R^-1 (alpha M_c^-1)^T.

    Attributes:
        error: Output minus target.
        y_dot: Rate of the output.
        A21: Lower left block of A.
        A22: Lower right block of A.
        S: Eigenvalues of S.
        axes: (cosine, sine) of the angle from the output's axes to the principal ones.
        gain: R^-1 (alpha M_c^-1)^T, by the output's own axes, (n, 2).
        smallest_gain: Smallest singular value of alpha M_c^-1.
    """

    error: Pair
    y_dot: Pair
    A21: Matrix
    A22: Matrix
    S: Pair
    axes: Pair
    gain: FloatArray
    smallest_gain: float


@compiled
def tip_state(
    W: FloatArray,
    jacobians: FloatArray,
    force: FloatArray,
    qvel: FloatArray,
    point: FloatArray,
    driven: FloatArray,
    output: tuple[int, int],
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
        driven: Rows of the identity that pick the n driven joints, over R^-1 times the same, (2 n, nv).
        output: World axes of the outputs.
        target: Target along them.
        whole_stack: A = d z^+ instead of [0, d ydot^+].
    """
    n = driven.shape[0] // 2
    gains = driven.dot(W.T)
    B_T, gain = gains[:n], gains[n:]
    rates, bias = jacobians.dot(qvel), W.dot(force)
    S, square = gain.T.dot(B_T), B_T.T.dot(B_T)
    values, axes = principal_axes(float(S[0, 0]), float(S[0, 1]), float(S[1, 1]))
    cosine, sine = axes
    i, j = output
    y0, y1 = float(point[i]), float(point[j])
    x, y = y0 - target[0], y1 - target[1]
    error = (cosine * x + sine * y, cosine * y - sine * x)
    y0, y1 = cosine * y0 + sine * y1, cosine * y1 - sine * y0
    x, y = float(rates[i]), float(rates[j])
    v0, v1 = cosine * x + sine * y, cosine * y - sine * x
    x, y = float(rates[3 + i]) - float(bias[0]), float(rates[3 + j]) - float(bias[1])
    d0, d1 = cosine * x + sine * y, cosine * y - sine * x
    # d z^+ or [0, d ydot^+], with v^+ = v^T / |v|^2, zero at zero.
    length = v0 * v0 + v1 * v1
    if whole_stack:
        length += y0 * y0 + y1 * y1
    scale = 1.0 / length if length > 0.0 else 0.0
    d0, d1 = d0 * scale, d1 * scale
    A22 = (d0 * v0, d0 * v1, d1 * v0, d1 * v1)
    A21 = (d0 * y0, d0 * y1, d1 * y0, d1 * y1) if whole_stack else (0.0, 0.0, 0.0, 0.0)
    smallest = principal_axes(float(square[0, 0]), float(square[0, 1]), float(square[1, 1]))[0][1]
    return Tip(error, (v0, v1), A21, A22, values, axes, gain, math.sqrt(max(smallest, 0.0)))


def feedback(blocks: Blocks, error: Pair, y_dot: Pair, axes: Pair) -> Pair:
    """-[P2^T, P3] [y - y_d; ydot], back on the output's own axes."""
    P2, P3 = blocks
    (e0, e1), (v0, v1), (cosine, sine) = error, y_dot, axes
    w0 = -(P2[0] * e0 + P2[2] * e1 + P3[0] * v0 + P3[1] * v1)
    w1 = -(P2[1] * e0 + P2[3] * e1 + P3[2] * v0 + P3[3] * v1)
    return cosine * w0 - sine * w1, sine * w0 + cosine * w1
