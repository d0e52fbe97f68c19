"""Passive walkers: a step from a fixed point of a gait, with the heel strike as an impact."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ffsm_mj.validation.case import Number, Origin, Topic, ValidationCase, Values
from ffsm_mj.validation.scene import body, model, rule, run_scene, slides, times, touching

_FOOT_M = 1e-7
_SLOPE_RAD, _FOOT_KG = 0.009, 1e-6
_GAITS = {"long": ("0.20031090049483", "-0.19983247291764"), "short": ("0.19393736960624", "-0.20386692731962")}
_HIP_KG, _LEG_KG, _ABOVE_FOOT_M, _BELOW_HIP_M, _G = 10.0, 5.0, 0.5, 0.5, 9.81
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


@dataclass(frozen=True)
class _Walker:
    """Hip with two legs of 1 m: masses in kg, place of the mass centre of a leg below the hip, its moment of inertia."""

    hip: float
    leg: float
    below: float
    moment: float
    gravity: tuple[float, float, float]

    def leg_text(self, name: str) -> str:
        foot = f'type="sphere" size="{_FOOT_M}" pos="0 0 -1"'
        joint, centre = f'<joint name="{name}" axis="0 -1 0"/>', (0.0, 0.0, -self.below)
        return body(f"{name}_foot", self.leg, [self.moment] * 3, joint=joint, centre=centre, geom=foot)

    def stone(self, x: float, z: float) -> str:
        geom = f'<geom name="stone" type="box" size="0.05 0.05 0.05" pos="{x!r} 0 {z - 0.05!r}"/>'
        return model(geom, gravity=self.gravity)

    def step(self, state: Mapping[str, float], most_s: float) -> dict[str, float]:
        """State of the legs after a step, angles from the vertical; the swing foot begins where the last step ended."""
        stance, swing, stance_rate, swing_rate = (state[key] for key in ("stance", "swing", "stance_rate", "swing_rate"))
        hip_x, hip_z = -math.sin(stance), math.cos(stance)
        next_x, next_z = -(hip_x + math.sin(swing)), -(hip_z - math.cos(swing))
        legs = self.leg_text("stance") + self.leg_text("swing")
        walker = body("hip", self.hip, [1.0] * 3, legs, joint=slides("xz"), at=(hip_x, 0.0, hip_z + _FOOT_M))
        rates = {"x": -stance_rate * hip_z, "z": stance_rate * hip_x, "stance": stance_rate, "swing": swing_rate}
        feet = {"stance_foot": "stone/stone", "swing_foot": "next/stone"}
        run = run_scene(
            model(walker, gravity=self.gravity),
            {"stone": self.stone(0.0, 0.0), "next": self.stone(next_x, next_z)},
            conservative=False,
            initial={
                "joints": {"robot/stance": stance, "robot/swing": swing},
                "rates": {f"robot/{name}": rate for name, rate in rates.items()},
            },
            contacts=touching(*(rule(foot, stone, 0.0, 10.0, foot) for foot, stone in feet.items())),
            **times(2e-3, most_s),
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


_SIMPLEST = _Walker(1.0, _FOOT_KG, 1.0, 1e-8 * _FOOT_KG, (math.sin(_SLOPE_RAD), 0.0, -math.cos(_SLOPE_RAD)))
_COMPASS = _Walker(_HIP_KG, _LEG_KG, _BELOW_HIP_M, 1e-10, (0.0, 0.0, -_G))
_WHY = "feet of 1e-6 of the mass of the hip instead of none: a step from the fixed point is off by some of that"


def _steps() -> Values:
    values = {}
    for name, (stance, rate) in ((name, map(float, texts)) for name, texts in _GAITS.items()):
        swing_rate = rate - rate * (1.0 - math.cos(2.0 * stance))
        after = _SIMPLEST.step({"stance": stance, "swing": -stance, "stance_rate": rate, "swing_rate": swing_rate}, 4.0)
        values[f"{name}_angle"], values[f"{name}_rate"] = after["stance"], after["stance_rate"]
    return values


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
    after = _COMPASS.step({key: float(_INTEGRATED[key]) for key in _PRINTED}, 0.736)
    return after | {"energy": _energy(_COMPASS.step(_STEEPER, 0.736))}


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
            *(
                Number(key, _WHAT[key], text, source="program", known=_SIMULATED if "rate" in key else "")
                for key, text in _PRINTED.items()
            ),
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
