"""Persistent contact with Coulomb friction: spheres, blocks, rods, a foot on a free plate, a ball in a V."""

from __future__ import annotations

import math

import numpy as np

from ffsm_mj.analysis.run import Run
from ffsm_mj.validation.case import Number, Origin, Topic, ValidationCase, Values
from ffsm_mj.validation.scene import (
    ball,
    body,
    box,
    constant,
    final,
    ground,
    growing,
    model,
    motors,
    rock,
    rule,
    run_scene,
    slide,
    slides,
    text_of,
    throughout,
    times,
    touching,
)

_UNIT_GRAVITY = (0.0, 0.0, -1.0)


def _on_ground(
    geom: str, body_text: str, rates: tuple[float, ...], restitution: float, mu: float, step_s: float, duration_s: float
) -> Run:
    """Run of a free body on the ground under g = 1."""
    return run_scene(
        model(body_text, gravity=_UNIT_GRAVITY),
        {"floor": model(ground(), gravity=_UNIT_GRAVITY)},
        conservative=False,
        initial={"rates": {"robot/free": list(rates)}},
        contacts=touching(rule(geom, "floor/ground", restitution, mu)),
        **times(step_s, duration_s),
    )


def _sphere(rates: tuple[float, ...], mu: float, duration_s: float, restitution: float = 0.0, step_s: float = 1e-3) -> Run:
    """Run of a sphere with m = R = g = 1 on the ground."""
    return _on_ground("ball", ball("ball", 1.0, 1.0, at=(0, 0, 1)), rates, restitution, mu, step_s, duration_s)


def _rolling() -> Values:
    run = _sphere((0.7, 0.0, 0.0, 0.0, 0.0, 0.0), 0.2, 1.25)
    (stick,) = run.records["contact_sticks"]
    return {
        "stick_s": stick.time_s,
        "speed": final(run, "v_robot_free")[0],
        "place": final(run, "q_robot_free")[0],
        "heat": run["balance.friction_heat_J"][-1],
    }


def _curved() -> Values:
    """Velocity of slip is (1.3, 0.5) m/s; it keeps its direction, and so the centre moves on a parabola."""
    run = _sphere((0.7, -0.4, 0.0, 0.9, -0.6, 2.0), 0.2, 2.1)
    (stick,) = run.records["contact_sticks"]
    velocity = final(run, "v_robot_free")
    return {
        "stick_s": stick.time_s,
        "v_x": velocity[0],
        "v_y": velocity[1],
        "heat": run["balance.friction_heat_J"][-1],
    }


_BLOCK_KG = 4.0


def _rod(mu: float, floor: str, other: str) -> Run:
    """Run of a rod of 1 kg, half-length 1 m, at arctan 2 to what it is pressed on, with its tip sliding at 0.5 m/s.

    Args:
        mu: Friction of the tip.
        floor: Geom that it slides on.
        other: MJCF of the object with this geom.
    """
    tip_m, across, down = 1e-3, 1.0 / math.sqrt(5.0), 2.0 / math.sqrt(5.0)
    joints = slides("xz") + '<joint name="turn" axis="0 1 0"/>'
    tip = f'size="{tip_m}" pos="{across!r} 0 {tip_m - down!r}"'
    rod = body("tip", 1.0, [1 / 3] * 3, joint=joints, at=(0.0, 0.0, down), geom=tip)
    return run_scene(
        model(rod, more=motors("z")),
        {floor.partition("/")[0]: model(other)},
        initial={"rates": {"robot/x": 0.5}},
        contacts=touching(rule("tip", floor, 0.0, mu, "foot")),
        phases=throughout(press=constant("z", -1.0)),
        **times(1e-3, 0.005),
    )


def _rod_and_block() -> Values:
    """The rod on a block that slides freely: rod and block exchange momentum."""
    block = 'type="box" size="2 2 0.1"'
    run = _rod(1.2, "block/block", body("block", _BLOCK_KG, [1.0] * 3, joint=slides("x"), at=(0.0, 0.0, -0.1), geom=block))
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


def _painleve() -> Values:
    forces = {mu: _rod(mu, "floor/ground", ground())["contact.foot_force_z_N"][0] for mu in (1.2, 1.3)}
    inverse = {mu: 1.0 / abs(force) for mu, force in forces.items()}
    critical = 1.3 + 0.1 * inverse[1.3] / (inverse[1.2] - inverse[1.3])
    return {
        "force": abs(forces[1.2]),
        "critical": critical,
        "ended": float("painleve" in _rod(1.34, "floor/ground", ground()).message),
    }


def _thrown() -> Values:
    """Normal impulses of all bounces are those of the weight, so friction has the effect of one long slide."""
    run = _sphere((1.0, 0.0, -1.0, 0.0, -0.5, 0.0), 0.05, 8.0, restitution=0.5, step_s=4e-3)
    (stick,) = run.records["contact_sticks"]
    return {
        "stick_s": stick.time_s,
        "speed": float(final(run, "v_robot_free")[0]),
        "place": float(final(run, "q_robot_free")[0]),
    }


