"""What OSDRE needs of the state of two outputs, in plain floats.

The package ``ffsm-mj-fast`` compiles this very file; ``fast/ffsm_mj_fast/osdre_planar.pxd`` has the types.
"""

from __future__ import annotations

from ffsm_controllers.osdre.riccati_planar import Blocks, Pair, PlanarRiccati


def turned_pair(x: Pair, axes: Pair) -> Pair:
    """A vector by axes at an angle, given as (cosine, sine)."""
    return axes[0] * x[0] + axes[1] * x[1], axes[0] * x[1] - axes[1] * x[0]


def lower_block(drift: Pair, y: Pair, y_dot: Pair, whole_stack: bool) -> Blocks:
    """Lower block (A21, A22) of the factorised dynamics, paper (30).

    With v^+ = v^T / |v|^2, zero at zero, it is d z^+ for the whole stack z = [y; ydot] and [0, d ydot^+] otherwise.

    Args:
        drift: Acceleration of the output without torques, d.
        y: Output.
        y_dot: Its rate.
        whole_stack: Which of the two parameterizations.
    """
    y0, y1 = y[0] if whole_stack else 0.0, y[1] if whole_stack else 0.0
    v0, v1 = y_dot
    square = v0 * v0 + v1 * v1 + y0 * y0 + y1 * y1
    scale = 1.0 / square if square > 0.0 else 0.0
    d0, d1 = drift[0] * scale, drift[1] * scale
    return (d0 * y0, d0 * y1, d1 * y0, d1 * y1), (d0 * v0, d0 * v1, d1 * v0, d1 * v1)


def feedback(blocks: Blocks, error: Pair, y_dot: Pair) -> Pair:
    """-[P2^T, P3] [y - y_d; ydot]."""
    P2, P3 = blocks
    e0, e1 = error
    v0, v1 = y_dot
    return (
        -(P2[0] * e0 + P2[2] * e1 + P3[0] * v0 + P3[1] * v1),
        -(P2[1] * e0 + P2[3] * e1 + P3[2] * v0 + P3[3] * v1),
    )


def answer(
    riccati: PlanarRiccati, S: Pair, axes: Pair, drift: Pair, y: Pair, error: Pair, y_dot: Pair, whole_stack: bool
) -> tuple[Pair, Pair, float, bool]:
    """The law (32) without the gains R^-1 B^T of the torques.

    Args:
        riccati: Solver of the equation.
        S: Its eigenvalues.
        axes: Principal axes of S, as (cosine, sine) in those of the outputs.
        drift: Acceleration of the output without torques.
        y: Output.
        error: Its distance from the target.
        y_dot: Its rate.
        whole_stack: Which of the two parameterizations.

    Returns:
        What the gains take, in the axes of the outputs; the error along the principal axes; residual of the equation, and
        whether the robust method was needed.

    Raises:
        RiccatiError: The equation has no stabilising solution here.
    """
    error, y_dot = turned_pair(error, axes), turned_pair(y_dot, axes)
    A21, A22 = lower_block(turned_pair(drift, axes), turned_pair(y, axes), y_dot, whole_stack)
    blocks, residual, fallback = riccati.solve(A21, A22, S, axes)
    return turned_pair(feedback(blocks, error, y_dot), (axes[0], -axes[1])), error, residual, fallback
