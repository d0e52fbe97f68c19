"""Directions of slow slips are known to the rounding of velocities only, and forces no better."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.contact_models.persistent.friction.modes import FrictionModes
from ffsm_mj.contact_models.persistent.friction.point_modes import SLIDE, STICK
from ffsm_mj.contact_models.persistent.rows import ContactPoint
from ffsm_mj.replay import replay_log
from tests.contact_models.persistent.friction.reading import good
from tests.contact_models.persistent.test_friction_seen import on_floor


@pytest.fixture(scope="module")
def slow(tmp_path_factory):
    """A sphere of 1 N on a floor, mu = 0.2, that slides along x at 1e-6 m/s in its first row."""
    path = on_floor(tmp_path_factory.mktemp("slow"), rates=(1e-6, 0.0, 0.0, 0.0, 0.0, 0.0), duration_s=8e-3)
    return good(ffsm_mj.run(path)).log


@pytest.mark.parametrize(
    ("column", "error", "agrees"),
    [
        ("contact.sole_friction_y_N", 1e-7, True),
        ("contact.sole_force_y_N", 1e-7, True),
        ("contact.sole_friction_y_N", 3e-7, False),
        ("contact.sole_friction_x_N", 1e-9, False),
        ("contact.sole_force_z_N", 1e-9, False),
        ("contact.sole_slip_m_s", 1e-9, False),
    ],
)
def test_columns_are_compared_to_the_turn_of_a_slip_by_its_rounding(slow, column, error, agrees):
    """1e-12 m/s of 1e-6 m/s turn 0.2 N by 2e-7 N, across the slip alone."""
    rows = np.array(slow.rows)
    rows[0, slow.header.layout.index[column]] += error
    again = replay_log(replace(slow, rows=rows))
    assert again.agrees == agrees, again.worst


def test_the_forces_of_a_fast_slip_are_known_to_rounding(tmp_path):
    path = on_floor(tmp_path, rates=(0.1, 0.0, 0.0, 0.0, 0.0, 0.0), duration_s=8e-3)
    log = good(ffsm_mj.run(path)).log
    rows = np.array(log.rows)
    rows[0, log.header.layout.index["contact.sole_friction_y_N"]] += 1e-9
    assert not replay_log(replace(log, rows=rows)).agrees


@pytest.mark.parametrize(("kind", "drifts"), [(STICK, True), (SLIDE, False)])
def test_points_that_replace_others_that_stick_drift(kind, drifts):
    """A change of motion finds the features of a pair anew; velocities of sticking points drift between projections."""
    pair = SimpleNamespace(mu=0.5)
    old, new = ((ContactPoint(pair, None),) for _ in range(2))
    modes, still = FrictionModes(), np.zeros((1, 3))
    modes.set(old, np.array([kind]), still, np.zeros(1), np.array([kind == SLIDE]))
    assert not modes.of(new).drifts.any()
    modes.replace(old, new)
    assert modes.of(new).drifts.all() == drifts
    restore = modes.snapshot()
    modes.set(new, np.array([SLIDE]), still, np.ones(1), np.array([True]))
    assert not modes.of(new).drifts.any()
    restore()  # a step that step-size control rejects
    assert modes.of(new).drifts.all() == drifts
