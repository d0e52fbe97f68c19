"""Persistent contact with Coulomb friction."""

from __future__ import annotations

import math
from typing import Any

from ffsm_mj.analysis.run import Run
from ffsm_mj.validation.case import Number, Origin, Topic, ValidationCase, Values
from ffsm_mj.validation.scene import ball, constant, final, ground, model, run_scene, slide, text_of, times

_UNIT_GRAVITY = (0.0, 0.0, -1.0)


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


_BLOCK_KG = 4.0


def _rod_and_block() -> Values:
    """The rod on a block that slides freely: rod and block exchange momentum."""
    rod, motor, scenario = _rod(1.2, "block/block")
    block = f"""<body name="block" pos="0 0 -0.1">{slide("x", "1 0 0")}
      <inertial pos="0 0 0" mass="{_BLOCK_KG}" diaginertia="1 1 1"/>
      <geom name="block" type="box" size="2 2 0.1" mass="0"/></body>"""
    run = run_scene(model(rod, more=motor), {"block": model(block)}, initial={"rates": {"robot/x": 0.5}}, **scenario)
    blocks, whole = run["momentum.objects_P_x_N_s"], run["momentum.total_P_x_N_s"]
    lost = run["balance.friction_heat_J"] + run["energy.total_J"] - run["balance.work_J"]
    return {
        "force": abs(float(run["contact.foot_force_z_N"][0])),
        "early": float(blocks[1] / run.time[1]),
        "momentum": float(max(abs(whole - whole[0]))),
        "energy": float(max(abs(lost - lost[0]))),
    }


_SLIP_M_S = math.hypot(1.3, 0.5)
_STICK_S = 2.0 * _SLIP_M_S / (7.0 * 0.2)


def _rod(mu: float, floor: str) -> tuple[str, str, dict[str, Any]]:
    """MJCF of a rod of 1 kg, half-length 1 m, at arctan 2 to what it is pressed on, and keys of its scenario.

    Its tip slides at 0.5 m/s on the geom ``floor``.
    """
    tip_m, across, down = 1e-3, 1.0 / math.sqrt(5.0), 2.0 / math.sqrt(5.0)
    joints = slide("x", "1 0 0") + slide("z", "0 0 1") + '<joint name="turn" axis="0 1 0"/>'
    rod = f"""<body name="rod" pos="0 0 {down!r}">{joints}
      <inertial pos="0 0 0" mass="1" diaginertia="{1 / 3} {1 / 3} {1 / 3}"/>
      <geom name="tip" type="sphere" size="{tip_m}" pos="{across!r} 0 {tip_m - down!r}" mass="0"/></body>"""
    motor = '<actuator><motor name="press" joint="z"/></actuator>'
    rule = {"name": "foot", "between": ["tip", floor], "restitution": 0.0, "mu": mu}
    return (
        rod,
        motor,
        {
            "contacts": {"rules": [rule]},
            "phases": [{"name": "press", "until": "end", "controller": constant("z", -1.0)}],
            **times(1e-3, 0.005),
        },
    )


def _rod_run(mu: float) -> Run:
    """Run of the rod on the ground."""
    rod, motor, scenario = _rod(mu, "floor/ground")
    return run_scene(model(rod, more=motor), {"floor": model(ground())}, initial={"rates": {"robot/x": 0.5}}, **scenario)


def _painleve() -> Values:
    forces = {mu: _rod_run(mu)["contact.foot_force_z_N"][0] for mu in (1.2, 1.3)}
    inverse = {mu: 1.0 / abs(force) for mu, force in forces.items()}
    critical = 1.3 + 0.1 * inverse[1.3] / (inverse[1.2] - inverse[1.3])
    return {"force": abs(forces[1.2]), "critical": critical, "ended": float("painleve" in _rod_run(1.34).message)}


CASES = (
    ValidationCase(
        "sliding-to-rolling",
        "A sphere slides and begins to roll",
        Topic.FRICTION,
        Origin.CLOSED_FORM,
        "Billiard ball: t* = 2 v0 / (7 mu g), v = 5/7 v0; Coriolis 1835, Théorie mathématique des effets du jeu de billard",
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
        Topic.FRICTION,
        Origin.CLOSED_FORM,
        "Slip of a uniform sphere keeps its direction: t* = 2 |u0| / (7 mu g); Coriolis 1835, as above",
        "m = R = g = 1, mu = 0.2, v0 = (0.7, -0.4), spin (0.9, -0.6, 2); RK4 at 1 ms.",
        (
            Number("stick_s", "begins to roll, s", text_of(_STICK_S), 5e-9, "slip is smaller than 1e-9 of its start"),
            Number("v_x", "v_x after, m/s", text_of(0.7 - 2.0 / 7.0 * 1.3), 1e-10, "RK4: 1e-12 measured at 2 ms, order 4"),
            Number("v_y", "v_y after, m/s", text_of(-0.4 - 2.0 / 7.0 * 0.5), 1e-10, "RK4: 1e-12 measured at 2 ms, order 4"),
            Number("heat", "heat of friction, J", text_of(_SLIP_M_S**2 / 7.0), 1e-10, "mu m g u0 t* / 2, RK4"),
        ),
        _curved,
    ),
    ValidationCase(
        "painleve",
        "Painlevé's sliding rod",
        Topic.FRICTION,
        Origin.PUBLISHED,
        "Least coefficient of friction at which Coulomb's law has no solution for a sliding homogeneous rod, the minimum 4/3"
        " of (4 + t^2) / (3 t) at t = tan(theta) = 2; Génot & Brogliato 1999, New results on Painlevé paradoxes, European"
        " Journal of Mechanics A/Solids (report: HAL inria-00073323)",
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
        "rod-and-block",
        "A rod slides on a block that moves",
        Topic.FRICTION,
        Origin.CLOSED_FORM,
        "Coulomb's law: the normal force is that on a fixed floor, 1 N / (1.6 - 1.2 mu), as the block yields along the"
        " slip only; conservation of momentum and energy. Arrangement after the rod and block of Potra, Anitescu, Gavrea"
        " & Trinkle 2006, A linearly implicit trapezoidal method for integrating stiff multibody dynamics with contact,"
        " joints, and friction, Int. J. Numer. Meth. Engng 66(7):1079-1124",
        f"The rod of `painleve` at mu = 1.2 on a block of {_BLOCK_KG:g} kg that slides freely along the tip's way; 5 ms.",
        (
            Number("force", "normal force, N", "6.25", 1e-9, "one solve, conditioned by 1/0.16"),
            Number(
                "early",
                "acceleration of the block by the friction over the first ms times 4 kg, N",
                "7.5",
                1e-3,
                "the rod turns by 1e-4 rad in a millisecond",
            ),
            Number("momentum", "change of the momentum of both, N s", "0", 1e-15, "rounding of 0.5 N s"),
            Number(
                "energy", "energy and heat of friction less work of the press, J", "0", 1e-11, "heat by the weights of RK4"
            ),
        ),
        _rod_and_block,
        "Their runs are shown in figures, and no digits of them are at hand: what is compared follows from the laws,"
        " not from their results.",
    ),
)
