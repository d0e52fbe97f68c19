"""The Riccati solvers against SciPy's: along smooth paths of problems, and on the equations of a run of `spatial`.

``uv run python benchmarks/riccati.py`` prints the second: every equation in the order of the run. Of several
passes the fastest time of each tick counts, so that the slow ones are the solver's own and not the machine's.
"""

# ruff: noqa: E402

from __future__ import annotations

from ffsm_mj.cli.main import one_blas_thread

one_blas_thread()

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import groupby
from unittest.mock import patch

import numpy as np

from ffsm_controllers.osdre import law
from ffsm_controllers.osdre.riccati import from_eigenvectors, planar_riccati, relative_residual
from ffsm_mj._core.osdre import BlockLaw
from ffsm_mj._core.riccati_doubling import Doubling
from ffsm_mj._core.riccati_planar import principal_axes, turned
from ffsm_mj.assembly.prepare import PreparedRun, prepare

OURS, SCIPY = "doubling", "SciPy's Schur method"
GOAL = 0.025
GREATEST_RESIDUAL, WORST_OVER_MEDIAN = 1e-13, 3.0


@dataclass(frozen=True)
class Equation:
    """One tick's equation."""

    A21: np.ndarray
    A22: np.ndarray
    S: np.ndarray
    Q: np.ndarray