def _block() -> Values:
    block = box("box", 1.0, (0.2, 0.1, 0.05), at=(0, 0, 0.05))
    run = _on_ground("box", block, (0.6, 0.2, 0.0, 0.0, 0.0, 4.0), 0.0, 0.3, 2e-3, 0.4)
    pose, velocity = final(run, "q_robot_free"), final(run, "v_robot_free")
    return {
        "x": float(pose[0]),
        "y": float(pose[1]),
        "angle": 2.0 * math.atan2(pose[6], pose[3]),
        "v_x": float(velocity[0]),
        "v_y": float(velocity[1]),
        "spin": float(velocity[5]),
        "lost": float(run["balance.friction_heat_J"][-1] + run["energy.robot_J"][-1] - run["energy.robot_J"][0]),
        "tilt": float(np.hypot(pose[4], pose[5])),
    }


_RK4 = "RK4 at 2 ms: 4e-11 measured on the rates, order 4"


_PRESS_N, _PLATE_KG, _FOOT_KG = 1.0, 3.0, 1.0
_STEP_S = 1e-2


def _foot(mu: float, speed: float, duration_s: float, push_N_s: float = 0.0) -> Run:
    """Run of a foot on a plate, both free in x and z, pressed on each other and pushed along it by inner forces."""
    foot_joints = slide("along", "1 0 0") + slide("across", "0 0 1")
    foot = body("foot", _FOOT_KG, [1.0] * 3, joint=foot_joints, at=(0.0, 0.0, 0.2), geom='size="0.1"')
    plate = body("plate", _PLATE_KG, [1.0] * 3, foot, joint=slides("xz"), geom='type="box" size="5 5 0.1"')
    laws, files = {"press": constant("across", -_PRESS_N)}, dict[str, str]()
    if push_N_s:
        laws["push"], files = growing("along", push_N_s, _STEP_S, duration_s)
    return run_scene(
        model(plate, more=motors("across", *(["along"] if push_N_s else []))),
        rock(),
        files,
        initial={"rates": {"robot/along": speed}},
        contacts=touching(rule("plate", "foot", 0.0, mu, "foot")),
        phases=throughout(**laws),
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
    joints = slides("xz") + '<joint name="turn" axis="0 1 0"/>'
    run = run_scene(
        model(ball("ball", 1.0, radius, joint=joints), more=motors(*efforts)),
        walls,
        contacts=touching(*(rule("ball", f"{name}/wall", 0.0, mu) for name in walls)),
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
    ValidationCase(
        "thrown-to-rolling",
        "A thrown sphere bounces, slides and rolls",
        Topic.FRICTION,
        Origin.CLOSED_FORM,
        "v = 5/7 v0 + 2/7 R omega0 whatever happens before; all normal impulse is m (g t + u), so rolling begins at 53/7",
        "m = R = g = 1, v0 = (1, 0, -1), spin -0.5, mu = 0.05, e = 0.5: some ten impacts, then contact; RK4 at 4 ms.",
        (
            Number("stick_s", "begins to roll, s", text_of(53 / 7), 1e-8, "slip is smaller than 1e-9 of its start"),
            Number("speed", "speed, m/s", text_of(4 / 7), 1e-10, "rounding of some 10 impacts and 2000 steps"),
            Number("place", "way after 8 s, m", "6.004591836735", 1e-8, "speed times the tolerance of the time"),
        ),
        _thrown,
    ),
    ValidationCase(
        "spinning-block",
        "A block slides and spins on four corners",
        Topic.FRICTION,
        Origin.CLOSED_FORM,
        "Planar motion with shares of the weight as of equal springs under the corners (they balance the moments"
        " of friction); these equations of order six integrated apart by DOP853 to 1e-13",
        "1 kg, half-sizes (0.2, 0.1, 0.05) m, g = 1, mu = 0.3, v = (0.6, 0.2) m/s, spin 4 rad/s, after 0.4 s.",
        (
            Number("x", "x, m", "0.228376395007", 1e-9, _RK4),
            Number("y", "y, m", "0.073903063787", 1e-9, _RK4),
            Number("angle", "angle, rad", "1.344910153147", 1e-9, _RK4),
            Number("v_x", "v_x, m/s", "0.546653625929", 1e-9, _RK4),
            Number("v_y", "v_y, m/s", "0.162598230772", 1e-9, _RK4),
            Number("spin", "spin, rad/s", "2.740559454496", 1e-9, _RK4),
            Number("lost", "heat of friction less loss of kinetic energy, J", "0", 1e-9, _RK4),
            Number("tilt", "tilt (sine of half the angle)", "0", 1e-10, "drift of closed gaps"),
        ),
        _block,
        "The share of the corners is a convention, and the motion depends on it.",
    ),
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
