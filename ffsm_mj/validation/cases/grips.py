"""Grips by friction: two fingers hold a free cube up to Coulomb's limit, lose it above, and let it swing."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ffsm_mj.analysis.run import Run
from ffsm_mj.validation.case import Number, Origin, Topic, ValidationCase, Values
from ffsm_mj.validation.scene import (
    body,
    constant,
    final,
    growing,
    model,
    motors,
    rule,
    run_scene,
    slide,
    slides,
    text_of,
    throughout,
    times,
    touching,
    vector,
)

_TIPS = {"ball": ('type="sphere" size="0.02"', 0.02), "plate": ('type="box" size="0.04 0.01 0.04"', 0.01)}
"""Geom of a finger and how far it reaches towards the cube, m."""
_HALF_M, _CUBE_KG, _CUBE_KG_M2 = 0.05, 2.0, 0.004
_STEP_S = 2e-3


def _gripper(tip: str, base_kg: float, finger_kg: float, origin_m: float, stiffness: float) -> str:
    """MJCF of a base with two fingers that close along y, thrust along z; ``origin_m``: where it acts, x in the base."""
    geom, thick = _TIPS[tip]

    def finger(name: str, y: float) -> str:
        at, centre, joint = (-origin_m, y, 0.0), (0.0, -y, 0.0), slide(name, "0 1 0")
        return body(name, finger_kg, [1e-9] * 3, joint=joint, at=at, centre=centre, geom=geom)

    spring = f' stiffness="{stiffness}"' if stiffness else ""
    joints = f"""{slides("xy")}<joint name="z" type="slide" axis="0 0 1"{spring}/>
      <joint name="turn" type="ball"/>"""
    base = f"""<body name="base" pos="{origin_m!r} 0 0">{joints}
      <inertial pos="{-origin_m!r} 0 0" mass="{base_kg}" diaginertia="0.8 0.9 1.0"/>
      {finger("left", _HALF_M + thick)}{finger("right", -_HALF_M - thick)}</body>"""
    return model(base, more=motors("left", "right", "z"))


def _gripped(
    tip: str,
    thrust: tuple[Mapping[str, Any], Mapping[str, str]] | None,
    duration_s: float,
    *,
    mu: float,
    grip_N: float,
    base_kg: float = 8.0,
    finger_kg: float = 1.0,
    step_s: float = _STEP_S,
    centre_m: float = 0.0,
    origin_m: float = 0.0,
    stiffness: float = 0.0,
    speed: float = 0.0,
) -> Run:
    """Run of a cube in the fingers.

    Args:
        tip: Kind of the fingers.
        thrust: Law of the thrust on the base, and its files.
        duration_s: Time.
        mu: Friction of both tips.
        grip_N: Force of each finger.
        base_kg: Mass of the base.
        finger_kg: Mass of each finger.
        step_s: Step and control period.
        centre_m: Mass centre of the cube, x in the cube.
        origin_m: Where the thrust acts, x in the base.
        stiffness: Stiffness of a spring along z between the base and the world, N/m.
        speed: Of all bodies along z at the start, m/s.
    """
    geom = f'type="box" size="{vector([_HALF_M] * 3)}"'
    cube = body("cube", _CUBE_KG, [_CUBE_KG_M2] * 3, centre=(centre_m, 0.0, 0.0), geom=geom)
    laws: dict[str, Any] = {"left": constant("left", -grip_N), "right": constant("right", grip_N)}
    files: Mapping[str, str] = {}
    if thrust is not None:
        laws["thrust"], files = thrust
    return run_scene(
        _gripper(tip, base_kg, finger_kg, origin_m, stiffness),
        {"cube": model(cube)},
        files,
        conservative=False,
        initial={"rates": {"robot/z": speed, "cube/free": [0, 0, speed, 0, 0, 0]}},
        contacts=touching(*(rule(name, "cube/cube", 0.0, mu, name) for name in ("left", "right"))),
        phases=throughout(**laws),
        **times(step_s, duration_s),
    )


def _slip_s(run: Run) -> float:
    """Time at which both pads begin to slip; the mean of no time is not a number."""
    times = [record.time_s for record in run.records["contact_slips"]]
    return times[0] if len(times) == 2 and times[0] == times[1] else math.nan


def _behind(run: Run) -> tuple[float, float]:
    """Speed and way of the cube along z relative to the base, m/s and m."""
    speed = final(run, "v_cube_free")[2] - final(run, "v_robot_z")[0]
    return float(speed), float(final(run, "q_cube_free")[2] - final(run, "q_robot_z")[0])


def _too_heavy() -> Values:
    values: dict[str, float] = {}
    for tip in _TIPS:
        run = _gripped(tip, growing("z", 48.0, _STEP_S, 0.6), 0.6, mu=0.4, grip_N=5.0)
        speed, way = _behind(run)
        values |= {f"{tip}_slip_s": _slip_s(run), f"{tip}_speed": speed, f"{tip}_way": way}
        values[f"{tip}_heat"] = float(run["balance.friction_heat_J"][-1])
    off_centre, common = 0.02, 0.04 / 12.0
    run = _gripped(
        "plate", growing("z", 480.0, _STEP_S, 0.052), 0.052, mu=0.4, grip_N=5.0, centre_m=off_centre, origin_m=common
    )
    return values | {"off_centre": _slip_s(run)}


_SPRING_N_M, _START_M_S, _ALL_KG = 400.0, 0.5, 12.0
_OMEGA = math.sqrt(_SPRING_N_M / _ALL_KG)
_SHAKEN_S = math.asin(2.0 * 0.4 * 5.0 / (_CUBE_KG * _OMEGA * _START_M_S)) / _OMEGA


def _shaken() -> Values:
    run = _gripped("plate", None, 0.2, mu=0.4, grip_N=5.0, stiffness=_SPRING_N_M, speed=_START_M_S)
    return {"slip_s": _slip_s(run), "cube": float(final(run, "v_cube_free")[2]), "base": float(final(run, "v_robot_z")[0])}


def _shaken_after() -> tuple[float, float]:
    """Speeds of cube and base at 0.2 s: the cube under 2 mu N, the base on its spring under the reaction."""
    left_s, force, base_kg = 0.2 - _SHAKEN_S, 2.0 * 0.4 * 5.0, _ALL_KG - _CUBE_KG
    speed, place = _START_M_S * math.cos(_OMEGA * _SHAKEN_S), _START_M_S / _OMEGA * math.sin(_OMEGA * _SHAKEN_S)
    alone, rest = math.sqrt(_SPRING_N_M / base_kg), force / _SPRING_N_M
    base = speed * math.cos(alone * left_s) - (place - rest) * alone * math.sin(alone * left_s)
    return speed - force / _CUBE_KG * left_s, base


_SOFT: dict[str, float] = {"base_kg": 10.0, "finger_kg": 0.2, "mu": 0.7, "grip_N": 10.0}
_LIMIT_N = 2.0 * 0.7 * 10.0 * 12.4 / _CUBE_KG
"""Thrust on the base of 10.4 kg under which the cube needs 2 mu N."""


def _creep() -> Values:
    half = _gripped("plate", (constant("z", 0.5 * _LIMIT_N), {}), 10.0, step_s=0.1, **_SOFT)
    way = half["state.q_cube_free_z_m"] - half["state.q_robot_z_m"]
    values = {"way": float(np.abs(way).max()), "heat": float(half["balance.friction_heat_J"][-1])}
    for name, share in (("held", 0.99), ("lost", 1.01)):
        run = _gripped("plate", (constant("z", share * _LIMIT_N), {}), 0.04, step_s=4e-3, **_SOFT)
        values[f"{name}_cube"] = float(final(run, "v_cube_free")[2]) / 0.04
        values[f"{name}_base"] = float(final(run, "v_robot_z")[0]) / 0.04
    return values


def _swing() -> Values:
    run = _gripped("ball", (constant("z", 12.0), {}), 0.3, mu=0.4, grip_N=10.0, centre_m=0.02)
    w, _, y, _ = final(run, "q_cube_free")[3:]
    return {"angle": 2.0 * math.atan2(y, w), "heat": float(run["balance.friction_heat_J"][-1])}


_TICK = "a control tick, at which the load passes the limit by 0.2 to 2 %"
_SHIFT = "place under held efforts: 4.8 m/s^3 h^2 T / 12"
_RK4, _EVEN = "RK4: (h w)^5 / 120 of a step", "constant forces: rounding"
_TIP_NAMES = {"ball": "ball tips", "plate": "flat pads"}

CASES = (
    ValidationCase(
        "grip-lost",
        "A grip holds by friction and loses a cube that becomes too heavy",
        Topic.GRIPS,
        Origin.CLOSED_FORM,
        "Coulomb: two pads give the cube at most 2 mu N, until t = 2 mu N M / (48 m); then it falls behind at 24 (t -"
        " 0.5)^2 / 10. Off its centre the flat pads hold as long as any distribution of pressure does: cone program,"
        " 2e-12",
        "Free base and fingers of 10 kg, N = 5 N, mu = 0.4, cube of 2 kg, thrust of 48 t N, 0.6 s; RK4 and control at 2"
        " ms, the thrust of each tick at its mean. Off centre: mass centre of the cube 2 cm aside, 480 t N through the"
        " common centre.",
        (
            *(
                Number(f"{tip}_{key}", f"{name}: {what}", text, tolerance, why)
                for tip, name in _TIP_NAMES.items()
                for key, what, text, tolerance, why in (
                    ("slip_s", "both begin to slip, s", "0.5", 1e-9, _TICK),
                    ("speed", "relative speed, m/s", "-0.024", 1e-12, "impulses of ticks are exact: rounding"),
                    ("way", "relative way, m", "-0.0008", 2e-7, _SHIFT),
                    ("heat", "heat of friction, J", "0.0032", 1e-6, "4 N times the way"),
                )
            ),
            Number("off_centre", "off centre: both begin to slip, s", "0.05", 1e-9, _TICK),
        ),
        _too_heavy,
    ),
    ValidationCase(
        "grip-shaken",
        "A grip on a vibrating base slips inside a step",
        Topic.GRIPS,
        Origin.CLOSED_FORM,
        "Harmonic motion of 12 kg on a spring until m w v0 sin(w t) = 2 mu N; then the base alone on its spring under the"
        " reaction of 2 mu N",
        "The gripper of the case above with flat pads, its base on a spring of 400 N/m, at 0.5 m/s; RK4 at 2 ms.",
        (
            Number("slip_s", "both begin to slip, s", text_of(_SHAKEN_S), 1e-10, f"{_RK4}, 66 steps"),
            *(
                Number(name, f"speed of the {name} at 0.2 s, m/s", text_of(speed), 1e-9, f"{_RK4}, 100 steps")
                for name, speed in zip(("cube", "base"), _shaken_after(), strict=True)
            ),
        ),
        _shaken,
    ),
    ValidationCase(
        "grip-creep",
        "A grip at half its limit does not creep",
        Topic.GRIPS,
        Origin.CLOSED_FORM,
        "Coulomb: no slip below 2 mu N, above it the cube has 2 mu N / m. The question of google-deepmind/mujoco issue"
        " 3328 (a capsule creeps out of a grip at 0.05 to 2.3 mm/s), without weight",
        "Base of 10 kg, fingers of 0.2 kg, flat pads pressed by 10 N, mu = 0.7, cube of 2 kg, base pushed along the"
        " pads so that the cube needs half of 2 mu N, for 10 s and 175 m; RK4 at 0.1 s. And at 0.99 and 1.01 of the"
        " limit for 40 ms.",
        (
            Number("way", "largest slip in 10 s, m", "0", 1e-10, "rounding of places of 175 m in 100 steps"),
            Number("heat", "heat of friction, J", "0", 1e-15, "none"),
            *(
                Number(
                    f"{key}_{body}", f"{share} of the limit: acceleration of the {body}, m/s^2", text_of(value), 1e-9, _EVEN
                )
                for key, share, body, value in (
                    ("held", 0.99, "cube", 0.99 * 7.0),
                    ("held", 0.99, "base", 0.99 * 7.0),
                    ("lost", 1.01, "cube", 7.0),
                    ("lost", 1.01, "base", (1.01 * _LIMIT_N - 14.0) / 10.4),
                )
            ),
        ),
        _creep,
    ),
    ValidationCase(
        "grip-swing",
        "A cube swings between ball tips as on a hinge",
        Topic.GRIPS,
        Origin.CLOSED_FORM,
        "The same motion with a hinge in place of the tips: base and hinged cube, integrated apart by DOP853 to 1e-13",
        "Gripper of 10 kg with ball tips, N = 10 N, mu = 0.4; mass centre of the cube 2 cm off the line of the tips,"
        " thrust of 12 N for 0.3 s; RK4 at 2 ms.",
        (
            Number("angle", "angle of the cube, rad", "0.383815560117", 5e-12, "RK4 at 2 ms: 1.2e-12 measured, order 4"),
            Number("heat", "heat of friction, J", "0", 1e-15, "sticking does no work"),
        ),
        _swing,
    ),
)
