"""A patch with friction that slides over the edge of a face: it shrinks to a line or a point, and is gone."""

from __future__ import annotations

import math

import numpy as np
import pytest

import ffsm_mj
from tests.contact_models.impact.test_fixed import slab
from tests.contact_models.persistent.friction.scenes import PLATE, cube, final, gripped, heat, load, loaded, steps
from tests.replays import proved
from tests.scenes import box, scene

BOUND_M = 1e-9
"""A corner leaves a face this far beyond its edge."""
START_M = 0.05
"""Place of the cube at the start, half out of the pads."""


def pulled_out(folder, *, force_N, mu=0.3, rates=(0, 0, 0, 0, 0, 0), step, duration):
    """A cube of 2 kg between pads of 8 x 8 cm, 10 N each, on a base; all 9 kg of it and the pads pull the cube out."""
    pull = load("cube/cube", "robot/base", force_N=[list(force_N)], axes="robot/base")
    return gripped(
        folder,
        PLATE,
        cube(2.0, 0.05, 2.0 * 0.1**2 / 6),
        mu=mu,
        grip_N=10.0,
        loads=[pull],
        step=step,
        duration=duration,
        base_kg=7.0,
        initial={"joints": {"cube/free": [START_M, 0, 0, 1, 0, 0, 0]}, "rates": {"cube/free": list(rates)}},
    )


def ends(run):
    """Times at which pairs open, s."""
    return [record.time_s for record in run.records["contact_endings"]]


PULL_N, FRICTION_N, REDUCED_KG = 9.0, 2 * 0.3 * 10.0, 1.0 / (1.0 / 2.0 + 1.0 / 9.0)
SLIP_M = 0.05 + 0.04 - START_M
"""Half sides of cube and pad less the start: the trailing edge of the cube passes the edge of the pads."""


def lost_after(mu):
    """Time at which a cube that is pulled straight from rest leaves both pads, s, and its speed over the pads then, m/s."""
    rate = (PULL_N - 2 * mu * 10.0) / REDUCED_KG
    return math.sqrt(2 * SLIP_M / rate), math.sqrt(2 * SLIP_M * rate)


@pytest.mark.parametrize("before_s", [1e-3, 1e-5, pytest.param(1e-7, marks=pytest.mark.long)])
def test_a_cube_slides_out_of_two_pads(tmp_path, before_s):
    """The time is that of a constant acceleration, and the heat mu N times the way of both pads.

    A tick falls shortly before the patches vanish: they are then up to a ten-millionth of their length wide.
    """
    time_s, speed = lost_after(0.3)
    step = (time_s - before_s) / 40
    run = proved(ffsm_mj.run(pulled_out(tmp_path, force_N=(PULL_N, 0, 0), step=step, duration=42 * step)))
    # Brackets of 1e-13 s, and steps whose errors are rounding: the acceleration is constant.
    assert ends(run) == [pytest.approx(time_s + BOUND_M / speed, abs=1e-11)] * 2
    assert heat(run) == pytest.approx(FRICTION_N * SLIP_M, rel=1e-7)
    assert np.abs(final(run, "v_cube_free")[3:]).max() < 1e-9


def test_without_friction_it_is_the_same_closed_form(tmp_path):
    time_s, speed = lost_after(0.0)
    path = pulled_out(tmp_path, force_N=(PULL_N, 0, 0), mu=0.0, step=4e-3, duration=0.132)
    run = proved(ffsm_mj.run(path))
    assert ends(run) == [pytest.approx(time_s + BOUND_M / speed, abs=1e-11)] * 2


@pytest.mark.long
@pytest.mark.parametrize("before_s", [1e-3, 3e-5])
def test_a_cube_slides_out_obliquely(tmp_path, before_s):
    """Its last corner leaves both pads at one instant, and nothing turns it out of their plane on the way."""
    velocity = (0.6, 0, 0.3, 0, 0.5, 0)
    coarse = ffsm_mj.run(pulled_out(tmp_path, force_N=(6, 0, 3), rates=velocity, step=2e-3, duration=0.1))
    last_s = ends(coarse)[0]
    step = (last_s - before_s) / 40
    run = proved(ffsm_mj.run(pulled_out(tmp_path, force_N=(6, 0, 3), rates=velocity, step=step, duration=42 * step)))
    # By symmetry: a tilt would part the cube from one pad first.
    assert ends(run) == [pytest.approx(last_s, abs=1e-6)] * 2
    spin = final(run, "v_cube_free")[3:]
    assert np.abs(spin[[0, 2]]).max() < 1e-6 * abs(spin[1])
    # All friction is slip against mu N, and the pads keep their force.
    for side in ("left", "right"):
        assert run[f"contact.{side}_heat_J"][-1] == pytest.approx(0.5 * heat(run), rel=1e-6)
    assert np.abs(run["momentum.total_P_x_N_s"] - 1.2).max() < 1e-11


@pytest.mark.long
def test_pads_of_unequal_friction_turn_the_cube_out(tmp_path):
    """The patches shrink until they cannot balance the moment; the cube then turns about their edges until it is lost."""
    run = proved(ffsm_mj.run(pulled_out(tmp_path, force_N=(PULL_N, 0, 0), mu=(0.3, 0.2), step=4e-3, duration=0.22)))
    assert len(ends(run)) == 2
    # The pad that rubs more holds back its side: the cube turns about +z, where left is at y > 0.
    assert final(run, "v_cube_free")[5] > 1e-3


PRESS_N, SPEED, MU = 2.0, 1.0, 0.2


@pytest.mark.parametrize(
    ("mu", "step"), [(0.0, 4e-3), *(pytest.param(MU, step, marks=pytest.mark.long) for step in (4e-3, 1e-3))]
)
def test_a_block_tips_where_its_centre_of_pressure_passes_the_edge(tmp_path, mu, step):
    """A block of 1 kg at 1 m/s is pressed 0.1 m behind its centre; friction at its foot shifts the pressure forward.

    By moments about its centre the pressure is 0.1 - 0.05 mu behind it. From -0.3 m that place reaches the edge at 0 after a
    way s = 0.4 - 0.05 mu, in a time t with s = v t - mu N t^2 / 2 m.
    """
    path = scene(
        tmp_path,
        box("box", mass=1.0, half=(0.2, 0.1, 0.05)),
        {"slab": slab("slab", "5 5 0.5")},
        fixed={"slab": {"position_m": [-5, 0, -0.5]}},
        initial={"joints": {"robot/free": [-0.3, 0, 0.05, 1, 0, 0, 0]}, "rates": {"robot/free": [SPEED, 0, 0, 0, 0, 0]}},
        contacts={"rules": [{"name": "foot", "between": ["box", "slab/slab"], "restitution": 0.0, "mu": mu}]},
        contact_models=loaded(load("robot/box", "slab/slab", force_N=[[0, 0, -PRESS_N]], at_m=[-0.1, 0, 0])),
        **steps(step, 0.6),
    )
    run = proved(ffsm_mj.run(path))
    brake, way = mu * PRESS_N, 0.4 - 0.05 * mu
    tips = way / SPEED if mu == 0.0 else (SPEED - math.sqrt(SPEED**2 - 2 * brake * way)) / brake
    changes = [record.time_s for record in run.records["contact_changes"]]
    # The force at the rear corners vanishes to ten times its rounding, 1e-9 N of 10 N/s.
    assert min(abs(time_s - tips) for time_s in changes) < 2e-9
    assert len(ends(run)) == 1
