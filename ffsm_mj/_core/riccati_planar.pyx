# cython: boundscheck=False, wraparound=False
"""The Riccati equation of two outputs, in plain floats: ten times faster than any linear-algebra call on 4 x 4 matrices.

With A = [[0, I], [A21, A22]], B = [0; B2], S = B2 R^-1 B2^T and K = [[P1, P2], [P2^T, P3]] only P2 and P3 are needed. All
blocks are taken along the principal axes of S, where nothing cancels however near the pose is to a singular one. A
Newton-Kleinman step solves a Lyapunov equation for them with F = A21 - S P2^T and G = A22 - S P3: its blocks give
X2 = (t J - W1 / 2) F^-1 with one free scalar t (J the rotation by 90 degrees), a 2 x 2 Lyapunov equation for X3 in closed
form, affine in t, and t from the symmetry of X1. Matrices are flat tuples (a, b, c, d) by rows; S is its two eigenvalues.
"""

cimport cython

import math

import numpy as np

from ffsm_mj.state import entries, fitting

ACCEPTED_RESIDUAL = 1e-13
"""Relative residual at which a solution counts as exact to rounding."""
cdef double _ACCEPTED_RESIDUAL = ACCEPTED_RESIDUAL
# Newton's steps: from the extrapolation one or two do (docs/performance.md). Where twelve do not, the start was bad, and the
# robust method gives another.
cdef int _ITERATIONS = 12
# Newton's error after a step is of the order of that step squared: after small ones what is left is rounding, or nearly.
cdef double _NEARLY = 1e-6
cdef int _CORRECTIONS = 3
cdef double _ROUNDING = 2e-15


cdef class PlanarRiccati:
    """The equation of two outputs from tick to tick, along the principal axes of S."""

    def __init__(self, Q, robust):
        """Start cold.

        Args:
            Q: State weight.
            robust: What to do where there is no warm start or it leads nowhere.
        """
        self._weight, self._robust = Q, robust
        self._isotropic = True
        for a, b, c, d in Q:
            if a != d or b != 0.0 or c != 0.0:
                self._isotropic = False
        # The last three solutions, the oldest first, each along the axes of its time.
        zero = (0.0, 0.0, 0.0, 0.0)
        self._first = self._second = self._third = (zero, zero)
        self._warm = False

    def get_state(self):
        """The last three solutions, (3, 2, 4), and whether there is one."""
        return {"solutions": np.array((self._first, self._second, self._third)), "warm": self._warm}

    def set_state(self, state):
        """Go on from the solutions of a state.

        Raises:
            StateError: It does not fit.
        """
        values = entries(state, ("solutions", "warm"), "PlanarRiccati")
        solutions = fitting(values["solutions"], (3, 2, 4), "PlanarRiccati.solutions").tolist()
        self._first, self._second, self._third = [tuple(map(tuple, blocks)) for blocks in solutions]
        self._warm = values["warm"]

    @cython.locals(Q=weight_t, blocks=blocks_t, rough=blocks_t, left=double, rough_left=double)
    cpdef (blocks_t, double, bint) solve(self, matrix_t A21, matrix_t A22, pair_t S, pair_t axes):
        """Stabilising solution.

        Args:
            A21: Lower left block of A along the principal axes of S.
            A22: Lower right block of A along them.
            S: Eigenvalues of S.
            axes: (cosine, sine) of the angle to the first axis.

        Returns:
            P2 and P3 along the axes, relative residual, and whether the robust method was needed: there was no warm start,
            or it failed.

        Raises:
            RiccatiError: No method finds a stabilising solution.
        """
        Q = self._weight
        if not self._isotropic:
            Q = (turned(Q[0], axes), turned(Q[1], axes), turned(Q[2], axes))
        # The extrapolation of the last three solutions errs by the third power of the tick: Newton's method converges from
        # there at once (docs/performance.md).
        if self._warm:
            blocks, left = _attempt(A21, A22, S, Q, extrapolated(self._first, self._second, self._third))
            if left <= _ACCEPTED_RESIDUAL:
                self._first, self._second, self._third = self._second, self._third, blocks
                return blocks, left, False
        rough, rough_left = self._robust(A21, A22, S, Q)
        blocks, left = _attempt(A21, A22, S, Q, rough)
        # The robust method may have met an equation at which a Newton step is not defined: its own result is better then.
        if not left <= rough_left:
            blocks, left = rough, rough_left
        self._first = self._second = self._third = blocks
        self._warm = True
        return blocks, left, True


