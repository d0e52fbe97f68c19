"""What a control law sees of contacts that last."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.contact_models.persistent.model import PersistentContactModel
from ffsm_mj.errors import ControllerError
from tests.scenes import two_balls


class Ramp:
    """Pushes with 1 N more in each tick for 20 ticks, then pulls; keeps what it was told."""

    telemetry_signals: ClassVar = ()
    told: ClassVar[list] = []

    def __init__(self, config, context):
        self.motor = context.system.index("actuator", "robot/push_x")
        Ramp.told = []

    def start(self, observation): ...

    def control(self, observation, command):
        contacts = tuple(observation.contacts)  # those of an earlier observation cannot be read any more
        self.told.append((observation._replace(contacts=contacts), float(observation.data.ctrl[self.motor])))
        tick = round(observation.time_s / 0.01)
        command.drive([self.motor], [1.0 + tick if tick < 20 else -5.0])

    def telemetry(self):
        return ()


def test_closed_pairs_come_with_their_forces_under_the_efforts_that_are_held(tmp_path):
    """2 kg push 3 kg: three fifths of the effort go through the contact, at its point, 0.1 m from either centre."""
    path = two_balls(
        tmp_path,
        restitution=0.0,
        speed=0.1,
        gap=0.00345,
        duration_s=0.3,
        control_period_s=0.01,
        time_step_s=0.005,
        phases=[{"name": "ramp", "until": "end", "controller": {"kind": "ramp"}}],
    )
    run = ffsm_mj.run(path, controllers={"ramp": Ramp})
    (contact,), told = run.contacts, Ramp.told
    assert [event.time_s for seen, _ in told for event in seen.events][:1] == [contact.start_s]
    closed = [(seen, held) for seen, held in told if seen.contacts]
    entry = closed[0][0]
    assert entry.time_s == contact.start_s
    assert not entry.at_tick
    assert [seen.time_s for seen, _ in closed[1:]] == pytest.approx(np.arange(0.04, 0.205, 0.01))
    assert all(seen.contacts == () for seen, _ in told if not contact.start_s <= seen.time_s <= contact.end_s)
    for seen, held in closed:
        (one,) = seen.contacts
        assert one.pair == "ball-target/target"
        assert held > 0.0
        # Positions are about 1 m: their rounding is 1e-16, a gap within 1e-9 m moves the point as little.
        np.testing.assert_allclose(one.force_N, [0.6 * held, 0.0, 0.0], atol=1e-12)
        np.testing.assert_allclose(one.normal, [1.0, 0.0, 0.0], atol=1e-12)
    ticks = [(seen, held) for seen, held in closed if seen.at_tick]
    rows = np.searchsorted(run.time, [seen.time_s - 1e-9 for seen, _ in ticks])
    points = [seen.contacts[0].point_m for seen, _ in ticks]
    np.testing.assert_allclose([point[0] for point in points], run["state.q_robot_x_m"][rows] + 0.1, atol=1e-9)


def test_a_closed_pair_that_nothing_presses_is_seen_without_force(tmp_path):
    """Nothing drives the two balls that hit plastically: they stay together without force."""
    seen = []

    class Off(Ramp):
        def __init__(self, config, context): ...

        def control(self, observation, command):
            seen.append(observation._replace(contacts=tuple(observation.contacts)))

    path = two_balls(
        tmp_path,
        restitution=0.0,
        duration_s=0.4,
        phases=[{"name": "coast", "until": "end", "controller": {"kind": "coast"}}],
    )
    run = ffsm_mj.run(path, controllers={"coast": Off})
    (contact,) = run.contacts
    assert (contact.end_s, contact.impulse_N_s, contact.peak_force_N) == (None, 0.0, 0.0)
    (one,) = seen[-1].contacts
    np.testing.assert_allclose(one.force_N, np.zeros(3), atol=1e-12)
    assert one.point_m[0] == pytest.approx(run["state.q_robot_x_m"][-2] + 0.1, abs=1e-9)


def test_contacts_that_no_law_reads_are_not_computed(tmp_path, monkeypatch):
    """Nor once more for a law that reads them twice; and those of an earlier observation are refused."""
    computed = []
    right = PersistentContactModel.active_contacts
    monkeypatch.setattr(PersistentContactModel, "active_contacts", lambda self: computed.append(1) or right(self))
    kept, read = [], []

    class Blind(Ramp):
        def control(self, observation, command):
            kept.append(observation)
            command.drive([self.motor], [1.0])

    class Reader(Blind):
        def control(self, observation, command):
            super().control(observation, command)
            if observation.contacts:
                read.append(observation.contacts[-1])

    path = two_balls(
        tmp_path,
        restitution=0.0,
        speed=0.1,
        gap=0.00345,
        duration_s=0.1,
        phases=[{"name": "push", "until": "end", "controller": {"kind": "push"}}],
    )
    assert ffsm_mj.run(path, controllers={"push": Blind}).contacts
    assert not computed
    with pytest.raises(ControllerError, match="were not read then"):
        list(kept[-1].contacts)
    ffsm_mj.run(path, controllers={"push": Reader}, out=tmp_path / "again")
    assert len(computed) == len(read) > 0
