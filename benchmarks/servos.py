"""Cost of servos: runs of an arm with servos over runs of the same arm with motors.

``uv run python benchmarks/servos.py``: process time of runs in memory, medians of interleaved ones. An arm of seven hinges
on a free bus of 100 kg moves for 2 s in ticks of one step of 1 ms with balances and log; no law commands it, so that motors
exert nothing and servos keep their first setpoint. Soft servos, with rates of 5 1/s, take explicit steps as they are; those
of fast ones, with 200 1/s, are divided; stiff ones, with 1e5 1/s as those of an iiwa 14, take implicit steps. ``--only
KIND`` makes runs of one kind, for an instruction counter.
"""

# ruff: noqa: E402

from __future__ import annotations

from ffsm_mj.cli.main import one_blas_thread

one_blas_thread()

import argparse
import json
import statistics
import tempfile
from pathlib import Path

from scenes import run_s

from ffsm_mj.assembly.prepare import PreparedRun, prepare

TICKS = 2000
KINDS = {
    "motors": '<motor name="{0}" joint="{0}"/>',
    "soft servos": '<position name="{0}" joint="{0}" kp=".5" kv=".1"/>',
    "soft servos with limits": '<position name="{0}" joint="{0}" kp=".5" kv=".1" forcerange="-50 50"/>',
    "fast servos": '<position name="{0}" joint="{0}" kp="200" kv="4" forcerange="-87 87"/>',
    "stiff servos": '<position name="{0}" joint="{0}" kp="2000" kv="2000"/>',
}


def arm(kind: str) -> str:
    """A bus of 100 kg with seven links of .3 m, about y and z in turn."""
    links, actuators = "", ""
    for i in reversed(range(7)):
        axis, name = ("0 0 1", "0 1 0")[i % 2], f"joint{i}"
        links = (
            f'<body name="link{i}" pos="0 0 .3"><joint name="{name}" axis="{axis}" damping=".02"/>'
            f'<inertial pos="0 .02 .15" mass="{4.0 - 0.5 * i}" diaginertia=".05 .05 .02"/>{links}</body>'
        )
        actuators = KINDS[kind].format(name) + actuators
    return (
        '<mujoco><option gravity="0 0 0"/><worldbody><body name="bus"><freejoint name="bus"/>'
        f'<inertial pos="0 0 0" mass="100" diaginertia="10 11 12"/>{links}</body></worldbody>'
        f"<actuator>{actuators}</actuator></mujoco>"
    )


def prepared(folder: Path, kind: str) -> PreparedRun:
    """All joints bent, and at slow rates."""
    name = kind.replace(" ", "-")
    (folder / f"{name}.xml").write_text(arm(kind))
    scenario = {
        "name": "arm",
        "duration_s": TICKS * 1e-3,
        "control_period_s": 1e-3,
        "robot": {"mjcf": f"{name}.xml"},
        "contacts": {"rules": []},
        "initial": {
            "joints": {f"joint{i}": 0.3 for i in range(7)},
            "rates": {"bus": [0.01, 0.0, 0.02, 0.02, -0.01, 0.02]} | {f"joint{i}": 0.02 for i in range(7)},
        },
        "phases": [{"name": "coast", "until": "end", "controller": {"kind": "off"}}],
    }
    path = folder / f"{name}.yaml"
    path.write_text(json.dumps(scenario))
    return prepare(path)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--repeats", type=int, default=9, help="runs of each kind")
    parser.add_argument("--only", choices=KINDS, help="runs of one kind")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        runs = {kind: prepared(Path(folder), kind) for kind in ([options.only] if options.only else KINDS)}
        for run in runs.values():
            run_s(run)  # imports
        times = [[run_s(run) for run in runs.values()] for _ in range(options.repeats)]
    for kind, each in zip(runs, zip(*times, strict=True), strict=True):
        ratio = statistics.median(a / row[0] for a, row in zip(each, times, strict=True))
        print(f"{kind}: {1e6 / TICKS * statistics.median(each):.1f} us per tick, ratio {ratio:.2f}")


if __name__ == "__main__":
    main()
