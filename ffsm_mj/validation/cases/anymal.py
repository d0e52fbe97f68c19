"""SimBenchmark's tests with ANYmal in free flight: momentum through impacts, and energy."""

from __future__ import annotations

import math

import numpy as np

from ffsm_mj.validation.case import Number, Origin, Topic, ValidationCase, Values
from ffsm_mj.validation.scene import ball, model, run_scene, slide, times

_LEGS = {"LF": (1, 1), "RF": (1, -1), "LH": (-1, 1), "RH": (-1, -1)}
"""Signs of a leg's place: fore or hind, left or right."""
_JOINTS = ("HAA", "HFE", "KFE")
_MASS_KG = 33.946674
_SOURCE = "Kang & Hwangbo 2018, SimBenchmark (leggedrobotics/SimBenchmark, commit 3fd1764), {}, closed form and sample table"


def _inertial(at: tuple[float, ...], mass: float, inertia: tuple[float, ...]) -> str:
    """Inertia as Ixx, Ixy, Ixz, Iyy, Iyz, Izz about the mass centre."""
    xx, xy, xz, yy, yz, zz = inertia
    return f'<inertial pos="{_join(at)}" mass="{mass}" fullinertia="{_join((xx, yy, zz, xy, xz, yz))}"/>'


def _join(values: tuple[float, ...]) -> str:
    return " ".join(repr(float(value)) for value in values)


