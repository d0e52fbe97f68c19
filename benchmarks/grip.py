"""A grip at half of the Coulomb limit: creep of MuJoCo's own soft contact beside that of persistent contact with friction.

``uv run python benchmarks/grip.py`` prints the slip of a box of 2 kg between two pads of 10 N, mu 0.7, whose base of
10 kg is pushed so that the box needs half of 2 mu N, after 10 s, and writes ``docs/figures/squeeze/creep.svg``. Coulomb's
law has no slip. ``--dry`` only prints.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
import numpy as np
from matplotlib.figure import Figure

import ffsm_mj
from ffsm_mj.report.plots.style import BLUE, VERMILION, WIDTH_IN, publication, write

FIGURES = Path(__file__).parents[1] / "docs" / "figures" / "squeeze"
MU, GRIP_N, DURATION_S = 0.7, 10.0, 10.0
PUSH_N = 0.5 * 2 * MU * GRIP_N * 12.4 / 2.0
FAR_M = 1e9
RECIPES = {f"MuJoCo, impratio {ratio:g}": ratio for ratio in (1.0, 10.0, 100.0)}
OURS, ROUNDING_M = "persistent contact", 1e-12


def robot(head: str, damping: float) -> str:
    """MJCF of a base on a slide along x with two fingers on slides along y; damping of the fingers in N s/m."""
    finger = """<body name="{0}" pos="0 {1} 0"><inertial pos="0 0 0" mass="0.2" diaginertia="0.001 0.001 0.001"/>
      <joint name="{0}" type="slide" axis="0 1 0" damping="{2}"/>
      <geom name="{0}" type="box" size="0.02 0.01 0.02" mass="0" friction="0.7 0 0"/></body>"""
    return f"""<mujoco>{head}<worldbody><body name="base"><joint name="x" type="slide" axis="1 0 0"/>
      <inertial pos="0 0 0" mass="10" diaginertia="1 1 1"/>{finger.format("left", 0.06, damping)}
      {finger.format("right", -0.06, damping)}</body>%s</worldbody><actuator><motor name="push" joint="x"/>
      <motor name="left" joint="left"/><motor name="right" joint="right"/></actuator></mujoco>"""


BOX = """<body name="box"><inertial pos="0 0 0" mass="2" diaginertia="0.004 0.004 0.004"/><freejoint name="free"/>
<geom name="box" type="box" size="0.05 0.05 0.05" mass="0" friction="0.7 0 0"/></body>"""


def soft(impratio: float, step_s: float = 1e-3) -> tuple[np.ndarray, np.ndarray]:
    """Time in s and slip in m by MuJoCo's own contact, RK4."""
    head = f"""<option gravity="0 0 0" integrator="RK4" timestep="{step_s}" cone="elliptic" impratio="{impratio}"/>"""
    model = mujoco.MjModel.from_xml_string(robot(head, 50.0) % BOX)
    data = mujoco.MjData(model)
    data.ctrl[1:] = -GRIP_N, GRIP_N
    for _ in range(round(0.5 / step_s)):  # the pads settle
        mujoco.mj_step(model, data)
    data.ctrl[0] = PUSH_N
    start = data.joint("x").qpos[0] - data.joint("free").qpos[0]
    slip = []
    for _ in range(round(DURATION_S / step_s)):
        mujoco.mj_step(model, data)
        slip.append(data.joint("x").qpos[0] - data.joint("free").qpos[0] - start)
    return step_s * np.arange(1, len(slip) + 1), np.array(slip)


def exact(step_s: float = 0.02) -> tuple[np.ndarray, np.ndarray]:
    """The same by persistent contact with friction."""
    head = '<option gravity="0 0 0"/>'
    law = {
        "kind": "pd",
        "joints": ["x", "left", "right"],
        "kp": [PUSH_N / FAR_M, GRIP_N / FAR_M, GRIP_N / FAR_M],
        "kd": 0.0,
        "target": [FAR_M, -FAR_M, FAR_M],
    }
    scenario = {
        "name": "grip",
        "duration_s": DURATION_S,
        "time_step_s": step_s,
        "control_period_s": step_s,
        "robot": {"mjcf": "robot.xml"},
        "objects": {"box": {"mjcf": "box.xml"}},
        "contacts": {"rules": [{"between": [side, "box/box"], "restitution": 0.0, "mu": MU} for side in ("left", "right")]},
        "phases": [{"name": "push", "until": "end", "controller": law}],
    }
    with TemporaryDirectory() as folder:
        (Path(folder) / "robot.xml").write_text(robot(head, 0.0) % "")
        (Path(folder) / "box.xml").write_text(f"<mujoco>{head}<worldbody>{BOX}</worldbody></mujoco>")
        path = Path(folder) / "scene.yaml"
        path.write_text(json.dumps(scenario))  # JSON is YAML
        run = ffsm_mj.run(path)
    return run.time, run["state.q_robot_x_m"] - run["state.q_box_free_x_m"]


def main() -> None:
    """Run all, print, draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--dry", action="store_true", help="only print")
    dry = parser.parse_args().dry
    curves = {name: soft(impratio) for name, impratio in RECIPES.items()} | {OURS: exact()}
    for name, (_, slip) in curves.items():
        print(f"{name:32}{1e6 * slip[-1]:14.6g} um in {DURATION_S:g} s")
    if dry:
        return
    with publication():
        figure = Figure(figsize=(WIDTH_IN, 0.4 * WIDTH_IN))
        axes = figure.subplots()
        for name, (time, slip) in curves.items():
            colour = BLUE if name == OURS else VERMILION
            # Rounding is labelled as none.
            end = 0.0 if abs(slip[-1]) < ROUNDING_M else 1e3 * slip[-1]
            axes.plot(time, 1e3 * slip, color=colour, clip_on=False)
            axes.annotate(
                f"{name}\n{end:.3g} mm",
                (time[-1], end),
                xytext=(6, 0),
                textcoords="offset points",
                fontsize=7,
                va="center",
                color=colour,
                annotation_clip=False,
            )
        axes.set_yscale("symlog", linthresh=1e-3)
        axes.set_yticks((0.0, 1e-3, 1e-2, 1e-1, 1.0, 10.0), ("0", "0.001", "0.01", "0.1", "1", "10"))
        axes.set(xlabel="time under load, s", ylabel="slip of the box, mm", xlim=(0.0, DURATION_S), ylim=(-2e-4, 40.0))
    FIGURES.mkdir(parents=True, exist_ok=True)
    write(figure, FIGURES, "creep", ("svg",))


if __name__ == "__main__":
    main()
