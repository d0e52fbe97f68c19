"""Near misses: of equal approaches the first counts, in every inertial frame; all fields of one are known to rounding."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.optimize import brentq

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.contact_models.impact import time_of_impact
from ffsm_mj.replay import replay_log
from tests.changed_logs import with_records
from tests.replays import assert_replayed
from tests.scenes import ball, scene

OFF = {"kind": "off"}
FRAMES = [(0.0, 0.0, 0.0), (-7.3, 0.4, 2.1)]
ARM = 0.05
"""Offset of the site from the centre of the ball, m."""


def near_miss(folder, place, rates, within, frame, **changes):
    """The near miss of a spinning ball at a place (3,) m, with rates (6,) relative to a hand at rest at the origin."""
    base = [*frame, 0.0, 0.0, 0.0]
    path = scene(
        folder,
        ball("hand"),
        {"target": ball("target", extra=f'<site name="handle" pos="{ARM} 0 0"/>')},
        initial={
            "joints": {"target/free": [*place, 1, 0, 0, 0]},
            "rates": {"target/free": (np.array(base) + rates).tolist(), "robot/free": base},
        },
        grasps={"grasp": {"robot_site": "robot/centre", "object_site": "handle", "when": {"within": within}}},
        contacts={"rules": []},
        phases=[
            {"name": "try", "for_s": 0.8, "arm": ["grasp"], "controller": OFF},
            {"name": "rest", "until": "end", "controller": OFF},
        ],
        control_period_s=2e-2,
        **{"duration_s": 1.0, **changes},
    )
    run = ffsm_mj.run(path)
    assert_replayed(run)
    (miss,) = run.records["near_misses"]
    return miss, run


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("drift", [0.0, 1e-15])
def test_of_equal_distances_the_first_counts_in_every_inertial_frame(tmp_path, frame, drift):
    """Hand and ball keep their distance, which rounding changes by 1e-16 m at rest and 1e-15 m in a moving frame."""
    miss, _ = near_miss(tmp_path, (0.3, 0.03, 0.0), (0.0, 0.0, drift, 0.0, 0.0, 0.0), {"position_m": 0.01}, frame)
    assert miss.least_s == 0.0
    assert miss.position_m == pytest.approx(math.hypot(0.3 + ARM, 0.03), abs=1e-14)


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("step_s", [1e-3, 2e-2])
def test_all_fields_of_a_minimum_are_known_to_rounding(tmp_path, step_s, frame):
    """The handle passes on a cycloid, so that the relative velocity at the minimum depends on its time.

    Handle at p + v t + R(w t) s: the distance is least where its product with v + w x R(w t) s vanishes. Velocities of 1 m/s
    and offsets of 0.1 m that are known to 1e-15 give the root to 1e-14 s; sums over steps and a frame at 7 m/s, where places
    are known to 1e-15 m, add some more: 1e-12 s in all, and fields that vary by 1 and less per second as well.
    """
    v, spin, place = np.array([-0.6, 0.1]), 3.0, np.array([0.2537, 0.11])

    def motion(t):
        c, s = math.cos(spin * t), math.sin(spin * t)
        return place + v * t + ARM * np.array([c, s]), v + spin * ARM * np.array([-s, c])

    least_s = brentq(lambda t: float(np.dot(*motion(t))), 0.2, 0.6, xtol=1e-15)
    offset, velocity = motion(least_s)
    miss, run = near_miss(
        tmp_path, (*place, 0.0), (*v, 0.0, 0.0, 0.0, spin), {"position_m": 0.001}, frame, time_step_s=step_s
    )
    assert miss.least_s == pytest.approx(least_s, abs=1e-12)
    assert miss.position_m == pytest.approx(np.linalg.norm(offset), abs=1e-12)
    assert miss.speed_m_s == pytest.approx(np.linalg.norm(velocity), abs=1e-12)
    assert miss.angle_rad == pytest.approx(spin * least_s, abs=5e-12)
    # The log proves it: another time of the approach, with the fields of that time, does not agree.
    late_s = miss.least_s + 1e-9
    late = dataclasses.replace(
        miss, least_s=late_s, speed_m_s=float(np.linalg.norm(motion(late_s)[1])), angle_rad=spin * late_s
    )
    records = {**run.log.records, "near_misses": (late,)}
    assert not replay_log(with_records(run.log, records)).agrees


@pytest.mark.parametrize("frame", FRAMES)
def test_of_values_that_fail_alike_the_first_is_named_in_every_inertial_frame(tmp_path, frame):
    """The ball comes nearer and turns away: the largest ratio is least where both are equal, d(t) / 0.01 = w t / 0.02."""
    spin, within = 0.4, {"position_m": 0.01, "angle_rad": 0.02}
    rates = (-0.3, 0.0, 0.0, 0.0, 0.0, spin)
    miss, _ = near_miss(tmp_path, (0.3, 0.0, 0.0), rates, within, frame)

    def offset(t):
        return math.hypot(0.3 - 0.3 * t + ARM * math.cos(spin * t), ARM * math.sin(spin * t))

    least_s = brentq(lambda t: offset(t) / 0.01 - spin * t / 0.02, 0.0, 0.8, xtol=1e-15)
    assert miss.failed == "position_m"
    assert miss.least_s == pytest.approx(least_s, abs=1e-12)
    assert miss.least_ratio == pytest.approx(miss.angle_rad / 0.02, abs=1e-9)
    assert miss.failed_value == miss.position_m


def test_the_rates_after_an_impact_that_ends_the_run_count(tmp_path):
    """Two equal balls meet at 1 m/s with e = 0.5: their relative speed is least after the impact, 0.5 m/s."""
    path = scene(
        tmp_path,
        ball("hand"),
        {"target": ball("target", extra='<site name="handle" pos="0 0 0"/>')},
        initial={
            "joints": {"target/free": [0.5, 0, 0, 1, 0, 0, 0]},
            "rates": {"target/free": [-1.0, 0, 0, 0, 0, 0]},
        },
        grasps={"grasp": {"robot_site": "robot/centre", "object_site": "handle", "when": {"within": {"speed_m_s": 0.1}}}},
        contacts={"default": {"restitution": 0.5}},
        phases=[{"name": "try", "until": "end", "arm": ["grasp"], "controller": OFF}],
        stop_on_impact=True,
        duration_s=1.0,
    )
    run = ffsm_mj.run(path)
    (impact,), (miss,) = run.impacts, run.records["near_misses"]
    assert miss.time_s == impact.time_s == pytest.approx(miss.least_s, abs=1e-14)
    assert miss.least_ratio == pytest.approx(5.0, abs=1e-12)  # exact but for some 1e-15 of rounding
    assert [str(check) for check in all_checks(run) if not check.passes] == []
    assert_replayed(run)


def test_a_run_that_is_given_up_within_a_step_records_what_it_reached(tmp_path, monkeypatch):
    """The search for an impact moves the state along the step; what is recorded at the end is the state at its start."""
    monkeypatch.setattr(time_of_impact, "_MAX_EVALUATIONS", 2)
    target = ball("target", extra='<site name="handle" pos="0 0 0"/>')
    path = scene(
        tmp_path,
        ball("hand"),
        {"target": target.replace('type="sphere" size="0.1"', 'type="box" size="0.1 0.1 0.1"')},
        initial={
            "joints": {"target/free": [0.5, 0, 0, 1, 0, 0, 0]},
            "rates": {"target/free": [-1.0, 0, 0, 0, 0, 0]},
        },
        grasps={"grasp": {"robot_site": "robot/centre", "object_site": "handle", "when": {"within": {"speed_m_s": 0.1}}}},
        phases=[{"name": "try", "until": "end", "arm": ["grasp"], "controller": OFF}],
        contacts={"default": {"restitution": 0.5}},
        time_step_s=0.02,
        control_period_s=0.02,
        duration_s=1.0,
    )
    run = ffsm_mj.run(path)
    (miss,) = run.records["near_misses"]
    assert run.outcome == "diverged"
    assert miss.time_s == run.time[-1]
    assert list(miss.qpos) == run.qpos[-1].tolist()
    assert_replayed(run)