def _leg(name: str, x: int, y: int) -> str:
    hip = (
        0.00123301508523,
        -x * y * 6.4285329973e-05,
        x * 6.9990104e-08,
        0.000993231183395,
        y * 2.327401345e-06,
        0.00142160349098,
    )
    thigh = (
        0.0147571628275,
        -x * y * 1.7996507882e-05,
        x * 0.000205877679383,
        0.0144188925719,
        -y * 0.00181291342366,
        0.00178449075964,
    )
    shank = (
        0.0037693717909,
        -x * y * 7.7334500762e-05,
        -x * 0.000152069372983,
        0.00400446467635,
        -y * 0.0003218356083,
        0.000418471691904,
    )
    foot = (
        8.3086410294e-05,
        x * y * 4.16901601e-07,
        x * 3.99054799e-07,
        8.2860209667e-05,
        -y * 3.45712252e-07,
        8.1948124086e-05,
    )
    return f"""<body name="{name}_HIP" pos="{_join((x * 0.2629, y * 0.115, 0))}"><joint name="{name}_HAA" axis="1 0 0"/>
      {_inertial((x * 0.0542, -y * 0.0136, 0), 1.1064, hip)}
      <geom name="{name}_HIP" type="cylinder" size="0.04 0.04" pos="{_join((x * 0.0585, y * 0.0315, 0))}"
        euler="{math.pi / 2} 0 0" mass="0"/>
      <body name="{name}_THIGH" pos="{_join((x * 0.0585, y * 0.0315, 0))}"><joint name="{name}_HFE" axis="0 1 0"/>
        {_inertial((x * 0.0008, y * 0.0545, -0.1975), 1.51, thigh)}
        <geom name="{name}_THIGH" type="cylinder" size="0.04 0.04" pos="{_join((0, y * 0.07, -0.25))}"
          euler="{math.pi / 2} 0 0" mass="0"/>
        <body name="{name}_SHANK" pos="{_join((0, y * 0.111, -0.25))}"><joint name="{name}_KFE" axis="0 1 0"/>
          {_inertial((x * 0.016355414056, -y * 0.00562219106, -0.064350437219), 0.318, shank)}
          <geom name="{name}_SHANK" type="cylinder" size="0.015 0.095" pos="{_join((x * 0.06, -y * 0.03, -0.18))}"
            euler="0 {x * 0.34} 0" mass="0"/>
          <body name="{name}_FOOT" pos="{_join((0, -y * 0.016, -0.31))}" euler="{y * 0.323} {x * 0.549} 0">
            {_inertial((-x * 5.552058e-06, y * 7.1133124e-05, -0.021388647779), 0.1922685, foot)}
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
            _anymal('<freejoint name="free"/>'),
            {"ball": model(ball("ball", 10.0, 0.2, at=(0, -5, 0)))},
            initial={"joints": _posture(), "rates": {"ball/free": [0, 5.0, 0, 0, 0, 0]}},
            contacts={"rules": [{"between": [geom, "ball/ball"], "restitution": 0.0} for geom in touched]},
            **times(float(text), 10.0),
        )
        momentum = np.column_stack([run[f"momentum.total_P_{axis}_N_s"] for axis in "xyz"])
        values[text] = float(np.mean(np.sum((momentum - (0.0, 50.0, 0.0)) ** 2, axis=1)))
        first = run.impacts[0]
        values |= {"time": first.time_s, "impulse": first.impulse_N_s, "loss": -first.energy_change_J}
    return values


_ENERGY = {"1e-3": "1.6273e-17", "4e-3": "4.50248e-14", "1e-2": "5.56596e-11"}
_FAR_M = 1e12


def _energy() -> Values:
    """A second of lift with twice the weight, then two seconds of fall: energy from the first instant of the fall."""
    lift = 2.0 * _MASS_KG * 9.81
    joints = slide("x", "1 0 0") + slide("y", "0 1 0") + slide("z", "0 0 1") + '<joint name="turn" type="ball"/>'
    push = {"kind": "pd", "joints": ["z"], "kp": lift / _FAR_M, "kd": 0.0, "target": [_FAR_M]}
    values = {}
    for text in _ENERGY:
        run = run_scene(
            _anymal(joints, gravity=(0, 0, -9.81), more='<actuator><motor name="lift" joint="z"/></actuator>'),
            {"rock": model(ball("rock", 1.0, 0.1, at=(90, 0, 0)), gravity=(0, 0, -9.81))},
            conservative=False,
            initial={"joints": _posture()},
            phases=[
                {"name": "lift", "for_s": 1.0, "controller": push},
                {"name": "fall", "until": "end", "controller": {"kind": "off"}},
            ],
            **times(float(text), 3.0),
        )
        falling = np.array(run.time) >= 1.0 - 1e-9
        energy = run["energy.robot_J"][falling] - run["balance.robot_gravity_work_J"][falling]
        values[text] = float(np.mean((energy - energy[0]) ** 2))

    return values


CASES = (
    ValidationCase(
        "simbenchmark-momentum",
        "SimBenchmark: ANYmal is hit by a ball in free flight, momentum over 10 s",
        Topic.IMPACTS,
        Origin.PUBLISHED,
        _SOURCE.format("momentum test") + "; first impact: Pinocchio 4.1, `impulseDynamics` on the same model",
        "ANYmal of 33.95 kg with 12 free joints, zero gravity, ball of 10 kg at 5 m/s, e = 0, no friction; mean"
        " over the steps"
        " of |P - P0|^2. Printed: MuJoCo with RK4. At 4 ms Bullet has 4.3e-3, MuJoCo with Euler 1.3e-2, RaiSim 9.2e-4,"
        " DART 150 (N s)^2.",
        (
            *(
                Number(text, f"mean squared error of the momentum at {1e3 * float(text):g} ms, (N s)^2", best, at_most=True)
                for text, best in _MOMENTUM.items()
            ),
            Number("4e-3", "the same at 4 ms beside ODE's, (N s)^2", "1.21657e-27", at_most=True, known=_ODE),
            Number(
                "time",
                "first impact, s",
                "0.9368",
                1e-12,
                "4.684 m at 5 m/s: event localisation to 1e-13 s",
                source="closed form",
            ),
            Number(
                "impulse",
                "its impulse, N s",
                "37.05451872138856",
                2e-10,
                "inertias are printed to 12 digits",
                source="Pinocchio 4.1",
            ),
            Number(
                "loss",
                "its loss of energy, J",
                "92.6362968034714",
                1e-9,
                "inertias are printed to 12 digits",
                source="Pinocchio 4.1",
            ),
        ),
        _momentum,
        "Overlaps of legs with legs are reported by the run, not resolved.",
    ),
    ValidationCase(
        "simbenchmark-energy",
        "SimBenchmark: ANYmal is thrown up and falls, energy over 2 s",
        Topic.FREE_MOTION,
        Origin.PUBLISHED,
        _SOURCE.format("energy test"),
        "Lifted by twice its weight for 1 s, then free for 2 s, no contacts; mean over the steps of (E - E0)^2."
        " Printed: MuJoCo with RK4, which is our integrator too. At 1 ms RaiSim has 1.2e-2, MuJoCo with Euler 3.5,"
        " Bullet 3.7, ODE 3.9, DART 237 J^2.",
        (
            *(
                Number(text, f"mean squared error of the energy at {1e3 * float(text):g} ms, J^2", best, at_most=True)
                for text, best in _ENERGY.items()
            ),
        ),
        _energy,
    ),
)
