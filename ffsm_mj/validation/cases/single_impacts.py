"""Single impacts with and without friction."""

from __future__ import annotations

import math

from ffsm_mj.comparison import Number
from ffsm_mj.report.run import Run
from ffsm_mj.validation.case import Origin, ValidationCase, Values
from ffsm_mj.validation.scene import ball, box, final, ground, model, run_scene, slide, text_of, times

_ROUNDING = "rounding of velocities of 1 m/s"


def _off_centre(restitution: float) -> Run:
    """Run of a sphere of 1 kg that hits a box of 2 kg at rest, 0.3 m beside its centre."""
    return run_scene(
        model(ball("ball", 1.0, 0.1)),
        {"box": model(box("box", 2.0, (0.1, 0.5, 0.1), at=(0.7, 0.3, 0.0)))},
        initial={"rates": {"robot/free": [1.0, 0, 0, 0, 0, 0]}},
        contacts={"rules": [{"between": ["ball", "box/box"], "restitution": restitution}]},
        **times(1e-3, 1.0),
    )


def _one_collision() -> Values:
    values: dict[str, float] = {}
    for e in (1.0, 0.5):
        run = _off_centre(e)
        hit = run.impacts[0]
        values |= {
            f"time_{e}": hit.time_s,
            f"ball_{e}": final(run, "v_robot_free")[0],
            f"box_{e}": final(run, "v_box_free")[0],
            f"spin_{e}": final(run, "v_box_free")[5],
            f"energy_{e}": run["energy.total_J"][-1] / run["energy.total_J"][0],
        }
    return values


def _one_collision_numbers() -> tuple[Number, ...]:
    inertia, arm = 2.0 / 12.0 * (0.2**2 + 1.0**2), 0.3
    compliance = 1.0 + 1.0 / 2.0 + arm**2 / inertia
    numbers = [Number("time_1.0", "time of impact, s", "0.5", 1e-12, "event localisation to 1e-13 s")]
    for e in (1.0, 0.5):
        impulse = (1.0 + e) / compliance
        numbers += [
            Number(f"ball_{e}", f"e = {e:g}: speed of the ball, m/s", text_of(1.0 - impulse), 1e-12, _ROUNDING),
            Number(f"box_{e}", f"e = {e:g}: speed of the box, m/s", text_of(impulse / 2.0), 1e-12, _ROUNDING),
            Number(f"spin_{e}", f"e = {e:g}: spin of the box, rad/s", text_of(impulse * arm / inertia), 1e-11, _ROUNDING),
            Number(f"energy_{e}", f"e = {e:g}: energy ratio", text_of(1.0 - (1.0 - e * e) / compliance), 1e-12, _ROUNDING),
        ]
    return tuple(numbers)


def _sphere_hit(mu: float, e: float, velocity: tuple[float, ...], spin: tuple[float, ...]) -> Run:
    """Run of a sphere with m = R = 1 that is thrown at a wall z = 0."""
    return run_scene(
        model(ball("ball", 1.0, 1.0, at=(0, 0, 1.01))),
        {"floor": model(ground())},
        initial={"rates": {"robot/free": [*velocity, *spin]}},
        contacts={"rules": [{"between": ["ball", "floor/ground"], "restitution": e, "mu": mu}]},
        **times(1e-3, 0.02),
    )


def _spheres() -> Values:
    slips = _sphere_hit(0.2, 0.8, (2.0, 0.0, -1.0), (0.0, -5.0, 0.0))
    sticks = _sphere_hit(0.5, 0.7, (0.6, 0.8, -1.0), (0.0, 0.0, 0.0))
    slipped, stuck = final(slips, "v_robot_free"), final(sticks, "v_robot_free")
    return {
        "slip_x": slipped[0],
        "slip_z": slipped[2],
        "slip_spin": slipped[4],
        "slip_loss": slips["energy.total_J"][-1] - slips["energy.total_J"][0],
        "stick_x": stuck[0],
        "stick_y": stuck[1],
        "stick_z": stuck[2],
    }


