"""The figure of ``docs/friction.md``: who gains energy at an impact with friction. ``make figures``.

The end of a rod of 1 kg and 1 m, at 55 degrees to the floor, comes down at 1 m/s and slides at 0.7 m/s; over mu and e the
kinetic energy after, in parts of what the contact sees of it before. Newton's law of restitution is solved here and in the
tests only: ffsm-mj refuses it with friction.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.colors import LinearSegmentedColormap, TwoSlopeNorm
from matplotlib.figure import Figure

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.impact.friction.coulomb import CoulombProblem, coulomb
from ffsm_mj.contact_models.impact.friction.routh import stronge
from ffsm_mj.report.plots.style import BLACK, BLUE, VERMILION, WIDTH_IN, publication, write
from ffsm_mj.tolerances import SOLVED

FOLDER = Path(__file__).parent / "figures" / "friction"
ANGLE_RAD = np.radians(55.0)
VELOCITY_M_S = np.array([-1.0, 0.7])
GREATEST_MU, POINTS = 1.0, 41


def rod() -> tuple[FloatArray, FloatArray]:
    """Rows (n, t, none) of the rod's end, (3, 2), and the mass-weighted velocity of least energy, (2,)."""
    c, s = np.cos(ANGLE_RAD), np.sin(ANGLE_RAD)
    G = np.array([[1 + 3 * c * c, -3 * s * c], [-3 * s * c, 1 + 3 * s * s]])
    root = np.linalg.cholesky(G)
    return np.vstack((root, np.zeros(2))), np.linalg.solve(root, VELOCITY_M_S)


def by_stronge(A: FloatArray, w: FloatArray, mu: float, e: float) -> FloatArray:
    """Velocity after by the law of ffsm-mj."""
    return stronge(A, w, mu, e).w


def by_newton(A: FloatArray, w: FloatArray, mu: float, e: float) -> FloatArray:
    """Velocity after with u_n+ = -e u_n- and Coulomb friction: the plastic problem, with u_n + e u_n- in place of u_n."""
    u = A @ w
    speed = float(np.abs(u).max())
    u[0] *= 1.0 + e
    impulses, residual = coulomb(CoulombProblem(A @ A.T, u, np.array([mu]), np.zeros(1), speed))
    if residual > SOLVED:
        raise ValueError(f"Newton's law has no solution at mu = {mu:g}, e = {e:g}")
    after: FloatArray = w + A.T @ impulses[0]
    return after


LAWS = {"Stronge: energetic restitution": by_stronge, "Newton: ratio of velocities": by_newton}


def energies(points: int = POINTS) -> tuple[FloatArray, FloatArray, dict[str, FloatArray]]:
    """Values of mu and of e, and by law the energy after over that before, (e, mu)."""
    A, w = rod()
    mu, e = np.linspace(0.0, GREATEST_MU, points), np.linspace(0.0, 1.0, points)
    before = float(w @ w)
    found = {
        name: np.array([[float(np.sum(law(A, w, m, r) ** 2)) / before for m in mu] for r in e]) for name, law in LAWS.items()
    }
    return mu, e, found


def main() -> None:
    """Solve, draw, write, and print the extremes."""
    mu, e, found = energies()
    shades = LinearSegmentedColormap.from_list("energy", [BLUE, "white", VERMILION])
    levels, middle = np.linspace(0.0, 1.5, 31), TwoSlopeNorm(1.0, 0.0, 1.5)
    with publication():
        figure = Figure(figsize=(WIDTH_IN, 0.45 * WIDTH_IN))
        axes = figure.subplots(1, 2, sharey=True)
        for ax, (name, values) in zip(axes, found.items(), strict=True):
            filled = ax.contourf(mu, e, values, levels, cmap=shades, norm=middle)
            if values.max() > 1.0 + 1e-9:
                line = ax.contour(mu, e, values, [1.0], colors=BLACK, linewidths=1.0)
                ax.clabel(line, fmt=lambda _: "nothing lost", fontsize=8.0)
            ax.set(
                title=name, xticks=np.linspace(0.0, 0.8, 5), xlabel="coefficient of friction $\\mu$", xlim=(0, GREATEST_MU)
            )
        axes[0].set(ylabel="coefficient of restitution e")
        figure.colorbar(filled, ax=list(axes), label="energy after / energy before", ticks=[0.0, 0.5, 1.0, 1.25, 1.5])
    FOLDER.mkdir(parents=True, exist_ok=True)
    write(figure, FOLDER, "energy", ("svg",))
    for name, values in found.items():
        at = np.unravel_index(int(values.argmax()), values.shape)
        gains = float(np.mean(values > 1.0 + 1e-9))
        print(f"{name}: gains at {gains:.0%} of the points, most {values.max():.4f} at mu = {mu[at[1]]:g}, e = {e[at[0]]:g}")


if __name__ == "__main__":
    main()