cdef (blocks_t, double) _attempt(matrix_t A21, matrix_t A22, pair_t S, weight_t Q, blocks_t start):
    """Newton's method, or its start and an infinite residual where a step is not defined."""
    try:
        return newton(A21, A22, S, Q, start)
    except ZeroDivisionError:
        return start, math.inf


@cython.locals(cosine=double, sine=double)
cpdef (pair_t, pair_t) principal_axes(double s0, double s1, double s3):
    """Eigenvalues of [[s0, s1], [s1, s3]], the larger one first, and (cosine, sine) of the angle to its axis."""
    mean, difference = 0.5 * (s0 + s3), 0.5 * (s0 - s3)
    radius = math.sqrt(difference * difference + s1 * s1)
    # Both eigenvalues are equal: any axes are principal.
    if radius == 0.0:
        return (s0, s3), (1.0, 0.0)
    largest = mean + radius
    double_cosine, double_sine = difference / radius, s1 / radius
    # Of the half angle the larger of sine and cosine is taken from a root, which cancels for the other.
    if double_cosine >= 0.0:
        cosine = math.sqrt(0.5 * (1.0 + double_cosine))
        sine = 0.5 * double_sine / cosine
    else:
        sine = math.copysign(math.sqrt(0.5 * (1.0 - double_cosine)), double_sine)
        cosine = 0.5 * double_sine / sine
    return (largest, (s0 * s3 - s1 * s1) / largest), (cosine, sine)


cpdef matrix_t turned(matrix_t M, pair_t axes):
    """V^T M V for the rotation V to some axes: trace and antisymmetric part stay, the rest turns by twice the angle."""
    a, b, c, d = M
    cosine, sine = axes[0] * axes[0] - axes[1] * axes[1], 2.0 * axes[0] * axes[1]
    mean, odd = 0.5 * (a + d), 0.5 * (b - c)
    p, q = 0.5 * (a - d), 0.5 * (b + c)
    p, q = p * cosine + q * sine, q * cosine - p * sine
    return mean + p, q + odd, q - odd, mean - p


@cython.locals(
    P2=matrix_t, P3=matrix_t, X2=matrix_t, X3=matrix_t, rest=rest_t,
    F=matrix_t, G=matrix_t, D2=matrix_t, D3=matrix_t, near=bint, left=double, before=double, change=double,
)
cpdef (blocks_t, double) newton(matrix_t A21, matrix_t A22, pair_t S, weight_t Q, blocks_t start):
    """Iterate from a start until what is left is rounding.

    The result is verified to be the stabilising solution, which is unique: a start too far away can lead to another.

    Returns:
        The solution, and its residual relative to the largest term: infinite where the iteration leads nowhere.

    Raises:
        ZeroDivisionError: A step is not defined.
    """
    P2, P3 = start
    near = False
    for _ in range(_ITERATIONS):
        X2, X3 = _step(A21, A22, S, Q, P2, P3)
        a, b, c, d = X2
        p, q, _q, r = X3
        e, f, g, h = P2
        s, t, _t, u = P3
        change = abs(a - e) + abs(b - f) + abs(c - g) + abs(d - h) + abs(p - s) + abs(q - t) + abs(r - u)
        P2, P3 = X2, X3
        near = change <= _NEARLY * (abs(a) + abs(b) + abs(c) + abs(d) + abs(p) + abs(q) + abs(r))
        if near:
            break
    F, G = _closed(A21, A22, S, P2, P3)
    # Newton's method may converge to a solution that does not stabilise; only one does, so the test decides.
    if not (near and _stable(F, G)):
        return (P2, P3), math.inf
    rest, left = _defect(A21, A22, S, Q, P2, P3)
    for _ in range(_CORRECTIONS):
        if left <= _ROUNDING:
            break
        # The same step as a correction for what is left of the equation: small, and so is its rounding.
        D2, D3 = _blocks(F, G, rest)
        a, b, c, d = D2
        p, q, _q, r = D3
        X2, X3 = (P2[0] + a, P2[1] + b, P2[2] + c, P2[3] + d), (P3[0] + p, P3[1] + q, P3[2] + q, P3[3] + r)
        before = left
        rest, left = _defect(A21, A22, S, Q, X2, X3)
        if not left < before:
            return (P2, P3), before
        P2, P3 = X2, X3
    return (P2, P3), left


