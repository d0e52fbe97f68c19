"""Steps of the shipped environments per second of one core, and of several processes at once.

``python benchmarks/env_steps.py [PROCESSES]``: random actions, medians over three episodes; resets are told apart. The
steps of one core are per second of its CPU time, beside them the share that the steps of MuJoCo's RK4 in them take alone,
which no way to compute the rest can spare; those of a vector are per second of wall time.
"""

from __future__ import annotations

import sys
import time
from statistics import median

import gymnasium
import mujoco

from ffsm_mj.gym.policies import BASELINES

EPISODES = 3
VECTOR_STEPS = 100
BARE_STEPS = 2000


def episode(env: gymnasium.Env, seed: int) -> tuple[float, int, float, float]:
    """CPU time of the reset in s, steps, CPU time per step in s, simulated time in s."""
    start = time.process_time()
    env.reset(seed=seed)
    env.action_space.seed(seed)
    began, steps, over = time.process_time(), 0, False
    while not over:
        *_, terminated, truncated, info = env.step(env.action_space.sample())
        steps, over = steps + 1, terminated or truncated
    return began - start, steps, (time.process_time() - began) / steps, info["time_s"]


def bare_step_s(env: gymnasium.Env) -> float:
    """CPU time of a bare step of the model of an environment by RK4, s."""
    env.reset(seed=0)
    assembly = env.simulator.assembly
    model, data = assembly.system.mj, mujoco.MjData(assembly.system.mj)
    data.qpos[:], data.qvel[:] = assembly.data.qpos, assembly.data.qvel
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    start = time.process_time()
    for _ in range(BARE_STEPS):
        mujoco.mj_step(model, data)
    return (time.process_time() - start) / BARE_STEPS


def alone(name: str, **keys: int) -> str:
    """A row of the table, with keys of the section ``env`` that replace those of the file."""
    env = gymnasium.make(name, env=keys).unwrapped
    episode(env, 0)  # what is made once
    found = [episode(env, 1 + seed) for seed in range(EPISODES)]
    reset, per_step = median(each[0] for each in found), median(each[2] for each in found)
    simulated = median(each[3] / each[1] for each in found)
    ticks, scenario = env.config.ticks_per_step, env.simulator.prepared.scenario
    share = bare_step_s(env) * ticks * scenario.steps_per_tick / per_step
    env.close()
    return (
        f"| `{name}` | {env.action_space.shape[0]} | {env.observation_space.shape[0]} | {ticks} | {1 / per_step:.0f} "
        f"| {ticks / per_step:.0f} | {simulated / per_step:.1f} | {100.0 * share:.0f} % | {1e3 * reset:.0f} ms |"
    )


def together(name: str, processes: int) -> float:
    """Steps per second of wall time of all processes together, resets included."""
    vector = gymnasium.make_vec(name, num_envs=processes, vectorization_mode="async", stride=processes)
    try:
        vector.reset(seed=0)
        actions = vector.action_space
        actions.seed(0)
        start = time.perf_counter()
        for _ in range(VECTOR_STEPS):
            vector.step(actions.sample())
        return processes * VECTOR_STEPS / (time.perf_counter() - start)
    finally:
        vector.close()


def main() -> None:
    """Print both tables."""
    processes = int(sys.argv[1]) if len(sys.argv) > 1 else 2
    print(
        "| environment | actions | observations | ticks per step | steps/s | ticks/s | times real time | RK4 alone | reset |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for name in BASELINES:
        print(alone(name))
    print(alone("ffsm_mj/Capture-v0", ticks_per_step=2))
    for name in BASELINES:
        print(f"{name}, {processes} processes: {together(name, processes):.0f} steps/s")


if __name__ == "__main__":
    main()
