"""Bodies that are fixed to the world: hit by robot and objects, they give momentum from outside and take no energy."""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.records.signals import COMPONENTS
from ffsm_mj.recount import recount
from tests.scenes import HEAD, ball, scene


def slab(name, half="5 5 0.5"):
    """MJCF of a box in the world of its file, of a mass that is nobody's business."""
    return f'<mujoco>{HEAD}<worldbody><geom name="{name}" type="box" size="{half}" mass="1e4"/></worldbody></mujoco>'


def good(run):
    """Every law holds, and the log agrees with its states."""
    assert run.outcome == "completed"
    assert [law for law in run.laws() if not law.holds] == []
    again = recount(run.log)
    assert not again.obstacle
    assert again.agrees, again.worst
    assert [law for law in again.laws() if not law.holds] == []
    return run


def taken(run, party):
    """What fixed bodies gave a party through the run: (P, L about the origin)."""
    return np.array([run[f"ledger.fixed_on_{party}_{component}"][-1] for component in COMPONENTS])


def bouncing(folder, **scenario):
    """The robot, a ball of 2 kg that slides in x and z, falls at 1 m/s on a floor whose top is at z = 0, 0.3 m below it."""
    return scene(
        folder,
        ball("ball", mass=2.0, joints="xz"),
        {"floor": slab("floor")},
        fixed={"floor": {"position_m": [0, 0, -0.5]}},
        **{
            "initial": {"joints": {"robot/z": 0.4}, "rates": {"robot/z": -1.0, "robot/x": 0.3}},
            "impact_pairs": [{"robot_geom": "ball", "object_geom": "floor/floor", "restitution": 0.7}],
            **scenario,
        },
    )


def test_a_ball_on_a_fixed_floor(tmp_path):
    """The closed form: v = -e v along the normal, the rest untouched; the floor gives (1 + e) m v, and no work."""
    run = good(ffsm_mj.run(bouncing(tmp_path)))
    (hit,) = run.impacts
    # All numbers are below 4 in SI units: rounding is some 1e-16 of each, and a root good to 1e-14 m at 1 m/s.
    assert hit.time_s == pytest.approx(0.3, abs=1e-13)
    assert (hit.qvel_after["robot/z"], hit.qvel_after["robot/x"]) == (pytest.approx((0.7,), abs=1e-14), (0.3,))
    assert (hit.robot_geom, hit.object_geom) == ("robot/ball", "floor/floor")
    assert hit.impulse_N_s == pytest.approx(2.0 * 1.7, rel=1e-14)
    assert hit.energy_change_J == pytest.approx(-0.5 * 2.0 * (1 - 0.7**2), rel=1e-14)
    # Of everything that moves: not conserved, and the record says so. L about the origin: the hit is 0.09 m along x from it.
    assert hit.linear_momentum_change_N_s == pytest.approx(3.4, rel=1e-14)
    assert hit.angular_momentum_change_N_m_s == pytest.approx(3.4 * 0.09, rel=1e-12)
    # On the floor, about the origin of its frame.
    np.testing.assert_allclose(hit.angular_impulse_N_m_s, (0.0, 3.4 * 0.09, 0.0), atol=1e-12)
    np.testing.assert_allclose(taken(run, "robot"), (0, 0, 3.4, 0, -3.4 * 0.09, 0), atol=1e-12)
    assert not taken(run, "objects").any()
    assert not any(run[f"ledger.contact_{component}"].any() for component in COMPONENTS)


def test_runs_without_fixed_bodies_have_no_columns_of_them(tmp_path):
    path = scene(
        tmp_path,
        ball("ball"),
        {"rock": ball("rock")},
        duration_s=0.01,
        initial={"joints": {"rock/free": [3, 0, 0, 1, 0, 0, 0]}},
    )
    assert not [key for key in ffsm_mj.run(path).keys if "fixed" in key]
