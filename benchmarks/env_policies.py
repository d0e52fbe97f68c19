"""Shares of episodes that the scripted policies of the shipped environments end with success, and random actions.

``python benchmarks/env_policies.py [ROWS]``: the first rows of the design of each environment.
"""

from __future__ import annotations

import sys
from collections.abc import Callable

import gymnasium
import numpy as np

from ffsm_mj.gym.policies import BASELINES


def episode(env: gymnasium.Env, policy: Callable, seed: int) -> tuple[bool, float, float]:
    """Success, time of the end in s, and sum of the rewards."""
    observation, _ = env.reset(seed=seed)
    total, over = 0.0, False
    while not over:
        observation, reward, terminated, truncated, info = env.step(policy(observation))
        total, over = total + reward, terminated or truncated
    return info["success"], info["time_s"], total


def row(name: str, rows: int) -> str:
    """A row of the table."""
    env = gymnasium.make(name).unwrapped
    env.action_space.seed(0)
    cells = []
    for policy in (BASELINES[name], lambda _: env.action_space.sample()):
        found = [episode(env, policy, seed) for seed in range(rows)]
        times = [time_s for success, time_s, _ in found if success]
        end = f", {np.median(times):.1f} s" if times else ""
        cells.append(f"{sum(each[0] for each in found)} of {rows}{end}; {np.median([each[2] for each in found]):.2f}")
    env.close()
    return f"| `{name}` | {' | '.join(cells)} |"


def main() -> None:
    """Print the table."""
    rows = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    print("| environment | scripted: successes, median time; median return | random |")
    print("|---|---|---|")
    for name in BASELINES:
        print(row(name, rows), flush=True)


if __name__ == "__main__":
    main()
