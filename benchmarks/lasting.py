"""What contact that lasts costs: a whole run pressing all the while against the same run with nothing near.

``uv run python benchmarks/lasting.py`` prints microseconds of CPU time per control tick of 1 ms, in contact and
free, with the same models and the same law; medians over interleaved repeats, ratios within each, and the ratios that are
required. Two jaws press on a cube between them, with four points each. With friction all points stick; in the last case
all of them slide throughout. ``--parts`` prints where a tick of one case goes instead: of several runs the quickest.
"""

# ruff: noqa: E402

from __future__ import annotations

from ffsm_mj.cli.main import one_blas_thread

one_blas_thread()

import argparse
import json
import statistics
from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from loops import in_memory
from scenes import AWAY_M, HEAD
from tick import quickest

from ffsm_mj.assembly.prepare import PreparedRun, prepare
from ffsm_mj.balance.balance import Balance
from ffsm_mj.contact_models.persistent.columns import ContactReport
from ffsm_mj.contact_models.persistent.model import PersistentContactModel
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.simulation.integrator import EventDrivenIntegrator

HALF_M, REACH_M, THICK_M = 0.2, 0.3, 0.05
OPEN_M, THIN_M = 0.4, 0.02
PUSH_N = 1.0
FAR_M = 1e3
SPHERE, CORNERS, JAWS = "sphere on box", "box on box, four points", "two jaws, eight points"
RUBS, MU = ", friction", 0.5
SLIDES, SMOOTH_MU, SLIP_M_S = ", sliding", 0.02, 0.08
GOALS = {
    SPHERE: (1.6, 1.8),
    CORNERS: (1.9, 2.1),
    JAWS: (2.0, 2.4),
}
PADS = {
    SPHERE: f'type="sphere" size="{THICK_M}"',
    "capsule on box, two points": f'type="capsule" size="{THICK_M} 0.1"',
    CORNERS: f'type="box" size="{THICK_M} 0.1 0.1"',
}
PARTS: dict[str, list[tuple[Any, str]]] = {
    "contacts, for the log": [(ContactReport, "_write_values")],
    "forces in stages, and in between": [(PersistentContactModel, "push")],
    "whether something begins or ends": [(PersistentContactModel, "due")],
    "drift, and which press": [(PersistentContactModel, "begin_step")],
    "step, in the loop": [(Motion, "step")],
    "whether they still press at its end": [(PersistentContactModel, "is_clear")],
    "balance, in the loop": [(EventDrivenIntegrator, "exchanges"), (Balance, "enter")],
}
BOX = f"""<mujoco>{HEAD}<worldbody><body name="box"><inertial pos="0 0 0" mass="3" diaginertia="0.1 0.1 0.1"/>
<freejoint name="free"/>
<geom name="box" type="box" size="{HALF_M} {HALF_M} {HALF_M}" mass="0"/></body></worldbody></mujoco>"""


def pusher(pad: str) -> str:
    """MJCF of a base on a free joint whose rod, on a slide, ends in a pad."""
    return f"""<mujoco>{HEAD}<worldbody><body name="bus"><freejoint name="base"/>
    <inertial pos="0 0 0" mass="20" diaginertia="1 1 1"/><body name="rod" pos="{REACH_M} 0 0">
    <inertial pos="0 0 0" mass="0.5" diaginertia="0.01 0.01 0.01"/><joint name="rod" type="slide" axis="1 0 0"/>
    <geom name="pad" {pad} mass="0"/></body></body></worldbody>
    <actuator><motor name="push" joint="rod"/></actuator></mujoco>"""


def jaws() -> str:
    """MJCF of a base on a free joint with two plates on slides to either side."""

    def jaw(name: str, y: float) -> str:
        return f"""<body name="{name}" pos="0 {y} 0"><inertial pos="0 0 0" mass="0.5" diaginertia="0.01 0.01 0.01"/>
        <joint name="{name}" type="slide" axis="0 1 0"/>
        <geom name="{name}" type="box" size="0.1 {THIN_M} 0.1" mass="0"/></body>"""

    return f"""<mujoco>{HEAD}<worldbody><body name="bus"><freejoint name="base"/>
    <inertial pos="0 0 0" mass="5" diaginertia="1 1 1"/>{jaw("left", -OPEN_M)}{jaw("right", OPEN_M)}</body></worldbody>
    <actuator><motor name="ml" joint="left"/><motor name="mr" joint="right"/></actuator></mujoco>"""


def pressed(pad: str, *, away_m: float, mu: float = 0.0, duration_s: float = 1.0, slip_m_s: float = 0.0) -> PreparedRun:
    """A pad that is pushed with a constant force, at a box or, ``away_m`` from it, at nothing; plastic.

    The box is at rest, or passes the pad at ``slip_m_s``.
    """
    law = {"kind": "pd", "joints": ["rod"], "kp": PUSH_N / FAR_M, "kd": 0.0, "target": [FAR_M]}
    pairs = [{"between": ["pad", "box/box"], "restitution": 0.0, "mu": mu}]
    place = [REACH_M + THICK_M + HALF_M + away_m, -0.5 * slip_m_s * duration_s, 0.0]
    return _prepared(pusher(pad), pairs, law, place, duration_s, slip_m_s=slip_m_s)