def _rod_hit(degrees: float, mu: float, e: float, slip: float) -> Run:
    """Run of a rod with m = L = 1 that moves without turning; its lower end hits the floor at 1 m/s."""
    angle, radius, gap = math.radians(degrees), 1e-3, 1e-3
    x, z = 0.5 * math.cos(angle), 0.5 * math.sin(angle)
    joints = slide("x", "1 0 0") + slide("z", "0 0 1") + '<joint name="turn" axis="0 1 0"/>'
    rod = f"""<body name="rod" pos="0 0 {z + gap!r}">{joints}
      <inertial pos="0 0 0" mass="1" diaginertia="{1 / 12} {1 / 12} {1 / 12}"/>
      <geom name="tip" type="sphere" size="{radius}" pos="{-x!r} 0 {radius - z!r}" mass="0"/></body>"""
    return run_scene(
        model(rod),
        {"floor": model(ground())},
        initial={"rates": {"robot/x": slip, "robot/z": -1.0}},
        contacts={"rules": [{"between": ["tip", "floor/ground"], "restitution": e, "mu": mu}]},
        **times(1e-3, 0.003),
    )


def _rods() -> Values:
    values = {}
    for name, setting in {"stick": (45.0, 0.7, 1.0, -0.3), "both": (45.0, 1.0, 0.5, -0.2)}.items():
        run = _rod_hit(*setting)
        values[f"{name}_loss"] = run["energy.total_J"][-1] - run["energy.total_J"][0]
    return values


_TOHOKU = {(1000, 8): 0.7798, (1000, 20): 0.5600, (9000, 8): 0.9178, (9000, 20): 0.8114}


def _damped_restitution(stiffness: float, damping: float, mass: float) -> float:
    """Restitution of a linear spring and damper whose force is never negative."""
    zeta = damping / (2.0 * math.sqrt(stiffness * mass))
    s = math.sqrt(1.0 - zeta * zeta)
    return math.exp(-2.0 * zeta / s * math.atan2(s, zeta))


_TARGET_KG, _TARGET_I, _TARGET_M = 4.45, 0.0172, 0.15
_LEVER_M = 0.8 * _TARGET_M / 2.0
_EFFECTIVE_KG = 1.0 / (1.0 / _TARGET_KG + _LEVER_M**2 / _TARGET_I)


def _tapped(e: float) -> Run:
    """Run of the spinning target whose face meets a fixed tip at 0.8 of its half side."""
    radius, spin = 0.01, 1.0
    tip = f'<geom name="tip" type="sphere" size="{radius}" pos="{_LEVER_M!r} {-_TARGET_M / 2 - radius - 1e-7!r} 0"/>'
    joints = slide("x", "1 0 0") + slide("y", "0 1 0") + '<joint name="yaw" axis="0 0 1"/>'
    body = f"""<body name="target">{joints}
      <inertial pos="0 0 0" mass="{_TARGET_KG}" diaginertia="0.0172 0.0172 {_TARGET_I}"/>
      <geom name="target" type="box" size="0.075 0.075 0.075" mass="0"/></body>"""
    return run_scene(
        model(body),
        {"hand": model(tip)},
        initial={"rates": {"robot/yaw": -spin}},
        contacts={"rules": [{"between": ["target", "hand/tip"], "restitution": e}]},
        **times(1e-3, 0.01),
    )


def _tapped_values() -> Values:
    values = {}
    for (stiffness, damping), _ in _TOHOKU.items():
        e = _damped_restitution(stiffness, damping, _EFFECTIVE_KG)
        run = _tapped(e)
        hit = run.impacts[0]
        rate = hit.qvel_after["robot/yaw"]
        values[f"spin_{stiffness}_{damping}"] = -float(rate[0] if isinstance(rate, tuple | list) else rate)
    return values


