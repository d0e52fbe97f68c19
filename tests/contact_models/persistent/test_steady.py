"""Shortcut through steady states: the same logs as without it, and no state taken for steady that is not."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj._core.steady import SteadyContacts
from ffsm_mj.contact_models.persistent import closed_contacts
from ffsm_mj.contact_models.persistent.closed_contacts import ForceSolver
from ffsm_mj.contact_models.persistent.rule_columns import RuleMode
from ffsm_mj.tolerances import PROJECTED_SLIP_M_S
from tests.ticks import in_the_loop

# Sums of some twenty terms are taken in another order, over 60 steps.
ROUNDING = 1e-12
HALF, REACH, WIDE, THIN = 0.2, 0.4, 0.12, 0.02
TURN = 0.5
OBJECT = """<mujoco><option gravity="0 0 0"/><worldbody><body name="box"><freejoint name="free"/>
<inertial pos="0.01 0.02 0" mass="3" diaginertia="0.1 0.09 0.12"/>
<geom name="left" pos="0 -0.1 0" type="box" size="0.2 0.1 0.2" mass="0"/>
<geom name="right" pos="0 0.1 0" type="box" size="0.2 0.1 0.2" mass="0"/></body></worldbody></mujoco>"""


def gripper(pad, inwards):
    """MJCF of a free base with a wrist that turns about z and carries two slides along y, each with a pad."""
    jaws = "".join(
        f"""<body name="{name}" pos="0 {side * REACH} 0"><inertial pos="0 0 0" mass="0.5" diaginertia=".01 .01 .01"/>
        <joint name="{name}" type="slide" axis="0 1 0"/>
        <geom name="{name}" pos="0 {-side * inwards} 0" {pad} mass="0"/></body>"""
        for name, side in (("low", -1.0), ("high", 1.0))
    )
    return f"""<mujoco><option gravity="0 0 0"/><worldbody><body name="bus"><freejoint name="base"/>
    <inertial pos="0 0 -0.1" mass="5" diaginertia="1 0.8 1.2"/>
    <body name="wrist"><inertial pos="0 0 0" mass="0.5" diaginertia="0.01 0.01 0.01"/>
    <joint name="wrist" axis="0 0 1"/>{jaws}</body></body></worldbody>
    <actuator><motor name="ml" joint="low"/><motor name="mh" joint="high"/></actuator></mujoco>"""


PADS = {
    "plates": (f'type="box" size="{WIDE} {THIN} 0.1"', THIN),
    "balls": (f'type="sphere" size="{THIN}"', THIN),
    "rods": (f'type="capsule" size="{THIN} {WIDE}"', THIN),
}


def held(
    folder,
    *,
    pad="plates",
    mu=0.5,
    one_rule=True,
    squeeze=4.0,
    drift=0.0,
    turn=TURN,
    spin=(0.0, 0.0, 0.0),
    slip=0.0,
    phases=(),
):
    """A box between two pads that press on it with a constant force; it slips along them with ``slip`` m/s.

    Before they do, they press with each of the forces ``phases`` for 0.02 s.
    """
    form, inwards = PADS[pad]
    folder.mkdir(exist_ok=True)
    (folder / "robot.xml").write_text(gripper(form, inwards))
    (folder / "object.xml").write_text(OBJECT)
    close = REACH - inwards - THIN - HALF
    # The last of three rules never has a closed pair.
    sides = [["robot", "box"]] if one_rule else [["low", "box/left"], ["high", "box/right"], ["low", "high"]]
    rules = [{"between": each, "restitution": 0.0, "mu": mu} for each in sides]
    scenario = {
        "name": "held",
        "duration_s": 0.06,
        "time_step_s": 0.001,
        "control_period_s": 0.001,
        "robot": {"mjcf": "robot.xml"},
        "objects": {"box": {"mjcf": "object.xml"}},
        "initial": {
            "joints": {"low": close, "high": -close},
            "rates": {
                "base": [0.1, 0.0, -0.05, *spin],
                "wrist": turn,
                "box/free": [0.1, 0.0, slip - 0.05, *spin[:2], spin[2] + turn],
            },
        },
        "contacts": {"rules": rules},
        "phases": [
            {
                "name": f"hold {number}",
                **ends,
                "controller": {
                    "kind": "pd",
                    "joints": ["low", "high"],
                    "kp": 1.0,
                    "kd": drift,
                    "target": [close + force, -close - force],
                },
            }
            for number, (force, ends) in enumerate(
                [*((each, {"for_s": 0.02}) for each in phases), (squeeze, {"until": "end"})]
            )
        ],
    }
    path = folder / "scene.yaml"
    path.write_text(json.dumps(scenario))
    return path


@pytest.fixture
def decided(monkeypatch):
    """Number of problems of forces set up outside the shortcut."""
    count = []
    original = ForceSolver.evaluation

    def counted(*args):
        count.append(args)
        return original(*args)

    monkeypatch.setattr(ForceSolver, "evaluation", counted)
    return count


class NeverSteady(SteadyContacts):
    """No state is steady."""

    def __init__(self, closed, system):
        super().__init__(closed, system)
        self.push = closed.push
        self.holds = self.goes_on = self.write = lambda *_: False
        self.exchange = lambda _: None


def both(folder, monkeypatch, decided, **scene):
    """Rows with the shortcut and without, and how many problems of forces were set up outside it in the first."""
    with_shortcut = ffsm_mj.run(held(folder / "with", **scene))
    taken = len(decided)
    monkeypatch.setattr(closed_contacts, "SteadyContacts", NeverSteady)
    without = ffsm_mj.run(held(folder / "without", **scene))
    assert (with_shortcut.outcome, without.outcome) == ("completed", "completed")
    return with_shortcut.log, without.log, taken


TURNS = (0.3, -0.2, 0.4)


@pytest.mark.long
@pytest.mark.parametrize("one_rule", [True, False])
@pytest.mark.parametrize("mu", [0.0, 0.5])
@pytest.mark.parametrize("pad", PADS)
def test_the_log_is_that_without_the_shortcut(tmp_path, monkeypatch, decided, pad, mu, one_rule):
    """Grips of one, two and four points on each side, in one rule and in two, turning, under a load that changes."""
    log, other, taken = both(tmp_path, monkeypatch, decided, pad=pad, mu=mu, one_rule=one_rule, spin=TURNS, drift=0.5)
    np.testing.assert_allclose(np.array(log.rows), np.array(other.rows), rtol=ROUNDING, atol=ROUNDING)
    # The first ticks find the active set and the modes; every tick sets up three problems and more without the shortcut.
    if pad != "rods":  # whose clearance elsewhere is looked at in each state
        assert taken < 20, taken


def test_a_grip_that_slides_until_it_holds(tmp_path, monkeypatch, decided):
    """The box slides through the pads, and is steady once it sticks: at the same time to rounding."""
    log, other, taken = both(tmp_path, monkeypatch, decided, mu=0.1, squeeze=1.0, slip=3e-3)
    stops, others = ([record.time_s for record in each.records["contact_sticks"]] for each in (log, other))
    assert len(stops) > 0
    assert 0.01 < stops[0] < 0.05
    np.testing.assert_allclose(stops, others, rtol=0.0, atol=ROUNDING)
    np.testing.assert_allclose(np.array(log.rows), np.array(other.rows), rtol=ROUNDING, atol=ROUNDING)
    assert taken < len(decided) - taken, "the second run has as many while it slides, and more where it sticks"


@pytest.mark.parametrize("mu", [0.0, 0.5])
@pytest.mark.parametrize("pad", PADS)
def test_bodies_that_float_side_by_side(tmp_path, monkeypatch, decided, pad, mu):
    """They touch without force, pressed together from 0.02 s on and pulled apart from 0.04 s on.

    While they float along each other nothing is decided, and what begins is seen at once.
    """
    log, other, taken = both(
        tmp_path, monkeypatch, decided, pad=pad, mu=mu, turn=0.0, slip=3e-3, phases=(0.0, 2.0), squeeze=-2.0
    )
    np.testing.assert_allclose(np.array(log.rows), np.array(other.rows), rtol=ROUNDING, atol=ROUNDING)
    modes = np.array(log.column("contact.robot_box_mode"))
    assert modes[10] == RuleMode.CLOSED
    assert modes[30] > RuleMode.CLOSED
    assert modes[50] == RuleMode.OPEN
    assert [record.time_s for record in log.records["contact_endings"]] == [pytest.approx(0.04, abs=1e-12)] * 2
    assert taken < len(decided) - taken


@pytest.mark.parametrize("pad", ["plates", "balls"])
def test_slip_that_is_drift_is_projected_out(tmp_path, monkeypatch, pad):
    """Points that stick are given 1e-11 m/s, ten times what may remain; without a projection they would keep it."""
    slips, steady = nudged(tmp_path, monkeypatch, pad, 1e-11)
    assert steady == [True, True]
    assert abs(slips[20]) < PROJECTED_SLIP_M_S


@pytest.mark.parametrize("pad", ["plates", "balls"])
def test_points_that_slip_are_not_steady(tmp_path, monkeypatch, pad):
    """The box is given 1e-6 m/s along the pads, which is no drift."""
    _, steady = nudged(tmp_path, monkeypatch, pad, 1e-6)
    assert steady == [True, False]


@pytest.mark.parametrize("flag", ["released", "struck", "stops"])
def test_modes_are_chosen_after_events(tmp_path, monkeypatch, flag):
    """After an impact elsewhere, or where points begin to slide or stop, sticking forces alone do not tell the modes."""

    def change(closed):
        setattr(closed.modes, flag, True)
        return lambda: setattr(closed.modes, flag, False)

    _, steady = nudged(tmp_path, monkeypatch, "plates", 0.0, change)
    assert steady == [True, False]


def nudged(folder, monkeypatch, pad, slip, change=lambda _: lambda: None):
    """A grip whose box is given a slip in m/s at the start of a step: slips at the starts of all steps, whether steady.

    ``change`` changes the closed contacts there, and returns what takes this back.
    """
    slips, steady, (bus_z, box_z) = [], [], (2, 11)

    class Nudged(SteadyContacts):
        def __init__(self, closed, system):
            super().__init__(closed, system)
            self.given = closed

        def goes_on(self, left_s=math.nan):
            qvel = self.given.data.qvel
            slips.append(qvel[box_z] - qvel[bus_z])
            if len(slips) == 20:
                steady.append(self.holds())
                qvel[box_z] += slip
                self.given.motion.go_to(self.given.data.qpos.copy(), qvel.copy())
                take_back = change(self.given)
                steady.append(self.holds())
                take_back()
            return super().goes_on(left_s)

    in_the_loop(monkeypatch)
    monkeypatch.setattr(closed_contacts, "SteadyContacts", Nudged)
    ffsm_mj.run(held(folder, pad=pad))
    return slips, steady
