"""Persistent contact with Coulomb friction."""

from __future__ import annotations

import math

import numpy as np

from ffsm_mj.comparison import Number
from ffsm_mj.report.run import Run
from ffsm_mj.validation.case import Origin, ValidationCase, Values
from ffsm_mj.validation.scene import ball, box, final, ground, model, run_scene, slide, states, text_of, times

_UNIT_GRAVITY = (0.0, 0.0, -1.0)
_BOX_KG, _BALL_KG, _BALLS, _MU_GROUND, _MU_BALL, _PUSH_N, _G = 10.0, 1.0, 5, 0.4, 0.8, 150.0, 9.81
_FAR_M = 1e12
"""A spring towards a target so far away is a constant force."""


def _sphere(mu: float, velocity: tuple[float, ...], spin: tuple[float, ...], duration_s: float) -> Run:
    """Run of a sphere with m = R = g = 1 on the ground."""
    return run_scene(
        model(ball("ball", 1.0, 1.0, at=(0, 0, 1)), gravity=_UNIT_GRAVITY),
        {"floor": model(ground(), gravity=_UNIT_GRAVITY)},
        conservative=False,
        initial={"rates": {"robot/free": [*velocity, *spin]}},
        contacts={"rules": [{"between": ["ball", "floor/ground"], "restitution": 0.0, "mu": mu}]},
        **times(1e-3, duration_s),
    )


def _rolling() -> Values:
    run = _sphere(0.2, (0.7, 0.0, 0.0), (0.0, 0.0, 0.0), 1.25)
    (stick,) = run.records["contact_sticks"]
    return {
        "stick_s": stick.time_s,
        "speed": final(run, "v_robot_free")[0],
        "place": final(run, "q_robot_free")[0],
        "heat": run["balance.friction_heat_J"][-1],
    }


def _curved() -> Values:
    """Velocity of slip is (1.3, 0.5) m/s; it keeps its direction, and so the centre moves on a parabola."""
    run = _sphere(0.2, (0.7, -0.4, 0.0), (0.9, -0.6, 2.0), 2.1)
    (stick,) = run.records["contact_sticks"]
    velocity = final(run, "v_robot_free")
    return {
        "stick_s": stick.time_s,
        "v_x": velocity[0],
        "v_y": velocity[1],
        "heat": run["balance.friction_heat_J"][-1],
    }


_SLIP_M_S = math.hypot(1.3, 0.5)
_STICK_S = 2.0 * _SLIP_M_S / (7.0 * 0.2)


def _rod_run(mu: float) -> Run:
    """Run of a pressed rod of 1 kg, half-length 1 m, at arctan 2 to the ground, its tip sliding at 0.5 m/s."""
    tip_m, across, down = 1e-3, 1.0 / math.sqrt(5.0), 2.0 / math.sqrt(5.0)
    joints = slide("x", "1 0 0") + slide("z", "0 0 1") + '<joint name="turn" axis="0 1 0"/>'
    rod = f"""<body name="rod" pos="0 0 {down!r}">{joints}
      <inertial pos="0 0 0" mass="1" diaginertia="{1 / 3} {1 / 3} {1 / 3}"/>
      <geom name="tip" type="sphere" size="{tip_m}" pos="{across!r} 0 {tip_m - down!r}" mass="0"/></body>"""
    press = {"kind": "pd", "joints": ["z"], "kp": 1.0 / _FAR_M, "kd": 0.0, "target": [-_FAR_M]}
    return run_scene(
        model(rod, more='<actuator><motor name="press" joint="z"/></actuator>'),
        {"floor": model(ground())},
        initial={"rates": {"robot/x": 0.5}},
        contacts={"rules": [{"name": "foot", "between": ["tip", "floor/ground"], "restitution": 0.0, "mu": mu}]},
        phases=[{"name": "press", "until": "end", "controller": press}],
        **times(1e-3, 0.005),
    )


def _painleve() -> Values:
    forces = {mu: _rod_run(mu)["contact.foot_force_z_N"][0] for mu in (1.2, 1.3)}
    inverse = {mu: 1.0 / abs(force) for mu, force in forces.items()}
    critical = 1.3 + 0.1 * inverse[1.3] / (inverse[1.2] - inverse[1.3])
    return {"force": abs(forces[1.2]), "critical": critical, "ended": float("painleve" in _rod_run(1.34).message)}


def _rolling_test() -> Values:
    """SimBenchmark's rolling test with a row of balls across the push."""
    half_z, radius, gravity = 0.05, 0.1, (0.0, 0.0, -_G)
    balls = {
        f"ball{i}": model(ball("ball", _BALL_KG, radius, at=(0.5 * i - 1.0, 0.0, 2.0 * half_z + radius)), gravity=gravity)
        for i in range(_BALLS)
    }
    ground_rule = {"name": "ground", "between": ["box", "floor/ground"], "restitution": 0.0, "mu": _MU_GROUND}
    rules = [{"between": ["box", f"{name}/ball"], "restitution": 0.0, "mu": _MU_BALL} for name in balls]
    robot = box("box", _BOX_KG, (2.0, 4.0, half_z), joint=slide("y", "0 1 0") + slide("z", "0 0 1"), at=(0, 0, half_z))
    push = {"kind": "pd", "joints": ["y"], "kp": _PUSH_N / _FAR_M, "kd": 0.0, "target": [_FAR_M]}
    run = run_scene(
        model(robot, gravity=gravity, more='<actuator><motor name="push" joint="y"/></actuator>'),
        {**balls, "floor": model(ground(), gravity=gravity)},
        conservative=False,
        contacts={"rules": [ground_rule, *rules]},
        phases=[{"name": "push", "until": "end", "controller": push}],
        **times(1e-3, _ROLLING_S),
    )
    time = np.array(run.time)
    box_off = (states(run, "v_robot_y")[:, 0] - _BOX_A * time) ** 2
    ball_off = (states(run, "v_ball0_free")[:, 1] - _BALL_A * time) ** 2
    return {
        "error": float(np.mean(box_off + ball_off)),
        "box": states(run, "v_robot_y")[-1, 0] / _ROLLING_S,
        "ball": states(run, "v_ball4_free")[-1, 1] / _ROLLING_S,
    }