def _tapped_numbers() -> tuple[Number, ...]:
    numbers = []
    for stiffness, damping in _TOHOKU:
        e = _damped_restitution(stiffness, damping, _EFFECTIVE_KG)
        left = 1.0 - (1.0 + e) * _LEVER_M**2 * _EFFECTIVE_KG / _TARGET_I
        numbers.append(
            Number(
                f"spin_{stiffness}_{damping}",
                f"k = {stiffness} N/m, d = {damping} N s/m, e = {e:.4f}: spin after / before",
                text_of(left, 6),
                1e-5,
                "the face starts 1e-7 m from the tip and has turned by 2 urad when it meets it",
            )
        )
    return tuple(numbers)


CASES = (
    ValidationCase(
        "one-collision",
        "A sphere hits a box beside its centre",
        Origin.CLOSED_FORM,
        "Impulse (1 + e) u / (1/m + 1/M + b^2 / I); Goldsmith 1960, Impact",
        "Ball of 1 kg at 1 m/s, box of 2 kg at rest, 0.3 m off its centre, e = 1 and 0.5.",
        _one_collision_numbers(),
        _one_collision,
    ),
    ValidationCase(
        "thrown-sphere",
        "A spinning sphere bounces with friction",
        Origin.CLOSED_FORM,
        "A sphere slips throughout if mu (1 + e) |u_n| <= 2/7 |u_t|, else it sticks; Routh 1905, Advanced Rigid Dynamics",
        "m = R = 1. Slips: mu = 0.2, e = 0.8, v = (2, 0, -1), spin (0, -5, 0). Sticks: mu = 0.5, e = 0.7, v ="
        " (0.6, 0.8, -1).",
        (
            Number("slip_x", "slips: v_x, m/s", "1.64", 1e-12, _ROUNDING),
            Number("slip_z", "slips: v_z, m/s", "0.8", 1e-12, _ROUNDING),
            Number("slip_spin", "slips: spin, rad/s", "-4.1", 1e-12, _ROUNDING),
            Number("slip_loss", "slips: change of energy, J", "-2.4732", 1e-12, _ROUNDING),
            Number("stick_x", "sticks: v_x = 5/7 of before, m/s", text_of(0.6 * 5 / 7), 1e-12, _ROUNDING),
            Number("stick_y", "sticks: v_y = 5/7 of before, m/s", text_of(0.8 * 5 / 7), 1e-12, _ROUNDING),
            Number("stick_z", "sticks: v_z, m/s", "0.7", 1e-12, _ROUNDING),
        ),
        _spheres,
    ),
    ValidationCase(
        "rod-with-friction",
        "A slanted rod hits the floor with friction",
        Origin.CLOSED_FORM,
        "Energetic restitution W = (1 - e^2) W_c along Routh's incremental impulse; Stronge 1990, Rigid body collisions with"
        " friction, Proc. R. Soc. A 431",
        "m = L = 1, 45 degrees, u_n = -1 m/s. mu = 0.7, e = 1, slip 0.3 m/s; mu = 1, e = 0.5, slip 0.2 m/s: both stick.",
        (
            Number("stick_loss", "mu = 0.7, e = 1: change of energy, J", "-0.126", 1e-12, _ROUNDING),
            Number("both_loss", "mu = 1, e = 0.5: change of energy, J", "-0.305", 1e-12, _ROUNDING),
        ),
        _rods,
    ),
    ValidationCase(
        "tohoku-taps",
        "Detumbling taps: spring and damper as a restitution",
        Origin.CLOSED_FORM,
        "Parameters: Uchida, Uno & Yoshida 2024, arXiv 2405.00943, tables 4.1 and 4.2 of its public code; restitution of a"
        " spring and damper with F >= 0: e = exp(-2 zeta / s atan2(s, zeta)), s^2 = 1 - zeta^2",
        "Target of 4.45 kg and 0.0172 kg m^2 at 1 rad/s against a tip that does not move, at 0.8 of its half"
        " side, no friction.",
        _tapped_numbers(),
        _tapped_values,
        "The formula only, not their simulation: contacts there last 21 to 200 ms, as long as their arms take to move, so a"
        " rigid impact is an idealisation; their arms, impedance control and friction (mu = 0.3) are left out.",
    ),
)