def gripped(*, away_m: float, mu: float = 0.0, duration_s: float = 1.0) -> PreparedRun:
    """Two plastic jaws that press on a cube between them, or where it is not."""
    law = {"kind": "pd", "joints": ["left", "right"], "kp": PUSH_N / FAR_M, "kd": 0.0, "target": [FAR_M, -FAR_M]}
    pairs = [{"between": [name, "box/box"], "restitution": 0.0, "mu": mu} for name in ("left", "right")]
    closed = {"left": OPEN_M - THIN_M - HALF_M, "right": THIN_M + HALF_M - OPEN_M}
    return _prepared(jaws(), pairs, law, [away_m, 0.0, 0.0], duration_s, closed)


def _prepared(
    robot: str,
    pairs: list[dict[str, Any]],
    law: dict[str, Any],
    place: list[float],
    duration_s: float,
    joints: dict[str, float] | None = None,
    slip_m_s: float = 0.0,
) -> PreparedRun:
    scenario = {
        "name": "lasting",
        "duration_s": duration_s,
        "time_step_s": 0.001,
        "control_period_s": 0.001,
        "robot": {"mjcf": "robot.xml"},
        "objects": {"box": {"mjcf": "box.xml"}},
        "initial": {
            "joints": {"box/free": [*place, 1.0, 0.0, 0.0, 0.0], **(joints or {})},
            "rates": {"box/free": [0.0, slip_m_s, 0.0, 0.0, 0.0, 0.0]},
        },
        "contacts": {"rules": pairs},
        "phases": [{"name": "push", "until": "end", "controller": law}],
    }
    with TemporaryDirectory() as folder:
        for name, text in (("robot.xml", robot), ("box.xml", BOX)):
            (Path(folder) / name).write_text(text)
        path = Path(folder) / "scene.yaml"
        path.write_text(json.dumps(scenario))  # JSON is YAML
        return prepare(path)


def measured(touching: PreparedRun, free: PreparedRun, repeats: int) -> tuple[float, float, float]:
    """Microseconds per tick in contact and free, and their ratio; medians."""
    rounds = [(in_memory(touching), in_memory(free)) for _ in range(repeats)]
    held, alone = (1e6 * statistics.median(side) / touching.scenario.ticks for side in zip(*rounds, strict=True))
    return held, alone, statistics.median(a / b for a, b in rounds)


def parts(case: Callable[..., PreparedRun], repeats: int) -> None:
    """Where a tick of a case goes, in contact and free."""
    scenes = [case(away_m=away, duration_s=0.25) for away in (0.0, AWAY_M)]
    print(f"{'us per tick':40}{'in contact':>12}{'free':>8}")
    runs = [quickest(scene, PARTS, repeats) for scene in scenes]
    for label in PARTS:
        held, alone = (run.parts[label].spent_us / scene.scenario.ticks for run, scene in zip(runs, scenes, strict=True))
        print(f"{label:40}{held:>12.1f}{alone:>8.1f}")
    held, alone = (run.whole_us / scene.scenario.ticks for run, scene in zip(runs, scenes, strict=True))
    print(f"{'the whole tick':40}{held:>12.1f}{alone:>8.1f}")


def main() -> None:
    """Run every case, print its line."""
    cases: dict[str, Callable[..., PreparedRun]] = {name: partial(pressed, pad) for name, pad in PADS.items()}
    cases[JAWS] = gripped
    cases |= {name + RUBS: partial(cases[name], mu=MU) for name in GOALS}
    cases[CORNERS + SLIDES] = partial(pressed, PADS[CORNERS], mu=SMOOTH_MU, slip_m_s=SLIP_M_S)
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument(
        "--case", choices=cases, action="append", help="one of the cases; several may be given (default: all)"
    )
    parser.add_argument("--parts", action="store_true", help="where a tick goes (default: of the sphere on the box)")
    options = parser.parse_args()
    if options.parts:
        parts(cases[(options.case or [SPHERE])[0]], options.repeats)
        return
    measured(cases[SPHERE](away_m=0.0, duration_s=0.1), cases[SPHERE](away_m=AWAY_M, duration_s=0.1), 1)
    print(f"{'us per tick':34}{'in contact':>12}{'free':>8}{'ratio':>8}{'goal':>8}")
    for name in options.case or cases:
        held, alone, ratio = measured(cases[name](away_m=0.0), cases[name](away_m=AWAY_M), options.repeats)
        goals = GOALS.get(name.removesuffix(RUBS))
        goal = f"{goals[name.endswith(RUBS)]:>8.1f}" if goals else ""
        print(f"{name:34}{held:>12.0f}{alone:>8.0f}{ratio:>8.1f}{goal}", flush=True)


if __name__ == "__main__":
    main()
