"""Values of a compiled scene that MuJoCo accepts but a simulation cannot use, by element."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

MOST_MASS = 1e20
"""Greatest mass in kg and moment of inertia in kg m^2: energies, their squares and their sums stay finite."""
MOST_LENGTH = 1e10
"""Greatest length and coordinate in m; MuJoCo's own limit for a state."""
LEAST_SHARE = 1e-10
"""Least eigenvalue of the mass matrix scaled to a diagonal of ones: below it, accelerations lose six digits to rounding."""


def number_faults(model: Any) -> Iterator[tuple[str, str, str]]:
    """Yield (kind, full name, fault and allowed values)."""
    for b in range(1, model.nbody):
        worst = max(float(model.body_mass[b]), float(np.max(model.body_inertia[b])))
        if not worst <= MOST_MASS:
            yield "body", model.body(b).name, f"has a mass or inertia of {worst:g}; at most {MOST_MASS:g} kg or kg m^2"
    for kind, count, arrays in (
        ("body", model.nbody, (model.body_pos, model.body_ipos)),
        ("joint", model.njnt, (model.jnt_pos,)),
        ("geom", model.ngeom, (model.geom_pos, model.geom_size)),
        ("site", model.nsite, (model.site_pos,)),
    ):
        if all(np.abs(array).max(initial=0.0) <= MOST_LENGTH for array in arrays):
            continue
        for i in range(count):
            worst = max(float(np.max(np.abs(array[i]))) for array in arrays)
            if not worst <= MOST_LENGTH:
                yield kind, getattr(model, kind)(i).name, f"has a length of {worst:g} m; at most {MOST_LENGTH:g} m"
    yield from _colour_faults(model)
    for i in range(model.npair):
        if model.pair_geom1[i] == model.pair_geom2[i]:
            yield "geom", model.geom(model.pair_geom1[i]).name, "is in a <contact><pair> with itself; remove it"


def _colour_faults(model: Any) -> Iterator[tuple[str, str, str]]:
    for kind, colours in (("geom", model.geom_rgba), ("material", model.mat_rgba)):
        if np.all((colours >= 0.0) & (colours <= 1.0)):
            continue
        for i, rgba in enumerate(colours):
            if not (np.all(rgba >= 0.0) and np.all(rgba <= 1.0)):
                name = getattr(model, kind if kind == "geom" else "mat")(i).name
                yield kind, name, f"has rgba {' '.join(f'{x:g}' for x in rgba)}; each is from 0 to 1"


def weakest_dof(model: Any, data: Any) -> tuple[int, float]:
    """The degree of freedom with the least effective inertia, and the least eigenvalue of the scaled mass matrix.

    Args:
        model: The scene.
        data: MuJoCo data after ``mj_forward``.

    Returns:
        Index of the degree of freedom, and the eigenvalue: 1 if all are independent, NaN if the matrix is not finite.
    """
    mass: npt.NDArray[np.float64] = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    diagonal = np.diag(mass)
    bad = ~(np.isfinite(mass).all(axis=0) & (diagonal > 0.0))
    if bad.any():
        return int(np.argmax(bad)), float("nan")
    # Scaling removes units and sizes: what remains small is a combination of coordinates with almost no inertia.
    scale = 1.0 / np.sqrt(diagonal)
    values, vectors = np.linalg.eigh(mass * np.outer(scale, scale))
    return int(np.argmax(np.abs(vectors[:, 0]))), float(values[0])
