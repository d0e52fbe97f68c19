"""SimBenchmark's rolling test: 25 balls on a pushed box."""

from __future__ import annotations

import math

import numpy as np

from ffsm_mj.analysis.run import Run
from ffsm_mj.validation.case import Number, Origin, Topic, ValidationCase, Values
from ffsm_mj.validation.scene import ball, box, constant, ground, model, run_scene, slide, states, text_of, times

_BOX_KG, _BALL_KG, _SIDE, _MU_GROUND, _MU_BALL, _PUSH_N, _G = 10.0, 1.0, 5, 0.4, 0.8, 150.0, 9.81
_SECONDS = 4.0
_BALLS = _SIDE**2
_ON_GROUND_N = _MU_GROUND * (_BOX_KG + _BALLS * _BALL_KG) * _G
_ON_BALL_N = (_PUSH_N - _ON_GROUND_N) / _BOX_KG / (3.5 / _BALL_KG + _BALLS / _BOX_KG)
_BOX_A = (_PUSH_N - _ON_GROUND_N - _BALLS * _ON_BALL_N) / _BOX_KG
_BALL_A = _ON_BALL_N / _BALL_KG
_HALF_M = (10.0, 10.0, 0.05)
_BEST = {"y_1e-2": "4.38984e-09", "y_4e-2": "4.11572e-09", "xy_1e-2": "7.54888e-09"}
"""Bullet, the best of the engines there, by direction of the push and step."""


def _pushed(step_s: float, directions: str) -> Run:
    """Run of the box on slides, pushed evenly along each of some directions."""
    radius, gravity = 0.1, (0.0, 0.0, -_G)
    balls = {
        f"ball{i}{k}": model(
            ball("ball", _BALL_KG, radius, at=(0.5 * i - 1.0, 0.5 * k - 1.0, 2.0 * _HALF_M[2] + radius)), gravity=gravity
        )
        for i in range(_SIDE)
        for k in range(_SIDE)
    }
    on_ground = {"name": "ground", "between": ["box", "floor/ground"], "restitution": 0.0, "mu": _MU_GROUND}
    on_box = [{"between": ["box", f"{name}/ball"], "restitution": 0.0, "mu": _MU_BALL} for name in balls]
    joints = slide("x", "1 0 0") + slide("y", "0 1 0") + slide("z", "0 0 1")
    motors = "".join(f'<motor name="{axis}" joint="{axis}"/>' for axis in directions)
    share = _PUSH_N / math.sqrt(len(directions))
    return run_scene(
        model(
            box("box", _BOX_KG, _HALF_M, joint=joints, at=(0, 0, _HALF_M[2])),
            gravity=gravity,
            more=f"<actuator>{motors}</actuator>",
        ),
        {**balls, "floor": model(ground(), gravity=gravity)},
        conservative=False,
        contacts={"rules": [on_ground, *on_box]},
        phases=[{"name": "push", "until": "end", "controllers": {axis: constant(axis, share) for axis in directions}}],
        **times(step_s, _SECONDS),
    )


def _values() -> Values:
    values = {}
    for key in _BEST:
        directions, _, step = key.partition("_")
        run = _pushed(float(step), directions)
        time = np.array(run.time)
        share = np.array([float(axis in directions) for axis in "xyz"]) / math.sqrt(len(directions))
        off = np.column_stack([states(run, f"v_robot_{axis}")[:, 0] for axis in "xyz"]) - np.outer(_BOX_A * time, share)
        balls = [states(run, f"v_ball{i}{k}_free")[:, :3] for i in range(_SIDE) for k in range(_SIDE)]
        rolled = np.outer(_BALL_A * time, share)
        values[key] = max(float(np.mean(np.sum(off**2 + (each - rolled) ** 2, axis=1))) for each in balls)
        if directions == "y":
            values |= {"box": states(run, "v_robot_y")[-1, 0] / _SECONDS, "ball": balls[0][-1, 1] / _SECONDS}
    return values


_WHERE = {"y": "along y", "xy": "along the diagonal"}

CASES = (
    ValidationCase(
        "simbenchmark-rolling",
        "SimBenchmark: 25 balls roll on a pushed box",
        Topic.FRICTION,
        Origin.PUBLISHED,
        "Kang & Hwangbo 2018, SimBenchmark (leggedrobotics/SimBenchmark, commit 3fd1764), rolling test, closed"
        " form and table (data/rolling/sample.csv)",
        f"Box of 10 kg, mu = 0.4 to the ground, pushed by 150 N; 5 x 5 balls of 1 kg, mu = 0.8; {_SECONDS:g} s. Mean"
        " over the steps of the squared errors of the velocities of the box and of a ball, the worst of the 25. Printed:"
        " Bullet, the best engine there. At 10 ms along y ODE has 8.7e-9, RaiSim 4.2e-7, MuJoCo 0.11 to 0.18, DART 0.43"
        " m^2/s^2; along the diagonal RaiSim 4.2e-7, MuJoCo 0.11 to 0.21, ODE and DART 3.1 m^2/s^2. Not as there: the"
        " box cannot turn, and size and places of the balls are ours; the formula has none of them.",
        (
            *(
                Number(
                    key,
                    f"pushed {_WHERE[key.partition('_')[0]]}, {1e3 * float(key.partition('_')[2]):g} ms: mean squared"
                    " error of both velocities, m^2/s^2",
                    best,
                    at_most=True,
                )
                for key, best in _BEST.items()
            ),
            Number(
                "box",
                "acceleration of the box, m/s^2",
                text_of(_BOX_A),
                1e-9,
                "constant forces: rounding",
                source="closed form",
            ),
            Number(
                "ball",
                "acceleration of the balls, m/s^2",
                text_of(_BALL_A),
                1e-9,
                "constant forces: rounding",
                source="closed form",
            ),
        ),
        _values,
    ),
)
