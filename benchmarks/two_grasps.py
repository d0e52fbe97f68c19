"""What a second grasp costs: runs of a robot with two arms that holds an object by both, by one, and not at all.

``uv run python benchmarks/two_grasps.py`` prints microseconds of CPU time per control tick of 1 ms, and what
the second grasp adds as a share of the free tick, with the share that is allowed; medians over interleaved repeats. The
first grasp is a child body, the second one rows in every stage of a step.
"""

# ruff: noqa: E402

from __future__ import annotations

from ffsm_mj.cli.main import one_blas_thread

one_blas_thread()

import argparse
import json
import statistics
from pathlib import Path
from tempfile import TemporaryDirectory

from loops import in_memory
from scenes import HEAD

from ffsm_mj.assembly.prepare import PreparedRun, prepare

GOAL = 1.5
"""Largest cost of a second grasp in free ticks."""
AXES = ("0 0 1", "0 1 0", "0 0 1", "1 0 0")
HANDS = ("left", "right")
PLATE = f"""<mujoco>{HEAD}<worldbody><body name="plate"><freejoint name="free"/>
  <inertial pos="0.03 0.02 0" mass="3" diaginertia="0.05 0.08 0.06"/>
  <site name="to_left" pos="-0.1 0.3 0"/><site name="to_right" pos="-0.1 -0.3 0"/></body></worldbody></mujoco>"""


def robot() -> str:
    """MJCF of a free base with two arms of four hinges."""
    arms = ""
    for side, y in zip(HANDS, (0.3, -0.3), strict=True):
        for k, axis in enumerate(AXES):
            place = f"0.3 {y} 0" if k == 0 else "0.3 0 0"
            arms += f"""<body name="{side}_{k}" pos="{place}"><joint name="{side}_{k}" type="hinge" axis="{axis}"/>
            <inertial pos="0.15 0.01 0" mass="{1.2 - 0.2 * k}" diaginertia="0.01 0.02 0.025"/>"""
        arms += f'<site name="{side}" pos="0.25 0 0"/>' + "</body>" * len(AXES)
    motors = "".join(f'<motor name="{side}_{k}" joint="{side}_{k}"/>' for side in HANDS for k in range(len(AXES)))
    return f"""<mujoco>{HEAD}<worldbody><body name="base"><freejoint name="free"/>
    <inertial pos="0.02 0.01 0" mass="10" diaginertia="0.8 0.7 0.9"/>{arms}</body></worldbody>
    <actuator>{motors}</actuator></mujoco>"""


def holding(hands: tuple[str, ...], duration_s: float) -> PreparedRun:
    """A run in which some hands hold the plate from the start."""
    joints = {f"{side}_{k}": 0.1 * (k + 1) * (-1) ** k for side in HANDS for k in range(len(AXES))}
    grasps = {
        side: {"robot_site": side, "object_site": f"plate/to_{side}", "when": {"within": {"position_m": 5.0}}}
        for side in HANDS
    }
    law = {"kind": "pd", "kp": 0.5, "kd": 0.3, "target": [*joints.values()]}
    scenario = {
        "name": "two_grasps",
        "duration_s": duration_s,
        "time_step_s": 0.001,
        "control_period_s": 0.001,
        "robot": {"mjcf": "robot.xml"},
        "objects": {"plate": {"mjcf": "plate.xml"}},
        "initial": {
            "joints": {"plate/free": [1.6, 0.03, -0.02, 0.998, 0.03, 0.02, 0.05], **joints},
            "rates": {"plate/free": [-0.05, 0.1, 0.02, 0.2, -0.1, 0.15]},
        },
        "grasps": grasps,
        "phases": [{"name": "hold", "until": "end", "arm": [*hands], "controller": law}],
    }
    with TemporaryDirectory() as folder:
        for name, text in (("robot.xml", robot()), ("plate.xml", PLATE)):
            (Path(folder) / name).write_text(text)
        path = Path(folder) / "scene.yaml"
        path.write_text(json.dumps(scenario))  # JSON is YAML
        return prepare(path)


def main() -> None:
    """Run all cases, print a line in us per tick."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--duration-s", type=float, default=0.5)
    options = parser.parse_args()
    runs = [holding(HANDS[:count], options.duration_s) for count in range(3)]
    ticks = runs[0].scenario.ticks
    print(f"{'free':>8}{'one':>8}{'two':>8}{'second / free':>15}{'allowed':>9}")
    in_memory(runs[2])
    rounds = [[1e6 * in_memory(run) / ticks for run in runs] for _ in range(options.repeats)]
    free, one, two = (statistics.median(each) for each in zip(*rounds, strict=True))
    share = statistics.median((c - b) / a for a, b, c in rounds)
    print(f"{free:>8.1f}{one:>8.1f}{two:>8.1f}{share:>15.2f}{GOAL:>9.1f}", flush=True)


if __name__ == "__main__":
    main()
