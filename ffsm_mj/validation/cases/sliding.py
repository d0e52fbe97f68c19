"""Sliding that begins with bounces, and a block that slides and spins on four corners."""

from __future__ import annotations

import math

import numpy as np

from ffsm_mj.validation.case import Number, Origin, Topic, ValidationCase, Values
from ffsm_mj.validation.scene import ball, box, final, ground, model, run_scene, text_of, times

_GRAVITY = (0.0, 0.0, -1.0)


def _thrown() -> Values:
    """Normal impulses of all bounces are those of the weight, so friction has the effect of one long slide."""
    run = run_scene(
        model(ball("ball", 1.0, 1.0, at=(0, 0, 1)), gravity=_GRAVITY),
        {"floor": model(ground(), gravity=_GRAVITY)},
        conservative=False,
        initial={"rates": {"robot/free": [1.0, 0.0, -1.0, 0.0, -0.5, 0.0]}},
        contacts={"rules": [{"between": ["ball", "floor/ground"], "restitution": 0.5, "mu": 0.05}]},
        **times(4e-3, 8.0),
    )
    (stick,) = run.records["contact_sticks"]
    return {
        "stick_s": stick.time_s,
        "speed": float(final(run, "v_robot_free")[0]),
        "place": float(final(run, "q_robot_free")[0]),
    }


def _block() -> Values:
    run = run_scene(
        model(box("box", 1.0, (0.2, 0.1, 0.05), at=(0, 0, 0.05)), gravity=_GRAVITY),
        {"floor": model(ground(), gravity=_GRAVITY)},
        conservative=False,
        initial={"rates": {"robot/free": [0.6, 0.2, 0.0, 0.0, 0.0, 4.0]}},
        contacts={"rules": [{"between": ["box", "floor/ground"], "restitution": 0.0, "mu": 0.3}]},
        **times(2e-3, 0.4),
    )
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

CASES = (
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
)
