"""The compass walker: a step from the fixed point of its gait, with the heel strike as a plastic impact."""

from __future__ import annotations

import math

import numpy as np

from ffsm_mj.validation.case import Number, Origin, Topic, ValidationCase, Values
from ffsm_mj.validation.scene import model, run_scene, slide, times

_HIP_KG, _LEG_KG, _ABOVE_FOOT_M, _BELOW_HIP_M, _G = 10.0, 5.0, 0.5, 0.5, 9.81
_FOOT_M, _POINT_KG_M2 = 1e-7, 1e-10
_PRINTED = {"swing": "-0.323389", "stance": "0.218669", "swing_rate": "-0.377377", "stance_rate": "-1.092386"}
_INTEGRATED = {
    "swing": "-0.32338856",
    "stance": "0.21866880",
    "swing_rate": "-0.37737395",
    "stance_rate": "-1.09238359",
    "period": "0.73434639",
}
_STEEPER = {"swing": -0.32377462, "stance": 0.21877462, "swing_rate": -0.37613459, "stance_rate": -1.09286681}
"""Fixed point at 0.0525 rad, by the same reduced model."""


def _leg(name: str) -> str:
    return f"""<body name="{name}"><joint name="{name}" axis="0 -1 0"/>
      <inertial pos="0 0 {-_BELOW_HIP_M}" mass="{_LEG_KG}" diaginertia="{_POINT_KG_M2} {_POINT_KG_M2} {_POINT_KG_M2}"/>
      <geom name="{name}_foot" type="sphere" size="{_FOOT_M}" pos="0 0 {-_BELOW_HIP_M - _ABOVE_FOOT_M}" mass="0"/></body>"""


def _stone(x: float, z: float) -> str:
    geom = f'<geom name="stone" type="box" size="0.05 0.05 0.05" pos="{x!r} 0 {z - 0.05!r}"/>'
    return model(geom, gravity=(0.0, 0.0, -_G))


def _step(state: dict[str, float]) -> dict[str, float]:
    """State of the legs after a step, angles from the vertical; the swing foot begins where the last step ended."""
    stance, swing, stance_rate, swing_rate = (state[key] for key in ("stance", "swing", "stance_rate", "swing_rate"))
    hip_x, hip_z = -math.sin(stance), math.cos(stance)
    next_x, next_z = -(hip_x + math.sin(swing)), -(hip_z - math.cos(swing))
    walker = f"""<body name="hip" pos="{hip_x!r} 0 {hip_z + _FOOT_M!r}">{slide("x", "1 0 0")}{slide("z", "0 0 1")}
      <inertial pos="0 0 0" mass="{_HIP_KG}" diaginertia="1 1 1"/><geom name="hip" size="0.01" mass="0"/>
      {_leg("stance")}{_leg("swing")}</body>"""
    rates = {"x": -stance_rate * hip_z, "z": stance_rate * hip_x, "stance": stance_rate, "swing": swing_rate}
    feet = {"stance_foot": "stone/stone", "swing_foot": "next/stone"}
    run = run_scene(
        model(walker, gravity=(0.0, 0.0, -_G)),
        {"stone": _stone(0.0, 0.0), "next": _stone(next_x, next_z)},
        conservative=False,
        initial={
            "joints": {"robot/stance": stance, "robot/swing": swing},
            "rates": {f"robot/{name}": rate for name, rate in rates.items()},
        },
        contacts={
            "rules": [
                {"name": foot, "between": [foot, stone], "restitution": 0.0, "mu": 10.0} for foot, stone in feet.items()
            ]
        },
        **times(2e-3, 0.736),
    )
    strike = next(hit for hit in run.impacts if hit.pair == "swing_foot")
    after = {leg: float(np.ravel(strike.qvel_after[f"robot/{leg}"])[0]) for leg in ("stance", "swing")}
    return {
        "period": strike.time_s,
        "stance": float(strike.qpos[3]),
        "swing": float(strike.qpos[2]),
        "stance_rate": after["swing"],
        "swing_rate": after["stance"],
    }


def _energy(state: dict[str, float]) -> float:
    """Mechanical energy after a step, zero at rest at the stance foot, J."""
    stance, swing, stance_rate, swing_rate = (state[key] for key in ("stance", "swing", "stance_rate", "swing_rate"))
    length = _ABOVE_FOOT_M + _BELOW_HIP_M
    hip = length * stance_rate * np.array([math.cos(stance), math.sin(stance)])
    leg = hip - _BELOW_HIP_M * swing_rate * np.array([math.cos(swing), math.sin(swing)])
    kinetic = 0.5 * _LEG_KG * (_ABOVE_FOOT_M * stance_rate) ** 2 + 0.5 * _HIP_KG * hip @ hip + 0.5 * _LEG_KG * leg @ leg
    heights = _LEG_KG * _ABOVE_FOOT_M + _HIP_KG * length + _LEG_KG * length
    return float(kinetic + _G * (heights * math.cos(stance) - _LEG_KG * _BELOW_HIP_M * math.cos(swing)))


def _values() -> Values:
    after = _step({key: float(_INTEGRATED[key]) for key in _PRINTED})
    return after | {"energy": _energy(_step(_STEEPER))}


_WHAT = {
    "swing": "swing angle after, rad",
    "stance": "stance angle after, rad",
    "swing_rate": "swing rate after, rad/s",
    "stance_rate": "stance rate after, rad/s",
    "period": "time of a step, s",
}
_SIMULATED = (
    "the printed state is where a simulation had come to, not a fixed point to its last digit: the equations,"
    " integrated apart, give our digits"
)
_POINTS = "digits of the reduced model, and legs with point masses of 1e-10 kg m^2"


def _printed(key: str, text: str) -> Number:
    if "rate" in key:
        return Number(key, _WHAT[key], text, source="program", known=_SIMULATED)
    return Number(key, _WHAT[key], text, source="program")


CASES = (
    ValidationCase(
        "compass-walker",
        "The compass walker: the fixed point of its gait",
        Topic.SEVERAL_CONTACTS,
        Origin.PUBLISHED,
        "Model of Goswami, Espiau & Keramane 1996 and Goswami, Thuilot & Espiau 1998, A study of the passive gait of a"
        " compass-like biped robot: symmetry and chaos, Int. J. Robotics Research 17(12):1282-1301. Digits of its limit"
        " cycle on 3 degrees: public"
        " programs of hybrid simulation (initial state of Hybrid_Systems_Simulation, 6 digits; reference energy of"
        " unstable-zeros/learning-hcbfs, commit 8f9b433). 8 digits: equations of the two legs and conservation of"
        " angular momentum at the strike, integrated apart by DOP853 to 1e-13",
        "Hip of 10 kg, legs of 5 kg at half their length of 1 m, point feet, g = 9.81 m/s^2; stepping stones, as the"
        " swing foot passes through the ground; e = 0, mu = 10. RK4 at 2 ms. One step from the fixed point.",
        (
            *(_printed(key, text) for key, text in _PRINTED.items()),
            Number(
                "energy",
                "energy of the gait at 0.0525 rad, J",
                "153.244",
                known="153.2448 by the equations, so the printed digits were cut, not rounded",
                source="program",
            ),
            *(Number(key, _WHAT[key], text, 1e-7, _POINTS, source="equations") for key, text in _INTEGRATED.items()),
        ),
        _values,
        "The programs name the slope 3 degrees, and 0.0525 rad in models after Drake's compass gait; the energy fits"
        " the second.",
    ),
)
