"""The example of ``docs/fit.md``: tosses of a cube that our own simulator made, with noise, and the fit to them.

Writes the picture; prints what ``ffsm fit`` prints. ``python docs/fit_figure.py FOLDER`` keeps recording and scenario there.
"""

from __future__ import annotations

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import ffsm_mj
from ffsm_mj.cli.main import main as main_of_ffsm

PICTURE = Path(__file__).parent / "figures" / "fit" / "fit.svg"
CUBE = """<mujoco><option gravity="0 0 -9.81"/><worldbody><body name="cube"><freejoint name="free"/>
  <geom name="cube" type="box" size="0.025 0.025 0.025" mass="0.5"/></body></worldbody></mujoco>"""
SLAB = '<mujoco><worldbody><geom name="slab" type="box" pos="0 0 -0.1" size="1 1 0.1"/></worldbody></mujoco>'
TOSSES, SEED = 24, 0
NOISE_M, NOISE_RAD = 1e-4, 1e-3
SCENARIO = """name: tosses
description: A cube of 5 cm is tossed onto a slab.
conservative: false
duration_s: 0.5
time_step_s: 0.001
control_period_s: 0.004
robot: {mjcf: cube.xml}
objects:
  slab: {mjcf: slab.xml, fixed: true}
initial:
  joints: {robot/free: [0.0, 0.0, 0.2, 1.0, 0.0, 0.0, 0.0]}
contacts:
  rules:
    - {between: [cube, slab], restitution: 0.55, mu: 0.22, name: floor}
phases:
  - {name: toss, until: end, controller: {kind: "off"}}
"""


def tosses(scenario: Path) -> str:
    """CSV of poses every 4 ms, as a motion-capture system would have them."""
    random, lines = np.random.default_rng(SEED), list[str]()
    for k in range(TOSSES):
        turn = random.normal(size=4)
        pose = [0.0, 0.0, 0.2, *(turn / np.linalg.norm(turn))]
        rates = [*random.uniform(-0.8, 0.8, 2), 0.5, *random.uniform(-12.0, 12.0, 3)]
        run = ffsm_mj.run(scenario, {"initial.joints": {"robot/free": pose}, "initial.rates": {"robot/free": rates}})
        keys = [key for key in run.log.header.layout.keys if key.startswith("state.q_")]
        for time_s, *pose in zip(*(run.log.column(key).tolist() for key in ("state.time_s", *keys)), strict=True):
            noise = [*(NOISE_M * random.normal(size=3)), *(0.5 * NOISE_RAD * random.normal(size=4))]
            numbers = [1e3 * (pose[i] + noise[i]) for i in range(3)] + [pose[i] + noise[i] for i in range(3, 7)]
            lines.append(",".join([str(k), f"{time_s:.3f}", *(f"{x:.6g}" for x in numbers)]))
    return "\n".join(["run,time_s,cube_x_mm,cube_y_mm,cube_z_mm,cube_qw,cube_qx,cube_qy,cube_qz", *lines]) + "\n"


def main() -> None:
    """Simulate, fit and draw."""
    with TemporaryDirectory() as temporary:
        folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(temporary)
        folder.mkdir(exist_ok=True)
        (folder / "cube.xml").write_text(CUBE, encoding="utf-8")
        (folder / "slab.xml").write_text(SLAB, encoding="utf-8")
        scenario, data = folder / "tosses.yaml", folder / "tosses.csv"
        scenario.write_text(SCENARIO, encoding="utf-8")
        data.write_text(tosses(scenario), encoding="utf-8")
        main_of_ffsm(["fit", str(data), "--scenario", str(scenario), "--out", str(folder / "fit")])
        PICTURE.parent.mkdir(parents=True, exist_ok=True)
        PICTURE.write_bytes((folder / "fit" / "fit.svg").read_bytes())


if __name__ == "__main__":
    main()