def recorded(prepared: PreparedRun) -> list[Equation]:
    """Every equation of a run, in its order."""
    equations: list[Equation] = []

    class Noted(BlockLaw):
        """Notes the equation of each tick: (30) and S from the state, as the law in the core has them."""

        def __init__(self, kinematics, data, riccati, driven, axes, target_m, whole_stack, *others):
            super().__init__(kinematics, data, riccati, driven, axes, target_m, whole_stack, *others)
            self.seen = kinematics, data, driven, list(axes), whole_stack

        def tick(self):
            super().tick()
            tip, data, driven, axes, whole_stack = self.seen
            drift = tip.jac_dot[axes] @ data.qvel - tip.W @ (data.qfrc_bias - data.qfrc_passive)
            y, y_dot = tip.point[axes], tip.J @ data.qvel
            stack = np.concatenate((y if whole_stack else 0.0 * y, y_dot))
            lower = np.outer(drift, stack) / max(float(stack @ stack), 1e-300)
            gains, p = driven @ tip.W.T, len(axes)
            S = gains[len(driven) // 2 :].T @ gains[: len(driven) // 2]
            equations.append(Equation(lower[:, :p].copy(), lower[:, p:].copy(), S, weights[-1]))
            return 0

    weights: list[np.ndarray] = []

    def weighed(Q):
        weights.append(Q)
        return Doubling(Q)

    with patch.object(law, "BlockLaw", Noted), patch.object(law, "Doubling", weighed):
        prepared.run()
    return equations


def ours(equations: list[Equation]) -> tuple[np.ndarray, np.ndarray]:
    """Seconds of each solution, and what is left of each equation, by the law's solver from tick to tick."""
    spent, left = [], []
    for _, phase in groupby(equations, lambda equation: id(equation.Q)):
        first, *others = phase
        solver = Doubling(first.Q)
        for one in (first, *others):
            start = time.perf_counter()
            lower, *_ = solver.solve(one.A21, one.A22, one.S)
            spent.append(time.perf_counter() - start)
            left.append(residual(one, whole(one, lower)))
    return np.array(spent), np.array(left)


def scipys(equations: list[Equation]) -> tuple[np.ndarray, np.ndarray]:
    """The same by SciPy."""
    spent, left = [], []
    for one in equations:
        values, axes = np.linalg.eigh(one.S)
        A, B = stacked(one.A21, one.A22, axes * np.sqrt(np.maximum(values, 0.0)))
        start = time.perf_counter()
        K = scipy_care(A, B, one.Q)
        spent.append(time.perf_counter() - start)
        left.append(residual(one, K))
    return np.array(spent), np.array(left)


def whole(one: Equation, lower: np.ndarray) -> np.ndarray:
    """K from its lower blocks [P2^T, P3]: the block of the equation that is linear in P1 gives P1."""
    p = len(one.S)
    P2_T, P3 = lower[:, :p], lower[:, p:]
    P1 = P3 @ one.S @ P2_T - one.A22.T @ P2_T - P3 @ one.A21 - one.Q[p:, :p]
    return np.block([[0.5 * (P1 + P1.T), P2_T.T], [P2_T, P3]])


def residual(one: Equation, K: np.ndarray) -> float:
    """Of the whole equation, relative to its largest term."""
    A, B = stacked(one.A21, one.A22, one.S)
    return relative_residual(A, np.hstack((np.zeros_like(B), B)), one.Q, K)


def stacked(A21: np.ndarray, A22: np.ndarray, B2: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A and B of the output stack from their lower blocks."""
    p = len(A21)
    A = np.block([[np.zeros((p, p)), np.eye(p)], [A21, A22]])
    return A, np.vstack((np.zeros_like(B2), B2))


def scipy_care(A, B, Q):
    """SciPy's Schur method, the oracle."""
    from scipy.linalg import solve_continuous_are

    return solve_continuous_are(A, B, Q, np.eye(B.shape[1]))


def three_outputs(solver: str) -> float:
    """Seconds per solution for three outputs along a smooth path."""
    rng = np.random.default_rng(0)
    ends = [rng.normal(size=(2, 3, k)) for k in (3, 3, 4)]
    Q, count, total = np.diag([1.0] * 3 + [0.5] * 3), 300, 0.0
    doubling = Doubling(Q)
    for k in range(count):
        A21, A22, B2 = (np.cos(0.001 * k) * first + np.sin(0.001 * k) * second for first, second in ends)
        A, B = stacked(A21, A22, B2)
        start = time.perf_counter()
        if solver == "doubling":
            doubling.solve(A21, A22, B2 @ B2.T)
        else:
            scipy_care(A, B, Q)
        total += time.perf_counter() - start
    return total / count


def two_outputs(solver: str) -> float:
    """Seconds per solution along a smooth path of problems, warm-started where the solver can."""
    rng = np.random.default_rng(0)
    first, second = rng.normal(size=(2, 2, 4)), rng.normal(size=(2, 2, 4))
    left, right = rng.normal(size=(2, 3)), rng.normal(size=(2, 3))
    Q, count = np.diag([1.0, 1.0, 0.5, 0.5]), 500
    planar, total = planar_riccati(Q), 0.0
    for k in range(count):
        angle = 0.001 * k
        A21, A22 = np.hsplit(np.cos(angle) * first[0] + np.sin(angle) * second[0], 2)
        B2 = np.cos(angle) * left + np.sin(angle) * right
        (A, B), S = stacked(A21, A22, B2), np.zeros((4, 4))
        S[2:, 2:] = B2 @ B2.T
        values, axes = principal_axes(*S[2:, 2:].ravel()[[0, 1, 3]].tolist())
        lower = [turned(tuple(block.ravel().tolist()), axes) for block in (A21, A22)]
        start = time.perf_counter()
        if solver == "structured":
            planar.solve(*lower, values, axes)
        elif solver == "eigenvectors":
            from_eigenvectors(A, S, Q)
        else:
            scipy_care(A, B, Q)
        total += time.perf_counter() - start
    return total / count


def report(passes: int) -> None:
    """Time all solvers in turn on the equations of `spatial`, several times, and print their table."""
    equations = recorded(prepare("spatial"))
    solvers: dict[str, Callable] = {OURS: lambda: ours(equations), SCIPY: lambda: scipys(equations)}
    least: dict[str, np.ndarray] = {}
    greatest: dict[str, float] = {}
    for _ in range(passes):
        for name, solver in solvers.items():
            spent, left = solver()
            least[name] = np.minimum(least.get(name, np.inf), spent)
            greatest[name] = left.max()
    print(f"{len(equations)} Riccati equations of spatial, the fastest of {passes} passes at each tick")
    print(
        f"{'':22}{'median':>12}{'mean':>12}{'worst':>12}{'/ median':>10}{'goal':>6}{'ratio':>8}{'goal':>7}"
        f"{'residual':>11}{'goal':>8}"
    )
    for name, spent in least.items():
        times = "".join(f"{1e6 * value:>9.1f} us" for value in (np.median(spent), spent.mean(), spent.max()))
        worst, ratio = spent.max() / np.median(spent), spent.mean() / least[SCIPY].mean()
        goals = [f"{value:g}" if name == OURS else "" for value in (WORST_OVER_MEDIAN, GOAL, GREATEST_RESIDUAL)]
        print(f"{name:22}{times}{worst:>10.1f}{goals[0]:>6}{ratio:>8.3f}{goals[1]:>7}{greatest[name]:>11.1e}{goals[2]:>8}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--passes", type=int, default=5)
    report(parser.parse_args().passes)
