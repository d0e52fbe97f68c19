"""SimBenchmark's tests: ANYmal in free flight, 25 balls on a pushed box, bouncing balls."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from ffsm_mj.analysis.run import Run
from ffsm_mj.validation.case import Number, Origin, Topic, ValidationCase, Values
from ffsm_mj.validation.scene import (
    FREE,
    ball,
    box,
    constant,
    ground,
    model,
    motors,
    rock,
    rule,
    run_scene,
    slides,
    states,
    text_of,
    throughout,
    times,
    touching,
    vector,
)

_LEGS = {"LF": (1, 1), "RF": (1, -1), "LH": (-1, 1), "RH": (-1, -1)}
"""Signs of a leg's place: fore or hind, left or right."""
_JOINTS = ("HAA", "HFE", "KFE")
_MASS_KG = 33.946674
_PAPER = "Kang & Hwangbo 2018, SimBenchmark (leggedrobotics/SimBenchmark, commit 3fd1764)"


_PARTS = {
    "HIP": (0.00123301508523, -6.4285329973e-05, 6.9990104e-08, 0.000993231183395, 2.327401345e-06, 0.00142160349098),
    "THIGH": (0.0147571628275, -1.7996507882e-05, 0.000205877679383, 0.0144188925719, -0.00181291342366, 0.00178449075964),
    "SHANK": (0.0037693717909, -7.7334500762e-05, -0.000152069372983, 0.00400446467635, -0.0003218356083, 0.000418471691904),
    "FOOT": (8.3086410294e-05, 4.16901601e-07, 3.99054799e-07, 8.2860209667e-05, -3.45712252e-07, 8.1948124086e-05),
}
"""Ixx, Ixy, Ixz, Iyy, Iyz, Izz of the parts of a leg in front at the left, about their mass centres."""


def _inertial(at: Sequence[float], mass: float, inertia: Sequence[float]) -> str:
    """Inertia as Ixx, Ixy, Ixz, Iyy, Iyz, Izz about the mass centre."""
    xx, xy, xz, yy, yz, zz = inertia
    return f'<inertial pos="{vector(at)}" mass="{mass}" fullinertia="{vector((xx, yy, zz, xy, xz, yz))}"/>'


def _leg(name: str, x: int, y: int) -> str:
    def inertial(part: str, at: Sequence[float], mass: float) -> str:
        """Products of inertia of a mirrored part change their signs."""
        signs = (1, x * y, x, 1, y, 1)
        return _inertial(at, mass, [sign * value for sign, value in zip(signs, _PARTS[part], strict=True)])

    return f"""<body name="{name}_HIP" pos="{vector((x * 0.2629, y * 0.115, 0))}"><joint name="{name}_HAA" axis="1 0 0"/>
      {inertial("HIP", (x * 0.0542, -y * 0.0136, 0), 1.1064)}
      <geom name="{name}_HIP" type="cylinder" size="0.04 0.04" pos="{vector((x * 0.0585, y * 0.0315, 0))}"
        euler="{math.pi / 2} 0 0" mass="0"/>
      <body name="{name}_THIGH" pos="{vector((x * 0.0585, y * 0.0315, 0))}"><joint name="{name}_HFE" axis="0 1 0"/>
        {inertial("THIGH", (x * 0.0008, y * 0.0545, -0.1975), 1.51)}
        <geom name="{name}_THIGH" type="cylinder" size="0.04 0.04" pos="{vector((0, y * 0.07, -0.25))}"
          euler="{math.pi / 2} 0 0" mass="0"/>
        <body name="{name}_SHANK" pos="{vector((0, y * 0.111, -0.25))}"><joint name="{name}_KFE" axis="0 1 0"/>
          {inertial("SHANK", (x * 0.016355414056, -y * 0.00562219106, -0.064350437219), 0.318)}
          <geom name="{name}_SHANK" type="cylinder" size="0.015 0.095" pos="{vector((x * 0.06, -y * 0.03, -0.18))}"
            euler="0 {x * 0.34} 0" mass="0"/>
          <body name="{name}_FOOT" pos="{vector((0, -y * 0.016, -0.31))}" euler="{y * 0.323} {x * 0.549} 0">
            {inertial("FOOT", (-x * 5.552058e-06, y * 7.1133124e-05, -0.021388647779), 0.1922685)}
            <geom name="{name}_FOOT" type="sphere" size="0.03" mass="0"/></body></body></body></body>"""


