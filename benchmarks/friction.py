"""What an impact costs by law and number of contacts, with friction and without.

``uv run python benchmarks/friction.py`` prints median and 95th percentile of CPU time in ms over random impacts of two free
bodies: points and normals in space, mu from 0 to 1.5, e from 0 to 1, half of them elastic or plastic throughout. One contact
with friction goes by Stronge's law whatever the law for several, or by ``compliant`` with k_t / k_n of the Poisson's ratio
0.3; "line" where it cannot move along the second tangent. Beside it what share ended with another status than ``ok``.
"""

# ruff: noqa: E402

from __future__ import annotations

from ffsm_mj.cli.main import one_blas_thread

one_blas_thread()

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.impact.friction.laws import impact_with_compliance, impact_with_friction
from ffsm_mj.contact_models.impact.laws import FRICTIONLESS
from ffsm_mj.dynamics.rigid_body import tangents

CONTACTS = (1, 2, 3, 4, 6)
FRICTION = ("blend", "poisson")


@dataclass(frozen=True)
class Scene:
    """Rows J L^-T of (n, t1, t2) of each contact (3k, 12), mass-weighted velocity (12,), mu (k,) and e (k,)."""

    A: FloatArray
    w: FloatArray
    mu: FloatArray
    e: FloatArray


@dataclass(frozen=True)
class Cost:
    """CPU time of an impact in ms: median and 95th percentile; share of impacts whose status was not ``ok``."""

    median_ms: float
    p95_ms: float
    told: float


def scene(seed: int, count: int) -> Scene:
    """An impact of two free bodies at ``count`` points, of which one at least approaches."""
    rng = np.random.default_rng([count, seed])
    weights = [np.sqrt([m, m, m, *rng.uniform(0.2, 1.0, 3)]) for m in rng.uniform(0.5, 2.0, 2)]
    rows = []
    for _ in range(count):
        normal, arms = rng.normal(size=3), rng.normal(size=(2, 3))
        frame = np.vstack((normal := normal / np.linalg.norm(normal), tangents(normal)))
        sides = [np.hstack((frame, np.cross(arm, frame))) / weight for arm, weight in zip(arms, weights, strict=True)]
        rows.append(np.hstack((-sides[0], sides[1])))
    A, w = np.concatenate(rows), rng.normal(size=12)
    e = (np.ones(count), np.zeros(count), *2 * (rng.uniform(size=count),))[seed % 4]
    return Scene(A, -w if A[0] @ w > 0.0 else w, rng.uniform(1e-3, 1.5, count), e)


def with_friction(one: Scene, law: str) -> str:
    """Status of an impact."""
    return impact_with_friction(one.A, one.w, one.mu, one.e, law).status


def along_a_line(one: Scene) -> Scene:
    """The impact without motion along the second tangent."""
    return replace(one, A=one.A * np.array([[1.0], [1.0], [0.0]]))


def with_compliance(one: Scene) -> str:
    """Status of an impact with tangential compliance."""
    return impact_with_compliance(one.A, one.w, float(one.mu[0]), float(one.e[0]), 1.7 / 1.4).status


def without_friction(one: Scene, law: str) -> str:
    """The same for the law of the normals alone."""
    return "jammed" if FRICTIONLESS[law](one.A[::3], one.w, one.e).jammed else "ok"


def cost(count: int, solve: Callable[[Scene], str], impacts: int) -> Cost:
    """Of a number of impacts at so many points."""
    spent, told = [], 0
    solve(scene(0, count))
    for seed in range(impacts):
        one = scene(seed, count)
        begin = time.thread_time()
        told += solve(one) != "ok"
        spent.append(1e3 * (time.thread_time() - begin))
    return Cost(float(np.median(spent)), float(np.percentile(spent, 95)), told / impacts)


def row(count: int, law: str, friction: str, found: Cost) -> None:
    """Print a line of the table."""
    times = f"{found.median_ms:>10.3f}{found.p95_ms:>9.2f}"
    print(f"{count:>8}  {law:10}{friction:10}{times}{found.told:>9.1%}", flush=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--impacts", type=int, default=300, help="random impacts per line")
    impacts = parser.parse_args().impacts
    print(f"{'contacts':>8}  {'law':10}{'friction':10}{'median ms':>10}{'p95 ms':>9}{'not ok':>9}")
    for count in CONTACTS:
        for law in FRICTION:
            for friction, solve in (("no", without_friction), ("yes", with_friction)):
                if count == 1 and law != FRICTION[0]:
                    continue  # all laws are one
                found = cost(count, partial(solve, law=law), impacts)
                row(count, "stronge" if count == 1 and friction == "yes" else law, friction, found)
    row(1, "compliant", "yes", cost(1, with_compliance, impacts))
    row(1, "stronge", "line", cost(1, lambda one: with_friction(along_a_line(one), FRICTION[0]), impacts))
    row(1, "compliant", "line", cost(1, lambda one: with_compliance(along_a_line(one)), impacts))


if __name__ == "__main__":
    main()