cpdef blocks_t extrapolated(blocks_t first, blocks_t second, blocks_t third):
    """The fourth of four values at equal intervals, if they lie on a parabola."""
    a0, a1, a2, a3 = first[0]
    p0, p1, _p, p3 = first[1]
    b0, b1, b2, b3 = second[0]
    q0, q1, _q, q3 = second[1]
    c0, c1, c2, c3 = third[0]
    r0, r1, _r, r3 = third[1]
    off = p1 + 3.0 * (r1 - q1)
    return (
        (a0 + 3.0 * (c0 - b0), a1 + 3.0 * (c1 - b1), a2 + 3.0 * (c2 - b2), a3 + 3.0 * (c3 - b3)),
        (p0 + 3.0 * (r0 - q0), off, off, p3 + 3.0 * (r3 - q3)),
    )


@cython.locals(q1=matrix_t, q2=matrix_t, q3=matrix_t)
cdef (matrix_t, matrix_t) _step(matrix_t A21, matrix_t A22, pair_t S, weight_t Q, matrix_t P2, matrix_t P3):
    """One Newton-Kleinman step."""
    s0, s3 = S
    a, b, c, d = P2
    p0, p1, _, p3 = P3
    # S P2^T, S P3; F, G.
    m0, m1, m2, m3 = s0 * a, s0 * c, s3 * b, s3 * d
    n0, n1, n2, n3 = s0 * p0, s0 * p1, s3 * p1, s3 * p3
    f0, f1, f2, f3 = A21[0] - m0, A21[1] - m1, A21[2] - m2, A21[3] - m3
    g0, g1, g2, g3 = A22[0] - n0, A22[1] - n1, A22[2] - n2, A22[3] - n3
    q1, q2, q3 = Q
    # W1 = Q1 + P2 S P2^T, antisymmetric part of W2 = Q12 + P2 S P3, W3 = Q3 + P3 S P3.
    w0, w1, w3 = q1[0] + a * m0 + b * m2, q1[1] + a * m1 + b * m3, q1[3] + c * m1 + d * m3
    skew = q2[1] + a * n1 + b * n3 - (q2[2] + c * n0 + d * n2)
    z0, z1, z3 = q3[0] + p0 * n0 + p1 * n2, q3[1] + p0 * n1 + p1 * n3, q3[3] + p1 * n1 + p3 * n3
    return _blocks((f0, f1, f2, f3), (g0, g1, g2, g3), ((w0, w1, w3), skew, (z0, z1, z3)))


cdef (matrix_t, matrix_t) _closed(matrix_t A21, matrix_t A22, pair_t S, matrix_t P2, matrix_t P3):
    """F and G of the closed loop."""
    s0, s3 = S
    return (
        (A21[0] - s0 * P2[0], A21[1] - s0 * P2[2], A21[2] - s3 * P2[1], A21[3] - s3 * P2[3]),
        (A22[0] - s0 * P3[0], A22[1] - s0 * P3[1], A22[2] - s3 * P3[2], A22[3] - s3 * P3[3]),
    )


@cython.locals(r=double, t=double, x0=double, x1=double, x3=double, y0=double, y1=double, y3=double)
cdef (matrix_t, matrix_t) _blocks(matrix_t F, matrix_t G, rest_t W):
    """X2 and X3 of the Lyapunov equation of the closed loop with right side -W."""
    f0, f1, f2, f3 = F
    g0, g1, g2, g3 = G
    w0, w1, w3 = W[0]
    z0, z1, z3 = W[2]
    # U = -W1 F^-1 / 2, V = J F^-1.
    det = f0 * f3 - f1 * f2
    r = 1.0 / det
    h = -0.5 * r
    u0, u1 = h * (w0 * f3 - w1 * f2), h * (w1 * f0 - w0 * f1)
    u2, u3 = h * (w1 * f3 - w3 * f2), h * (w3 * f0 - w1 * f1)
    v0, v1, v2, v3 = -f2 * r, f0 * r, -f3 * r, f1 * r
    # X3 = Xa + t Xb of G^T X + X G = -(W3 + X2 + X2^T).
    x0, x1, x3 = _lyapunov(g0, g1, g2, g3, z0 + 2.0 * u0, z1 + u1 + u2, z3 + 2.0 * u3)
    y0, y1, y3 = _lyapunov(g0, g1, g2, g3, 2.0 * v0, v1 + v2, 2.0 * v3)
    # Antisymmetric part of W2 + F^T X3 + X2 G vanishes.
    fixed = W[1] + f0 * x1 + f2 * x3 - f1 * x0 - f3 * x1 + u0 * g1 + u1 * g3 - u2 * g0 - u3 * g2
    slope = f0 * y1 + f2 * y3 - f1 * y0 - f3 * y1 + v0 * g1 + v1 * g3 - v2 * g0 - v3 * g2
    t = -fixed / slope
    off = x1 + t * y1
    return (u0 + t * v0, u1 + t * v1, u2 + t * v2, u3 + t * v3), (x0 + t * y0, off, off, x3 + t * y3)