def _anymal(joints: str, *, gravity: tuple[float, ...] = (0.0, 0.0, 0.0), more: str = "") -> str:
    """MJCF of ANYmal, model Beth, from its masses and dimensions; angles in radians, fixed axes x, y, z."""
    base = (0.268388530624, 0.000775392455422, -0.0151848534451, 0.884235660795, -0.000989297489507, 0.829158678306)
    legs = "".join(_leg(name, x, y) for name, (x, y) in _LEGS.items())
    body = f"""<body name="base">{joints}{_inertial((0, 0, 0), 21.39, base)}
      <geom name="base" type="box" size="0.2655 0.116 0.13" pos="0 0 0.08" mass="0"/>
      <body name="imu" pos="0.0245 -0.04255 0.1857" euler="{math.pi} 0 0">
        {_inertial((0, 0, 0), 0.05, (1.60333333333e-05, 0, 0, 2.80333333333e-05, 0, 2.80333333333e-05))}
        <geom name="imu" type="box" size="0.029 0.029 0.011" pos="0 0 0.011" mass="0"/></body>{legs}</body>"""
    compiler = '<mujoco><compiler angle="radian" eulerseq="XYZ"/>'
    return model(body, gravity=gravity, more=more).replace("<mujoco>", compiler, 1)


def _posture() -> dict[str, float]:
    """Angles of the joints, rad."""
    fold = {"LF": (0.03, 0.4, -0.8), "RF": (-0.03, 0.4, -0.8), "LH": (0.03, -0.4, 0.8), "RH": (-0.03, -0.4, 0.8)}
    return {
        f"robot/{leg}_{joint}": angle for leg, angles in fold.items() for joint, angle in zip(_JOINTS, angles, strict=True)
    }


_MOMENTUM = {"4e-3": "3.52388e-07", "1e-2": "2.39822e-05"}
"""MuJoCo with RK4, the best of the engines there that integrate joints."""


_ODE = (
    "ODE keeps the momentum to rounding at any step, since it integrates each body's own velocity; its joints are kept by"
    " constraints, and its mean squared error of the energy is 62 J^2 in the next test"
)


def _momentum() -> Values:
    values: dict[str, float] = {}
    touched = ["base", "imu", *(f"{leg}_{part}" for leg in _LEGS for part in ("HIP", "THIGH", "SHANK", "FOOT"))]
    for text in _MOMENTUM:
        run = run_scene(
            _anymal(FREE),
            {"ball": model(ball("ball", 10.0, 0.2, at=(0, -5, 0)))},
            initial={"joints": _posture(), "rates": {"ball/free": [0, 5.0, 0, 0, 0, 0]}},
            contacts=touching(*(rule(geom, "ball/ball", 0.0) for geom in touched)),
            **times(float(text), 10.0),
        )
        momentum = np.column_stack([run[f"momentum.total_P_{axis}_N_s"] for axis in "xyz"])
        values[text] = float(np.mean(np.sum((momentum - (0.0, 50.0, 0.0)) ** 2, axis=1)))
        first = run.impacts[0]
        values |= {"time": first.time_s, "impulse": first.impulse_N_s, "loss": -first.energy_change_J}
    return values


_ENERGY = {"1e-3": "1.6273e-17", "4e-3": "4.50248e-14", "1e-2": "5.56596e-11"}


def _energy() -> Values:
    """A second of lift with twice the weight, then two seconds of fall: energy from the first instant of the fall."""
    lift = 2.0 * _MASS_KG * 9.81
    joints = slides("xyz") + '<joint name="turn" type="ball"/>'
    values = {}
    for text in _ENERGY:
        run = run_scene(
            _anymal(joints, gravity=(0, 0, -9.81), more=motors("z")),
            rock((0, 0, -9.81)),
            conservative=False,
            initial={"joints": _posture()},
            phases=[
                {"name": "lift", "for_s": 1.0, "controller": constant("z", lift)},
                {"name": "fall", "until": "end", "controller": {"kind": "off"}},
            ],
            **times(float(text), 3.0),
        )
        falling = np.array(run.time) >= 1.0 - 1e-9
        energy = run["energy.robot_J"][falling] - run["balance.robot_gravity_work_J"][falling]
        values[text] = float(np.mean((energy - energy[0]) ** 2))

    return values


