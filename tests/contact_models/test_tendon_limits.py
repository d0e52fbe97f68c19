"""Limits of tendons: unilateral rows along their lengths, in impacts, at rest and pressed, fixed and spatial."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from mcap.records import Message

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.cli.main import main
from ffsm_mj.contact.joint_limit import TendonLimit
from ffsm_mj.errors import InputError
from ffsm_mj.log.mcap.format import encode_record
from tests.balance.test_tendon_springs import BASE, MASSES, REACH, REDUCED, cord, masses
from tests.hostile.test_logs import changed
from tests.replays import proved
from tests.scenes import scene

RANGE = 'limited="true" range="-0.2 0.1"'
PULL = '<motor name="pull" tendon="cord"/>'


def sliding(folder, restitution=0.0, actuator="", rate=1.0, **scenario):
    """Two masses on slides part at 1 m/s, along a cord that may be 0.1 m longer."""
    return ffsm_mj.run(
        scene(
            folder,
            masses(RANGE, actuator),
            {},
            **{
                "duration_s": 0.4,
                "initial": {"rates": {"s_1": rate}},
                "joint_limits": {"cord": {"restitution": restitution}},
            }
            | scenario,
        )
    )


@pytest.mark.long(one_of=3)
@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_a_cord_stops_two_masses(tmp_path, e):
    """At t = 0.1 s the impulse is (1 + e) mu v, whatever the body that carries both; momenta are kept."""
    run = proved(sliding(tmp_path, e))
    first = run.records["limit_impacts"][0]
    assert (first.joint, first.side, first.unit) == ("robot/cord", "upper", "m")
    assert first.time_s == pytest.approx(0.1, abs=1e-12)
    assert first.impulse == pytest.approx((1.0 + e) * REDUCED, rel=1e-12)
    assert first.work_J == pytest.approx(-(1.0 - e * e) * 0.5 * REDUCED, abs=1e-12)
    rates = [dict(first.qvel_after)[f"robot/s_{i}"][0] for i in (1, 2)]
    assert rates[0] - rates[1] == pytest.approx(-e, abs=1e-12)
    assert MASSES[0] * rates[0] + MASSES[1] * rates[1] == pytest.approx(MASSES[0], rel=1e-12)
    if e == 0.0:  # they go on together, at rest at the limit
        last = run["state.q_robot_s_1_m"][-1] - run["state.q_robot_s_2_m"][-1]
        assert last == pytest.approx(0.1, abs=1e-12)
        assert run["contact.robot_cord_limit"][-1] != 0.0


def test_pressed_against_its_end(tmp_path):
    """A motor of the cord pulls with 3 N against the end: the limit carries 3 N, and lets go as it pulls back."""
    (tmp_path / "pull.csv").write_text("time_s,pull_N\n0,3\n0.35,-2\n0.5,-2\n")
    law = [{"name": "p", "until": "end", "controller": {"kind": "playback", "file": "pull.csv", "after": "hold"}}]
    run = proved(sliding(tmp_path, 0.0, PULL, rate=0.0, phases=law, duration_s=0.5))
    held = (run.time > 0.25) & (run.time < 0.34)
    np.testing.assert_allclose(run["contact.robot_cord_limit_force_N"][held], -3.0, atol=1e-11)
    later = 0.1 - 0.5 * 2.0 / REDUCED * (0.5 - 0.35) ** 2
    assert run["state.q_robot_s_1_m"][-1] - run["state.q_robot_s_2_m"][-1] == pytest.approx(later, abs=1e-11)


@pytest.fixture(scope="module")
def logged(tmp_path_factory):
    """The log of an impact at the end of a cord, e = 0.5, as the command writes and reads it."""
    folder = tmp_path_factory.mktemp("logged")
    path = scene(
        folder,
        masses(RANGE),
        {},
        duration_s=0.2,
        initial={"rates": {"s_1": 1.0}},
        joint_limits={"cord": {"restitution": 0.5}},
    )
    ffsm_mj.run(path, out=folder / "out", rerun=False)
    assert main(["analyze", str(folder / "out")]) == 0
    return ffsm_mj.load_run(folder / "out")


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("impulse", 1.5 * REDUCED + 1e-6),
        ("separation_rate", 0.5 + 1e-6),
        ("restitution", 0.6),
        ("limit", 0.1 + 1e-6),
        ("work_J", 0.0),
        ("side", "lower"),
    ],
)
def test_a_log_whose_impact_is_changed_fails(logged, tmp_path, field, value):
    """An impact at the end of a tendon is resolved again from the log alone."""
    (impact,) = logged.records["limit_impacts"]
    whole, other = encode_record(impact), encode_record(replace(impact, **{field: value}))

    def change(record):
        yield replace(record, data=other) if isinstance(record, Message) and record.data == whole else record

    assert main(["analyze", changed(logged, tmp_path / "x.mcap", change)]) == 1


@pytest.mark.long(one_of=3)
@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_a_cord_of_coupled_masses(tmp_path, e):
    """s_1 = -2 s_2: along their distance l the masses move by 2/3 and -1/3, and the bus by what keeps the momentum."""
    text = masses(RANGE).replace(' 0.1 0"', ' 0 0"')  # through the mass centre: nothing turns
    text = text.replace(
        "<actuator>", '<equality><joint joint1="s_1" joint2="s_2" polycoef="0 -2 0 0 0"/></equality><actuator>'
    )
    limits = {"cord": {"restitution": e}}
    run = proved(
        ffsm_mj.run(scene(tmp_path, text, {}, duration_s=0.4, initial={"rates": {"s_1": 1.0}}, joint_limits=limits))
    )
    m, a = np.array(MASSES), np.array([2.0, -1.0]) / 3.0
    along = m @ a**2 - (m @ a) ** 2 / (m.sum() + 3.0)
    first = run.records["limit_impacts"][0]
    assert first.time_s == pytest.approx(0.1 / 1.5, abs=1e-12)
    assert first.impulse == pytest.approx((1.0 + e) * 1.5 * along, rel=1e-11)


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_two_cords_of_one_length_stop_at_once(tmp_path, e):
    """Rows that depend on each other: the motion is that of one cord, and the work of both adds up to its own."""
    twin = '<joint joint="s_1" coef=".5"/><joint joint="s_2" coef="-.5"/>'
    twin = f'<fixed name="twin" limited="true" range="-1 .05">{twin}</fixed>'
    text = masses(RANGE).replace("</tendon>", f"{twin}</tendon>")
    limits = {name: {"restitution": e} for name in ("cord", "twin")}
    run = proved(
        ffsm_mj.run(scene(tmp_path, text, {}, duration_s=0.3, initial={"rates": {"s_1": 1.0}}, joint_limits=limits))
    )
    both = run.records["limit_impacts"]
    assert {each.joint for each in both} == {"robot/cord", "robot/twin"}
    rates = [dict(both[-1].qvel_after)[f"robot/s_{i}"][0] for i in (1, 2)]
    assert rates[0] - rates[1] == pytest.approx(-e, abs=1e-12)
    assert sum(each.work_J for each in both) == pytest.approx(-(1.0 - e * e) * 0.5 * REDUCED, abs=1e-12)


TAUT = 'limited="true" range="0.1 0.85"'
ROUND = f'<spatial name="cord" {TAUT}><site site="anchor"/><geom geom="drum"/><site site="tip"/></spatial>'


def swung(folder, step, e=0.0, tendon=None):
    """The path of an arm whose cord from base to tip becomes taut, and stays so for a while as the whole turns."""
    folder.mkdir(exist_ok=True)
    return scene(
        folder,
        REACH.format(tendon or cord(TAUT), ""),
        {},
        duration_s=0.96,
        time_step_s=step,
        control_period_s=0.008,
        initial={"joints": {"a": 0.3, "b": -1.6}, "rates": {"robot/free": [0.1, -0.2, 0.05, 0.2, -0.1, 0.3], "b": 1.5}},
        joint_limits={"cord": {"restitution": e}},
    )


@pytest.mark.long(one_of=3)
@pytest.mark.parametrize(("e", "tendon"), [(0.0, None), (1.0, None), (0.0, ROUND)])
def test_a_spatial_cord_is_taut(tmp_path, e, tendon):
    """The length never exceeds its end; all balances and checks hold, and the end converges with order four."""
    runs = [ffsm_mj.run(swung(tmp_path / str(k), 4e-3 / 2**k, e, tendon)) for k in range(3)]
    proved(runs[-1])
    assert runs[-1].records["limit_impacts"]
    keys = [key for key in runs[-1].keys if key.startswith("state.v_")]
    coarse, fine = (max(abs(run[key][-1] - runs[-1][key][-1]) for key in keys) for run in runs[:2])
    assert coarse / fine > 2**3.3
    assert fine < 1e-8
    if e == 0.0:
        assert (runs[-1]["contact.robot_cord_limit"] != 0.0).sum() > 80  # rows every 8 ms


@pytest.mark.parametrize("tendon", [cord(TAUT), ROUND])
def test_second_rate_of_a_length(tendon):
    """At zero generalised acceleration it is the second derivative along q + v t."""
    model = mujoco.MjModel.from_xml_string(REACH.format(tendon, ""))
    limit, data, random = TendonLimit(model, 0, "lower", 0.0), mujoco.MjData(model), np.random.default_rng(3)
    for _ in range(5):
        start, data.qvel[:] = np.array([*random.normal(size=7), 0.3, -1.2]), random.normal(size=model.nv)
        start[3:7] /= np.linalg.norm(start[3:7])
        lengths = []
        for time_s in (-1e-3, 1e-3, 0.0):
            data.qpos[:] = start
            mujoco.mj_integratePos(model, data.qpos, data.qvel, time_s)
            mujoco.mj_forward(model, data)
            lengths.append(limit.value(data))
        assert data.ten_wrapnum[0] == (4 if tendon is ROUND else 2)
        assert limit.bend(data) == pytest.approx((lengths[0] + lengths[1] - 2.0 * lengths[2]) / 1e-6, rel=1e-4, abs=1e-6)
        assert limit.rate(data) == pytest.approx(data.ten_velocity[0], rel=1e-12)


@pytest.mark.parametrize(
    ("tendon", "message"),
    [
        ('<fixed name="t" range="0 1"><joint joint="x" coef="1"/></fixed>', "acts on the world are not supported"),
        ('<fixed name="t" range="0 1e-7"><joint joint="one" coef="1"/></fixed>', "allows a single length"),
        ('<fixed name="t" range="0.2 1"><joint joint="one" coef="1"/></fixed>', "tendon robot/t starts at 0 rad, outside"),
    ],
)
def test_what_is_refused(tmp_path, tendon, message):
    """Each with its file and line, or its place in the scenario."""
    text = BASE.format(base="", tendon=tendon, actuator="")
    with pytest.raises(InputError, match=message):
        prepare(scene(tmp_path, text.replace("<option", '<compiler angle="radian"/><option'), {}))
