"""Impacts: single ones with and without friction, series of bounces, several contacts at one instant."""

from __future__ import annotations

import math
from itertools import pairwise

from ffsm_mj.analysis.run import Run
from ffsm_mj.validation.case import Number, Origin, Topic, ValidationCase, Values
from ffsm_mj.validation.scene import ball, body, box, final, ground, model, rule, run_scene, slides, text_of, times, touching

_ROUNDING = "rounding of velocities of 1 m/s"


def _off_centre(restitution: float) -> Run:
    """Run of a sphere of 1 kg that hits a box of 2 kg at rest, 0.3 m beside its centre."""
    return run_scene(
        model(ball("ball", 1.0, 0.1)),
        {"box": model(box("box", 2.0, (0.1, 0.5, 0.1), at=(0.7, 0.3, 0.0)))},
        initial={"rates": {"robot/free": [1.0, 0, 0, 0, 0, 0]}},
        contacts=touching(rule("ball", "box/box", restitution)),
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
        contacts=touching(rule("ball", "floor/ground", e, mu)),
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
    joints, tip = slides("xz") + '<joint name="turn" axis="0 1 0"/>', f'size="{radius}" pos="{-x!r} 0 {radius - z!r}"'
    return run_scene(
        model(body("tip", 1.0, [1 / 12] * 3, joint=joints, at=(0.0, 0.0, z + gap), geom=tip)),
        {"floor": model(ground())},
        initial={"rates": {"robot/x": slip, "robot/z": -1.0}},
        contacts=touching(rule("tip", "floor/ground", e, mu)),
        **times(1e-3, 0.003),
    )


def _rods() -> Values:
    values = {}
    for name, setting in {"stick": (45.0, 0.7, 1.0, -0.3), "both": (45.0, 1.0, 0.5, -0.2)}.items():
        run = _rod_hit(*setting)
        values[f"{name}_loss"] = run["energy.total_J"][-1] - run["energy.total_J"][0]
    return values


_GRAVITY = (0.0, 0.0, -9.81)
_DROP_M, _RESTITUTION = 1.0, 0.9
_FALL_S = math.sqrt(2.0 * _DROP_M / -_GRAVITY[2])
_LIMIT_S = _FALL_S * (1.0 + _RESTITUTION) / (1.0 - _RESTITUTION)


def _rest() -> Values:
    run = run_scene(
        model(ball("ball", 1.0, 0.1, at=(0.0, 0.0, 0.1 + _DROP_M)), gravity=_GRAVITY),
        {"floor": model(ground(), gravity=_GRAVITY)},
        conservative=False,
        contacts=touching(rule("ball", "floor/ground", _RESTITUTION)),
        **times(1e-3, 9.0),
    )
    (rest,) = run.records["contact_beginnings"]
    tenth = run.impacts[9]
    return {
        "first_s": run.impacts[0].time_s,
        "tenth_s": tenth.time_s,
        "tenth_m_s": tenth.separation_speed_m_s,
        "rest_s": rest.time_s,
    }


def _tenth_s() -> float:
    flights = sum(2.0 * _FALL_S * _RESTITUTION**k for k in range(1, 10))
    return _FALL_S + flights


_TENTH_M_S = -_GRAVITY[2] * _FALL_S * _RESTITUTION**10
_H_REST_S = 1e-3
_UNRESOLVED = "bounces whose flight is shorter than the step h are not resolved: at most h / (1 - e) early"
_CRADLE_RADIUS_M = 0.5


def _row(moving: int, resting: int, e: float) -> list[float]:
    """Velocities after the impact of touching balls on touching balls at rest, m/s."""
    names = [f"ball{i}" for i in range(moving + resting)]
    models = {
        name: model(ball(name, 1.0, _CRADLE_RADIUS_M, joint=slides("x"), at=(i + (0.1 if i >= moving else 0.0), 0, 0)))
        for i, name in enumerate(names)
    }
    geoms = ["ball0", *(f"{name}/{name}" for name in names[1:])]
    run = run_scene(
        models.pop("ball0"),
        models,
        initial={"rates": {"robot/x": 1.0} | {f"{name}/x": 1.0 for name in names[1:moving]}},
        contacts=touching(*(rule(*pair, e) for pair in pairwise(geoms))),
        **times(1e-3, 0.15),
    )
    return [float(final(run, f"v_{subsystem}_x")[0]) for subsystem in ("robot", *names[1:])]


def _cradle() -> Values:
    values: dict[str, float] = {}
    for name, row in {"1_2": (1, 2, 1.0), "2_2": (2, 2, 1.0), "half": (1, 2, 0.5)}.items():
        values |= {f"{name}_{i}": speed for i, speed in enumerate(_row(*row))}
    return values


def _cradle_numbers(name: str, what: str, values: tuple[float, ...]) -> list[Number]:
    why = "rounding of velocities of 1 m/s"
    return [
        Number(f"{name}_{i}", f"{what}: ball {i + 1}, m/s", text_of(value), 1e-12, why) for i, value in enumerate(values)
    ]


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
    ValidationCase(
        "bouncing-ball",
        "A ball bounces to rest",
        Topic.IMPACTS,
        Origin.CLOSED_FORM,
        "Geometric series of the flights: t = sqrt(2 h / g) (1 + e) / (1 - e); Brogliato, Nonsmooth Mechanics, ch. 1",
        "h = 1 m, e = 0.9, g = 9.81 m/s^2, RK4 at 1 ms.",
        (
            Number("first_s", "first impact, s", text_of(_FALL_S), 1e-12, "event localisation to 1e-13 s"),
            Number("tenth_s", "tenth impact, s", text_of(_tenth_s()), 1e-10, "ten events of 1e-12 s"),
            Number(
                "tenth_m_s", "speed after the tenth impact, m/s", text_of(_TENTH_M_S), 1e-10, "g times the error of the time"
            ),
            Number("rest_s", "at rest, s", text_of(_LIMIT_S), _H_REST_S / (1.0 - _RESTITUTION), _UNRESOLVED),
        ),
        _rest,
    ),
    ValidationCase(
        "newtons-cradle",
        "Newton's cradle: equal balls in contact",
        Topic.SEVERAL_CONTACTS,
        Origin.PUBLISHED,
        "Smith, Kaufman, Vouga, Tamstorf & Grinspun 2012, Reflections on simultaneous impact, ACM TOG 31(4),"
        " article 106:"
        " generalised reflections give the textbook cradle (0, 0, 1); Newton's law for all contacts at once gives (-1/3,"
        " 2/3, 2/3)",
        "Impact law `blend`. Equal balls of 1 kg at 1 m/s, e = 1; and e = 0.5, where the law is the mean of"
        " plastic (1/3 each)"
        " and elastic.",
        (
            *_cradle_numbers("1_2", "one on two", (0.0, 0.0, 1.0)),
            *_cradle_numbers("2_2", "two on two", (0.0, 0.0, 1.0, 1.0)),
            *_cradle_numbers("half", "one on two, e = 0.5", (1 / 6, 1 / 6, 2 / 3)),
        ),
        _cradle,
        "A convention, not the only answer: equal springs in the place of the contacts give (-0.130, 0.150, 0.980).",
    ),
)