cdef triple_t _lyapunov(double g0, double g1, double g2, double g3, double n0, double n1, double n3):
    """X of G^T X + X G = -N for symmetric N: X = -(N + adj(G)^T N adj(G) / det G) / (2 tr G)."""
    r = 1.0 / (g0 * g3 - g1 * g2)
    h = -0.5 / (g0 + g3)
    # N adj(G) with adj(G) = [[g3, -g1], [-g2, g0]].
    k0, k1, k2, k3 = n0 * g3 - n1 * g2, n1 * g0 - n0 * g1, n1 * g3 - n3 * g2, n3 * g0 - n1 * g1
    return (
        h * (n0 + r * (g3 * k0 - g2 * k2)),
        h * (n1 + r * (g3 * k1 - g2 * k3)),
        h * (n3 + r * (g0 * k3 - g1 * k1)),
    )


cdef bint _stable(matrix_t F, matrix_t G):
    """Routh-Hurwitz test of the closed loop det(s^2 I - s G - F); false for NaN too."""
    f0, f1, f2, f3 = F
    g0, g1, g2, g3 = G
    a = -(g0 + g3)
    b = g0 * g3 - g1 * g2 - f0 - f3
    c = g0 * f3 + g3 * f0 - g1 * f2 - g2 * f1
    d = f0 * f3 - f1 * f2
    return a > 0.0 and b > 0.0 and c > 0.0 and d > 0.0 and a * b * c - c * c - a * a * d > 0.0


@cython.locals(q1=matrix_t, q2=matrix_t, q3=matrix_t, worst=double, largest=double)
cdef (rest_t, double) _defect(matrix_t A21, matrix_t A22, pair_t S, weight_t Q, matrix_t P2, matrix_t P3):
    """What is left of the equation, and the greatest entry of that over the greatest of its terms."""
    s0, s3 = S
    a, b, c, d = P2
    p0, p1, _, p3 = P3
    q1, q2, q3 = Q
    m0, m1, m2, m3 = s0 * a, s0 * c, s3 * b, s3 * d
    n0, n1, n2, n3 = s0 * p0, s0 * p1, s3 * p1, s3 * p3
    e0, e1, e2, e3 = A21
    h0, h1, h2, h3 = A22
    k0, k1, k3 = a * m0 + b * m2, a * m1 + b * m3, c * m1 + d * m3
    l0, l1, l3 = p0 * n0 + p1 * n2, p0 * n1 + p1 * n3, p1 * n1 + p3 * n3
    t0, t1, t3 = a * e0 + b * e2, a * e1 + b * e3 + c * e0 + d * e2, c * e1 + d * e3
    o0, o1, o3 = a + p0 * h0 + p1 * h2, b + c + p0 * h1 + p1 * h3 + h0 * p1 + h2 * p3, d + p1 * h1 + p3 * h3
    # P1 is minus the rest of the coupling block; what is left of the equation there is its antisymmetric part.
    j1 = q2[1] + e0 * p1 + e2 * p3 + a * h1 + b * h3 - a * n1 - b * n3
    j2 = q2[2] + e1 * p0 + e3 * p1 + c * h0 + d * h2 - c * n0 - d * n2
    w0, w1, w3 = 2.0 * t0 + q1[0] - k0, t1 + q1[1] - k1, 2.0 * t3 + q1[3] - k3
    z0, z1, z3 = 2.0 * o0 + q3[0] - l0, o1 + q3[1] - l1, 2.0 * o3 + q3[3] - l3
    skew = j1 - j2
    worst = max(abs(w0), abs(w1), abs(w3), abs(skew), abs(z0), abs(z1), abs(z3))
    largest = max(k0, k3, l0, l3, q1[0], q1[3], q3[0], q3[3], abs(t0), abs(t1), abs(t3), abs(o0), abs(o1), abs(o3), abs(j1))
    return ((w0, w1, w3), skew, (z0, z1, z3)), worst / largest
