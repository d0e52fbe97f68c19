"""Ticks that a replay takes in the core: what it finds is the same without them, to the last bit, whatever the log says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.replay import replay_log
from ffsm_mj.replay.logged_motion import LoggedMotion
from ffsm_mj.scenario.shipped import scenario_names
from tests.replay.test_replay import SCENES
from tests.scenes import two_balls

FLIGHTS = ("free-flying-hardware", "coasting", "no-actuation")
"""Scenarios whose replay is in the core but where bodies are close."""
GROUPS = ("state", "actuators", "controller", "contact")
NAMES = [*FLIGHTS, *(name for name in scenario_names() if name not in FLIGHTS)]


def found(log, monkeypatch, *, in_core):
    """Rows, the worst differences, and the number of rows that the core wrote."""
    rows, written, of = [], [], LoggedMotion.of

    def watched(*given):
        flight = of(*given) if in_core else None
        if flight is not None:
            take = flight.take
            flight.take = lambda *where: written.append(take(*where)) or written[-1]
        return flight

    with monkeypatch.context() as patched:
        patched.setattr(LoggedMotion, "of", watched)
        again = replay_log(log, rows=rows.append)
    return np.concatenate(rows), repr((again.worst, again.samples, again.gaps, again.obstacle)), sum(written)


def in_core(log, monkeypatch):
    """Number of rows that the core wrote, after a comparison with a replay without it."""
    own, other = (found(log, monkeypatch, in_core=each) for each in (True, False))
    np.testing.assert_array_equal(own[0], other[0])
    assert own[1] == other[1]
    assert other[2] == 0
    return own[2]


@pytest.mark.long(one_of=25)
@pytest.mark.parametrize("name", NAMES)
def test_a_replay_is_the_same_without_the_core(name, monkeypatch):
    log = ffsm_mj.run(name, {"duration_s": 9.0, "terminal": None}).log  # longer than the flight to any first contact
    written = in_core(log, monkeypatch)
    assert written > 0.5 * len(log.rows) or name not in FLIGHTS


@pytest.mark.long
@pytest.mark.parametrize("scene", sorted(SCENES, reverse=True))
def test_so_is_that_of_a_log_with_changes(scene, tmp_path, monkeypatch, rng):
    """Numbers changed by rounding and by more, none at all, rows that are missing: where the core stops, and goes on."""
    log = ffsm_mj.run(*SCENES[scene](tmp_path)).log
    assert in_core(log, monkeypatch) > 0 or scene == "stopped at the impact"
    places = [
        i
        for i, key in enumerate(log.header.layout.keys)
        if key.split(".")[0] in ("state", "actuators", "controller", "contact")
    ]
    for by in (1e-16, 1e-9, 1e-3, np.nan, 1e20):
        rows = np.array(log.rows)
        for row in rng.integers(len(rows), size=4):
            place = rng.choice(places)
            rows[row, place] = rows[row, place] * (1.0 + by) + by
        in_core(replace(log, rows=rows), monkeypatch)
    kept = rng.random(len(log.rows)) < 0.9
    in_core(replace(log, rows=np.array(log.rows)[kept]), monkeypatch)


@pytest.mark.long
def test_a_force_where_nothing_touches_fails_its_check(tmp_path, monkeypatch):
    """In the middle of free flight, which the core takes but for that row."""
    log = ffsm_mj.run(two_balls(tmp_path, restitution=0.0, duration_s=1.5)).log  # more rows than a replay takes at once
    rows, (force,) = np.array(log.rows), (i for i, key in enumerate(log.header.layout.keys) if key.endswith("_force_x_N"))
    rows[67, force] = 1.0
    again = replay_log(replace(log, rows=rows))
    assert [(check.name, check.time_s) for check in again.checks() if not check.passes] == [
        ("contact complementarity", log.rows[67, log.header.layout.time])
    ]
    assert in_core(replace(log, rows=rows), monkeypatch) > 100


def test_efforts_that_are_held_after_a_gap_are_not_decided_anew(tmp_path, monkeypatch):
    """On a torque-speed line the limits at the first row after it are those of another speed than that of the log."""
    log = ffsm_mj.run(*SCENES["driven"](tmp_path)).log
    rows = np.delete(np.array(log.rows), range(96, 99), axis=0)
    rows[96, log.header.layout.index["state.v_robot_x_m_s"]] += 1e-6
    in_core(replace(log, rows=rows), monkeypatch)
    rows = np.delete(np.array(log.rows), range(40, 44), axis=0)
    rows[40, log.header.layout.index["state.v_robot_x_m_s"]] += 1e-6
    in_core(replace(log, rows=rows), monkeypatch)