_BOX_KG, _BALL_KG, _SIDE, _MU_GROUND, _MU_BALL, _PUSH_N, _G = 10.0, 1.0, 5, 0.4, 0.8, 150.0, 9.81
_SECONDS = 4.0
_COUNT = _SIDE**2
_DOWN = (0.0, 0.0, -_G)
_ON_GROUND_N = _MU_GROUND * (_BOX_KG + _COUNT * _BALL_KG) * _G
_ON_BALL_N = (_PUSH_N - _ON_GROUND_N) / _BOX_KG / (3.5 / _BALL_KG + _COUNT / _BOX_KG)
_BOX_A = (_PUSH_N - _ON_GROUND_N - _COUNT * _ON_BALL_N) / _BOX_KG
_BALL_A = _ON_BALL_N / _BALL_KG
_HALF_M = (10.0, 10.0, 0.05)
_BEST = {"y_1e-2": "4.38984e-09", "y_4e-2": "4.11572e-09", "xy_1e-2": "7.54888e-09"}
"""Bullet, the best of the engines there, by direction of the push and step."""


def _pushed(step_s: float, directions: str) -> Run:
    """Run of the box on slides, pushed evenly along each of some directions."""
    radius = 0.1
    balls = {
        f"ball{i}{k}": model(
            ball("ball", _BALL_KG, radius, at=(0.5 * i - 1.0, 0.5 * k - 1.0, 2.0 * _HALF_M[2] + radius)), gravity=_DOWN
        )
        for i in range(_SIDE)
        for k in range(_SIDE)
    }
    on_ground = rule("box", "floor/ground", 0.0, _MU_GROUND, "ground")
    on_box = [rule("box", f"{name}/ball", 0.0, _MU_BALL) for name in balls]
    share = _PUSH_N / math.sqrt(len(directions))
    return run_scene(
        model(
            box("box", _BOX_KG, _HALF_M, joint=slides("xyz"), at=(0, 0, _HALF_M[2])), gravity=_DOWN, more=motors(*directions)
        ),
        {**balls, "floor": model(ground(), gravity=_DOWN)},
        conservative=False,
        contacts=touching(on_ground, *on_box),
        phases=throughout(**{axis: constant(axis, share) for axis in directions}),
        **times(step_s, _SECONDS),
    )


def _rolling() -> Values:
    values = {}
    for key in _BEST:
        directions, _, step = key.partition("_")
        run = _pushed(float(step), directions)
        time = np.array(run.time)
        share = np.array([float(axis in directions) for axis in "xyz"]) / math.sqrt(len(directions))
        off = np.column_stack([states(run, f"v_robot_{axis}")[:, 0] for axis in "xyz"]) - np.outer(_BOX_A * time, share)
        balls = [states(run, f"v_ball{i}{k}_free")[:, :3] for i in range(_SIDE) for k in range(_SIDE)]
        rolled = np.outer(_BALL_A * time, share)
        values[key] = max(float(np.mean(np.sum(off**2 + (ball - rolled) ** 2, axis=1))) for ball in balls)
        if directions == "y":
            values |= {"box": states(run, "v_robot_y")[-1, 0] / _SECONDS, "ball": balls[0][-1, 1] / _SECONDS}
    return values


_WHERE = {"y": "along y", "xy": "along the diagonal"}

_BOUNCING, _BOUNCING_KG, _RADIUS_M, _HEIGHT_M, _BOUNCING_S = 49, 10.0, 0.1, 5.0, 20.0
_STEPS_S = {"1e-3": "0.0186204", "4e-3": "4.76468", "1e-2": "185.953"}


def _energy_errors() -> Values:
    """All balls do the same; one of them is simulated."""
    errors = {}
    for text in _STEPS_S:
        run = run_scene(
            model(ball("ball", _BOUNCING_KG, _RADIUS_M, joint=slides("z"), at=(0, 0, _HEIGHT_M)), gravity=_DOWN),
            {"floor": model(ground(), gravity=_DOWN)},
            conservative=False,
            contacts=touching(rule("ball", "floor/ground", 1.0)),
            **times(float(text), _BOUNCING_S),
        )
        height, speed = states(run, "q_robot_z")[:, 0] + _HEIGHT_M, states(run, "v_robot_z")[:, 0]
        energy = _BOUNCING_KG * (0.5 * speed**2 + _G * height)
        off = _BOUNCING * (energy + _BOUNCING_KG * -_G * _HEIGHT_M)
        errors[text] = float(np.mean(off**2))
    return errors


