"""Single impacts with and without friction."""

from __future__ import annotations

import math

from ffsm_mj.analysis.run import Run
from ffsm_mj.validation.case import Number, Origin, Topic, ValidationCase, Values
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


CASES = (
    ValidationCase(
        "one-collision",
        "A sphere hits a box beside its centre",
        Topic.IMPACTS,
        Origin.CLOSED_FORM,
        "Impulse (1 + e) u / (1/m + 1/M + b^2 / I); Goldsmith 1960, Impact",
        "Ball of 1 kg at 1 m/s, box of 2 kg at rest, 0.3 m off its centre, e = 1 and 0.5.",
        _one_collision_numbers(),
        _one_collision,
    ),
    ValidationCase(
        "thrown-sphere",
        "A spinning sphere bounces with friction",
        Topic.IMPACTS,
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
        Topic.IMPACTS,
        Origin.CLOSED_FORM,
        "Energetic restitution W = (1 - e^2) W_c along Routh's incremental impulse; Stronge 1990, Rigid body collisions"
        " with friction, Proc. R. Soc. Lond. A 431:169-181",
        "m = L = 1, 45 degrees, u_n = -1 m/s. mu = 0.7, e = 1, slip 0.3 m/s; mu = 1, e = 0.5, slip 0.2 m/s: both stick.",
        (
            Number("stick_loss", "mu = 0.7, e = 1: change of energy, J", "-0.126", 1e-12, _ROUNDING),
            Number("both_loss", "mu = 1, e = 0.5: change of energy, J", "-0.305", 1e-12, _ROUNDING),
        ),
        _rods,
    ),
)
