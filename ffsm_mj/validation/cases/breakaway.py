"""Sticking and sliding of a foot on a free plate, and of a ball in a V."""

from __future__ import annotations

import math

import numpy as np

from ffsm_mj.analysis.run import Run
from ffsm_mj.validation.case import Number, Origin, Topic, ValidationCase, Values
from ffsm_mj.validation.scene import ball, constant, final, growing, model, run_scene, slide, text_of, times

_PRESS_N, _PLATE_KG, _FOOT_KG = 1.0, 3.0, 1.0
_STEP_S = 1e-2


def _foot(mu: float, speed: float, duration_s: float, push_N_s: float = 0.0) -> Run:
    """Run of a foot on a plate, both free in x and z, pressed on each other and pushed along it by inner forces."""
    plate = f"""<body name="plate">{slide("x", "1 0 0")}{slide("z", "0 0 1")}
      <inertial pos="0 0 0" mass="{_PLATE_KG}" diaginertia="1 1 1"/><geom name="plate" type="box" size="5 5 0.1" mass="0"/>
      <body name="foot" pos="0 0 0.2">{slide("along", "1 0 0")}{slide("across", "0 0 1")}
        <inertial pos="0 0 0" mass="{_FOOT_KG}" diaginertia="1 1 1"/>
        <geom name="foot" type="sphere" size="0.1" mass="0"/></body></body>"""
    laws, files = {"press": constant("across", -_PRESS_N)}, dict[str, str]()
    if push_N_s:
        laws["push"], files = growing("push", push_N_s, _STEP_S, duration_s)
    motors = '<motor name="press" joint="across"/>' + ('<motor name="push" joint="along"/>' if push_N_s else "")
    return run_scene(
        model(plate, more=f"<actuator>{motors}</actuator>"),
        {"rock": model(ball("rock", 1.0, 0.1, at=(90, 0, 0)))},
        files,
        initial={"rates": {"robot/along": speed}},
        contacts={"rules": [{"name": "foot", "between": ["plate", "foot"], "restitution": 0.0, "mu": mu}]},
        phases=[{"name": "press", "until": "end", "controllers": laws}],
        **times(_STEP_S, duration_s),
    )


def _stops() -> Values:
    run = _foot(0.2, 0.8, 3.2)
    (stick,) = run.records["contact_sticks"]
    momentum = run["momentum.robot_P_x_N_s"]
    return {
        "stick_s": stick.time_s,
        "speed": float(final(run, "v_robot_x")[0]),
        "heat": float(run["balance.friction_heat_J"][-1]),
        "momentum": float(np.ptp(momentum)),
    }


def _breaks_away() -> Values:
    run = _foot(0.5, 0.0, 6.0, 0.1)
    (slip,) = run.records["contact_slips"]
    still = run.time < 4.99
    return {
        "slip_s": slip.time_s,
        "creep": float(np.abs(run["state.q_robot_along_m"][still]).max()),
        "speed": float(final(run, "v_robot_along")[0]),
        "heat": float(run["balance.friction_heat_J"][-1]),
    }


_WEDGES = {"30_0.5": (30.0, 0.5), "45_0.5": (45.0, 0.5), "60_0.5": (60.0, 0.5)}
"""Half-angles of the V in degrees and coefficients of friction, tan(half-angle) > mu: a force can pull the ball out."""


def _pulled(half_angle: float, mu: float, turned: float) -> float:
    """Speed of a ball of 1 kg in a V after 5 ms under 1 N at an angle from the axis into the V, angles in degrees.

    Before, it is pressed into the V for 1 ms: a wedge holds what has been pressed into it.
    """
    beta, angle, radius, half = math.radians(half_angle), math.radians(turned), 0.1, 0.05
    walls = {}
    for name, side in (("left", -1.0), ("right", 1.0)):
        away = -(radius + half)
        x, z = side * away * math.cos(beta), away * math.sin(beta)
        turn = side * (90.0 - half_angle)
        walls[name] = model(f'<geom name="wall" type="box" size="0.3 0.3 {half}" pos="{x!r} 0 {z!r}" euler="0 {turn!r} 0"/>')
    efforts = {"x": math.sin(angle), "z": -math.cos(angle)}
    joints = slide("x", "1 0 0") + slide("z", "0 0 1") + '<joint name="turn" axis="0 1 0"/>'
    motors = "".join(f'<motor name="{axis}" joint="{axis}"/>' for axis in efforts)
    run = run_scene(
        model(ball("ball", 1.0, radius, joint=joints), more=f"<actuator>{motors}</actuator>"),
        walls,
        contacts={"rules": [{"between": ["ball", f"{name}/wall"], "restitution": 0.0, "mu": mu} for name in walls]},
        phases=[
            {"name": "press", "for_s": 1e-3, "controller": constant("z", -1.0)},
            {"name": "pull", "until": "end", "controllers": {a: constant(a, f) for a, f in efforts.items() if f}},
        ],
        **times(1e-3, 6e-3),
    )
    return float(np.hypot(final(run, "v_robot_x")[0], final(run, "v_robot_z")[0]))