def _errors(what: str, best: Mapping[str, str]) -> tuple[Number, ...]:
    """Mean squared errors by step, none larger than those of the best engine there."""
    return tuple(
        Number(step, f"mean squared error of the {what.format(1e3 * float(step))}", text, at_most=True)
        for step, text in best.items()
    )


_LOCATED, _PRINTED = "4.684 m at 5 m/s: event localisation to 1e-13 s", "inertias are printed to 12 digits"
_CONSTANT = "constant forces: rounding"

CASES = (
    ValidationCase(
        "simbenchmark-momentum",
        "SimBenchmark: ANYmal is hit by a ball in free flight, momentum over 10 s",
        Topic.IMPACTS,
        Origin.PUBLISHED,
        f"{_PAPER}, momentum test, closed form and sample table;"
        " first impact: Pinocchio 4.1, `impulseDynamics` on the same model",
        "ANYmal of 33.95 kg with 12 free joints, zero gravity, ball of 10 kg at 5 m/s, e = 0, no friction; mean"
        " over the steps"
        " of |P - P0|^2. Printed: MuJoCo with RK4. At 4 ms Bullet has 4.3e-3, MuJoCo with Euler 1.3e-2, RaiSim 9.2e-4,"
        " DART 150 (N s)^2.",
        (
            *_errors("momentum at {:g} ms, (N s)^2", _MOMENTUM),
            Number("4e-3", "the same at 4 ms beside ODE's, (N s)^2", "1.21657e-27", at_most=True, known=_ODE),
            Number("time", "first impact, s", "0.9368", 1e-12, _LOCATED, source="closed form"),
            Number("impulse", "its impulse, N s", "37.05451872138856", 2e-10, _PRINTED, source="Pinocchio 4.1"),
            Number("loss", "its loss of energy, J", "92.6362968034714", 1e-9, _PRINTED, source="Pinocchio 4.1"),
        ),
        _momentum,
        "Overlaps of legs with legs are reported by the run, not resolved.",
    ),
    ValidationCase(
        "simbenchmark-energy",
        "SimBenchmark: ANYmal is thrown up and falls, energy over 2 s",
        Topic.FREE_MOTION,
        Origin.PUBLISHED,
        f"{_PAPER}, energy test, closed form and sample table",
        "Lifted by twice its weight for 1 s, then free for 2 s, no contacts; mean over the steps of (E - E0)^2."
        " Printed: MuJoCo with RK4, which is our integrator too. At 1 ms RaiSim has 1.2e-2, MuJoCo with Euler 3.5,"
        " Bullet 3.7, ODE 3.9, DART 237 J^2.",
        _errors("energy at {:g} ms, J^2", _ENERGY),
        _energy,
    ),
    ValidationCase(
        "simbenchmark-rolling",
        "SimBenchmark: 25 balls roll on a pushed box",
        Topic.FRICTION,
        Origin.PUBLISHED,
        f"{_PAPER}, rolling test, closed form and table (data/rolling/sample.csv)",
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
            Number("box", "acceleration of the box, m/s^2", text_of(_BOX_A), 1e-9, _CONSTANT, source="closed form"),
            Number("ball", "acceleration of the balls, m/s^2", text_of(_BALL_A), 1e-9, _CONSTANT, source="closed form"),
        ),
        _rolling,
    ),
    ValidationCase(
        "simbenchmark-bouncing",
        "SimBenchmark: 49 elastic balls, energy over 20 s",
        Topic.IMPACTS,
        Origin.PUBLISHED,
        f"{_PAPER}, bouncing test",
        "Mean over the steps of (E - E0)^2 of 49 balls of 10 kg from 5 m, e = 1; all do the same, one is simulated."
        " Printed: RaiSim, the best of the five engines there; ODE has 185 J^2 at 1 ms, Bullet 75245 J^2, DART 72274 J^2.",
        _errors("energy at h = {:g} ms, J^2", _STEPS_S),
        _energy_errors,
    ),
)
