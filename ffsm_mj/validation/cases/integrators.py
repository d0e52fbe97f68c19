"""What impacts ask of a time integrator: energy at impacts, angular momentum, large motions, each beside a closed form.

The three properties are those for which Di Stasio et al. 2019 state benchmark cases; the arrangements are of this project.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import ellipk

from ffsm_mj.analysis.run import Run
from ffsm_mj.arrays import FloatArray
from ffsm_mj.validation.case import Number, Origin, Topic, ValidationCase, Values
from ffsm_mj.validation.scene import ball, body, model, rule, run_scene, slides, text_of, times, touching

_PROPERTIES = (
    "Property of Di Stasio, Dureisseix, Gravouil, Georges & Homolle 2019, Benchmark cases for robust explicit time"
    " integrators in non-smooth transient dynamics, Adv. Model. Simul. Eng. Sci. 6:2"
)
_STEP_S = 1e-3
_IMPACTS = 10
_RADIUS_M = 0.1


def _change(values: FloatArray) -> float:
    """Largest difference from the first value."""
    return float(np.abs(values - values[0]).max())


def _energy(run: Run) -> FloatArray:
    """Kinetic energy and that of the springs, J."""
    return run["energy.total_J"] + run["energy.total_elastic_J"]


# A mass on a spring hits a wall: x'' = -omega^2 x, the wall at x = c.

_OMEGA, _WALL_M, _SPEED_M_S, _HALF = 5.0, 0.05, 1.0, 0.5


def _oscillator(wall_m: float, e: float, duration_s: float) -> Run:
    """Run of a ball of 1 kg on a spring that leaves a wall at 1 m/s; the spring is at rest ``wall_m`` below its face."""
    joint = f'<joint name="z" type="slide" axis="0 0 1" stiffness="{_OMEGA**2!r}" springref="{-wall_m!r}"/>'
    return run_scene(
        model(ball("ball", 1.0, _RADIUS_M, joint=joint, at=(0.0, 0.0, -_RADIUS_M))),
        {"wall": model('<geom name="wall" type="box" size="1 1 0.5" pos="0 0 0.5"/>')},
        initial={"rates": {"robot/z": -_SPEED_M_S}},
        conservative=False,
        contacts=touching(rule("ball", "wall/wall", e)),
        **times(_STEP_S, math.ceil(duration_s / _STEP_S) * _STEP_S),
    )


def _away_s(wall_m: float, speed_m_s: float) -> float:
    """Duration from the wall back to it: c cos(omega t) - v / omega sin(omega t) = c."""
    return 2.0 / _OMEGA * math.atan2(speed_m_s, -_OMEGA * wall_m)


def _struck() -> Values:
    elastic = _oscillator(_WALL_M, 1.0, (_IMPACTS + 0.5) * _away_s(_WALL_M, _SPEED_M_S))
    pressed = _oscillator(-_WALL_M, _HALF, 1.5 * _pressed_s(200))
    (rest,) = pressed.records["contact_beginnings"]
    return {
        "elastic_s": elastic.impacts[_IMPACTS - 1].time_s,
        "elastic_m_s": elastic.impacts[_IMPACTS - 1].separation_speed_m_s,
        "elastic_J": _change(_energy(elastic)),
        "pressed_s": pressed.impacts[4].time_s,
        "pressed_m_s": pressed.impacts[4].separation_speed_m_s,
        "rest_s": rest.time_s,
    }


def _pressed_s(impacts: int) -> float:
    """Time of an impact of the mass that its spring presses against the wall; the limit is that of rest."""
    return sum(_away_s(-_WALL_M, _SPEED_M_S * _HALF**k) for k in range(impacts))


# A ball on a spring about a fixed sphere: an ellipse, reflected at each impact about the line through the centre.

_LONG_M, _SHORT_M, _REACH_M = 1.0, 0.1, 2.0 * _RADIUS_M


def _orbit(e: float, duration_s: float) -> Run:
    """Run of a ball of 1 kg that starts at the far end of its ellipse; both spheres have the same radius."""
    joints = slides("xy").replace("/>", f' stiffness="{_OMEGA**2!r}"/>')
    start = (_LONG_M, 0.0, 0.0)
    joints = joints.replace('name="x"', f'name="x" springref="{-_LONG_M!r}"')
    return run_scene(
        model(ball("ball", 1.0, _RADIUS_M, joint=joints, at=start)),
        {"centre": model(f'<geom name="centre" type="sphere" size="{_RADIUS_M!r}"/>')},
        initial={"rates": {"robot/y": _SHORT_M * _OMEGA}},
        conservative=False,
        contacts=touching(rule("ball", "centre/centre", e)),
        **times(_STEP_S, math.ceil(duration_s / _STEP_S) * _STEP_S),
    )


def _first_hit() -> tuple[float, float]:
    """Time and polar angle of the first impact."""
    cosine = math.sqrt((_REACH_M**2 - _SHORT_M**2) / (_LONG_M**2 - _SHORT_M**2))
    phase = math.acos(cosine)
    return phase / _OMEGA, math.atan2(_SHORT_M * math.sin(phase), _LONG_M * cosine)


def _orbits() -> Values:
    first_s, _ = _first_hit()
    elastic = _orbit(1.0, 2.0 * _IMPACTS * first_s)
    lossy = _orbit(_HALF, 2.0 * first_s)
    last = elastic.impacts[_IMPACTS - 1]
    return {
        "time_s": last.time_s,
        "angle_rad": math.atan2(last.point_m[1], last.point_m[0]) % (2.0 * math.pi),
        "elastic_N_m_s": _change(elastic["momentum.robot_L_z_N_m_s"]),
        "lossy_N_m_s": _change(lossy["momentum.robot_L_z_N_m_s"]),
        "elastic_J": _change(_energy(elastic)),
    }


# A pendulum hits a wall at its lowest point: its period depends on the amplitude, theta'' = -w0^2 sin(theta).

_ARM_M, _G, _TURN_RAD = 1.0, 9.81, math.radians(170.0)
_MOMENT = 1.0 + 0.4 * _RADIUS_M**2
_W0 = math.sqrt(_G * _ARM_M / _MOMENT)


def _pendulum(e: float, duration_s: float) -> Run:
    """Run of a ball of 1 kg on an arm of 1 m, let go at 170 degrees."""
    gravity = (0.0, 0.0, -_G)
    place = f'type="sphere" size="{_RADIUS_M!r}" pos="0 0 {-_ARM_M!r}"'
    moments, centre = [0.4 * _RADIUS_M**2] * 3, (0.0, 0.0, -_ARM_M)
    bob = body("bob", 1.0, moments, joint='<joint name="turn" axis="0 -1 0"/>', centre=centre, geom=place)
    wall = f'<geom name="wall" type="box" size="0.5 1 0.05" pos="{-0.5 - _RADIUS_M!r} 0 {-_ARM_M!r}"/>'
    return run_scene(
        model(bob, gravity=gravity),
        {"wall": model(wall, gravity=gravity)},
        initial={"joints": {"turn": _TURN_RAD}},
        conservative=False,
        contacts=touching(rule("bob", "wall/wall", e)),
        **times(_STEP_S, math.ceil(duration_s / _STEP_S) * _STEP_S),
    )


def _swing_s(impacts: int, e: float) -> float:
    """Time of an impact: a quarter period, then half periods; sin(amplitude / 2) falls by e at each impact."""
    halves = [2.0 / _W0 * float(ellipk((math.sin(0.5 * _TURN_RAD) * e**k) ** 2)) for k in range(impacts)]
    return 0.5 * halves[0] + sum(halves[1:])


def _swing_energy(run: Run) -> FloatArray:
    """Kinetic energy and that of the weight, J."""
    return run["energy.total_J"] - _G * _ARM_M * np.cos(run["state.q_robot_turn_rad"])


def _swings() -> Values:
    elastic, lossy = _pendulum(1.0, _swing_s(_IMPACTS, 1.0) + 0.1), _pendulum(0.9, _swing_s(_IMPACTS, 0.9) + 0.1)
    last = lossy.impacts[_IMPACTS - 1]
    return {
        "elastic_s": elastic.impacts[_IMPACTS - 1].time_s,
        "elastic_J": _change(_swing_energy(elastic)),
        "first_s": lossy.impacts[0].time_s,
        "second_s": lossy.impacts[1].time_s,
        "last_s": last.time_s,
        "last_m_s": last.separation_speed_m_s,
    }


_PHASE = "RK4 at 1 ms: t (h omega)^4 / 120"
_LOSS = "RK4 at 1 ms: t / h times (h omega)^6 / 72 of the energy"

_STRUCK_NUMBERS = (
    Number("elastic_s", "e = 1: tenth impact, s", text_of(_IMPACTS * _away_s(_WALL_M, _SPEED_M_S)), 1e-10, _PHASE),
    Number("elastic_m_s", "e = 1: speed after it, m/s", text_of(_SPEED_M_S), 1e-11, _LOSS),
    Number("elastic_J", "e = 1: change of the energy, J", "0", 1e-11, _LOSS),
    Number("pressed_s", "e = 0.5, pressed: fifth impact, s", text_of(_pressed_s(5)), 1e-10, _PHASE),
    Number("pressed_m_s", "e = 0.5, pressed: speed after it, m/s", text_of(_SPEED_M_S * _HALF**5), 1e-12, _LOSS),
    Number(
        "rest_s",
        "e = 0.5, pressed: at rest, s",
        text_of(_pressed_s(200)),
        _STEP_S / (1.0 - _HALF),
        "bounces whose flight is shorter than the step h are not resolved: at most h / (1 - e) early",
    ),
)


def _orbit_numbers() -> tuple[Number, ...]:
    first_s, angle = _first_hit()
    passed = 2 * _IMPACTS - 1
    return (
        Number("time_s", "e = 1: tenth impact, s", text_of(passed * first_s), 1e-10, _PHASE),
        Number("angle_rad", "e = 1: its direction, rad", text_of((passed * angle) % (2.0 * math.pi)), 1e-10, _PHASE),
        Number("elastic_N_m_s", "e = 1: change of the angular momentum, N m s", "0", 1e-11, _LOSS),
        Number("elastic_J", "e = 1: change of the energy, J", "0", 1e-10, _LOSS),
        Number("lossy_N_m_s", "e = 0.5: change of the angular momentum, N m s", "0", 1e-12, _LOSS),
    )


def _swing_numbers() -> tuple[Number, ...]:
    speed = 2.0 * _W0 * math.sin(0.5 * _TURN_RAD) * 0.9**_IMPACTS * _ARM_M
    phase = "RK4 at 1 ms: t (h omega)^4 / 120 of 6.3 rad/s"
    return (
        Number("elastic_s", "e = 1: tenth impact, s", text_of(_swing_s(_IMPACTS, 1.0)), 1e-9, phase),
        Number("elastic_J", "e = 1: change of the energy, J", "0", 1e-10, _LOSS),
        Number("first_s", "e = 0.9: first impact, s", text_of(_swing_s(1, 0.9)), 1e-10, phase),
        Number("second_s", "e = 0.9: second impact, s", text_of(_swing_s(2, 0.9)), 1e-10, phase),
        Number("last_s", "e = 0.9: tenth impact, s", text_of(_swing_s(_IMPACTS, 0.9)), 1e-9, phase),
        Number("last_m_s", "e = 0.9: speed after it, m/s", text_of(speed), 1e-11, _LOSS),
    )


CASES = (
    ValidationCase(
        "spring-and-wall",
        "Energy at impacts: a mass on a spring hits a wall",
        Topic.INTEGRATION,
        Origin.CLOSED_FORM,
        f"{_PROPERTIES}: energy behaviour at impact. Flight tan(omega t / 2) = -v / (omega c), speeds e^n v",
        "1 kg, omega = 5 rad/s, 1 m/s; the spring is at rest 0.05 m before the wall (e = 1), or behind it and presses the"
        " mass against it (e = 0.5). RK4 at 1 ms.",
        _STRUCK_NUMBERS,
        _struck,
    ),
    ValidationCase(
        "orbit-and-sphere",
        "Angular momentum at impacts: a ball on a spring about a sphere",
        Topic.INTEGRATION,
        Origin.CLOSED_FORM,
        f"{_PROPERTIES}: angular momentum conservation. Each elastic impact reflects the ellipse about the line through the"
        " centre",
        "1 kg on a spring of rest length zero, omega = 5 rad/s, ellipse of 1 m and 0.1 m about a fixed sphere, centres 0.2 m"
        " apart at the impact. RK4 at 1 ms.",
        _orbit_numbers(),
        _orbits,
    ),
    ValidationCase(
        "pendulum-and-wall",
        "Large motions between impacts: a pendulum hits a wall",
        Topic.INTEGRATION,
        Origin.CLOSED_FORM,
        f"{_PROPERTIES}: non-linear behaviour. Half periods 2 K(k) / omega_0, k = e^n sin(theta_0 / 2)",
        "1 kg on an arm of 1 m, let go at 170 degrees, the wall at the lowest point; e = 1 and 0.9. RK4 at 1 ms.",
        _swing_numbers(),
        _swings,
    ),
)
