"""The simplest walker: one step from a fixed point of its gait, with the heel strike as an impact."""

from __future__ import annotations

import math

import numpy as np

from ffsm_mj.validation.case import Number, Origin, Topic, ValidationCase, Values
from ffsm_mj.validation.scene import model, run_scene, slide, times

_SLOPE_RAD = 0.009
_FOOT_KG, _FOOT_M = 1e-6, 1e-7
_GAITS = {"long": ("0.20031090049483", "-0.19983247291764"), "short": ("0.19393736960624", "-0.20386692731962")}
_GRAVITY = math.sin(_SLOPE_RAD), 0.0, -math.cos(_SLOPE_RAD)


def _leg(name: str) -> str:
    inertia = 1e-8 * _FOOT_KG
    return f"""<body name="{name}_leg"><joint name="{name}" axis="0 -1 0"/>
      <inertial pos="0 0 -1" mass="{_FOOT_KG}" diaginertia="{inertia} {inertia} {inertia}"/>
      <geom name="{name}_foot" type="sphere" size="{_FOOT_M}" pos="0 0 -1" mass="0"/></body>"""


def _stone(x: float) -> str:
    return model(f'<geom name="stone" type="box" size="0.05 0.05 0.05" pos="{x!r} 0 -0.05"/>', gravity=_GRAVITY)


def _step(stance: float, rate: float) -> tuple[float, float]:
    """Angle of the new stance leg and its rate after a step, from those after the step before."""
    swing_rate = rate - rate * (1.0 - math.cos(2.0 * stance))
    hip = f"{-math.sin(stance)!r} 0 {_FOOT_M + math.cos(stance)!r}"
    walker = f"""<body name="hip" pos="{hip}">{slide("x", "1 0 0")}{slide("z", "0 0 1")}
      <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><geom name="hip" size="0.01" mass="0"/>
      {_leg("stance")}{_leg("swing")}</body>"""
    feet = {"stance_foot": "stone/stone", "swing_foot": "next/stone"}
    run = run_scene(
        model(walker, gravity=_GRAVITY),
        {"stone": _stone(0.0), "next": _stone(2.0 * math.sin(stance))},
        conservative=False,
        initial={
            "joints": {"robot/stance": stance, "robot/swing": -stance},
            "rates": {
                "robot/x": -rate * math.cos(stance),
                "robot/z": -rate * math.sin(stance),
                "robot/stance": rate,
                "robot/swing": swing_rate,
            },
        },
        contacts={
            "rules": [
                {"name": foot, "between": [foot, stone], "restitution": 0.0, "mu": 10.0} for foot, stone in feet.items()
            ]
        },
        **times(2e-3, 4.0),
    )
    strike = next(hit for hit in run.impacts if hit.pair == "swing_foot")
    return float(strike.qpos[3]), float(np.ravel(strike.qvel_after["robot/swing"])[0])


def _steps() -> Values:
    values = {}
    for name, (stance, rate) in _GAITS.items():
        values[f"{name}_angle"], values[f"{name}_rate"] = _step(float(stance), float(rate))
    return values


_WHY = "feet of 1e-6 of the mass of the hip instead of none: a step from the fixed point is off by some of that"

CASES = (
    ValidationCase(
        "simplest-walker",
        "The simplest walker: fixed points of its gait",
        Topic.SEVERAL_CONTACTS,
        Origin.PUBLISHED,
        "Garcia, Chatterjee, Ruina & Coleman 1998, The simplest walking model: stability, complexity, and scaling,"
        " J. Biomech. Eng. 120(2):281-288: fixed points at a slope of 0.009 rad; digits (to 1e-10) of the program that"
        " accompanies it",
        "One step from the printed fixed point. Point mass at the hip, massless legs, point feet; stepping stones"
        " instead of the ground, as the swing foot passes through the ground at mid-stance; e = 0, mu = 10. RK4 at 2 ms.",
        tuple(
            Number(f"{name}_{key}", f"{name} gait: {what} after a step, {unit}", text, 1e-5, _WHY)
            for name, texts in _GAITS.items()
            for key, what, unit, text in zip(("angle", "rate"), ("angle", "rate"), ("rad", "rad/s"), texts, strict=True)
        ),
        _steps,
    ),
)
