"""Directions of slow slips are known to the rounding of velocities only, and forces no better."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.contact_models.persistent.contact_points import ContactPoint
from ffsm_mj.contact_models.persistent.force_check import _direction
from ffsm_mj.contact_models.persistent.friction.modes import SLIDE, STICK, FrictionModes, slipping_points
from ffsm_mj.contact_models.persistent.friction.problem import slip_directions
from ffsm_mj.replay import replay_log
from ffsm_mj.tolerances import CLOSED_RATE, RATE
from tests.contact_models.persistent.test_friction_seen import BODY, FLOOR, on_floor
from tests.replays import proved
from tests.scenes import scene


@pytest.fixture(scope="module")
def slow(tmp_path_factory):
    """A sphere of 1 N on a floor, mu = 0.2, that slides along x at 1e-6 m/s in its first row."""
    path = on_floor(tmp_path_factory.mktemp("slow"), rates=(1e-6, 0.0, 0.0, 0.0, 0.0, 0.0), duration_s=8e-3)
    return proved(ffsm_mj.run(path)).log


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
    log = proved(ffsm_mj.run(path)).log
    rows = np.array(log.rows)
    rows[0, log.header.layout.index["contact.sole_friction_y_N"]] += 1e-9
    assert not replay_log(replace(log, rows=rows)).agrees


@pytest.mark.parametrize(("kind", "drifts"), [(STICK, True), (SLIDE, False)])
def test_points_that_replace_others_that_stick_drift(kind, drifts):
    """A change of motion finds the features of a pair anew; velocities of sticking points drift between projections."""
    pair = SimpleNamespace(mu=0.5)
    old, new = ((ContactPoint(pair, None),) for _ in range(2))
    modes, still = FrictionModes(), np.zeros((1, 3))
    modes.set(old, np.array([kind]), still, np.zeros(1), np.array([kind == SLIDE]), np.array([False]))
    assert not modes.of(new).drifts.any()
    modes.replace(old, new)
    assert modes.of(new).drifts.all() == drifts
    restore = modes.snapshot()
    modes.set(new, np.array([SLIDE]), still, np.ones(1), np.array([True]), np.array([False]))
    assert not modes.of(new).drifts.any()
    restore()  # a step that step-size control rejects
    assert modes.of(new).drifts.all() == drifts


@pytest.mark.parametrize(("mu", "slides"), [(0.0, True), (0.5, False)])
def test_a_point_stops_with_another_one_that_stops_but_not_with_one_without_friction(mu, slides):
    """The first slips at 50 times the speed at which one stops; the second, on the same body, is at rest."""
    points = ContactPoint(SimpleNamespace(mu=0.5), None), ContactPoint(SimpleNamespace(mu=mu), None)
    modes, none = FrictionModes(), np.array([False, False])
    modes.set(points, np.array([SLIDE, SLIDE]), np.zeros((2, 3)), np.array([1e-3, 0.0]), ~none, none)
    before = modes.of(points)
    slips = np.array([50.0 * before.stop_speeds[0], 0.0])
    found = slipping_points(slips, before.sliding, before.stop_speeds, np.full(2, 1e-13), none, before.drifts, struck=False)
    assert found[0] == slides


@pytest.mark.parametrize(("largest_m_s", "bound_m_s"), [(1e-3, CLOSED_RATE), (20.0, 4e-6)])
def test_sticking_points_slip_beyond_the_drift_of_a_step_and_twice_what_stops_together(largest_m_s, bound_m_s):
    """Corners of a block that stops from 20 m/s stop at 2e-8 m/s, others within 100 times that with them: 2e-6 m/s."""
    at_rest, none = np.full(1, RATE), np.array([False])
    for share, slips in ((0.9, False), (1.1, True)):
        slip = np.array([share * bound_m_s])
        assert slipping_points(slip, none, np.array([1e-9 * largest_m_s]), at_rest, none, ~none, struck=False) == slips
        assert slipping_points(slip, none, np.array([1e-9 * largest_m_s]), at_rest, none, none, struck=False)


@pytest.mark.parametrize("width", [0.9, 0.6])
def test_a_point_that_rolls_in_long_steps_does_not_slip_while_another_one_slides(tmp_path, width):
    """Of two rolls, steps of 20 ms leave slips up to 1e-10 m/s, and above: truncation, projected out at the next step."""
    option = '<option gravity="0 0 -10"/>'
    roll = BODY.format(gravity=option, geom=f'type="ellipsoid" size="1 {width} 0.95"').replace('name="body"', 'name="roll"')
    path = scene(
        tmp_path,
        BODY.format(gravity=option, geom='type="box" size="1 1 0.5"'),
        {"floor": FLOOR.format(gravity=option), "roll": roll},
        fixed={"floor": {"position_m": [0.0, 0.0, -1.0]}},
        conservative=False,
        initial={
            "joints": {"robot/free": [0, 0, 0.5, 1, 0, 0, 0], "roll/free": [0, 8, 0.95, 1, 0, 0, 0]},
            "rates": {"robot/free": [8, 0, 0, 0, 0, 0], "roll/free": [0, -1.9, 0, 2, 0, 0.3]},
        },
        contacts={
            "rules": [
                {"between": ["robot", "floor"], "restitution": 0.0, "mu": 0.2},
                {"between": ["roll", "floor"], "restitution": 0.0, "mu": 3.0},
            ]
        },
        duration_s=0.4,
        time_step_s=2e-2,
        control_period_s=2e-2,
    )
    run = ffsm_mj.run(path, check=False)
    assert run.outcome == "completed"
    assert "contact_slips" not in {name for name, records in run.records.items() if records}


@pytest.mark.parametrize("pinned", [True, False])
def test_a_point_that_cannot_slip_keeps_the_direction_of_its_friction(pinned):
    """It is in the mode of points that slide without any slip, whose direction is rounding in every stage."""
    point, modes = ContactPoint(SimpleNamespace(mu=0.5), None), FrictionModes()
    none = np.array([False])
    modes.set([point], np.array([SLIDE]), np.array([[0.6, 0.8, 0.0]]), np.array([1e-16]), none, np.array([pinned]))
    assert modes.of((point,)).straight.tolist() == [pinned]
    problem = SimpleNamespace(lines=none)
    slip, kept = np.array([[1e-16, -1e-16]]), np.array([[0.6, 0.8]])
    found, _ = slip_directions(problem, slip, kept, ~none, modes.of((point,)).straight)
    assert np.array_equal(found, kept) == pinned


def test_the_force_check_lets_a_point_that_sticks_in_the_replay_slide_along_its_own_slip():
    assert np.array_equal(_direction(np.array([0.0, 2e-5]), np.zeros(2), 1e-12), [0.0, 1.0])


@pytest.mark.parametrize(("turn", "follows"), [(1e-9, True), (1e-3, False)])
def test_the_force_check_takes_the_replayed_direction_of_a_slip_where_rounding_makes_the_difference(turn, follows):
    """At 2e-5 m/s, known to 1e-12 m/s: to 5e-8 rad."""
    along = np.array([np.cos(turn), np.sin(turn)])
    found = _direction(np.array([2e-5, 0.0]), along, 1e-12)
    assert np.array_equal(found, along if follows else [1.0, 0.0])
