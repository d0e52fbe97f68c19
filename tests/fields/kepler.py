"""Kepler orbits in extended precision, by the classical elements: an oracle that shares nothing with the engine."""

from __future__ import annotations

import mpmath as mp
import numpy as np

MU = mp.mpf("3.986004418e14")
DIGITS = 40


def propagated(position, velocity, time_s):
    """Position and velocity after a time, by elements and Kepler's equation in ``DIGITS`` digits."""
    with mp.workdps(DIGITS):
        R, V = mp.matrix(position), mp.matrix(velocity)
        r, v2, rv = mp.norm(R), _dot(V, V), _dot(R, V)
        a = 1 / (2 / r - v2 / MU)
        cosine, sine = 1 - r / a, rv / mp.sqrt(MU * a)  # e cos E, e sin E
        n = mp.sqrt(MU / a**3)
        e, E0 = mp.sqrt(cosine**2 + sine**2), mp.atan2(sine, cosine)
        M = E0 - sine + n * mp.mpf(time_s)
        E = M
        for _ in range(200):
            step = (E - e * mp.sin(E) - M) / (1 - e * mp.cos(E))
            E -= step
            if abs(step) < mp.mpf(10) ** (3 - DIGITS):
                break
        change = E - E0
        f = 1 - a / r * (1 - mp.cos(change))
        g = mp.mpf(time_s) - (change - mp.sin(change)) / n
        there = f * R + g * V
        far = mp.norm(there)
        ft, gt = -mp.sqrt(MU * a) / (far * r) * mp.sin(change), 1 - a / far * (1 - mp.cos(change))
        return there, ft * R + gt * V


def relative(origin, offset, rate, time_s):
    """Position of a second mass relative to the origin after a time, world axes, m, (3,); both on Kepler orbits.

    Args:
        origin: Position and velocity of the origin at t = 0.
        offset: Position of the mass relative to it.
        rate: Its velocity relative to it.
        time_s: The time.
    """
    with mp.workdps(DIGITS):
        R, V = map(_exact, origin)
        there, _ = propagated(R + _exact(offset), V + _exact(rate), time_s)
        here, _ = propagated(R, V, time_s)
        return np.array([float(x) for x in there - here])


def _exact(values):
    return mp.matrix([mp.mpf(float(x)) for x in values])


def _dot(a, b):
    return sum(x * y for x, y in zip(a, b, strict=True))
