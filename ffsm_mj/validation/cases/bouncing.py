"""Bouncing balls: the limit of infinitely many impacts, and energy over many elastic ones."""

from __future__ import annotations

import math

import numpy as np

from ffsm_mj.validation.case import Number, Origin, Topic, ValidationCase, Values
from ffsm_mj.validation.scene import ball, ground, model, run_scene, slide, states, text_of, times

_GRAVITY = (0.0, 0.0, -9.81)
_DROP_M, _RESTITUTION = 1.0, 0.9
_FALL_S = math.sqrt(2.0 * _DROP_M / -_GRAVITY[2])
_LIMIT_S = _FALL_S * (1.0 + _RESTITUTION) / (1.0 - _RESTITUTION)


def _rest() -> Values:
    run = run_scene(
        model(ball("ball", 1.0, 0.1, at=(0.0, 0.0, 0.1 + _DROP_M)), gravity=_GRAVITY),
        {"floor": model(ground(), gravity=_GRAVITY)},
        conservative=False,
        contacts={"rules": [{"between": ["ball", "floor/ground"], "restitution": _RESTITUTION}]},
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


_H_REST_S = 1e-3
_BALLS, _MASS_KG, _RADIUS_M, _HEIGHT_M, _SECONDS = 49, 10.0, 0.1, 5.0, 20.0
_STEPS_S = {"1e-3": "0.0186204", "4e-3": "4.76468", "1e-2": "185.953"}


def _energy_errors() -> Values:
    """All balls do the same; one of them is simulated."""
    errors = {}
    for text in _STEPS_S:
        run = run_scene(
            model(ball("ball", _MASS_KG, _RADIUS_M, joint=slide("z", "0 0 1"), at=(0, 0, _HEIGHT_M)), gravity=_GRAVITY),
            {"floor": model(ground(), gravity=_GRAVITY)},
            conservative=False,
            contacts={"rules": [{"between": ["ball", "floor/ground"], "restitution": 1.0}]},
            **times(float(text), _SECONDS),
        )
        height, speed = states(run, "q_robot_z")[:, 0] + _HEIGHT_M, states(run, "v_robot_z")[:, 0]
        energy = _MASS_KG * (0.5 * speed**2 - _GRAVITY[2] * height)
        off = _BALLS * (energy + _MASS_KG * _GRAVITY[2] * _HEIGHT_M)
        errors[text] = float(np.mean(off**2))
    return errors


CASES = (
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
                "tenth_m_s",
                "speed after the tenth impact, m/s",
                text_of(-_GRAVITY[2] * _FALL_S * _RESTITUTION**10),
                1e-10,
                "g times the error of the time",
            ),
            Number(
                "rest_s",
                "at rest, s",
                text_of(_LIMIT_S),
                _H_REST_S / (1.0 - _RESTITUTION),
                "bounces whose flight is shorter than the step h are not resolved: at most h / (1 - e) early",
            ),
        ),
        _rest,
    ),
    ValidationCase(
        "simbenchmark-bouncing",
        "SimBenchmark: 49 elastic balls, energy over 20 s",
        Topic.IMPACTS,
        Origin.PUBLISHED,
        "Kang & Hwangbo 2018, SimBenchmark (leggedrobotics/SimBenchmark, commit 3fd1764), bouncing test",
        "Mean over the steps of (E - E0)^2 of 49 balls of 10 kg from 5 m, e = 1; all do the same, one is simulated."
        " Printed: RaiSim, the best of the five engines there; ODE has 185 J^2 at 1 ms, Bullet 75245 J^2, DART 72274 J^2.",
        tuple(
            Number(text, f"mean squared error of the energy at h = {1e3 * float(text):g} ms, J^2", best, at_most=True)
            for text, best in _STEPS_S.items()
        ),
        _energy_errors,
    ),
)
