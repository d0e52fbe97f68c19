"""Runs with contact rules of many pairs: the physics of the pairs one by one, columns by rule, replays from any sample."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run import Run
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.errors import InputError
from ffsm_mj.replay import replay_log
from tests.contact.unions.judge import OF_ORDER
from tests.replays import assert_passes
from tests.scenes import HEAD, scene

FEET = 0.3
"""Half the distance of the feet of the table."""
TABLE = f"""<mujoco>{HEAD}<worldbody><body name="table"><freejoint name="free"/>
  <inertial pos="0 0 0.2" mass="4" diaginertia="0.3 0.3 0.4"/>
  <geom type="box" size="0.4 0.4 0.02" pos="0 0 0.2" mass="0"/>
  <geom name="foot" size="0.05" pos="{FEET} {FEET} 0" mass="0"/><geom size="0.05" pos="{-FEET} {FEET} 0" mass="0"/>
  <geom size="0.05" pos="{FEET} {-FEET} 0" mass="0"/><geom size="0.05" pos="{-FEET} {-FEET} 0" mass="0"/>
  <geom name="shell" type="box" size="0.45 0.45 0.3" contype="0" conaffinity="0" mass="0"/></body></worldbody></mujoco>"""
FLOOR = f"""<mujoco>{HEAD}<worldbody><body name="floor">
  <geom name="left" type="box" size="0.5 1 0.1" pos="-0.5 0 0" mass="1"/>
  <geom name="right" type="box" size="0.5 1 0.1" pos="0.5 0 0" mass="1"/></body></worldbody></mujoco>"""
DOWN = '<option gravity="0 0 -2"/>'
PLACES = ["table_geom", *(f"table_geom_{i}" for i in (2, 3, 4))]
"""Generated names of the geoms without one: the plate and three feet."""


def table(folder, contacts=None, **changes):
    """A table of four feet falls on a floor of two slabs, tilted, and comes to rest on both."""
    folder.mkdir(exist_ok=True)
    robot, floor = (text.replace(HEAD, DOWN) for text in (TABLE, FLOOR))
    return scene(
        folder,
        robot,
        {"floor": floor},
        fixed={"floor": {"position_m": [0, 0, -0.1]}},
        **{
            "conservative": False,
            "duration_s": 1.5,
            "time_step_s": 2e-3,
            "control_period_s": 4e-3,
            "initial": {
                "joints": {"free": [0.02, 0.01, 0.2, math.cos(0.1), 0.6 * math.sin(0.1), 0.8 * math.sin(0.1), 0]},
                "rates": {"free": [0.05, 0, 0, 0, 0, 0.1]},
            },
            "contacts": {"default": {"restitution": 0.3}} if contacts is None else contacts,
        }
        | changes,
    )


@pytest.fixture(scope="module")
def fallen(tmp_path_factory):
    return ffsm_mj.run(table(tmp_path_factory.mktemp("fallen") / "a"))


@pytest.fixture(scope="module")
def apart(tmp_path_factory):
    """The same with a rule for each pair of geoms."""
    rules = [{"between": [geom, slab], "restitution": 0.3} for geom in ("foot", *PLACES) for slab in ("left", "right")]
    return ffsm_mj.run(table(tmp_path_factory.mktemp("apart") / "b", {"rules": rules}))


def test_default_contacts_resolve_every_geom_that_collides(fallen):
    """Four feet and a plate on two slabs that touch: one pair; the shell, which collides with nothing, passes through."""
    assert_passes(fallen)
    assert not fallen.unhandled_contacts
    assert {record.rule for record in fallen.impacts} == {"robot-floor"}
    feet = {record.geoms[0] for record in fallen.impacts}
    assert feet == {"robot/foot", *(f"robot/{name}" for name in PLACES[1:])}
    assert {record.geoms[1] for record in fallen.impacts} == {"floor/left", "floor/right"}
    assert {record.pair for record in fallen.impacts} == {"robot-floor"}
    # Each beginning and end names feet that touch there, not the plate.
    changes = [*fallen.records["contact_beginnings"], *fallen.records["contact_endings"]]
    assert changes
    assert {record.geoms[0] for record in changes} <= feet
    right = {"robot/foot", "robot/table_geom_3"}  # at x > 0
    assert all((record.geoms[1] == "floor/right") == (record.geoms[0] in right) for record in changes)
    # At rest on four feet: 4 kg at 2 m/s^2.
    assert fallen["contact.robot_floor_pairs"][-1] == 1
    assert fallen["contact.robot_floor_force_N"][-1] == pytest.approx(8.0, rel=1e-6)
    assert fallen["contact.robot_floor_force_z_N"][-1] == pytest.approx(-8.0, rel=1e-6)  # on the floor
    centre = [fallen[f"contact.robot_floor_centre_{axis}_m"][-1] for axis in "xy"]
    place = [fallen[f"state.q_robot_free_{axis}_m"][-1] for axis in "xy"]
    assert centre == pytest.approx(place, abs=1e-4)  # under the centre of mass, as nothing moves
    gaps = fallen["contact.robot_floor_gap_m"]
    assert abs(gaps[-1]) < 1e-9
    # Evaluated every fifth sample of 4 ms, and held: while the table falls, each evaluation differs.
    falling = gaps[: int(fallen.impacts[0].time_s / 4e-3)]
    assert np.flatnonzero(np.diff(falling)).tolist() == list(range(4, len(falling) - 1, 5))


def test_a_rule_of_many_pairs_is_the_physics_of_rules_of_one_pair_each(fallen, apart):
    """Rules decide columns and coefficients, not the motion, but for the order of sums, whose rounding impacts pass on."""
    allowed = OF_ORDER * (1 + len(fallen.impacts))
    shared = [key for key in fallen.keys if not key.startswith("contact.")]
    for key in shared:
        np.testing.assert_allclose(fallen[key], apart[key], rtol=allowed, atol=allowed, err_msg=key)
    # Contacts of one instant have no order.
    ours, theirs = (sorted(run.impacts, key=lambda r: (round(r.time_s, 9), r.geoms)) for run in (fallen, apart))
    assert [r.geoms for r in ours] == [r.geoms for r in theirs]
    # A gap is rounded to some 1e-14 m, and the time at which it closes to that over its rate, of several contacts of one
    # instant the fastest; the table of 4 kg gains 8 N times this time before, and its impulse up to (1 + e) times as much.
    fastest = {hit.event: 0.0 for hit in ours}
    for hit in ours:
        fastest[hit.event] = max(fastest[hit.event], hit.approach_speed_m_s)
    late_s = {event: 1e-14 / speed for event, speed in fastest.items()}
    for one, other in zip(ours, theirs, strict=True):
        assert one.time_s == pytest.approx(other.time_s, abs=allowed + late_s[one.event])
        assert one.impulse_N_s == pytest.approx(other.impulse_N_s, abs=allowed + 1.3 * 8.0 * late_s[one.event])
    allowed += 1.3 * 8.0 * sum(late_s.values())
    for column in ("force_N", "impulse_N_s"):
        every = sum(apart[f"contact.{name}_{column}"] for name in names_of(apart))
        np.testing.assert_allclose(fallen[f"contact.robot_floor_{column}"], every, rtol=allowed, atol=allowed)
    smallest = np.min([apart[f"contact.{name}_gap_m"] for name in names_of(apart)], axis=0)
    np.testing.assert_allclose(fallen["contact.robot_floor_gap_m"], smallest, atol=allowed)


def names_of(run):
    return [key.removeprefix("contact.").removesuffix("_mode") for key in run.keys if key.endswith("_mode")]


@pytest.mark.long
def test_a_replay_agrees_and_starts_again_after_any_gap(fallen):
    """Of the pairs of a rule, columns say only how many are closed; records say which."""
    assert replay_log(fallen.log).agrees
    log, count = fallen.log, len(fallen.log.rows)
    closed = np.flatnonzero(fallen["contact.robot_floor_pairs"] >= 1)
    cuts = [int(closed[0]) + 1, int(closed[len(closed) // 2])]
    for cut in cuts:
        kept = np.r_[0 : cut - 5, cut:count]
        again = replay_log(replace(log, rows=log.rows[kept]))
        assert again.agrees, (cut, again.worst)


@pytest.mark.long
def test_a_changed_gap_is_found(fallen):
    rows = fallen.log.rows.copy()
    rows[200, fallen.log.header.layout.index["contact.robot_floor_gap_m"]] += 1e-6
    assert not replay_log(replace(fallen.log, rows=rows)).agrees


def test_records_list_what_is_closed(apart):
    """From the records alone: the pairs that began and did not end are those that the last record lists."""
    closed: set[str] = set()
    events = sorted(
        (record for kind in ("contact_beginnings", "contact_changes", "contact_endings") for record in apart.records[kind]),
        key=lambda record: record.event,
    )
    for number in sorted({record.event for record in events}):
        records = [record for record in events if record.event == number]
        for record in records:
            if record in apart.records["contact_beginnings"]:
                closed.add(record.pair)
            elif record in apart.records["contact_endings"]:
                closed.discard(record.pair)
        assert set(records[-1].closed_pairs) == closed
    assert len(closed) == 4


def test_the_last_rule_that_names_a_pair_has_it(tmp_path):
    rules = [
        {"between": ["robot", "floor"], "restitution": 0.1},
        {"between": ["*", "right"], "mu": 0.2, "name": "rough"},
        {"between": ["table/*", "left"], "restitution": 0.2, "name": "body"},
        {"between": ["left", "foot"], "restitution": 0.7},
    ]
    contacts = {"default": {"restitution": 0.5}, "rules": rules}
    ignored = [{"between": [PLACES[0], "floor"], "reason": "the plate is above its feet"}]
    with pytest.raises(InputError, match=r"contacts\.rules\.0: has no effect: every pair that it names is in later rules"):
        prepare(table(tmp_path / "none", contacts))
    rules[0]["between"] = ["robot", "left"]
    with pytest.raises(InputError, match=r"contacts\.rules\.0: has no effect"):
        prepare(table(tmp_path / "none", contacts))
    contacts = {"default": {"restitution": 0.5}, "rules": rules[1:], "ignored": ignored}
    prepared = prepare(table(tmp_path / "some", contacts))
    assembly = prepared.assemble()
    name = assembly.system.mj.geom
    found = {
        frozenset(name(geom).name for geom in geoms): (pair.rule, pair.restitution, pair.mu)
        for pair in assembly.pairs
        for geoms in pair.geom_pairs
    }
    feet = ["robot/foot", *(f"robot/{place}" for place in PLACES[1:])]
    assert found == {
        **{frozenset((foot, "floor/right")): ("rough", 0.5, 0.2) for foot in feet},
        **{frozenset((foot, "floor/left")): ("body", 0.2, 0.0) for foot in feet[1:]},
        frozenset((feet[0], "floor/left")): ("left-foot", 0.7, 0.0),
    }
    text = "\n".join(prepared.describe())
    assert "rough: e = 0.5, mu = 0.2, 4 pairs (1 more ignored or in later rules)" in text
    assert "left-foot: e = 0.7, robot/foot - floor/left" in text


def test_a_shape_without_an_exact_distance_ends_the_run_where_it_is_met(tmp_path):
    """A height field below the table, which moves, is no fault of a rule between models."""
    path = table(tmp_path / "ground")
    asset = '<asset><hfield name="flat" nrow="2" ncol="2" size="0.1 0.1 0.01 0.1" elevation="0 0 0 0"/></asset><worldbody>'
    skirt = '<geom name="skirt" type="hfield" hfield="flat" pos="0 0 -0.05" mass="0"/></body></worldbody>'
    text = TABLE.replace(HEAD, DOWN).replace("<worldbody>", asset).replace("</body></worldbody>", skirt)
    (path.parent / "robot.xml").write_text(text)
    notes = prepare(path).notes()
    assert any("the run ends where one of 2 pairs meets: geom 'robot/skirt' is a height field" in note for note in notes)
    run = ffsm_mj.run(path)
    assert run.outcome == "unsupported_contact"
    assert "robot/skirt" in run.message
    assert "is a height field: impacts need convex geoms" in run.message
    # Its bottom, 0.05 m above the floor but for the tilt, falls at 2 m/s^2.
    assert 0.1 < run.time[-1] < 0.25
    with pytest.raises(InputError, match=r"contacts\.rules\.0\.between: geom 'robot/skirt' is a height field"):
        prepare(path, {"contacts": {"rules": [{"between": ["skirt", "left"]}]}})


def test_the_robot_with_itself_only_if_asked(tmp_path):
    """A lid on a hinge closes on its own base: through it by default, and that is reported; with a rule it bounces."""
    box = f"""<mujoco>{HEAD}<worldbody><body name="base"><freejoint name="free"/>
      <inertial pos="0 0 0" mass="5" diaginertia="0.3 0.3 0.3"/><geom name="base" type="box" size="0.3 0.3 0.1" mass="0"/>
      <body name="post" pos="0 0 0.2"><joint name="post" axis="0 0 1"/>
        <inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 0.1"/>
        <body name="lid" pos="-0.25 0 0"><joint name="lid" axis="0 1 0"/>
          <inertial pos="0.2 0 0" mass="1" diaginertia="0.01 0.02 0.02"/>
          <geom name="lid" type="capsule" fromto="0 0 0 0.4 0 0" size="0.02" mass="0"/></body></body></body>
      </worldbody></mujoco>"""
    start = {"joints": {"lid": -0.5}, "rates": {"lid": 1.0}}
    one = ffsm_mj.run(scene(tmp_path, box, {}, initial=start, duration_s=1.5, contacts={}))
    assert not one.impacts
    assert [contact.geoms for contact in one.unhandled_contacts] == [("robot/base", "robot/lid")]
    rule = {"rules": [{"between": ["robot", "self"], "restitution": 0.5}]}
    other = ffsm_mj.run(scene(tmp_path, box, {}, initial=start, duration_s=1.5, contacts=rule))
    assert {impact.rule for impact in other.impacts} == {"robot-self"}
    assert not other.unhandled_contacts
    assert all(check.passes for check in all_checks(other))
    assert Run(other.log).impacts == other.impacts
    (told, *_) = other.summary()["impacts"]
    assert (told["rule"], tuple(told["geoms"])) == ("robot-self", ("robot/base", "robot/lid"))