_ROLLING_S = 1.0
_ON_GROUND_N = _MU_GROUND * (_BOX_KG + _BALLS * _BALL_KG) * _G
_ON_BALL_N = (_PUSH_N - _ON_GROUND_N) / _BOX_KG / (3.5 / _BALL_KG + _BALLS / _BOX_KG)
_BOX_A = (_PUSH_N - _ON_GROUND_N - _BALLS * _ON_BALL_N) / _BOX_KG
_BALL_A = _ON_BALL_N / _BALL_KG

CASES = (
    ValidationCase(
        "sliding-to-rolling",
        "A sphere slides and begins to roll",
        Origin.CLOSED_FORM,
        "Billiard ball: t* = 2 v0 / (7 mu g), v = 5/7 v0; Routh 1905, Advanced Rigid Dynamics",
        "m = R = g = 1, mu = 0.2, v0 = 0.7, until t = 1.25; RK4 at 1 ms.",
        (
            Number("stick_s", "begins to roll, s", "1", 1e-9, "slip is smaller than 1e-9 of its start from then on"),
            Number("speed", "speed, m/s", "0.5", 1e-12, "rounding"),
            Number("place", "way, m", "0.725", 1e-9, "speed times the tolerance of the time"),
            Number("heat", "heat of friction, J", "0.07", 1e-12, "rounding"),
        ),
        _rolling,
    ),
    ValidationCase(
        "curved-slip",
        "A spinning sphere slides along a parabola",
        Origin.CLOSED_FORM,
        "Slip of a uniform sphere keeps its direction: t* = 2 |u0| / (7 mu g); Euler 1765; Coriolis 1835",
        "m = R = g = 1, mu = 0.2, v0 = (0.7, -0.4), spin (0.9, -0.6, 2); RK4 at 1 ms.",
        (
            Number("stick_s", "begins to roll, s", text_of(_STICK_S), 5e-9, "slip is smaller than 1e-9 of its start"),
            Number("v_x", "v_x after, m/s", text_of(0.7 - 2.0 / 7.0 * 1.3), 1e-10, "RK4: 1e-12 measured at 2 ms, order 4"),
            Number("v_y", "v_y after, m/s", text_of(-0.4 - 2.0 / 7.0 * 0.5), 1e-10, "RK4, as above"),
            Number("heat", "heat of friction, J", text_of(_SLIP_M_S**2 / 7.0), 1e-10, "mu m g u0 t* / 2, RK4"),
        ),
        _curved,
    ),
    ValidationCase(
        "painleve",
        "Painlevé's sliding rod",
        Origin.PUBLISHED,
        "Génot & Brogliato 1999, New results on Painlevé paradoxes, European Journal of Mechanics A/Solids 18: critical"
        " coefficient of friction of a homogeneous rod 4/3, at tan(theta) = 2",
        "Rod of 1 kg, half-length 1 m, pressed by 1 N at its centre, tip sliding at 0.5 m/s. Coulomb's law: F ="
        " 1 N / (1.6 - 1.2 mu).",
        (
            Number("force", "normal force at mu = 1.2, N", "6.25", 1e-9, "one solve, conditioned by 1/0.16"),
            Number(
                "critical", "mu at which the force becomes infinite", text_of(4 / 3), 1e-9, "from the forces at 1.2 and 1.3"
            ),
            Number("ended", "runs at mu = 1.34 that end as `painleve`", "1", 0.0, "a count"),
        ),
        _painleve,
    ),
    ValidationCase(
        "simbenchmark-rolling",
        "SimBenchmark: balls roll on a pushed box",
        Origin.PUBLISHED,
        "Kang & Hwangbo 2018, SimBenchmark (leggedrobotics/SimBenchmark, commit 3fd1764), rolling test, closed"
        " form and table",
        "Box of 10 kg, mu = 0.4 to the ground, pushed by 150 N along y; balls of 1 kg, mu = 0.8. A row of"
        f" {_BALLS} balls for"
        f" {_ROLLING_S:g} s instead of 25 for 4 s, and a box that does not turn; the closed form is that of {_BALLS} balls."
        " Printed: Bullet, the best engine there; RaiSim has 4.1e-7, MuJoCo RK4 3.2e-3, DART 0.43.",
        (
            Number("error", "mean squared error of both speeds at 1 ms, m^2/s^2", "4.93482e-9", at_most=True),
            Number("box", "acceleration of the box, m/s^2", text_of(_BOX_A), 1e-9, "constant forces: rounding"),
            Number("ball", "acceleration of the balls, m/s^2", text_of(_BALL_A), 1e-9, "constant forces: rounding"),
        ),
        _rolling_test,
    ),
)
