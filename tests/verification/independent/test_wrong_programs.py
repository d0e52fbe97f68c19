"""Mistakes put into the engine: its log agrees with a replay by the same engine, and an independent check fails."""

from __future__ import annotations

from zlib import crc32

import numpy as np
import pytest

from ffsm_mj.contact_models.grasp import closing_condition, load
from ffsm_mj.contact_models.impact.columns import FrictionHeat
from ffsm_mj.contact_models.impact.rest_rule import RestRule
from ffsm_mj.replay import replay_log
from ffsm_mj.scenario.contacts import ContactsConfig
from ffsm_mj.sensing import sensor
from ffsm_mj.sensing.group import SensorGroup
from tests.verification.independent.scenes import bouncing, chain, failing, holding, independent, measuring, pulled, sliding


def caught(run):
    """Independent checks that fail in a run whose replay agrees."""
    assert run.outcome == "completed"
    again = replay_log(run.log)
    assert again.agrees
    found = failing(run)
    assert found == {check.name for check in again.checks() if not check.passes} & set(independent(run))
    return found


def test_the_coefficient_of_another_pair(tmp_path, monkeypatch):
    monkeypatch.setattr(ContactsConfig, "restitution_of", lambda self, _: self.rules[0].restitution)
    assert caught(chain(tmp_path)) == {"restitution used"}


@pytest.mark.long
@pytest.mark.parametrize("factor", [4.0, 0.25])
def test_contacts_that_come_to_rest_too_soon_or_too_late(tmp_path, monkeypatch, factor):
    """Bounces at e = 0.5 halve: a factor of 4 is two bounces."""

    def least_speeds(self, pressing):
        return np.maximum(self.speed_m_s, 0.5 * factor * self.interval_s * pressing)

    monkeypatch.setattr(RestRule, "least_speeds", least_speeds)
    assert caught(bouncing(tmp_path)) == {"restitution used"}


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize("bounces", [bouncing, pulled])
def test_a_contact_that_never_bounces(tmp_path, monkeypatch, bounces):
    monkeypatch.setattr(RestRule, "least_speeds", lambda _, pressing: np.full_like(pressing, np.inf))
    assert caught(bounces(tmp_path)) == {"restitution used"}


def test_the_sign_of_the_heat_of_friction(tmp_path, monkeypatch):
    add = FrictionHeat.add
    monkeypatch.setattr(FrictionHeat, "add", lambda self, heat_J: add(self, -heat_J))
    assert caught(sliding(tmp_path)) == {"heat of friction"}


def test_a_load_one_tick_late(tmp_path, monkeypatch):
    class Late(load.LoadSampler):
        def take(self, closed, of):
            super().take(closed, of)
            now = self._values[:19].copy()
            before, self._before = getattr(self, "_before", now), now
            if closed and before[0]:
                self._values[:19] = before

    monkeypatch.setattr("ffsm_mj.contact_models.grasp.model.LoadSampler", Late)
    assert caught(holding(tmp_path)) == {"grasp load"}


def test_the_true_value_of_the_sample_before(tmp_path, monkeypatch):
    take = SensorGroup.take

    def late(self, true, hidden=()):
        before, self.last_true = getattr(self, "last_true", true), true.copy()
        take(self, before, hidden)

    monkeypatch.setattr(SensorGroup, "take", late)
    assert "sensor values" in caught(measuring(tmp_path))


def test_a_sample_that_is_shown_one_later(tmp_path, monkeypatch):
    """Each sample arrives one interval late: value and time of a sample belong together, and it is not the newest."""
    take = SensorGroup.take

    def late(self, true, hidden=()):
        given, self._errors.arrival_s = self._errors.arrival_s, lambda number: given(number) + self._interval_s
        take(self, true, hidden)
        self._errors.arrival_s = given

    monkeypatch.setattr(SensorGroup, "take", late)
    assert caught(measuring(tmp_path)) == {"sensor times"}


def test_the_noise_of_another_channel(tmp_path, monkeypatch):
    monkeypatch.setattr(sensor, "crc32", lambda name: crc32(name[:-1]))
    # Lost samples and delays are drawn from channels of their own.
    assert caught(measuring(tmp_path)) == {"sensor noise", "sensor times"}


@pytest.mark.parametrize("joint", ["rigid", "hinge"])
def test_an_impulse_beside_the_site(tmp_path, monkeypatch, joint):
    """By 1e-6 m, a millionth of the arm."""
    point = closing_condition.Sites.point
    monkeypatch.setattr(closing_condition.Sites, "point", lambda self, data: point(self, data) + 1e-6)
    axis = {} if joint == "rigid" else {"axis": [0.0, 0.6, 0.8]}
    grasp = {
        "robot_site": "grip",
        "object_site": "handle",
        "when": {"touch": ["hand-target/target"]},
        "joint": joint,
        **axis,
    }
    assert "grasp impulse" in caught(holding(tmp_path, grasps={"grasp": grasp}))
