"""Sliding in two directions: errors against references, and their order in the step.

``uv run python benchmarks/slip.py`` runs three cases of ``tests/contact_models/persistent/friction`` at several steps and
prints the table of ``docs/friction.md``: a sphere that slides across its spin until it rolls (closed form), a foot on three
slides that breaks away along a curve (Radau IIA to 1e-12), and a block that slides and spins on four corners (a model of
three coordinates by DOP853).
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

import ffsm_mj

sys.path.insert(0, str(Path(__file__).parents[1]))

from ffsm_mj.contact_models import registry
from tests.contact_models.persistent.friction.scenes import Loads, pulled
from tests.contact_models.persistent.friction.test_slip_in_space import PULL, curving, of_three_coordinates, spinning


def reduced_block() -> tuple[float, ...]:
    """Place and spin of the block by the model of three coordinates."""
    start = (0, 0, 0, 0.6, 0.2, 4.0)
    found = solve_ivp(of_three_coordinates, (0, 0.4), start, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    return float(found[0]), float(found[1]), float(found[5])


STEPS_S = (4e-3, 2e-3, 1e-3)
Case = tuple[str, Callable[[Path, float], Path], tuple[str, ...], tuple[float, ...]]
CASES: tuple[Case, ...] = (
    (
        "sphere, at 2.4 s: v_x, v_y, m/s",
        curving,
        ("v_robot_free_vx_m_s", "v_robot_free_vy_m_s"),
        (0.7 - 2.0 / 7.0 * 1.3, -0.4 - 2.0 / 7.0 * 0.5),
    ),
    (
        "foot, at 0.6 s: v_x, v_y, m/s",
        partial(pulled, force_N=PULL),
        ("v_robot_x_m_s", "v_robot_y_m_s"),
        (0.042675671986, 0.011535190635),
    ),
    (
        "block, at 0.4 s: x, y, m, spin, rad/s",
        lambda folder, step: spinning(folder, step, 0.4),
        ("q_robot_free_x_m", "q_robot_free_y_m", "v_robot_free_wz_rad_s"),
        reduced_block(),
    ),
)


def ended(made: Callable[[Path, float], Path], step_s: float, columns: tuple[str, ...]) -> Any:
    """Last values of columns of the state."""
    with TemporaryDirectory() as folder:
        run = ffsm_mj.run(made(Path(folder), step_s))
    return np.array([run[f"state.{column}"][-1] for column in columns])


def main() -> None:
    """Print one row per case."""
    registry.register(Loads)
    steps = " | ".join(f"error at {1e3 * step:g} ms" for step in STEPS_S)
    print(f"| case | reference | here, {1e3 * STEPS_S[-1]:g} ms | {steps} | order |")
    print("|" + "---|" * (len(STEPS_S) + 4))
    for name, made, columns, reference in CASES:
        found = [ended(made, step, columns) for step in STEPS_S]
        errors = [float(np.abs(each - reference).max()) for each in found]
        order = math.log2(errors[0] / errors[1])
        digits = [", ".join(f"{value:.12f}" for value in values) for values in (reference, found[-1])]
        print(f"| {name} | {digits[0]} | {digits[1]} | {' | '.join(f'{each:.1e}' for each in errors)} | {order:.1f} |")


if __name__ == "__main__":
    main()
