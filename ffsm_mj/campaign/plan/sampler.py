"""Samples in the unit cube: grid, random, Latin hypercube, Sobol sequence, and Saltelli's scheme."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from zlib import crc32

import numpy as np

from ffsm_mj.arrays import FloatArray

KINDS = ("grid", "random", "lhs", "sobol", "saltelli")
EXTENDABLE = ("random", "sobol")
"""Kinds of samples whose first rows do not depend on the number of samples."""


def samples(kind: str, n: int, seed: int, names: Sequence[str], levels: Sequence[int] = ()) -> FloatArray:
    """Points in the unit cube.

    Args:
        kind: ``grid``, ``random``, ``lhs``, ``sobol`` or ``saltelli``.
        n: Number of samples; ``saltelli`` gives n (d + 2) rows, ``grid`` ignores it.
        seed: Seed of the random numbers.
        names: Names of the d coordinates; for ``random`` each has its own stream, so that a new one changes no other.
        levels: Number of levels of each coordinate, for ``grid``.

    Returns:
        Numbers from 0 to 1, (rows, d). For ``saltelli``: A, B, then A with each column of B in turn, n rows each.
    """
    d = len(names)
    if kind == "grid":
        centres = [(np.arange(count) + 0.5) / count for count in levels]
        return np.array(list(product(*centres)))
    if kind == "random":
        return np.array([[_uniform(seed, name, i) for name in names] for i in range(n)])
    from scipy.stats import qmc  # slow to import

    if kind == "lhs":
        return np.asarray(qmc.LatinHypercube(d, rng=np.random.default_rng(seed)).random(n))
    if kind == "sobol":
        return _sobol(d, n, seed)
    return _saltelli(_sobol(2 * d, n, seed))


def _uniform(seed: int, name: str, i: int) -> float:
    """Number i of the stream of a name, in (0, 1): one word of a seed sequence, equal in all versions of NumPy."""
    word = np.random.SeedSequence(seed, spawn_key=(crc32(name.encode()), i)).generate_state(1, np.uint64)[0]
    return ((int(word) >> 12) + 0.5) * 2.0**-52


def _sobol(d: int, n: int, seed: int) -> FloatArray:
    from scipy.stats import qmc

    return np.asarray(qmc.Sobol(d, scramble=True, rng=np.random.default_rng(seed)).random(n))


def _saltelli(pairs: FloatArray) -> FloatArray:
    """Rows A, B, and A with one column of B, from points (n, 2 d)."""
    a, b = np.hsplit(pairs, 2)
    blocks = [a, b]
    for column in range(a.shape[1]):
        mixed = a.copy()
        mixed[:, column] = b[:, column]
        blocks.append(mixed)
    return np.vstack(blocks)