def _limit(half_angle: float, mu: float) -> float:
    """Largest angle at which the ball stays, in degrees."""
    stays, leaves = 0.0, 120.0
    while leaves - stays > 2e-3:
        angle = 0.5 * (stays + leaves)
        stays, leaves = (stays, angle) if _pulled(half_angle, mu, angle) > 1e-10 else (angle, leaves)
    return 0.5 * (stays + leaves)


def _wedge() -> Values:
    limits = {key: _limit(*where) for key, where in _WEDGES.items()}
    return limits | {"wedged": _pulled(30.0, 0.8, 179.0), "pulled": _pulled(30.0, 0.5, 179.0)}


CASES = (
    ValidationCase(
        "foot-stops",
        "A foot slides on a free plate and comes to rest on it",
        Topic.FRICTION,
        Origin.CLOSED_FORM,
        "Relative deceleration mu N (1/m + 1/M); momentum is conserved",
        "Foot of 1 kg at 0.8 m/s on a plate of 3 kg, pressed by an inner force of 1 N, mu = 0.2, zero gravity; RK4 at"
        " 10 ms.",
        (
            Number("stick_s", "sticks, s", "3", 4e-9, "slip is smaller than 1e-9 of 0.8 m/s, at 0.27 m/s^2"),
            Number("speed", "common speed, m/s", "0.2", 1e-12, "rounding"),
            Number("heat", "heat of friction, J", "0.24", 1e-12, "rounding"),
            Number("momentum", "change of the momentum, N s", "0", 1e-14, "rounding of 0.8 N s"),
        ),
        _stops,
    ),
    ValidationCase(
        "foot-breaks-away",
        "A foot holds on a free plate until its push exceeds the friction",
        Topic.FRICTION,
        Origin.CLOSED_FORM,
        "Coulomb: at rest while the push is below mu N; then u' = (0.1 t - mu N) (1/m + 1/M)",
        "The foot and the plate of the case above at rest, mu = 0.5, pushed along the plate by an inner force of 0.1 N/s t;"
        " RK4 and control at 10 ms, the push of each tick at its mean.",
        (
            Number("slip_s", "begins to slide, s", "5", 1e-9, "a control tick, at which the push passes the limit by 0.1 %"),
            Number("creep", "way until then, m", "0", 1e-15, "sticking is exact: rounding"),
            Number("speed", "relative speed at 6 s, m/s", text_of(1 / 15), 1e-12, "impulses of ticks are exact: rounding"),
            Number("heat", "heat of friction, J", text_of(1 / 90), 1e-6, "efforts held for h: mu N h^2 / 90 over 1 s"),
        ),
        _breaks_away,
    ),
    ValidationCase(
        "ball-in-v",
        "A ball in a V: the angle at which a force pulls it out",
        Topic.FRICTION,
        Origin.CLOSED_FORM,
        "The ball leaves a face where the force turns away from it, 90 degrees less the half-angle; for tan(half-angle)"
        " <= mu it is wedged and no force pulls it out; force closure, Nguyen 1988, Constructing force-closure"
        " grasps, Int. J. Robotics Research 7(3):3-16",
        "Two fixed faces at a half-angle from the axis, ball of 1 kg, pressed into the V, then pulled with 1 N at an"
        " angle from the axis for 5 ms; bisection, at rest if slower than 1e-10 m/s.",
        (
            *(
                Number(
                    key,
                    f"half-angle {beta:g} degrees, mu = {mu}: largest angle, degrees",
                    text_of(90.0 - beta),
                    2e-3,
                    "bisection",
                )
                for key, (beta, mu) in _WEDGES.items()
            ),
            Number(
                "pulled", "30 degrees, mu = 0.5, pulled out at 179 degrees: speed after 5 ms, m/s", "0.005", 1e-9, "1 m/s^2"
            ),
            Number("wedged", "30 degrees, mu = 0.8, pulled at 179 degrees: speed after 5 ms, m/s", "0", 1e-15, "wedged"),
        ),
        _wedge,
    ),
)
