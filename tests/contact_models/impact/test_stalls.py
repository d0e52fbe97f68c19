"""Impacts that double precision cannot resolve end the run, soon and with one line."""

from __future__ import annotations

import time

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.contact_models.impact.laws import project
from tests.contact_models.impact.test_fixed import slab
from tests.scenes import box, scene


def squeezed(folder, mass):
    """A block of 4 kg falls on a crate of a given mass on a floor."""
    crate = box("crate", mass=1.0, half=(0.4, 0.4, 0.2)).replace('mass="1.0"', f'mass="{mass}"')
    return scene(
        folder,
        box("block", mass=4.0, half=(0.3, 0.3, 0.1)),
        {"crate": crate, "floor": slab("floor")},
        fixed={"floor": {"position_m": [0, 0, -0.5]}},
        duration_s=0.02,
        initial={
            "joints": {"robot/free": [0, 0, 0.501, 1, 0, 0, 0], "crate/free": [0, 0, 0.2, 1, 0, 0, 0]},
            "rates": {"robot/free": [0, 0, -1.0, 0, 0, 0]},
        },
        contacts={
            "rules": [
                {"between": ["crate/crate", "floor/floor"], "restitution": 0.3},
                {"between": ["block", "crate/crate"], "restitution": 0.3},
            ]
        },
    )


@pytest.mark.parametrize("mass", [1e-11, 1e-6, 1.0])
def test_a_light_crate_between_heavy_ones(tmp_path, mass):
    """A mass ratio of 4e11 took minutes of sweeps, and then 1000 impacts without impulse at one instant."""
    begun = time.process_time()
    run = ffsm_mj.run(squeezed(tmp_path, mass))
    assert time.process_time() - begun < 20.0
    assert run.outcome == "completed" or "the masses of the bodies in contact differ too much" in run.message
    assert len(run.impacts) < 200
    assert [check for check in all_checks(run) if not check.passes] == []


def test_sweeps_end_at_the_rounding_of_the_impulses(rng):
    """Rows almost cancel: impulses are 1e6 times the velocities that they change, and no sweep improves them."""
    for _ in range(20):
        light = 10 ** rng.uniform(-12, -3)
        M = np.array([4.0, light])
        J = np.array([[1.0, -1.0], [0.0, 1.0]])  # the upper one on the lower one, that one on the floor
        A = J / np.sqrt(M)
        w = np.sqrt(M) * (-1.0, 0.0)
        begun = time.process_time()
        impulses = project(A, w)
        assert time.process_time() - begun < 0.5
        np.testing.assert_allclose(impulses, [4.0, 4.0], rtol=1e-9)
